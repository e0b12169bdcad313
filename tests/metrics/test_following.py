"""Whether a row follows motion."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest

from attlog import estimators
from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.flight.model import Imu, Mag, Stream
from attlog.metrics import compute, following
from attlog.metrics.metric import Case
from attlog.reference.model import Track
from attlog.segments.model import Segment
from tests.metrics import flights

T = np.arange(0.0, 60.0, 0.02)


@pytest.mark.parametrize("gain", [1.0, 0.5])
def test_resets_of_the_reference_are_no_motion_that_a_row_has_to_follow(gain: float) -> None:
    """It swings by 40 deg about each axis, and the reference jumps by 50 deg every 3 s."""
    swing = np.radians(40.0) * np.sin(np.outer(T, [0.9, 0.0, 0.0]))
    q_est = rotation.from_rotvec(gain * swing)
    segment = (T // 3.0).astype(np.int64)
    jumped = np.radians(50.0) * segment[:, None] * np.array([1.0, 0.0, 0.0])
    turned = rotation.increments(rotation.from_rotvec(swing + jumped))
    found = following._gains_of(T, q_est, turned, segment)
    assert found[[0, 3]] == pytest.approx(gain, rel=1e-3)
    assert np.isnan(found[1:3]).all()


# The rest that a filter is tried on holds the log's own samples, the magnetometer's among them.

STILL_T = np.arange(0.0, 60.0, 0.01)
FIELD_T = np.arange(0.003, 60.0, 0.1)


def resting(rest: tuple[float, float]) -> tuple[Case, Track]:
    """A log at rest from and to these times; its samples tell their own time."""
    row = flights.row(STILL_T, np.tile([1.0, 0.0, 0.0, 0.0], (len(STILL_T), 1)))
    case = flights.case([row], [Segment("continuous", 0, 60), Segment("rest.long", *rest)])
    of_time = [
        Stream(STILL_T, np.column_stack([STILL_T, STILL_T, STILL_T]), unit, "FRD", "imu") for unit in ("rad/s", "m/s^2")
    ]
    case.log.imus, case.log.imu = [Imu(0, *of_time)], 0
    field = Stream(FIELD_T, np.column_stack([FIELD_T] * 3), "T", "FRD", "mag")
    case.log.mags, case.log.mag = [Mag(0, field)], 0
    return case, row


def test_every_field_of_the_rest_stands_at_the_first_sample_after_it() -> None:
    found = following.rest_samples(*resting((10.0, 30.0)), shortest=5.0, longest=60.0)
    assert found is not None
    assert found.mag is not None
    assert (found.t[0], found.t[-1]) == pytest.approx((10.0, 30.0), abs=0.011)
    at = np.flatnonzero(np.isfinite(found.mag[:, 0]))
    inside = FIELD_T[(FIELD_T >= found.t[0]) & (FIELD_T <= found.t[-1])]
    np.testing.assert_array_equal(found.mag[at, 0], inside)
    assert np.abs(found.t[at] - inside).max() <= 0.01
    np.testing.assert_allclose(found.acc[:, 0], found.t)


@pytest.mark.parametrize(("longest", "begin"), [(60.0, 10.0), (8.0, 22.0)])
def test_the_end_of_a_long_rest_is_taken(longest: float, begin: float) -> None:
    found = following.rest_samples(*resting((10.0, 30.0)), shortest=5.0, longest=longest)
    assert found is not None
    assert found.t[0] == pytest.approx(begin, abs=0.011)


@pytest.mark.parametrize(("seconds", "enough"), [(4.9, False), (5.1, True)])
def test_a_rest_that_is_too_short_is_none(seconds: float, enough: bool) -> None:
    case, row = resting((10.0, 10.0 + seconds))
    assert (following.rest_samples(case, row, shortest=5.0, longest=60.0) is not None) is enough


def case_with(estimator, uses_mag=False, hz=100.0):
    t = np.arange(0.0, 40.0, 1.0 / hz)
    rng = np.random.default_rng(1)
    gyro = Stream(t, 1e-3 * rng.standard_normal((len(t), 3)), "rad/s", "FRD", "imu")
    acc = Stream(t, np.array([0.0, 0.0, -9.81]) + 0.02 * rng.standard_normal((len(t), 3)), "m/s^2", "FRD", "imu")
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    row = flights.row(t, q, estimator, estimator=estimator)
    row.uses_mag = uses_mag
    case = flights.case([row], [Segment("continuous", 0, 40), Segment("rest.long", 0, 40)], (t, q))
    case.log.imus, case.log.imu = [Imu(0, gyro, acc)], 0
    return case, row


CAUSAL = [n for n in estimators.names() if n != "gyro" and estimators.get(n).causal]


@pytest.mark.parametrize(("name", "hz"), [*((n, 100.0) for n in CAUSAL), ("mekf", 25.0)])
def test_every_filter_but_the_gyro_is_corrected_by_gravity(name, hz):
    uses = estimators.get(name).uses
    case, row = case_with(name, "mag" in uses, hz)
    left = following.tilt_left(case, row)
    assert left < (0.6 if name == "mekf" else 0.4)  # it may take a tilt for a bias of the accelerometer
    assert following.why_uncorrected(case, row) is None


@pytest.mark.parametrize("hz", [25.0, 100.0, 1000.0])
def test_integrated_gyro_keeps_the_whole_tilt(hz):
    case, row = case_with("gyro", hz=hz)
    assert following.tilt_left(case, row) == pytest.approx(1.0, abs=0.01)


def test_a_row_that_gravity_does_not_correct_is_ranked_nowhere():
    for name, ranked in (("gyro", False), ("mahony", True)):
        case, row = case_with(name)
        answers = compute(case, row, ["all", "rest"])
        values = {m: a for w in answers.values() for m, a in w.items() if a.value is not None}
        assert "tilt_rmse_deg" in values
        assert any(a.ranked for a in values.values()) == ranked
        assert (following.UNCORRECTED in {a.reason for a in values.values()}) != ranked


def test_a_row_that_cannot_be_run_again_is_not_called_uncorrected():
    case, row = case_with("no-such-filter")
    assert following.tilt_left(case, row) is None
    assert following.why_uncorrected(case, row) is None


def test_a_filter_that_cannot_run_again_is_tried_once_for_all_axes():
    case, row = case_with("mahony")
    with patch.object(estimators, "estimate", side_effect=AttlogError("it diverged")) as tried:
        assert [following.pulse_gain(case, row, axis) for axis in range(3)] == [None, None, None]
    assert tried.call_count == 1
