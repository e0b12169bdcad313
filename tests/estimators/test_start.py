"""What a segment starts with is found once for the same samples, and never taken for another segment's or way's."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from attlog.core import rotation
from attlog.estimators import aids as aid
from attlog.estimators import estimate, get, start
from attlog.estimators.aids import Aids, Measurements, aid_rows
from attlog.estimators.batch import estimate_batch
from attlog.estimators.registry import BUILT_IN
from attlog.estimators.samples import PreparedSamples, prepare
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


def test_in_motion_samples_from_a_rate_that_is_no_number_on_do_not_count() -> None:
    x = throw(3.0)
    x["gyr"][200] = np.nan
    seen = first_seconds(*(x[name] for name in ("t", "gyr", "acc", "mag")))
    before = first_seconds(*(x[name][:200] for name in ("t", "gyr", "acc", "mag")))
    np.testing.assert_array_equal((seen.acc, seen.mag), (before.acc, before.mag))
    assert np.isfinite(seen.acc).all()


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


def test_an_aid_arrives_at_the_first_sample_at_or_after_its_time_and_the_newest_counts() -> None:
    t = np.arange(0.0, 1.0, 0.1)
    baro = Measurements(np.array([-1.0, 0.3, 0.31, 0.35, 0.9001, 2.0]), np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
    estimator: Any = SimpleNamespace(uses={"baro"})
    found = aid_rows(estimator, Aids(baro=baro), t + 1e-12)
    told = found.table[found.row, aid.BARO]
    assert np.flatnonzero(np.isfinite(told)).tolist() == [0, 3, 4]
    assert told[[0, 3, 4]].tolist() == [1.0, 2.0, 4.0]
    assert np.isnan(found.table[found.quiet]).all()
