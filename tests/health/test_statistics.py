"""Robust fits, intervals, and the spans that count: closed forms and planted values."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from attlog.flight.model import TimeLine
from attlog.health import compass, flown, vibration
from attlog.health.check import HealthCase
from attlog.health.compass_offset import OffsetFit, study_samples
from attlog.health.regression import median_interval, robust_fit
from attlog.segments.model import Segment, Segments
from tests.health.made_compass import case_of, empty_log, samples
from tests.health.made_flight import flight


def test_a_line_is_found_in_spite_of_gross_errors() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 200.0, 0.5)
    x = rng.normal(size=len(t))
    y = 2.0 * x - 0.7 + 0.05 * rng.normal(size=len(t))
    y[::20] += 30.0
    found = robust_fit(t, np.column_stack([x, np.ones(len(t))])[:, None, :], y[:, None])
    assert found is not None
    assert found.x == pytest.approx([2.0, -0.7], abs=0.02)
    assert found.blocks == 40


def test_errors_that_last_make_the_standard_error_larger_than_independent_ones() -> None:
    """A mean of 40 independent values, each repeated ten times: s / sqrt(40), not s / sqrt(400)."""
    rng = np.random.default_rng(4)
    values = rng.normal(size=40)
    t = np.arange(0.0, 200.0, 0.5)
    found = robust_fit(t, np.ones((400, 1, 1)), np.repeat(values, 10)[:, None])
    assert found is not None
    assert found.sigma[0] == pytest.approx(1.0 / np.sqrt(40), rel=0.35)
    assert found.sigma[0] > 2.0 / np.sqrt(400)


def test_a_prior_holds_what_the_data_do_not_tell_and_its_width_is_the_answers() -> None:
    """Two columns that are one: the sum is known, the second is held to its prior."""
    rng = np.random.default_rng(5)
    t, one = np.arange(0.0, 100.0, 0.5), np.ones(200)
    y = 1.0 + 0.01 * rng.normal(size=200)
    columns = np.column_stack([one, one])[:, None, :]
    assert robust_fit(t, columns, y[:, None]) is None
    found = robust_fit(t, columns, y[:, None], np.array([np.inf, 0.1]))
    assert found is not None
    assert found.x == pytest.approx([1.0, 0.0], abs=0.02)
    assert found.sigma[1] == pytest.approx(0.1, rel=0.3)


def test_a_mean_of_two_blocks_is_not_surer_than_two_values() -> None:
    from scipy.stats import sem

    found = robust_fit(np.array([1.0, 6.0]), np.ones((2, 1, 1)), np.array([[1.0], [1.8]]), huber=1e9)
    assert found is not None
    assert found.sigma[0] == pytest.approx(sem([1.0, 1.8]), rel=1e-9)
    assert (found.x[0], found.blocks) == (pytest.approx(1.4), 2)


@pytest.mark.parametrize(("at", "n"), [((4.9, 5.1), 2), ((5.1, 9.9), 1), ((0.0, 4.9), 1)])
def test_blocks_are_of_five_seconds(at: tuple[float, float], n: int) -> None:
    found = robust_fit(np.array(at), np.ones((2, 1, 1)), np.array([[1.0], [2.0]]))
    assert found is not None
    assert found.blocks == n


# Intervals of assessments: 1.96 sigmas of the part along the vector, order statistics, half a line of a spectrum.


def test_the_error_of_an_offsets_size_is_that_along_it() -> None:
    found = OffsetFit(np.array([3.0, 0.0, -4.0]), np.array([0.5, 9.0, 0.2]), 1.0, 100, 20)
    assert found.size_sigma == pytest.approx(np.hypot(0.6 * 0.5, 0.8 * 0.2))


@pytest.mark.parametrize(("offset", "sigma", "counts"), [(1.4, 0.1, False), (1.6, 0.1, True), (2.1, 0.5, True)])
def test_an_offset_counts_beyond_fifteen_milligauss_and_four_sigmas_of_any_axis(
    offset: float, sigma: float, counts: bool
) -> None:
    for axis in range(3):
        for sign in (1.0, -1.0):
            vector, sigmas = np.zeros(3), np.full(3, 9.0)
            vector[axis], sigmas[axis] = sign * offset, sigma
            assert OffsetFit(vector, sigmas, 1.0, 100, 20).counts is counts
    assert not OffsetFit(np.array([1.9, 0.0, 0.0]), np.full(3, 0.5), 1.0, 100, 20).counts


@pytest.mark.parametrize(("motor", "verdict"), [(0.2, "warning"), (0.4, "fault")])
def test_motors_that_add_a_third_of_the_horizontal_field_are_a_fault(motor: float, verdict: str) -> None:
    """19.5 A more than on the ground; the horizontal field has 20.2 uT."""
    study = study_samples(samples(motor=(0.6 * motor, 0.8 * motor, 0.0)))
    assert study is not None
    assert compass.motor_check(case_of(empty_log()), study).verdict == verdict


@pytest.mark.parametrize(("n", "share"), [(60, 0.8), (400, 0.95), (12, 0.5)])
def test_the_interval_of_a_quantile_has_the_binomial_normal_ranks(n: int, share: float) -> None:
    x = np.random.default_rng(n).permutation(np.arange(n, dtype=float))
    low, high = vibration.quantile_interval(x, share)
    ranks = stats.norm.ppf([0.025, 0.975], n * share, np.sqrt(n * share * (1.0 - share)))
    assert (low, high) == (pytest.approx(max(ranks[0], 0.0), abs=0.51), pytest.approx(min(ranks[1], n - 1), abs=0.51))


def test_means_of_seconds_are_those_of_their_finite_samples() -> None:
    t = np.array([0.2, 0.9, 1.1, 3.0, 3.5, 3.9])
    starts, means = vibration.second_means(t, np.array([1.0, 3.0, np.nan, 2.0, np.nan, 6.0]))
    assert (starts.tolist(), means.tolist()) == ([0.0, 3.0], [2.0, 4.0])


# Time in which samples count: flights, rests, armed time, and what each sample stands for.


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
