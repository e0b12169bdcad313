"""Time in which samples count: flights, rests, armed time, and what each sample stands for."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import TimeLine
from attlog.health import flown
from attlog.health.check import HealthCase
from attlog.health.regression import median_interval
from attlog.segments.model import Segment, Segments
from tests.health.made_flight import flight

PHASES = [Segment("rest.long", 0.0, 20.0), Segment("airborne", 20.0, 60.0), Segment("rest.long", 70.0, 100.0)]


def test_flights_lose_their_ends_and_all_after_an_impact_counts_as_wreck() -> None:
    whole = Segments(PHASES)
    crashed = Segments([*PHASES, Segment("impact", 50.0, 51.0), Segment("wreck", 51.0, 100.0)])
    bent = Segments([*PHASES, Segment("impact", 40.0, 40.5)])
    assert flown.still_spans(whole) == ([(0.0, 20.0), (70.0, 100.0)], "at rest")
    assert flown.still_spans(crashed)[0] == [(0.0, 20.0)]
    assert flown.flight_spans(whole) == [(21.0, 59.0)]
    assert flown.flight_spans(crashed) == [(21.0, 50.0)]
    assert flown.flight_spans(bent) == [(21.0, 40.0)]
    assert flown.sound_spans(crashed, []) == []


def test_after_a_loss_of_control_a_flight_counts_again_but_not_for_compasses() -> None:
    lost = Segments([*PHASES, Segment("loss_of_control", 30.0, 35.0)])
    assert flown.flight_spans(lost) == [(21.0, 30.0), (35.0, 59.0)]
    assert flown.flight_before_crash(lost) == [(21.0, 29.0)]
    assert flown.flight_before_crash(lost, 0.0) == [(20.0, 30.0)]


def test_idling_motors_stand_in_for_a_rest() -> None:
    assert flown.still_spans(Segments([Segment("idle", 3.0, 9.0)])) == ([(3.0, 9.0)], "on the ground with motors on")
    assert flown.still_spans(Segments()) == ([], "")


def test_where_flight_is_unknown_the_time_armed_counts() -> None:
    log = flight()
    log.state.armed = TimeLine(np.array([0.0, 20.0, 60.0, 80.0]), [False, True, False, True], "made")
    last = max(float(g.t[-1]) for g in log.gnss)
    assert flown.armed_spans(log) == [(20.0, 60.0), (80.0, last)]
    case = HealthCase(log, Segments([], unknown=("airborne",)))
    assert flown.driven_spans(case) == [(21.0, 59.0), (81.0, last - 1.0)]
    case.segments = Segments([Segment("airborne", 5.0, 7.0), Segment("airborne", 10.0, 12.1)])
    assert flown.driven_spans(case) == [(11.0, pytest.approx(11.1))]


def test_a_sample_counts_for_its_step_and_at_most_for_three_usual_ones() -> None:
    t = np.array([0.0, 1.0, 2.0, 2.5, 5.0, 9.0, 10.0])
    np.testing.assert_array_equal(flown.held_seconds(t), [1.0, 1.0, 0.5, 2.5, 3.0, 1.0, 1.0])
    assert flown.held_seconds(t[:1]).tolist() == [0.0]


def test_the_interval_of_a_median_is_by_ranks_of_blocks_of_five_seconds() -> None:
    """16 blocks with medians 0 to 15 in any order: ranks 8 minus and plus 0.98 times 4, outwards."""
    order = np.random.default_rng(0).permutation(16)
    t = np.arange(0.0, 80.0, 0.5)
    x = order[(t // 5.0).astype(int)] + np.tile([-0.2, 0.0, 0.0, 0.0, 0.3], 32)
    assert median_interval(t, x) == (4.0, 12.0)
    assert median_interval(t[:20], np.arange(20.0)) == (4.5, 14.5)
