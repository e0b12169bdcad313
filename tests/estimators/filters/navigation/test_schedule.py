"""Events in order of time, made from kinds that may be let go of while they are gathered."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.estimators import Measurements
from attlog.estimators.filters.navigation.inputs import NoiseLevels, prepare_inputs
from attlog.estimators.filters.navigation.model import BARO, MAG, NO_RATE, POSITION, STILL, VELOCITY
from attlog.estimators.filters.navigation.schedule import Timetable, rest_times
from tests.estimators.filters.navigation.made import flight


def test_what_is_made_once_is_what_is_made_again_and_again():
    made = flight(seconds=24.0, still=8.0)
    m = made.motion
    inputs = prepare_inputs(m.t, m.gyr, m.acc, m.mag, made.aids, 0.0, ahead=True)
    tuned, table = NoiseLevels(), Timetable(inputs)
    first, second = table.scheduled(tuned, settling=True), table.scheduled(tuned, settling=True)
    once = Timetable(inputs).scheduled(tuned, settling=True, once=True)
    for a, b, c in zip(*([s.node_at, s.node_event, s.scalars, *s.events] for s in (first, second, once)), strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a, c)
        assert a.dtype == c.dtype
    assert {VELOCITY, MAG} <= set(first.events.kind.tolist())
    # Each event lies at the sample next to when it was true, and all are in order.
    fixes = np.flatnonzero(first.events.kind == VELOCITY)
    assert inputs.velocity is not None
    assert len(fixes) == len(inputs.velocity.t)
    np.testing.assert_array_equal(first.events.z[fixes], inputs.velocity.x)
    assert np.abs(first.events.offset).max() <= np.diff(inputs.t).max()


# Where events and nodes lie, what they hold and how much they count: by hand, on samples at 100 Hz.

N = 301
T = 5.0 + 0.01 * np.arange(N)
R = np.array([0.11, 0.13, 0.17, 0.19, 0.23, 0.029, 0.0031, 0.037])
TUNED = NoiseLevels(r=R, gnss_delay=0.12, mag_delay=0.0)
RAMP = np.outer(np.arange(N), [1.0, 2.0, -3.0])


def inputs(**given: Any) -> Any:
    own: dict[str, Any] = dict.fromkeys(["velocity", "position", "baro", "mag"])
    own |= {"sensed_at": T, "acc": RAMP, "gyr": -RAMP, "rest": np.zeros(N, np.int8)}
    return SimpleNamespace(**(own | given))


def fixes(t: list[float], columns: int = 1) -> Measurements:
    x = np.arange(3.0 * len(t)).reshape(-1, 3)
    return Measurements(np.array(t), x, 2.0 + np.arange(float(len(t) * columns)).reshape(len(t), columns))


def test_an_event_lies_at_the_nearest_sample_and_of_two_as_near_at_the_earlier() -> None:
    when = np.array([4.999, 5.0, 5.104, 5.106, 5.205, 7.999, 8.0, 8.001])
    table = Timetable(inputs())
    placed = table._place(BARO, when, np.arange(24.0).reshape(8, 3), np.ones((8, 3)))
    assert placed.at.tolist() == [0, 10, 11, 20, 300, 300]
    assert placed.offset == pytest.approx([0.0, 0.004, -0.004, 0.005, -0.001, 0.0])
    assert placed.z[:, 0].tolist() == [3.0, 6.0, 9.0, 12.0, 15.0, 18.0]
    back = table._place(BARO, when[::-1], np.arange(24.0).reshape(8, 3)[::-1], np.ones((8, 3)))
    assert back.at.tolist() == placed.at.tolist()


def test_what_is_missing_counts_nothing_and_means_are_centred() -> None:
    """Of a line the mean around a sample is half a sample's step less, as each value is of the interval before."""
    z = np.array([[1.0, np.nan, 3.0]])
    table = Timetable(inputs())
    for kind, force, rate in ((VELOCITY, True, True), (POSITION, False, False), (MAG, False, True)):
        placed = table._place(kind, T[[100]], z, np.full((1, 3), 2.0))
        assert placed.shape.tolist() == [[2.0, 0.0, 2.0]]
        assert placed.z.tolist() == [[1.0, 0.0, 3.0]]
        want = np.array([1.0, 2.0, -3.0]) * 100.5
        assert placed.force[0] == pytest.approx(want if force else np.zeros(3))
        assert placed.rate[0] == pytest.approx(-want if rate else np.zeros(3))


