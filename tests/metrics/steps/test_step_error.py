import numpy as np
import pytest
from scipy.stats import binom

from attlog.base import rotation
from attlog.metrics.statistics import intervals as interval
from attlog.metrics.steps import step_error
from attlog.segments.model import Segment
from tests.metrics import flights
from tests.metrics.motions import motion, sampled


def answers(est, seconds=36.0, kind="yaw", against="truth"):
    """Answers for a row ``est(t, q)`` (n, 4) in turns of yaw every 3 s."""
    t, q = motion(kind, seconds)
    ref, row = sampled(t, q, 50.0), sampled(t, est(t, q), 200.0)
    made = flights.row(row.t, row.q)
    end = float(ref.t[-1])
    case = flights.case([made], [Segment("continuous", 0, end), Segment("airborne", 1, end)], (ref.t, ref.q), against)
    return step_error.compute(case, made, "all")


def short_by(t, q, share):
    """Falls short by ``share(since)`` of each turn from 0.5 s after its start on, right again before the next."""
    yaw = np.unwrap(rotation.to_euler(q)[:, 2])
    starts = np.arange(3.0, 33.0, 3.0)
    since = t - starts[np.clip(np.searchsorted(starts, t, side="right") - 1, 0, None)]
    before = np.interp(starts, t, yaw)[np.clip(np.searchsorted(starts, t, side="right") - 1, 0, None)]
    lost = np.where((since > 0.5) & (since < 2.4) & (t > 3.0), share(since), 0.0)
    return rotation.from_euler(0.02, -0.03, yaw - lost * (yaw - before))


def test_a_row_that_shows_10_percent_too_little_is_told_so():
    found = answers(lambda t, q: short_by(t, q, lambda since: 0.1))
    pct, deg = found["step_error_pct.0.5s"], found["step_error_deg.0.5s"]
    assert pct.value == pytest.approx(-10.0, abs=1.0)
    assert pct.n >= 8
    strokes = 0.1 * np.array(deg.each) / np.abs(np.array(pct.each) / 100.0)
    assert deg.value == pytest.approx(np.median(strokes), rel=0.1)
    assert deg.detail["p90"] >= deg.value
    assert deg.ci95[0] <= deg.value <= deg.ci95[1]


def test_too_much_is_positive_and_left_turns_count_like_right_ones():
    found = answers(lambda t, q: short_by(t, q, lambda since: -0.1))["step_error_pct.1.0s"]
    assert found.value == pytest.approx(10.0, abs=1.0)
    assert min(found.each) > 8.0


def test_a_constant_heading_offset_and_misalignment_cancel():
    turn = rotation.from_rotvec(np.radians([2.0, -1.5, 3.0]))
    found = answers(lambda t, q: rotation.turn_about_down(rotation.multiply(q, turn), 1.0))
    assert found["step_error_deg.0.5s"].value == pytest.approx(0.0, abs=0.05)
    assert found["step_error_pct.1.0s"].value == pytest.approx(0.0, abs=0.1)


def test_an_error_that_decays_at_2_per_s_is_e_times_smaller_half_a_second_later():
    found = answers(lambda t, q: short_by(t, q, lambda since: 0.3 * np.exp(-2.0 * since)))
    ratio = found["step_error_pct.1.0s"].value / found["step_error_pct.0.5s"].value
    assert ratio == pytest.approx(np.exp(-1.0), rel=0.06)


def test_two_events_are_too_few():
    found = answers(lambda t, q: q, seconds=10.5)
    assert found["step_error_deg.0.5s"].code == "too_few_events"


@pytest.mark.parametrize(
    ("n", "ranks"), [(5, None), (6, (1, 6)), (8, (1, 8)), (9, (2, 8)), (10, (2, 9)), (20, (6, 15))]
)
def test_the_interval_of_a_median_has_the_ranks_of_printed_tables(n, ranks):
    """Ranks for 95 % of Conover, Practical Nonparametric Statistics, and most books of tables."""
    found = interval.of_median(np.arange(1.0, n + 1.0)[::-1])
    assert found == ranks


def test_the_interval_of_a_median_of_thousands_is_that_of_the_binomial_distribution():
    for n in (649, 1100, 5000):
        rank = int(binom.ppf(0.025, n, 0.5))
        rank += bool(2.0 * binom.cdf(rank, n, 0.5) <= 0.05)
        assert interval.of_median(np.arange(1.0, n + 1.0)) == (rank, n + 1 - rank)


def test_units_are_magnitudes_whatever_the_unit():
    found = answers(lambda t, q: short_by(t, q, lambda since: 0.1))
    deg, pct = found["step_error_deg.0.5s"], found["step_error_pct.0.5s"]
    np.testing.assert_allclose(deg.units.values, pct.units.values)
    assert deg.units.kind == "step_event"
    assert pct.units.on(pct.units.ids[:4]).value == pytest.approx(-10.0, abs=1.0)


def test_the_own_error_of_a_smoother_is_a_floor_in_both_units():
    def est(t, q):
        return short_by(t, q, lambda since: 0.1)

    found = answers(est, against="smoother")
    deg, pct = found["step_error_deg.0.5s"], found["step_error_pct.0.5s"]
    stroke = np.median(np.array(deg.each) / np.abs(np.array(pct.each) / 100.0))
    assert deg.floor == 0.05
    assert pct.floor == pytest.approx(100.0 * 0.05 / stroke)
    assert answers(est)["step_error_deg.0.5s"].floor == 0.0
