"""What a segment starts with is found once for the same samples, and never taken for another segment's or way's."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.core import rotation
from attlog.estimators import aids as aid
from attlog.estimators import estimate, get, start
from attlog.estimators import run as estimators_run
from attlog.estimators.aids import Aids, Measurements, aid_rows
from attlog.estimators.batch import estimate_batch
from attlog.estimators.registry import BUILT_IN
from attlog.estimators.samples import HELD, MISSING, NEW, PreparedSamples, prepare, typical_scale, uniform
from attlog.estimators.start import MOTION_S, derotate, first_seconds, start_attitude
from attlog.testing import still
from tests.conftest import few

RATE_HZ = 250


def tilting() -> PreparedSamples:
    """Eight seconds of turning, and of a force that turns in the body."""
    t = np.arange(8 * RATE_HZ) / RATE_HZ
    acc = 9.81 * np.column_stack([np.sin(t), np.zeros_like(t), -np.cos(t)])
    return prepare(t, np.column_stack([0.3 * t, 0.1 * t, 0.2 + 0.0 * t]), acc, None)


def test_a_second_run_over_the_same_samples_finds_the_same_start_without_looking_again() -> None:
    samples = tilting()
    seen = start.first(samples, 0, 1000, {})
    with patch.object(start, "first_seconds", side_effect=AssertionError("looked again")):
        assert start.first(samples, 0, 1000, {"init": "average"}) is seen


def test_other_segments_and_another_init_have_their_own_start() -> None:
    samples = tilting()
    asked = [(0, 1000, "average"), (1000, 2000, "average"), (0, 300, "average"), (0, 1000, "first")]
    for a, b, init in [*asked, *asked]:
        alone = start.first(tilting(), a, b, {"init": init})
        np.testing.assert_array_equal(start.first(samples, a, b, {"init": init}).acc, alone.acc)
    found = {start.first(samples, *one[:2], {"init": one[2]}).acc.tobytes() for one in asked}
    assert len(found) == len(asked)


def test_changed_samples_are_looked_at_anew() -> None:
    samples = tilting()
    start.first(samples, 0, 1000, {})
    turned = replace(samples, acc=-samples.acc)
    np.testing.assert_array_equal(start.first(turned, 0, 1000, {}).acc, -start.first(samples, 0, 1000, {}).acc)


def test_the_identity_start_is_level_with_the_nose_to_magnetic_north_unless_an_attitude_is_given() -> None:
    m = still(3.0, roll=0.4, pitch=-0.3, yaw=1.0)
    options = {"kp": 0.0, "ki": 0.0, "init": "identity"}
    level = estimate("mahony", *m.sensors, **options, declination=10.0)
    assert level.q[0] == pytest.approx(rotation.from_euler(0.0, 0.0, np.deg2rad(10.0)))
    assert estimate("mahony", *m.sensors, **options, q0=m.q[0]).q[0] == pytest.approx(m.q[0])


# A start that is fair to every filter: in motion, with a late compass, and with vectors of the state's own time.

G = 9.80665
FIELD = np.array([20.0, 0.0, 40.0])
NAVIGATION = ("eskf", "smoother")
"""Whole runs with a start and a heading of their own."""
WITH_FIELD = [n for n in BUILT_IN if "mag" in get(n).uses and n not in NAVIGATION]


def sensors(q: np.ndarray, rate: float, push: np.ndarray | None = None) -> dict[str, Any]:
    """Exact sensors of attitudes (n, 4); ``push`` (n, 3) is the earth's acceleration."""
    gyr = rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) * rate
    force = np.array([0.0, 0.0, -G]) + (0.0 if push is None else push)
    return {
        "t": np.arange(len(q)) / rate,
        "gyr": np.vstack([gyr[:1], gyr]),
        "acc": rotation.rotate_inverse(q, force),
        "mag": rotation.rotate_inverse(q, FIELD),
        "q": q,
    }


