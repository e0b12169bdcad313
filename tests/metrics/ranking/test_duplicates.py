"""Rows that are one filter twice are found by their attitudes and by what their files declare."""

from __future__ import annotations

import numpy as np
import pytest

import attlog
from attlog.base import rotation
from attlog.estimators import DEFAULT, get
from attlog.metrics.ranking.duplicates import DuplicateSearch, alike
from tests.metrics.flights import row

T = np.arange(0.0, 10.0, 0.01)
Q = rotation.from_euler(0.2 * np.sin(T), 0.1 * np.cos(T), 0.05 * T)


def made(name, q=Q, **fields):
    return row(T, q, name, estimator=name.partition(":")[0], **fields)


def turned(deg, where=slice(None)):
    q = Q.copy()
    q[where] = rotation.turn_about_down(q[where], np.radians(deg))
    return q


def test_equal_attitudes_are_told_and_nearly_equal_ones_are_not():
    (group,) = alike([made("a"), made("b", turned(1e-8)), made("c", turned(1e-3)), made("d", turned(1.0, 777))])
    assert (group.rows, group.by) == (["a", "b"], "attitudes")
    assert group.apart_deg == pytest.approx(1e-8, rel=0.5)


def test_an_earlier_row_is_wanted_again_only_where_another_looks_the_same() -> None:
    first, asked = made("a"), []

    def again(whole):
        asked.append(whole.name)
        return made("a")

    likeness = DuplicateSearch(again)
    for one in (first, made("b", turned(1e-3)), made("c", turned(1e-8)), made("d", turned(1.0, 778))):
        likeness.add(one)
        one.release()
    assert asked == ["a", "a"]
    (group,) = likeness.found()
    assert group.rows == ["a", "c"]


def test_rows_at_other_times_onboard_rows_and_failed_rows_are_not_compared():
    short = row(T[:-1], Q[:-1], "short")
    onboard, failed = made("onboard"), made("failed", status="failed")
    onboard.kind = "onboard"
    assert alike([made("a"), short, onboard, failed]) == []


def test_a_declared_equation_is_told_between_filters_with_what_differs():
    one = made("one", equation="Paper 3", parameters={"kp": 0.5, "ki": 0.1, "own": 1.0})
    two = made("two", turned(2.0), equation="Paper 3", parameters={"kp": 0.6, "ki": 0.1})
    other = made("other", turned(3.0), equation="Paper 4")
    (group,) = alike([one, two, other])
    assert (group.rows, group.by, group.source) == (["one", "two"], "equation", "Paper 3")
    assert group.differ == {"kp": [0.5, 0.6]}


def test_one_filter_with_two_gains_shares_its_equation_with_itself_without_a_word():
    assert alike([made("one", equation="Paper 3"), made("one:kp=2", turned(2.0), equation="Paper 3")]) == []


def test_what_the_files_declare_is_true():
    """Equal parameters give equal attitudes in all files of an equation, to the error of integration."""
    from attlog.testing import swing

    names = [n for n in ("complementary", "mahony", "mahony_dcm") if get(n).equation == get("mahony").equation]
    assert len(names) == 3
    m = swing(20.0)
    found = [attlog.estimate(n, *m.sensors, kp=0.5, ki=0.01, mag_gain=0.5).q for n in names]
    for q in found[1:]:
        assert np.degrees(rotation.total_angle(rotation.error(q, found[0]))).max() < 1e-3


@pytest.mark.slow
def test_page_terminal_and_json_say_it(attlog, samples, tmp_path):
    import json

    same_gains = "complementary:kp=0.3,ki=0.005,mag_gain=0.5"
    rows = f"{same_gains},variable_integral,mahony,gyro"
    run = attlog("analyze", samples / "copter_yaw_turns.bin", "-o", tmp_path, "--estimators", rows, "--json", "-v")
    groups = {group["by"]: group for group in json.loads(run.out)["alike"]}
    assert groups["attitudes"]["rows"] == [same_gains, "variable_integral"]
    assert groups["equation"]["rows"] == [same_gains, "mahony"]
    same = "Complementary (kp 0.3 ki 0.005 mag_gain 0.5) and Variable integral give the same attitudes in this log"
    assert same in " ".join(run.err.split())
    assert "and Mahony share one equation (Mahony2008 32) and differ in kp (0.3, 0.45)" in " ".join(run.err.split())
    assert same in (tmp_path / "copter_yaw_turns.bin.html").read_text(encoding="utf-8")


def test_the_default_rows_hold_the_baseline_and_no_filter_twice():
    assert DEFAULT[-1] == "gyro"
    assert {"complementary", "mahony", "madgwick", "ekf12", "vqf"} <= set(DEFAULT)
    assert len(DEFAULT) <= 8, "more than the page shows at first"


def test_of_several_equal_rows_the_largest_angle_is_told():
    (group,) = alike([made("a"), made("b", turned(4e-7)), made("c", turned(1e-7))])
    assert group.rows == ["a", "b", "c"]
    assert group.apart_deg == pytest.approx(4e-7, rel=0.2)


def test_equal_attitudes_of_two_imus_are_not_one_filter():
    one, other, same = made("one"), made("other"), made("same")
    one.imu = same.imu = object()
    other.imu = object()
    (group,) = alike([one, other, same])
    assert group.rows == ["one", "same"]