def test_each_kind_has_the_noise_of_its_groups_times_its_own_shape() -> None:
    rest = np.zeros(N, np.int8)
    rest[:100] = 1
    own = inputs(
        velocity=fixes([6.12, 6.32]),
        position=fixes([6.22], 2),
        baro=Measurements(np.array([5.5, 5.6]), np.array([7.0, 8.0])),
        mag=Measurements(np.array([5.7]), np.ones((1, 3))),
        rest=rest,
    )
    found = Timetable(own).scheduled(TUNED)
    want = {
        VELOCITY: [[0.22, 0.22, 0.26], [0.33, 0.33, 0.39]],
        POSITION: [[0.34, 0.34, 0.57]],
        BARO: [[0.23, 0.0, 0.0]] * 2,
        MAG: [[0.029] * 3],
        STILL: [[0.037] * 3] * 4,
        NO_RATE: [[0.0031] * 3] * 4,
    }
    for kind, sigma in want.items():
        assert found.events.sigma[found.events.kind == kind] == pytest.approx(np.array(sigma))
    assert found.events.z[found.events.kind == BARO].tolist() == [[7.0, 0.0, 0.0], [8.0, 0.0, 0.0]]
    assert (found.events.z[found.events.kind == STILL] == 0.0).all()
    # Fixes are true before their stamp by the delay; a gyro's zero is its mean over the 0.2 s before.
    at = np.repeat(found.node_at, np.diff(found.node_event))
    assert at[found.events.kind == VELOCITY].tolist() == [100, 120]
    ends = at[found.events.kind == NO_RATE]
    assert found.events.z[found.events.kind == NO_RATE][:, 0] == pytest.approx(-(ends - 9.5))
    scalars = np.cumsum(np.where(found.events.kind == BARO, 1, 3))
    assert found.scalars[-1] == scalars[-1] == 3 * 12 + 2
    assert found.scalars.tolist() == [0 if e == 0 else scalars[e - 1] for e in found.node_event]


def test_a_delay_moves_its_own_events_and_only_fixes_stamped_within_a_span_count() -> None:
    own = inputs(velocity=fixes([6.0, 6.5, 7.0]), mag=Measurements(T[[100]], np.ones((1, 3))))
    table = Timetable(own)

    def places(kind: int, **levels: float) -> list[int]:
        found = table.scheduled(NoiseLevels(**levels), within=(6.0, 6.6))  # type: ignore[arg-type]
        return np.repeat(found.node_at, np.diff(found.node_event))[found.events.kind == kind].tolist()

    assert places(VELOCITY, gnss_delay=0.1) == [90, 140]
    assert places(VELOCITY, gnss_delay=0.2) == [80, 130]
    assert [places(MAG, mag_delay=d) for d in (0.0, 0.05, -0.05, 0.0)] == [[100], [95], [105], [100]]


@pytest.mark.parametrize("every", [0.04, 0.07])
def test_nodes_are_events_ends_changes_of_rest_and_the_last_sample_of_a_slot_without_any(every: float) -> None:
    rest = np.zeros(N, np.int8)
    rest[57:93] = 1
    own = inputs(velocity=fixes([9.0]), baro=Measurements(T[[31, 32, 210]], np.zeros(3)), rest=rest)
    found = Timetable(own).scheduled(TUNED, every=every)
    looks = np.searchsorted(T, rest_times(own))
    nodes = {0, N - 1, 31, 32, 210, 56, 92, *looks.tolist()}
    slot = [int((k * 0.01) / every + 1e-6) for k in range(N)]
    for number in range(slot[-1] + 1):
        mine = [k for k in range(N) if slot[k] == number]
        if not nodes & set(mine):
            nodes.add(mine[-1])
    assert found.node_at.tolist() == sorted(nodes)
    assert found.rest_of.tolist() == rest[found.node_at].tolist()