def run(name: str, x: dict[str, Any], **options: Any) -> Any:
    return estimate(name, x["t"], x["gyr"], x["acc"], x["mag"], **options)


def off_deg(q: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.rad2deg(rotation.total_angle(rotation.earth_error(q, truth)))


def heading_off_deg(q: np.ndarray, truth: np.ndarray) -> np.ndarray:
    return np.abs(np.rad2deg(rotation.heading_angle(rotation.earth_error(q, truth))))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("name", [n for n in WITH_FIELD if n != "gyro"])
def test_a_constant_turn_seen_25_times_a_second_leaves_no_error(name: str, axis: int) -> None:
    """90 deg/s with exact vectors: compared with the attitude of the sample before they are 3.6 deg off.

    What is left is the length of madgwick's step, 2 beta dt, and single precision in packages.
    """
    t = np.arange(500) / 25.0
    x = sensors(rotation.from_rotvec(np.outer(t, np.radians(90.0) * np.eye(3)[axis])), 25.0)
    assert off_deg(run(name, x).q, x["q"]).max() < 0.2


@pytest.mark.slow
def test_a_filter_that_turns_first_is_handed_the_sample_s_own_vectors(tmp_path: Any) -> None:
    text = '''"""Writes down the heading of the field that it is handed."""
import math
import numpy as np
USES = {"mag"}
STATE = {"q": 4, "seen": 1}
VECTORS_AT = "start"

def start(params, acc, mag, q0):
    state = np.zeros(5)
    state[0:4] = q0
    return state

def step(state, params, dt, gyr, acc, mag):
    state[4] = -math.atan2(mag[1], mag[0])
'''
    x = sensors(rotation.from_euler(0, 0, 0.1 * np.arange(20)), 10.0)
    for at, begin in (("start", 0), ("end", 1)):
        file = tmp_path / f"{at}.py"
        file.write_text(text.replace('"start"', f'"{at}"'))
        seen = run(str(file), x).aux["seen"][1:, 0]
        assert seen == pytest.approx(0.1 * np.arange(begin, begin + 19), abs=1e-12)


@pytest.mark.parametrize("name", ["mahony", "ekf12"])
def test_a_step_in_parts_sees_vectors_of_each_part_s_time(name: str) -> None:
    """150 deg from sample to sample, in three parts."""
    t = np.arange(40) / 2.0
    x = sensors(rotation.from_euler(0 * t, 0 * t, 0 * t), 2.0)
    x["q"] = rotation.from_euler(0 * t, 0 * t, np.radians(300.0) * t)
    x["gyr"] = np.tile([0.0, 0.0, np.radians(300.0)], (40, 1))
    x["mag"] = rotation.rotate_inverse(x["q"], FIELD)
    assert off_deg(run(name, x).q, x["q"]).max() < 0.01


def throw(seconds: float = 12.0, rate: float = 100.0) -> dict[str, Any]:
    """Turning about all axes while being shaken by 6 m/s^2, not at rest for a moment."""
    t = np.arange(int(seconds * rate)) / rate
    q = rotation.from_euler(0.5 * np.sin(2.0 * t), 0.4 * np.cos(1.7 * t), 0.8 * t + 2.0)
    push = np.stack([6.0 * np.sin(5.0 * t + 1.0), 6.0 * np.cos(4.0 * t), 4.0 * np.sin(6.0 * t + 2.0)], axis=1)
    return sensors(q, rate, push)


def test_a_start_in_motion_averages_in_axes_that_the_gyro_holds_still() -> None:
    x = throw()
    first, average = (off_deg(run("gyro", x, init=i).q, x["q"])[0] for i in ("first", "average"))
    assert average < 5.0 < 20.0 < first


def test_the_average_in_stabilised_axes_is_the_closed_form() -> None:
    """Vectors of a body in free turning are one vector, up to rounding; NaN and zero rows are none."""
    x = throw()
    x["mag"][5:50] = np.nan
    x["acc"] = rotation.rotate_inverse(x["q"], [0.0, 0.0, -G])
    x["acc"][7] = 0.0
    held = derotate(np.full(len(x["t"]), 0.01), x["gyr"], x["acc"], x["mag"])
    assert rotation.earth_error(rotation.multiply(x["q"][0], held.turned), x["q"])[:, 1:] == pytest.approx(
        0.0, abs=1e-12
    )
    assert np.ptp(np.delete(held.acc, 7, axis=0), axis=0) == pytest.approx(0.0, abs=1e-11)
    assert not held.acc[7].any()
    assert not held.mag[5:50].any()


def test_a_whole_run_may_start_from_the_same_vectors() -> None:
    x = throw()
    seen = first_seconds(x["t"], x["gyr"], x["acc"], x["mag"])
    assert np.array_equal(start_attitude(seen.acc, seen.mag), run("gyro", x).q[0])
    assert seen.late is None


def test_bad_samples_of_the_first_seconds_do_not_count() -> None:
    x = throw()
    want = run("mahony", x).q[0]
    x["acc"][20:30] = 1e9
    x["acc"][40] = np.nan
    x["mag"][30:35] = 0.0
    assert off_deg(run("mahony", x).q[0], want) < 2.0


def test_a_gyro_bias_at_rest_does_not_turn_the_start() -> None:
    """5 deg/s over the 3 s of a start in motion would be 7.5 deg; a field after 1.2 s belongs to the start."""
    t = np.arange(500) / 100.0
    x = sensors(np.tile(rotation.from_euler(0.2, -0.1, 1.0), (500, 1)), 100.0)
    x["gyr"] = x["gyr"] + np.radians([3.0, -3.0, 3.0])
    x["mag"][t < 1.2] = np.nan
    assert off_deg(run("mahony", x).q[0], x["q"][0]) < 1e-6


@pytest.mark.parametrize("name", [n for n in WITH_FIELD if n != "accel_mag"])
def test_a_field_that_comes_in_the_first_seconds_belongs_to_the_start(name: str) -> None:
    x = throw()
    x["acc"] = rotation.rotate_inverse(x["q"], [0.0, 0.0, -G])
    x["mag"][:120] = np.nan
    e = run(name, x)
    assert heading_off_deg(e.q, x["q"]).max() < (3.0 if name == "vqf" else 0.2)
    assert "late_field" not in e.skipped
    assert e.no_heading == []


LATE = 800


def late(rate_hz: int = 100) -> dict[str, Any]:
    """A gentle swing far from north whose first field comes after 8 s, with a gyro bias."""
    t = np.arange(2400) / 100.0
    q = rotation.from_euler(0.3 * np.sin(t), 0.2 * np.cos(1.3 * t), 2.0 + 0.1 * t)
    x = sensors(q, 100.0)
    x["gyr"] = x["gyr"] + np.radians([0.2, -0.1, 0.0])
    x["mag"][(np.arange(2400) < LATE) | (np.arange(2400) % (100 // rate_hz) != 0)] = np.nan
    return x


@pytest.mark.parametrize("rate_hz", [100, 10])
@pytest.mark.parametrize("name", WITH_FIELD)
def test_a_field_that_comes_late_sets_the_heading_at_that_sample(name: str, rate_hz: int) -> None:
    x = late(rate_hz)
    e = run(name, x, declination=5.0)
    truth = rotation.turn_about_down(x["q"], np.radians(5.0))
    off = heading_off_deg(e.q, truth)
    assert off[LATE - 1] > 90.0
    assert off[LATE:].max() < 4.0
    tilt = np.rad2deg(np.abs(rotation.tilt_angle(rotation.earth_error(e.q, truth))))
    assert np.abs(tilt[LATE] - tilt[LATE - 1]) < 0.05
    assert tilt.max() < 5.0
    assert e.skipped["late_field"] == LATE
    assert e.no_heading == [(0.0, 8.0)]
    if e.bias is not None:
        assert np.abs(e.bias[LATE] - e.bias[LATE - 1]).max() < np.radians(0.05)


@pytest.mark.parametrize("plain", [False, True])
@pytest.mark.parametrize("name", few(["mahony_dcm", "ekf12", "madgwick"], 1))
def test_a_late_field_is_the_same_thinned_in_a_batch_and_in_plain_python(
    name: str, plain: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    x = {k: v[:1200] for k, v in late().items()}
    whole = run(name, x)
    if plain:
        monkeypatch.setenv("ATTLOG_NO_JIT", "1")
    assert run(name, x, every=7).q == pytest.approx(whole.q[::7], abs=1e-9)
    data = (x["t"], x["gyr"], x["acc"], x["mag"])
    for one in estimate_batch(get(name), [{}, {"declination": 0.0}], *data, every=7):
        assert one.q == pytest.approx(whole.q[::7], abs=1e-9)
        assert one.skipped == whole.skipped
        assert one.no_heading == whole.no_heading


def test_a_start_attitude_that_is_given_is_not_turned_by_a_late_field() -> None:
    x = late()
    e = run("mahony", x, q0=x["q"][0])
    assert heading_off_deg(e.q, x["q"])[: LATE + 10].max() < 1.0
    assert "late_field" not in e.skipped


def test_each_segment_waits_for_its_own_field() -> None:
    x = late()
    x["t"] = x["t"] + np.where(np.arange(2400) >= 1500, 5.0, 0.0)
    x["mag"][1500:1999] = np.nan
    e = run("mahony", x)
    assert e.skipped["late_field"] == LATE + 499
    assert e.no_heading == [(0.0, 8.0), (20.0, pytest.approx(24.99))]


def test_motion_that_never_shows_a_field_starts_at_heading_zero() -> None:
    x = throw()
    e = estimate("mahony", x["t"], x["gyr"], x["acc"])
    assert rotation.to_euler(e.q[0])[2] == pytest.approx(0.0, abs=1e-9)
    assert e.no_heading == []
    assert x["t"][-1] > MOTION_S


# Starts, late fields, even grids, arrivals of aids: closed forms with other numbers in every axis.

EARTH_FIELD = np.array([0.2, 0.0, 0.45])


@pytest.mark.parametrize(("roll", "pitch", "yaw"), [(0.3, -0.4, 2.0), (-2.5, 0.2, -1.0), (0.0, 1.2, 0.5)])
def test_a_start_at_rest_is_the_attitude_that_force_and_field_show(roll: float, pitch: float, yaw: float) -> None:
    q = rotation.from_euler(roll, pitch, yaw)
    acc, mag = (rotation.rotate_inverse(q, v) for v in (np.array([0.0, 0.0, -9.81]), EARTH_FIELD))
    found = start.start_attitude(acc, mag)
    assert float(rotation.total_angle(rotation.earth_error(found, q))) == pytest.approx(0.0, abs=1e-9)
    headless = rotation.to_euler(start.start_attitude(acc, np.zeros(3), 0.3)[None])[0]
    assert headless == pytest.approx((roll, pitch, -0.3), abs=1e-9)
    level = rotation.to_euler(start.start_attitude(np.zeros(3), EARTH_FIELD)[None])[0]
    assert level == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "size", "rest"),
    [
        ("rate", 9.5, True),
        ("rate", 10.5, False),
        ("turned", 0.9, True),
        ("turned", 1.1, False),
        ("pushed", 0.14, True),
        ("pushed", 0.16, False),
    ],
)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rest_is_a_small_rate_and_halves_that_agree(name: str, size: float, rest: bool, axis: int) -> None:
    gyr, acc = np.zeros((100, 3)), np.tile([0.0, 0.0, -9.81], (100, 1))
    if name == "rate":
        gyr[:, axis] = np.radians(size)
    elif name == "turned":
        gyr[:50, axis], gyr[50:, axis] = np.radians(0.5 * size), -np.radians(0.5 * size)
    else:
        acc[50:, axis] += size
    assert bool(start.at_rest(gyr, acc)) is rest
    assert not start.at_rest(gyr[:1], acc[:1])
    assert not start.at_rest(np.zeros((100, 3)), np.zeros((100, 3)))


def test_vectors_of_a_body_that_turns_are_turned_into_the_axes_of_its_first_sample() -> None:
    rng = np.random.default_rng(1)
    n, dt = 37, np.full(37, 0.02)
    gyr = rng.normal(size=(n, 3)) * [4.0, 2.0, 1.0]
    q = [Rotation.identity()]
    for k in range(1, n):
        q.append(q[-1] * Rotation.from_rotvec(gyr[k] * 0.02))
    body = Rotation.concatenate(q)
    acc, mag = body.inv().apply([1.0, 2.0, -9.0]), body.inv().apply([0.2, -0.1, 0.4])
    mag[5] = np.nan
    found = derotate(dt, gyr, acc, mag)
    np.testing.assert_allclose(found.acc, np.tile([1.0, 2.0, -9.0], (n, 1)), atol=1e-12)
    np.testing.assert_allclose(np.delete(found.mag, 5, axis=0), np.tile([0.2, -0.1, 0.4], (n - 1, 1)), atol=1e-12)
    np.testing.assert_array_equal(found.mag[5], np.zeros(3))


def seconds(rate: float = 0.0, field_from: float = 0.0, length: float = 6.0) -> Any:
    """Samples of a body that turns about z: its force has another value after half a second and after three."""
    t = np.arange(0.0, length, 0.01)
    acc = np.where(t < 0.505, -9.0, np.where(t < 3.005, -10.0, -20.0))[:, None] * [0.0, 0.0, 1.0]
    mag = np.where(t < field_from - 1e-9, 0.0, 1.0)[:, None] * [0.3, 0.1, 0.5]
    return start.first_seconds(t, np.tile([0.0, 0.0, rate], (len(t), 1)), acc, mag)


def test_a_start_at_rest_has_half_a_second_and_one_in_motion_three() -> None:
    np.testing.assert_allclose(seconds().acc, [0.0, 0.0, -9.0])
    moving = seconds(rate=0.5).acc
    np.testing.assert_allclose(moving, [0.0, 0.0, -(51 * 9.0 + 250 * 10.0) / 301], atol=1e-9)


def test_a_field_within_three_seconds_is_of_the_start_and_a_later_one_is_told_by_its_sample() -> None:
    assert seconds(field_from=2.9).late is None
    np.testing.assert_allclose(seconds(field_from=2.9).mag, [0.3, 0.1, 0.5], atol=1e-6)
    found = seconds(field_from=4.0)
    assert found.late == 400
    np.testing.assert_array_equal(found.mag, np.zeros(3))
    assert seconds(field_from=99.0).late is None
    samples = prepare(
        np.arange(0.0, 6.0, 0.01),
        np.zeros((600, 3)),
        np.tile([0.0, 0.0, -9.8], (600, 1)),
        np.tile([[np.nan] * 3], (600, 1)),
    )
    samples.mag[450] = [0.3, 0.1, 0.5]
    assert start.first(samples, 50, 600, {}).late == 450


def test_init_first_takes_the_first_good_sample() -> None:
    t = np.arange(0.0, 1.0, 0.01)
    acc = np.outer(1.0 + t, [0.1, 0.2, -9.0])
    acc[0] = np.nan
    found = start.first_seconds(t, np.zeros((100, 3)), acc, np.zeros((100, 3)), init="first")
    np.testing.assert_allclose(found.acc, acc[1])


def test_a_late_field_turns_the_heading_alone() -> None:
    q = rotation.from_euler(0.4, -0.3, 1.0)
    true = rotation.from_euler(0.4, -0.3, -2.2)
    found = start.turned_to_field(q, rotation.rotate_inverse(true, EARTH_FIELD))
    assert float(rotation.total_angle(rotation.earth_error(found, true))) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_array_equal(start.turned_to_field(q, np.zeros(3)), q)


@pytest.mark.parametrize("every", [1, 3])
def test_up_to_the_late_sample_no_field_is_seen_and_from_it_on_all(every: int) -> None:
    """The outputs tell the sample, whether it saw a field, and whether the heading was set at it."""
    mag, use = np.ones((20, 3)), np.full(20, NEW)
    calls: list[slice] = []

    def run(part: slice, field: np.ndarray, used: np.ndarray, n: int, out: np.ndarray) -> None:
        calls.append(part)
        rows = np.arange(part.start, part.stop)[::n]
        out[:, 0], out[:, 1], out[:, 2] = rows, field[::n, 0] * used[::n], 0.0

    def realign(row: np.ndarray) -> None:
        row[2] = 1.0

    out = estimators_run.in_parts(run, realign, (mag, use), slice(4, 18), 9, every, (3,))
    numbers = np.arange(4, 18)[::every]
    np.testing.assert_array_equal(out[:, 0], numbers)
    np.testing.assert_array_equal(out[:, 1], np.where(numbers > 9, 1.0, 0.0))
    np.testing.assert_array_equal(out[:, 2], np.where(numbers == 9, 1.0, 0.0))
    assert calls == [slice(4, 10), slice(10, 18)]
    calls.clear()
    last = estimators_run.in_parts(run, realign, (mag, use), slice(4, 18), 17, every, (3,))
    assert calls == [slice(4, 18)]
    assert last[:, 1].sum() == 0.0
    whole = estimators_run.in_parts(run, realign, (mag, use), slice(4, 18), None, every, (3,))
    np.testing.assert_array_equal(whole[:, 0], numbers)
    assert whole[:, 1].all()
    assert not whole[:, 2].any()


def test_who_uses_no_field_or_was_given_a_heading_waits_for_none() -> None:
    seen = start.StartVectors(np.zeros(3), np.zeros(3), 7)
    with_mag: Any = SimpleNamespace(uses={"mag"})
    without: Any = SimpleNamespace(uses=set())
    assert estimators_run.late_field(with_mag, seen, False) == 7
    assert estimators_run.late_field(with_mag, seen, True) is None
    assert estimators_run.late_field(without, seen, False) is None
    samples = prepare(0.1 * np.arange(100), np.zeros((100, 3)), None)
    counted, spans = estimators_run.without_heading(samples, [(10, 30), (60, 61)])
    assert counted == {"late_field": 21}
    assert spans == [(pytest.approx(1.0), pytest.approx(3.0)), (pytest.approx(6.0), pytest.approx(6.1))]
    assert estimators_run.without_heading(samples, []) == ({}, [])


def test_a_field_is_held_for_one_and_a_half_of_its_periods_within_its_segment() -> None:
    t = np.concatenate([0.1 * np.arange(20), 3.0 + 0.1 * np.arange(10)])
    mag = np.full((30, 3), np.nan)
    mag[[0, 4, 8, 19]] = [0.2, 0.1, 0.4]
    use = prepare(t, np.zeros((30, 3)), None, mag).use
    assert use[:9].tolist() == [NEW, HELD, HELD, HELD, NEW, HELD, HELD, HELD, NEW]
    assert use[9:19].tolist() == [HELD] * 6 + [MISSING] * 4
    assert use[19:].tolist() == [NEW] + [MISSING] * 10  # a segment of its own


def test_an_even_grid_keeps_the_angle_of_uneven_samples_and_the_field_where_it_came() -> None:
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.005, 0.015, 200))
    gyr, acc = rng.normal(size=(200, 3)), rng.normal(size=(200, 3)) + np.array([0.0, 0.0, -9.8])
    mag = np.full((200, 3), np.nan)
    mag[::10] = rng.normal(size=(20, 3))
    found = uniform(t, gyr, acc, mag)
    assert found.period == pytest.approx(np.median(np.diff(t)))
    np.testing.assert_allclose(np.diff(found.t), found.period)
    assert found.t[-1] >= t[-1] - 1e-9
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(gyr[1:] * np.diff(t)[:, None], axis=0)])
    at = found.t[:-1]
    wanted = np.column_stack([np.interp(at, t, x) for x in turned.T])
    np.testing.assert_allclose(np.cumsum(found.gyr[1:-1] * found.period, axis=0), wanted[1:], atol=1e-12)
    assert np.count_nonzero(found.mag.any(axis=1)) == 20
    first = np.flatnonzero(found.mag.any(axis=1))
    np.testing.assert_allclose(found.t[first], t[::10], atol=found.period)
    assert (found.t[first] >= t[::10] - 1e-8).all()
    np.testing.assert_array_equal(found.mag[first], mag[::10])
    assert found.mag_period == pytest.approx(np.median(np.diff(t[::10])))


