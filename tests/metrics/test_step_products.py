"""The compiled loops of the step fits: what simple numpy says of the same columns, and the same bits uncompiled."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.core import rotation
from attlog.estimators.vectors import field_error, gravity_error
from attlog.flight.model import Imu, Mag, Stream
from attlog.metrics import step_fit, step_products, step_sensors, step_turning
from attlog.metrics.step_products import axes_of, axis_of
from attlog.metrics.step_sensors import RowSensors, samples_of
from attlog.metrics.step_turning import REACH_AFTER_S, REACH_BEFORE_S, SummedTurning, around, stack_events
from tests.metrics import flights
from tests.metrics.flights import motion, sampled


def columns_of(row_hz, ref_hz):
    """The columns of some events; aiding as numbers that mean nothing."""
    t, q = motion("steps", 25.0)
    row, ref = sampled(t, q, row_hz, 0.004), sampled(t, q, ref_hz, offset=0.0013)
    groups = step_products.event_batches(row, ref, step_turning.find_steps(ref.t, ref.q, ref.segment), None)
    (found,) = groups.each()
    part = found.slow if found.slow_row else found.fast
    part.x[:, 1:] = np.cumsum(np.random.default_rng(2).standard_normal(part.x[:, 1:].shape), axis=0)
    return found


def slowly(found, delay, slope_s, aids):
    """Products and lines of each event, pair by pair with np.interp."""
    shift = -delay if found.slow_row else delay
    main = found.fast.x[:, 0] - (0.0 if found.slow_row else found.fast.x[:, 1:] @ aids)
    products, lines = [], []
    for event in range(len(found.fast.low)):
        rows = []
        for i, j in zip(found.begin[found.of == event], found.end[found.of == event], strict=True):
            a, b = found.slow.t[[i, j]] + shift
            if a - slope_s < found.fast.low[event] or b + slope_s > found.fast.high[event]:
                continue
            span = found.slow.t[j] - found.slow.t[i]
            moved = [(np.interp(b, found.fast.t, x) - np.interp(a, found.fast.t, x)) / span for x in found.fast.x.T]
            steep = [
                (np.interp(at + slope_s, found.fast.t, main) - np.interp(at - slope_s, found.fast.t, main))
                / 2
                / slope_s
                for at in (a, b)
            ]
            fixed = (found.slow.x[j] - found.slow.x[i]) / span
            est, ref = (fixed, moved) if found.slow_row else (moved, fixed)
            rows.append([est[0], (steep[1] - steep[0]) / span, *ref, *est[1:]])
        rows = np.array(rows)
        products.append((rows - rows.mean(axis=0)).T @ (rows - rows.mean(axis=0)))
        lines.append(len(rows))
    return np.array(products), np.array(lines)


@pytest.mark.parametrize(("row_hz", "ref_hz"), [(200.0, 50.0), (50.0, 200.0)])
@pytest.mark.parametrize("delay", [0.0061, -0.24])
def test_the_products_are_those_of_the_columns_built_pair_by_pair(row_hz, ref_hz, delay):
    found = columns_of(row_hz, ref_hz)
    assert found.slow_row == (row_hz < ref_hz)
    aids = np.linspace(0.1, 0.6, 6)
    products, lines = found.products(delay, 0.008, aids)
    wanted, counted = slowly(found, delay, 0.008, aids)
    np.testing.assert_array_equal(lines, counted)
    assert len(lines) > 3
    np.testing.assert_allclose(products, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


HOLDING = (step_sensors.held_field.function, step_sensors.held_field)


@pytest.mark.parametrize("loop", HOLDING, ids=["plain", "compiled"])
def test_a_field_is_held_until_it_is_too_old_or_the_next_one_comes(loop):
    t, rate = 0.01 * np.arange(60), np.tile([0.5, -1.0, 2.0], (60, 1))
    new, m, age = np.array([3, 10, 40]), np.zeros((60, 3)), np.zeros(60)
    m[new] = np.eye(3)
    loop(m, age, t, rate, new, 0.155)
    source = np.repeat([-1, 3, 10, -1, 40, -1], [3, 7, 16, 14, 16, 4])
    for k in range(60):
        held = np.flatnonzero(new == source[k])
        old = (t[k] - t[new[held]]).sum()
        wanted = Rotation.from_rotvec(-rate[k] * old).apply(np.eye(3)[held].sum(axis=0))
        np.testing.assert_allclose(m[k], wanted, atol=1e-12)
        assert age[k] == pytest.approx(old)


@pytest.mark.parametrize(("low", "high", "lines"), [(-1.0, 2.0, 9), (0.25, 2.0, 6), (-1.0, 0.65, 6), (0.25, 0.65, 3)])
def test_pairs_that_reach_beyond_either_end_of_an_event_make_no_line(low: float, high: float, lines: int) -> None:
    """Ten samples 0.1 s apart, slopes over 0.02 s on both sides: those from 0.3 s on, those up to 0.6 s."""
    slow, fast = 0.1 * np.arange(10), 0.05 * np.arange(-20, 40)
    out, count = np.zeros((1, 12, 12)), np.zeros(1, np.int64)
    room = np.empty((10, step_products.MOVED_COLUMNS)), np.empty((9, step_products.COLUMNS))
    turned, moved = np.tile(np.sin(slow)[:, None], (1, 7)), np.tile(np.sin(fast)[:, None], (1, 4))
    begin = np.arange(9)
    ends = np.array([low]), np.array([high])
    first = np.array([0, 9])
    step_products.event_products(
        out, count, *room, slow, turned, fast, moved, moved[:, 0].copy(), *ends, begin, begin + 1, first, 0.0, 0.02, 1
    )
    assert count.tolist() == [lines]


# Events of a lag's fit in groups: what all of them together tell, without the columns of all at once.


def both(seconds):
    t, q = motion("steps", seconds)
    row, ref = sampled(t, q, 200.0, 0.0073), sampled(t, q, 50.0, offset=0.0013)
    return row, ref, step_turning.find_steps(ref.t, ref.q, ref.segment)


@pytest.mark.parametrize("kept", [0, 200_000, 10**9])
def test_events_in_groups_tell_the_same_as_all_at_once(monkeypatch, kept):
    whole = step_fit.fit(step_products.event_batches(*both(60.0), None))["all"]
    monkeypatch.setattr(step_products, "BATCH_SAMPLES", 2000)
    groups = step_products.event_batches(*both(60.0), None)
    groups._room = kept
    found = step_fit.fit(groups)["all"]
    assert len(groups.bounds) >= 5
    assert [k for own in groups.bounds for k in range(own.start, own.stop)] == list(range(len(groups.events)))
    assert found.delay == pytest.approx(whole.delay, abs=1e-10)
    np.testing.assert_allclose(found.left_out, whole.left_out, rtol=1e-7)


def test_samples_around_an_event_are_those_of_its_segment_and_reach_far_enough():
    t = np.delete(np.arange(0.0, 60.0, 0.01), np.arange(2011, 2061))
    q = rotation.from_euler(0 * t, 0.3 * np.sin(t), 0 * t)
    track = SummedTurning(t, q, (t > 33.333).astype(np.int64))
    events = [
        step_turning.StepEvent(1, at, at + 0.1, at + 0.3, 9.0, at - 0.5, at + 1.3) for at in np.arange(0.2, 59.0, 0.37)
    ]
    for event, found in zip(events, around(track, events, 0.3), strict=True):
        middle = track.segment[np.searchsorted(track.t, event.middle)]
        near = (track.t >= event.begin - 0.3) & (track.t < event.end + 0.3) & (track.segment == middle)
        at = track.t[near]
        reaches = at[0] <= event.onset - REACH_BEFORE_S and at[-1] >= min(event.t90 + REACH_AFTER_S, event.end)
        assert (found is not None) == reaches
        if found is not None:
            np.testing.assert_array_equal(track.t[found], at)


def test_the_axis_of_an_event_is_unit_length_along_the_stroke_and_none_without_a_turn():
    _, ref, events = both(30.0)
    found = axes_of(ref, events)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0)
    assert all(found[k, e.axis] > 0.9 for k, e in enumerate(events))
    still = SummedTurning(ref.t, np.tile([1.0, 0.0, 0.0, 0.0], (len(ref.t), 1)), ref.segment)
    assert np.isnan(axes_of(still, events)).all()
    assert axis_of(still, events[0]) is None


def some(n=20, seed=0):
    rng = np.random.default_rng(seed)
    q = np.roll(Rotation.random(n, random_state=seed).as_quat(), 1, axis=1)
    m = rng.standard_normal((n, 3))
    return q, 9.8 * rng.standard_normal((n, 3)), m / np.linalg.norm(m, axis=1)[:, None]


def rates(q, f, m):
    """The corrections (n, 3, 5) about all three body axes."""
    return np.array(
        [[step_sensors.rates(*a, *b, *c, *axis) for axis in np.eye(3)] for a, b, c in zip(q, f, m, strict=True)]
    )


def turned(track, stack, seen):
    """The turning (n, 3, 6) about all three body axes."""
    events = len(stack.first)
    found = np.zeros((3, len(stack.index), 7))
    for out, axis in zip(found, np.eye(3), strict=True):
        step_sensors.add_turned(out, track, stack, seen, np.tile(axis, (events, 1)))
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
    seen = samples_of(case, case.log.imus[0], True)
    held = t <= 1.9 + 0.15 - 1e-6
    np.testing.assert_allclose(seen.m[held], at_t[held], atol=1e-9)
    assert not seen.m[t > 1.9 + 0.155].any()
    assert seen.age.max() == pytest.approx(0.145, abs=0.006)


def test_the_integral_of_gravity_begins_with_the_event():
    t = np.arange(0.0, 2.0, 0.01)
    track = SummedTurning(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), np.zeros(len(t), np.int64))
    tilted = np.tile([0.0, -9.80665 * np.sin(0.1), -9.80665 * np.cos(0.1)], (len(t), 1))
    stack = stack_events([slice(50, 150), slice(100, 200)])
    found = turned(track, stack, step_sensors.Vectors(tilted[stack.index], 0 * tilted[stack.index], False))
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
    sensors = RowSensors(case, row, track, samples_of(case, case.log.imus[0], True))
    stack = stack_events([slice(10, 100)])
    found = turned(track, stack, sensors.around(stack))
    assert sensors.north == pytest.approx(off)
    np.testing.assert_allclose(found[:, :, 4:], 0.0, atol=1e-9)


def test_a_slower_row_gets_the_mean_force_of_its_intervals():
    t = np.arange(0.0, 3.0, 0.01)
    case, row = case_with(t, np.zeros(3), np.ones((3, 3)), np.arange(3.0))
    case.log.imus[0].acc.x[:, 0] = t
    slow = flights.row(t[::5], row.q[::5])
    track = SummedTurning(slow.t, slow.q, slow.segment)
    seen = RowSensors(case, slow, track, samples_of(case, case.log.imus[0], True)).around(stack_events([slice(10, 20)]))
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
    case.reference.alignment.trim = np.array([0.02, -0.03, 0.0])
    slow = flights.row(t[::every], row.q[::every])
    slow.bias = 0.3 * rng.standard_normal((len(slow.t), 3))
    seen, track = samples_of(case, case.log.imus[0], True), SummedTurning(slow.t, slow.q, slow.segment)
    stack = stack_events([slice(12, 20), slice(30, 37)])
    found = RowSensors(case, slow, track, seen).around(stack)
    back = Rotation.from_rotvec(case.reference.alignment.trim)
    for i, k in enumerate(stack.index):
        near = np.flatnonzero(seen.t < slow.t[k] - 1e-6)[-1] + (every > 1)
        held = Rotation.from_rotvec(slow.bias[k] * seen.age[near]).apply(seen.m[near])
        np.testing.assert_allclose(found.m[i], back.apply(held), atol=1e-12)
        if every == 1:
            np.testing.assert_allclose(found.f[i], back.apply(seen.f[near]), atol=1e-12)
