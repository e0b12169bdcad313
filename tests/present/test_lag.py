"""How late, and how wrong, in a step?"""

from __future__ import annotations

import pytest

from attlog.health.model import Check
from attlog.metrics.answer import missing
from attlog.present.sentences.brief import brief_answers
from tests.present.made import LAG, STEP, absent, impure, lag, merged, row, sentence, step, verdict
from tests.present.made import result as made


def test_who_lags_is_known_by_its_interval_and_the_others_are_bounded_by_the_largest_end_of_theirs():
    rows = [row("ekf12", lag(12)), row("vqf", lag(-1, 3.2)), row("mahony", lag(1, 0.5))]
    assert sentence("lag", made(rows, {LAG: ["vqf", "mahony"]}, {LAG: "ekf12"}, "truth")) == (
        "EKF12 lags by +12 ms (+11 to +13) against the logged truth in 28 steps. "
        "No significant lag of VQF and Mahony: less than 5 ms."
    )


def test_a_wide_interval_bounds_nothing_below_itself():
    rows = [row("a", lag(1, 3)), row("b", lag(0, 12)), row("c", lag(0.4, 17.7))]
    assert sentence("lag", made(rows)) == (
        "No significant lag of 3 filters: less than 19 ms against onboard (agreement, not truth) in 28 steps."
    )


def test_less_than_half_a_sample_is_no_lag():
    assert sentence("lag", made([row("a", lag(4, 0.5, floor=5.0))])).startswith(
        "No significant lag of A: less than 5 ms"
    )


def test_most_is_said_only_of_the_row_that_the_ranking_finds_worst():
    rows = [row("a", lag(12)), row("b", lag(14)), row("c", lag(0))]
    assert "lag by +12 ms and +14 ms" in sentence("lag", made(rows, {LAG: ["c"]}))
    assert "B lags most: +14 ms (+13 to +15); A by +12 ms against" in sentence(
        "lag", made(rows, {LAG: ["c"]}, {LAG: "b"})
    )


@pytest.mark.parametrize(
    ("verdict_", "ms", "said"), [("warning", 15.2, True), ("ok", 3.0, False), ("fault", -25.0, False)]
)
def test_an_imu_that_is_late_by_itself_is_said_to_make_every_filter_late(verdict_, ms, said):
    found = made([row("a", lag(15)), row("b", lag(16))])
    found.audit = [Check("imu delay", verdict_, "IMU:0 comes later.", ms, "ms")]
    expected = "The IMU itself is 15 ms late, and every filter with it."
    assert (expected in sentence("lag", found)) == said
    assert (expected in brief_answers(found)["lag"].text) == said


def test_one_step_is_in_the_singular():
    rows = [row("a", lag(12))]
    rows[0].metrics["airborne"][LAG].n = 1
    assert "in 1 step." in sentence("lag", made(rows))


def test_a_lag_of_one_sample_of_a_slow_log_is_said_to_be_that():
    rows = [row("ekf12", lag(40, floor=20.0)), row("vqf", lag(0, floor=20.0))]
    found = made(rows, {LAG: ["vqf"]}, imu={"rate_hz": 25.0})
    assert "+40 ms (+39 to +41), one sample of this log's 25 Hz IMU, against" in sentence("lag", found)
    assert "one sample" not in sentence("lag", made(rows, {LAG: ["vqf"]}, imu={"rate_hz": 400.0}))


def test_filters_that_all_come_before_onboard_tell_that_onboard_is_late():
    rows = [row("a", lag(-8)), row("b", lag(-12))]
    assert sentence("lag", made(rows)) == (
        "A and B are ahead: −8 ms and −12 ms against onboard (agreement, not truth) in 28 steps. "
        "The onboard attitude itself lags."
    )
    assert "itself lags" not in sentence("lag", made([*rows, row("c", lag(0))]))


def test_a_row_that_is_no_pure_delay_is_not_judged_and_never_early():
    found = verdict("lag", made([row("a", lag(1)), row("fan", merged(impure(), step(5.0, -52.0)))]))
    assert "Lag cannot be determined for Fan: not a pure delay." in found.sentence
    assert ("fan", "follows 51 % of the step") in found.not_judged
    assert "fan" not in [name for name, _, _ in found.bars]


def test_the_angle_after_a_step_is_named_for_who_is_short_of_it():
    rows = [
        row("mahony@xu-0.6", merged(lag(0), step(8.0, -25.2))),
        row("complementary@fan", merged(lag(0), step(12.7, -51.8))),
        row("madgwick", merged(lag(0), step(1.5, -4.8))),
        row("ekf12", merged(lag(0), step(4.4, 7.0))),
    ]
    assert sentence("lag", made(rows)).endswith(
        " 0.5 s after a step (28 steps) Complementary Fan is still 52 % short (12.7°) and Mahony Xu 0.6 25 % (8.0°); "
        "Madgwick and EKF12 are off by 1.5° and 4.4°."
    )
    assert "Madgwick is least off, 1.5°; EKF12 is off by 4.4°." in sentence("lag", made(rows, {STEP: ["madgwick"]}))


def test_too_much_of_a_step_is_not_called_short():
    found = made([row("a", merged(lag(0), step(8.0, 25.0))), row("b", merged(lag(0), step(1.0, 2.0)))])
    assert "A is still 25 % too far (8.0°); B is off by 1.0°." in sentence("lag", found)


def test_the_delay_of_the_logged_imu_is_printed():
    rows = [row("a", lag(0))]
    rows[0].metrics["airborne"][LAG].taken_out = 11.2
    assert verdict("lag", made(rows)).notes == ["The logged IMU itself comes 11 ms late; that is not counted as lag."]
    rows[0].metrics["airborne"][LAG].taken_out = 0.0
    assert verdict("lag", made(rows)).notes == ["No delay of the logged IMU is known; lags are taken as they are."]


def test_all_impure():
    rows = [row("a", impure()), row("b", impure())]
    assert sentence("lag", made(rows)) == ("No filter's lag can be judged: A and B (wrong angle in the step).")


@pytest.mark.parametrize(("airborne", "advice"), [(60.0, True), (0.0, False), (None, False)])
def test_too_few_steps_are_said_with_the_count_and_only_who_flew_is_told_to_fly_more(airborne, advice):
    few = absent(LAG, "airborne", "too_few_events", "2 steps; at least 3 are needed")
    found = made([row("a", few), row("b", few)], seconds={"airborne": airborne})
    assert sentence("lag", found) == (
        "Cannot be judged: 2 steps; at least 3 are needed."
        + (" Fly some more brisk steps in roll, pitch and yaw." if advice else "")
    )


def test_what_flew_is_not_late_against_itself():
    itself = {"airborne": {LAG: missing("not_applicable", "this row is the reference itself", "ms", "airborne")}}
    rows = [row("a", lag(0)), row("onboard", itself, is_reference=True)]
    assert "Onboard:" not in sentence("lag", made(rows))


def test_a_row_behind_a_worse_one_is_not_called_least_off():
    """Few steps show no significant difference of a row that is wrong in some of them: 1.0 deg beside 0.02 and 0.14."""
    rows = [row(n, merged(lag(0.0), step(deg, -1.0))) for n, deg in (("a", 0.02), ("b", 0.14), ("c", 1.0))]
    assert "A is least off, 0.020°; B and C are off by 0.14° and 1.0°." in sentence(
        "lag", made(rows, {STEP: ["a", "c"]})
    )