@pytest.mark.parametrize(("jitter", "regular"), [(0.04, True), (0.06, False)])
def test_spacing_that_varies_by_less_than_five_percent_is_even(jitter: float, regular: bool) -> None:
    t = 0.01 * np.arange(50.0)
    t[20] += jitter * 0.01
    found = uniform(t, np.zeros((50, 3)), np.zeros((50, 3)), np.full((50, 3), np.nan))
    assert found.regular is regular
    q = rotation.from_euler(0.0 * found.t, 0.0 * found.t, found.t)
    np.testing.assert_allclose(rotation.to_euler(found.back(t, q))[:, 2], t, atol=2e-5)


def test_a_field_is_scaled_to_fifty_by_its_median_without_rows_of_nothing() -> None:
    field = np.array([[0.0, 3.0, 4.0], [0.0, 0.0, 0.0], [0.0, 0.0, 10.0], [0.0, 6.0, 8.0]])
    assert typical_scale(field) == 5.0
    assert typical_scale(np.zeros((4, 3))) == 1.0


def test_an_aid_arrives_at_the_first_sample_at_or_after_its_time_and_the_newest_counts() -> None:
    t = np.arange(0.0, 1.0, 0.1)
    baro = Measurements(np.array([-1.0, 0.3, 0.31, 0.35, 0.9001, 2.0]), np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
    estimator: Any = SimpleNamespace(uses={"baro"})
    found = aid_rows(estimator, Aids(baro=baro), t + 1e-12)
    told = found.table[found.row, aid.BARO]
    assert np.flatnonzero(np.isfinite(told)).tolist() == [0, 3, 4]
    assert told[[0, 3, 4]].tolist() == [1.0, 2.0, 4.0]
    assert np.isnan(found.table[found.quiet]).all()


def test_each_aid_has_its_own_columns_and_rest_stands_at_every_sample() -> None:
    t = np.arange(0.0, 1.0, 0.1)
    at = np.array([0.2, 0.5])
    aids = Aids(
        position=Measurements(at, np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), np.array([[7.0, 8.0], [9.0, 10.0]])),
        velocity=Measurements(at, np.array([[11.0, 12.0, 13.0], [14.0, 15.0, 16.0]]), np.array([17.0, 18.0])),
        baro=Measurements(at, np.array([19.0, 20.0])),
        airspeed=Measurements(at, np.array([21.0, 22.0])),
        at_rest=np.array([[0.0, 0.35]]),
    )
    estimator: Any = SimpleNamespace(uses={"gnss", "baro", "airspeed", "at_rest"})
    found = aid_rows(estimator, aids, t)
    row = found.table[found.row[5]]
    assert row.tolist() == [4.0, 5.0, 6.0, 9.0, 10.0, 14.0, 15.0, 16.0, 18.0, 20.0, 22.0, 0.0]
    assert found.table[found.row[2]][aid.LAT] == 1.0
    assert found.table[found.row][:, aid.AT_REST].tolist() == [1.0] * 4 + [0.0] * 6
    assert found.table[found.quiet][:, aid.AT_REST].tolist() == [1.0] * 4 + [0.0] * 6
    assert np.isnan(found.table[found.quiet][:, : aid.AT_REST]).all()
