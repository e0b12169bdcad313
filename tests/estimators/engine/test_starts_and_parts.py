"""Starts, late fields, even grids, arrivals of aids: closed forms with other numbers in every axis."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.base import rotation
from attlog.estimators import aids as aid
from attlog.estimators.aids import Aids, Measurements
from attlog.estimators.engine import late, start
from attlog.estimators.engine.events import events
from attlog.estimators.engine.samples import HELD, MISSING, NEW, prepare
from attlog.estimators.engine.stabilised import stabilised
from attlog.estimators.engine.uniform import typical_scale, uniform

EARTH_FIELD = np.array([0.2, 0.0, 0.45])


@pytest.mark.parametrize(("roll", "pitch", "yaw"), [(0.3, -0.4, 2.0), (-2.5, 0.2, -1.0), (0.0, 1.2, 0.5)])
def test_a_start_at_rest_is_the_attitude_that_force_and_field_show(roll: float, pitch: float, yaw: float) -> None:
    q = rotation.from_euler(roll, pitch, yaw)
    acc, mag = (rotation.rotate_inverse(q, v) for v in (np.array([0.0, 0.0, -9.81]), EARTH_FIELD))
    found = start.start_attitude(acc, mag)
    assert float(rotation.total_angle(rotation.error(found, q))) == pytest.approx(0.0, abs=1e-9)
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
    found = stabilised(dt, gyr, acc, mag)
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
    assert float(rotation.total_angle(rotation.error(found, true))) == pytest.approx(0.0, abs=1e-9)
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

    out = late.in_parts(run, realign, (mag, use), slice(4, 18), 9, every, (3,))
    numbers = np.arange(4, 18)[::every]
    np.testing.assert_array_equal(out[:, 0], numbers)
    np.testing.assert_array_equal(out[:, 1], np.where(numbers > 9, 1.0, 0.0))
    np.testing.assert_array_equal(out[:, 2], np.where(numbers == 9, 1.0, 0.0))
    assert calls == [slice(4, 10), slice(10, 18)]
    calls.clear()
    last = late.in_parts(run, realign, (mag, use), slice(4, 18), 17, every, (3,))
    assert calls == [slice(4, 18)]
    assert last[:, 1].sum() == 0.0
    whole = late.in_parts(run, realign, (mag, use), slice(4, 18), None, every, (3,))
    np.testing.assert_array_equal(whole[:, 0], numbers)
    assert whole[:, 1].all()
    assert not whole[:, 2].any()


def test_who_uses_no_field_or_was_given_a_heading_waits_for_none() -> None:
    seen = start.StartVectors(np.zeros(3), np.zeros(3), 7)
    with_mag: Any = SimpleNamespace(uses={"mag"})
    without: Any = SimpleNamespace(uses=set())
    assert late.late_field(with_mag, seen, False) == 7
    assert late.late_field(with_mag, seen, True) is None
    assert late.late_field(without, seen, False) is None
    samples = prepare(0.1 * np.arange(100), np.zeros((100, 3)), None)
    counted, spans = late.without_heading(samples, [(10, 30), (60, 61)])
    assert counted == {"late_field": 21}
    assert spans == [(pytest.approx(1.0), pytest.approx(3.0)), (pytest.approx(6.0), pytest.approx(6.1))]
    assert late.without_heading(samples, []) == ({}, [])


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
    found = events(estimator, Aids(baro=baro), t + 1e-12)
    told = found.table[found.row, aid.BARO]
    assert np.flatnonzero(np.isfinite(told)).tolist() == [0, 3, 4]
    assert told[[0, 3, 4]].tolist() == [1.0, 2.0, 4.0]
    assert np.isnan(found.table[found.quiet]).all()
    nothing = events(SimpleNamespace(uses=set()), Aids(baro=baro), t)  # type: ignore[arg-type]
    assert np.isnan(nothing.table).all()


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
    found = events(estimator, aids, t)
    row = found.table[found.row[5]]
    assert row.tolist() == [4.0, 5.0, 6.0, 9.0, 10.0, 14.0, 15.0, 16.0, 18.0, 20.0, 22.0, 0.0]
    assert found.table[found.row[2]][aid.LAT] == 1.0
    assert found.table[found.row][:, aid.AT_REST].tolist() == [1.0] * 4 + [0.0] * 6
    assert found.table[found.quiet][:, aid.AT_REST].tolist() == [1.0] * 4 + [0.0] * 6
    assert np.isnan(found.table[found.quiet][:, : aid.AT_REST]).all()
