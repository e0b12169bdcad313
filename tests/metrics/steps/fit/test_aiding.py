import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.estimators.engine.vectors import field_error, gravity_error
from attlog.flight.model import Imu, Mag, Stream
from attlog.metrics.steps.fit import aiding
from attlog.metrics.steps.fit.sensors import RowSensors, samples_of
from attlog.metrics.steps.fit.turning import SummedTurning, stacked
from tests.metrics import flights


def some(n=20, seed=0):
    rng = np.random.default_rng(seed)
    q = np.roll(Rotation.random(n, random_state=seed).as_quat(), 1, axis=1)
    m = rng.standard_normal((n, 3))
    return q, 9.8 * rng.standard_normal((n, 3)), m / np.linalg.norm(m, axis=1)[:, None]


def rates(q, f, m):
    """The corrections (n, 3, 5) about all three body axes."""
    return np.array([[aiding.rates(*a, *b, *c, *axis) for axis in np.eye(3)] for a, b, c in zip(q, f, m, strict=True)])


def turned(track, stack, seen):
    """The turning (n, 3, 6) about all three body axes."""
    events = len(stack.first)
    found = np.zeros((3, len(stack.index), 7))
    for out, axis in zip(found, np.eye(3), strict=True):
        aiding.add_turned(out, track, stack, seen, np.tile(axis, (events, 1)))
    return found[..., 1:].transpose(1, 0, 2)


def test_the_rates_are_the_corrections_that_the_filters_themselves_make():
    q, f, m = some()
    found = np.radians(rates(q, f, m))
    for k in range(len(q)):
        for column, wanted in (
            (0, gravity_error(q[k], f[k], 1.0)),
            (1, gravity_error(q[k], f[k], 0.0)),
            (3, field_error(q[k], m[k], 0.0)),
            (4, field_error(q[k], m[k], 1.0)),
        ):
            np.testing.assert_allclose(found[k, :, column], wanted, atol=1e-12)


def test_a_step_of_fixed_size_is_one_degree_per_second_and_fades_below_a_third_of_a_degree():
    level = np.array([[1.0, 0.0, 0.0, 0.0]])
    for tilt, wanted in ((20.0, 1.0), (0.15, 0.5)):
        a = np.radians(tilt)
        f = -9.81 * np.array([[0.0, np.sin(a), np.cos(a)]])
        found = rates(level, f, np.zeros((1, 3)))[0, :, 2]
        assert np.linalg.norm(found) == pytest.approx(wanted, rel=1e-3)
        assert found[0] == pytest.approx(np.linalg.norm(found))  # turns down (z) towards +y: about +x


def test_a_missing_accelerometer_or_magnetometer_sample_turns_nothing():
    q, f, m = some(3)
    assert not rates(q, 0 * f, 0 * m).any()


def case_with(t, rate, field, field_at, sampling="interval"):
    """A log of a steady turn with a slow magnetometer."""
    row = flights.row(t, np.roll(Rotation.from_rotvec(np.outer(t, rate)).as_quat(), 1, axis=1))
    case = flights.case([row], [])
    gyro, acc = (Stream(t, np.tile(x, (len(t), 1)), "", "FRD", "", sampling) for x in (rate, [0.0, 0.0, -9.8]))
    case.log.imus, case.log.imu = [Imu(0, gyro, acc)], 0
    case.log.mags, case.log.mag = [Mag(0, Stream(field_at, field, "T", "FRD", ""))], 0
    return case, row


def test_a_slow_magnetometer_is_turned_on_with_the_gyro_and_then_given_up():
    t = np.arange(0.0, 3.0, 0.01)
    rate = np.array([0.4, -0.9, 1.3])
    field_at = t[:200:10]
    at_t = Rotation.from_rotvec(np.outer(t, rate)).inv().apply([0.6, 0.0, 0.8])
    measured = Rotation.from_rotvec(np.outer(field_at, rate)).inv().apply([0.6, 0.0, 0.8])
    case, _ = case_with(t, rate, 4e-5 * measured, field_at)
    seen = samples_of(case, 0, True)
    held = t <= 1.9 + 0.15 - 1e-6
    np.testing.assert_allclose(seen.m[held], at_t[held], atol=1e-9)
    assert not seen.m[t > 1.9 + 0.155].any()
    assert seen.age.max() == pytest.approx(0.145, abs=0.006)


def test_the_integral_of_gravity_begins_with_the_event():
    t = np.arange(0.0, 2.0, 0.01)
    track = SummedTurning(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), np.zeros(len(t), np.int64))
    tilted = np.tile([0.0, -9.80665 * np.sin(0.1), -9.80665 * np.cos(0.1)], (len(t), 1))
    stack = stacked([slice(50, 150), slice(100, 200)])
    found = turned(track, stack, aiding.Vectors(tilted[stack.index], 0 * tilted[stack.index], False))
    x = np.degrees(np.sin(0.1))
    for first in (0, 100):
        since = t[:100]
        np.testing.assert_allclose(found[first : first + 100, 0, 0], x * since, atol=1e-9)
        np.testing.assert_allclose(found[first : first + 100, 0, 3], x * since * (since + 0.01) / 2, atol=1e-9)


def test_north_of_a_row_whose_heading_is_true_counts_as_magnetic_north():
    """A filter with declination holds its field 15 deg off: that is no heading error."""
    t = np.arange(0.0, 3.0, 0.01)
    off = np.radians(15.0)
    field = np.tile([np.cos(off), np.sin(off), 1.5], (30, 1))
    case, row = case_with(t, np.zeros(3), field, np.arange(0.0, 3.0, 0.1))
    track = SummedTurning(row.t, row.q, row.segment)
    sensors = RowSensors(case, row, track, samples_of(case, 0, True))
    stack = stacked([slice(10, 100)])
    found = turned(track, stack, sensors.around(stack))
    assert sensors.north == pytest.approx(off)
    np.testing.assert_allclose(found[:, :, 4:], 0.0, atol=1e-9)


def test_a_slower_row_gets_the_mean_force_of_its_intervals():
    t = np.arange(0.0, 3.0, 0.01)
    case, row = case_with(t, np.zeros(3), np.ones((3, 3)), np.arange(3.0))
    case.log.imus[0].acc.x[:, 0] = t
    slow = flights.row(t[::5], row.q[::5])
    track = SummedTurning(slow.t, slow.q, slow.segment)
    seen = RowSensors(case, slow, track, samples_of(case, 0, True)).around(stacked([slice(10, 20)]))
    assert seen.trapezoid
    np.testing.assert_allclose(seen.f[:, 0], slow.t[10:20] - 0.025, atol=1e-9)


@pytest.mark.parametrize("every", [1, 5])
def test_force_and_field_around_events_are_those_of_a_simple_search(every):
    """A row of every sample and a slower one, with a bias that turns the held field and a trim taken out of both."""
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 3.0, 0.01)
    field_at = t[:290:10]
    case, row = case_with(t, np.array([0.2, 0.1, -0.4]), rng.standard_normal((len(field_at), 3)), field_at)
    case.log.imus[0].acc.x[:] = rng.standard_normal((len(t), 3))
    case.reference.trim = np.array([0.02, -0.03, 0.0])
    slow = flights.row(t[::every], row.q[::every])
    slow.bias = 0.3 * rng.standard_normal((len(slow.t), 3))
    seen, track = samples_of(case, 0, True), SummedTurning(slow.t, slow.q, slow.segment)
    stack = stacked([slice(12, 20), slice(30, 37)])
    found = RowSensors(case, slow, track, seen).around(stack)
    back = Rotation.from_rotvec(case.reference.trim)
    for i, k in enumerate(stack.index):
        near = np.flatnonzero(seen.t < slow.t[k] - 1e-6)[-1] + (every > 1)
        held = Rotation.from_rotvec(slow.bias[k] * seen.age[near]).apply(seen.m[near])
        np.testing.assert_allclose(found.m[i], back.apply(held), atol=1e-12)
        if every == 1:
            np.testing.assert_allclose(found.f[i], back.apply(seen.f[near]), atol=1e-12)
