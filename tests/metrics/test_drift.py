"""Drift in the air against a heading that may drift itself."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from attlog import metrics
from attlog.core import rotation
from attlog.flight.model import Attitude
from attlog.metrics import drift, statistics
from attlog.metrics.windows import DRIFT_AIR_S, DRIFT_REST_S
from attlog.reference.model import HeadingReference, ReferenceSigma, Track
from attlog.segments.model import Segment
from tests.metrics import flights
from tests.metrics.test_corpus import trial_of


def slope_of(t, e, segment=None):
    return drift.fit_drift(drift.block_means(t, e, np.zeros(len(t), np.int64) if segment is None else segment))


def test_half_a_degree_per_minute_is_found_under_noise_and_two_resets():
    t = np.arange(0.0, 300.0, 0.005)
    segment = np.searchsorted([80.0, 210.0], t, side="right")
    rng = np.random.default_rng(4)
    e = 0.5 / 60.0 * t + rng.standard_normal(len(t)) + np.array([0.0, 12.0, -30.0])[segment]
    found = slope_of(t, e, segment)
    assert found.value == pytest.approx(0.5, abs=0.1)
    assert found.ci95[0] <= 0.5 <= found.ci95[1]
    assert found.ci95[1] - found.ci95[0] < 0.5


@pytest.mark.parametrize("net", [0.0, 3.0])
def test_a_heading_that_is_pulled_back_again_and_again_drifts_by_its_net_change(net):
    """It rises by 9 deg and falls back within 1 s, ten times: 54 deg/min for most of each 10 s, 0 or 3 in all."""
    t = np.arange(0.0, 100.0, 0.05)
    tooth = np.interp(t % 10.0, [0.0, 9.5, 10.0], [0.0, 9.0, 0.0])
    e = tooth + net / 60.0 * t + 0.1 * np.random.default_rng(2).standard_normal(len(t))
    found = slope_of(t, e)
    assert found.sawtooth
    assert found.value == pytest.approx(net, abs=1.0)
    assert found.ci95[0] < net < found.ci95[1] < net + 10.0


def test_a_curved_drift_is_no_saw_tooth():
    t = np.arange(0.0, 200.0, 0.05)
    e = 1e-3 * t**2 + 0.1 * np.random.default_rng(2).standard_normal(len(t))
    found = slope_of(t, e)
    assert not found.sawtooth
    assert found.value == pytest.approx(12.0, rel=0.05)


def test_a_drift_that_is_hardly_pulled_back_is_no_saw_tooth():
    """It rises by 9 deg and falls back by 3 every 10 s: 36 of 57 deg/min remain."""
    t = np.arange(0.0, 100.0, 0.05)
    tooth = np.interp(t % 10.0, [0.0, 9.5, 10.0], [0.0, 9.0, 6.0]) + 6.0 * (t // 10.0)
    assert not slope_of(t, tooth + 0.1 * np.random.default_rng(2).standard_normal(len(t))).sawtooth


def heading_noise(kind, n, step, rng):
    """White, first-order with a time constant in s, or a random walk."""
    white = rng.standard_normal(n)
    if kind == "white":
        return white
    if kind == "walk":
        return 0.1 * np.sqrt(step) * np.cumsum(white)
    a = np.exp(-step / kind)
    return lfilter([np.sqrt(1 - a * a)], [1, -a], white, zi=[a * rng.standard_normal()])[0]


def coverage(kind, seconds, runs, seed=5):
    """Share of runs whose interval holds the drift of 0.5 deg/min."""
    step, rng, hits = 0.1, np.random.default_rng(seed), 0
    t = np.arange(0.0, seconds, step)
    for _ in range(runs):
        e = 0.5 / 60.0 * t + heading_noise(kind, len(t), step, rng)
        found = drift.fit_drift(drift.block_means(t, e, np.zeros(len(t), np.int64)), DRIFT_REST_S)
        hits += found.ci95[0] <= 0.5 <= found.ci95[1]
    return hits / runs


@pytest.mark.parametrize("kind", ["white", "walk"])
def test_the_interval_covers_the_drift_neither_too_seldom_nor_too_often(kind):
    """White noise and its integral are the two for which groups are independent: 95 % is meant."""
    assert 0.90 <= coverage(kind, 60.0, 300) <= 0.985


def test_a_record_has_a_group_for_each_10_s_but_4_at_least_and_12_at_most():
    for seconds, groups in ((9.0, 4), (20.0, 4), (60.0, 6), (250.0, 12)):
        t = np.arange(0.0, seconds, 0.1)
        found = drift.fit_drift(drift.block_means(t, 0.01 * t, np.zeros(len(t), np.int64)), DRIFT_REST_S)
        assert len(found.slopes) == groups
        assert found.value == pytest.approx(0.6)


def test_a_record_that_is_too_short_has_no_value_and_says_its_time():
    t = np.arange(0.0, 18.0, 0.02)
    found = slope_of(t, 0.01 * t)
    assert found.value is None
    assert drift.reason_too_short(found, DRIFT_AIR_S) == "18 s; 20 are needed"
    t = np.arange(0.0, 30.0, 0.1)
    broken = drift.fit_drift(drift.block_means(t, 0.01 * t, np.floor(t / 2).astype(np.int64)))
    assert drift.reason_too_short(broken, DRIFT_AIR_S) == "30 s in segments too short for 4 slopes"


def test_rows_are_paired_by_the_slopes_of_groups_that_begin_together():
    t = np.arange(0.0, 60.0, 0.02)
    rng = np.random.default_rng(0)
    a, b = (drift.drift_answer(slope_of(t, k * t + rng.standard_normal(len(t))), "rest", "rest") for k in (0.02, 0.05))
    assert a.units.kind == "slope_group"
    np.testing.assert_array_equal(a.units.ids, b.units.ids)
    assert a.units.on(a.units.ids).value == a.value
    assert a.units.on(a.units.ids[:3]).value == pytest.approx(np.mean(a.units.values[:3]))


def test_rests_that_agree_are_pooled_and_rests_that_do_not_are_a_range():
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 60.0, 0.02)
    same = [slope_of(t, 0.01 * t + 0.05 * rng.standard_normal(len(t))) for _ in range(3)]
    pooled = drift.pool_drifts(same)
    assert pooled.agree
    assert pooled.value == pytest.approx(0.6, abs=0.05)
    moved = slope_of(t, 0.11 * t + 0.05 * rng.standard_normal(len(t)))
    apart = drift.pool_drifts([*same, moved])
    assert not apart.agree
    assert apart.range == (pytest.approx(0.6, abs=0.05), pytest.approx(6.6, abs=0.05))
    assert apart.ci95[0] < 0.62
    assert apart.ci95[1] > 6.58
    told = drift.drift_answer(apart, "rest", "rest")
    assert not told.ranked
    assert told.disagree == apart.range


REST = [
    Segment("continuous", 0, 100),
    Segment("rest.long", 0, 60),
    Segment("airborne", 60, 100),
    Segment("rest.short", 95, 98),
]


def turning(dps, seconds=100.0, hz=50.0):
    t = np.arange(0.0, seconds, 1.0 / hz)
    return t, rotation.from_euler(0.05, -0.1, 2.5 + np.radians(dps) * t)


def test_drift_at_rest_is_the_rows_own_turn():
    row = flights.row(*turning(0.03))
    answer = drift.REST_DRIFT.ask(flights.case([row], REST), row, "rest")["drift_rest_deg_per_min"]
    assert answer.value == pytest.approx(1.8, abs=1e-6)


def test_drift_in_the_air_is_against_the_reference_and_each_heading_reference():
    t, still = turning(0.0)
    row = flights.row(*turning(0.02))
    case = flights.case([row], REST, (t[::2], still[::2]), "truth", scoring_start=15.0)
    segment = (t[::5] > 70).astype(np.int64)
    heading = np.degrees(2.5) + 0.01 * t[::5] + 9.0 * segment
    case.heading_references["mag"] = HeadingReference("mag", t[::5], heading, segment, "compass")
    answers = drift.AIR_DRIFT.ask(case, row, "airborne")
    assert answers["drift_air_deg_per_min.truth"].value == pytest.approx(1.2, abs=1e-3)
    assert answers["drift_air_deg_per_min.mag"].value == pytest.approx(0.6, abs=1e-3)
    assert answers["drift_air_deg_per_min.gnss_yaw"].code == "no_gnss"
    assert drift.AIR_DRIFT.ask(case, row, "rest") == {}


def test_time_that_is_not_scored_tells_no_drift_in_the_air():
    t, still = turning(0.0)
    row = flights.row(*turning(0.02))
    case = flights.case([row], REST, (t[::2], still[::2]), "truth", scoring_start=15.0)
    lost = (row.errors.t > 60.0) & (row.errors.t < 75.0)
    row.errors.heading[lost] += 40.0
    row.errors.scored[lost] = False
    answers = drift.AIR_DRIFT.ask(case, row, "airborne")
    assert answers["drift_air_deg_per_min.truth"].value == pytest.approx(1.2, abs=0.02)


@pytest.mark.parametrize(("pitch_deg", "known"), [(50.0, True), (70.0, False), (-70.0, False)])
def test_a_nose_that_points_up_or_down_has_no_heading(pitch_deg, known):
    t = np.arange(0.0, 10.0, 0.02)
    row = flights.row(t, rotation.from_euler(0.0, np.radians(pitch_deg), 0.3 + 0.0 * t))
    compass = HeadingReference("mag", t[::5], np.degrees(0.3) + 0 * t[::5], np.zeros(len(t[::5]), np.int64), "compass")
    error, _ = drift.heading_error(row, compass)
    assert np.isfinite(error).all() if known else np.isnan(error).all()


def test_the_heading_reference_is_not_measured_against_itself():
    t, still = turning(0.0)
    row = flights.row(t, still, "onboard")
    row.kind = "onboard"
    case = flights.case([row], REST, (t[::2], still[::2]), "onboard")
    assert drift.AIR_DRIFT.ask(case, row, "airborne")["drift_air_deg_per_min.onboard"].code == "not_applicable"


def test_a_refused_attitude_is_no_heading_reference_and_every_comparison_says_why():
    t, still = turning(0.0)
    row = flights.row(t, still)
    case = flights.case([row], REST)
    case.reference.faults.reference = "ATT disagrees with gravity at rest by 30 deg"
    case.reference.faults.refused = {"onboard": case.reference.faults.reference}
    answers = metrics.compute(case, row, ["all"])["all"]
    for name in ("drift_air_deg_per_min.onboard", "lag_ms", "tilt_rmse_deg", "coverage_pct"):
        assert answers[name].code == "no_reference"
        assert answers[name].reason == case.reference.faults.reference


def test_every_rest_is_listed_with_its_drift_or_what_it_lacks():
    """20 s after the filter's start and 5 s after the motors' stop do not count; 8 s must remain."""
    t = np.arange(0.0, 200.0, 0.02)
    row = flights.row(t, rotation.from_euler(0.0, 0.0, np.radians(0.02) * t))
    rests = [Segment("rest.long", 0, 40), Segment("rest.long", 100, 120), Segment("rest.long", 150, 160)]
    phases = [Segment("continuous", 0, 200), Segment("armed", 40, 100), Segment("armed", 120, 150), *rests]
    answer = drift.REST_DRIFT.ask(flights.case([row], phases), row, "rest")["drift_rest_deg_per_min"]
    assert [(r.t0, r.t1, r.usable_s) for r in answer.records] == [(0, 40, 20), (100, 120, 15), (150, 160, 5)]
    assert [r.value for r in answer.records] == [pytest.approx(1.2), pytest.approx(1.2), None]
    assert answer.records[2].reason == "5 s after settling; 8 are needed"
    assert answer.value == pytest.approx(1.2)
    assert answer.seconds == pytest.approx(35.0, abs=1.1)


@pytest.mark.parametrize("missed", ["begins late", "has no numbers there"])
def test_a_row_that_lacks_one_of_several_rests_tells_no_drift_of_the_others(missed):
    """A gyro bias that changes in flight shows in one rest of two: half of it is no drift at rest."""
    t = np.arange(0.0, 200.0, 0.02)
    row = flights.row(t, rotation.from_euler(0.0, 0.0, np.radians(0.02) * t))
    rests = [Segment("rest.long", 0, 60), Segment("rest.long", 140, 200)]
    phases = [Segment("continuous", 0, 200), Segment("armed", 60, 140), *rests]
    assert drift.REST_DRIFT.ask(flights.case([row], phases), row, "rest")["drift_rest_deg_per_min"].value
    if missed == "begins late":
        late = flights.row(t[t > 100], row.q[t > 100], start=100.0)
    else:
        late = flights.row(t, np.where(((t > 25) & (t < 55))[:, None], np.nan, row.q))
    answer = drift.REST_DRIFT.ask(flights.case([late], phases), late, "rest")["drift_rest_deg_per_min"]
    assert (answer.value, answer.code) == (None, "not_covered")
    assert "1 of 2 rests" in answer.reason
    assert [r.value for r in answer.records] == [None, pytest.approx(1.2)]


def test_rests_that_are_all_too_short_tell_the_longest_and_the_turn_between_them():
    t = np.arange(0.0, 100.0, 0.02)
    row = flights.row(t, rotation.from_euler(0.0, 0.0, np.radians(3.0) * (t > 50)))
    phases = [
        Segment("continuous", 0, 100),
        Segment("armed", 26, 80),
        Segment("rest.long", 0, 26),
        Segment("rest.long", 80, 91),
    ]
    answer = drift.REST_DRIFT.ask(flights.case([row], phases), row, "rest")["drift_rest_deg_per_min"]
    assert answer.code == "rest_too_short"
    assert "6 s after settling; 8 are needed" in answer.reason
    assert "the heading turned by +3.0 deg" in answer.reason
    assert len(answer.records) == 2


def test_a_restart_settles_anew():
    t = np.arange(0.0, 80.0, 0.02)
    row = flights.row(t, rotation.from_euler(0.0, 0.0, np.zeros(len(t))))
    row.segment = (t > 40).astype(np.int64)
    phases = [Segment("continuous", 0, 80), Segment("rest.long", 0, 80)]
    case = flights.case([row], phases)
    ((_, usable),) = drift.usable_rests(case, row, "rest")
    assert usable == ((20.0, pytest.approx(40.02, abs=0.021)), (pytest.approx(60.02, abs=0.021), 80.0))


def test_a_reset_of_the_onboard_attitude_at_rest_is_no_drift():
    t = np.arange(0.0, 60.0, 0.02)
    heading = np.where(t < 32.3, 0.0, np.radians(15.0))
    q = rotation.from_euler(0 * t, 0 * t, heading)
    onboard = Track("onboard", "onboard", t, q, np.zeros(len(t), np.int64), uses_mag=True, estimator="ATT")
    rest = Segment("rest.long", 0.0, 60.0)
    cut = flights.case([onboard], [rest, Segment("reset", 32.28, 32.3)])
    cut.log.attitudes["ATT"] = Attitude(t, q, "ATT")
    cut.log.onboard = "ATT"
    blocks = drift.rest_blocks(cut, onboard, ((0.0, 60.0),))
    assert abs(drift.fit_drift(blocks).value) < 1e-6
    uncut = flights.case([onboard], [rest])
    uncut.log.attitudes, uncut.log.onboard = cut.log.attitudes, "ATT"
    assert drift.fit_drift(drift.rest_blocks(uncut, onboard, ((0.0, 60.0),))).value > 1.0


def test_the_line_that_is_drawn_is_the_least_squares_line_with_an_offset_for_each_segment():
    """By numpy: one slope, and a column of ones for each segment."""
    t = np.arange(0.0, 120.0, 0.02)
    segment = np.searchsorted([50.0, 90.0], t, side="right")
    e = 3.0 / 60.0 * t + np.array([5.0, -20.0, 40.0])[segment] + np.random.default_rng(8).standard_normal(len(t))
    blocks = drift.block_means(t, e, segment)
    design = np.column_stack([blocks.t, *(blocks.segment == s for s in np.unique(blocks.segment))])
    wanted = design @ np.linalg.lstsq(design, blocks.e, rcond=None)[0]
    np.testing.assert_allclose(drift.drift_line(blocks), wanted, atol=1e-9)


def test_records_of_unequal_length_are_pooled_by_their_length():
    """Values 1 and 2 over 60 and 20 s, with their own scatter: the closed forms of a weighted mean."""
    from scipy import stats

    one, two = np.array([0.6, 1.4, 1.0, 0.8, 1.2]), np.array([1.5, 2.5, 2.2, 1.8])
    records = [
        drift.Drift(float(np.mean(x)), statistics.mean_interval(x), x, [(0.0, 1.0)] * len(x), seconds)
        for x, seconds in ((one, 60.0), (two, 20.0))
    ]
    found = drift.pool_drifts(records)
    variance = np.array([stats.sem(one) ** 2, stats.sem(two) ** 2])
    weight = np.array([0.75, 0.25])
    total = weight**2 @ variance
    dof = total**2 / np.sum((weight**2 * variance) ** 2 / [4, 3])
    half = stats.t.ppf(0.975, dof) * np.sqrt(total)
    centre = np.sum([1.0, 2.0] / variance) / np.sum(1.0 / variance)
    agree = np.sum((np.array([1.0, 2.0]) - centre) ** 2 / variance) <= stats.chi2.ppf(0.95, 1)
    assert found.agree == agree
    assert found.value == pytest.approx(1.25)
    assert found.seconds == 80.0
    assert found.range == (1.0, 2.0)
    wanted = (1.25 - half, 1.25 + half) if agree else (records[0].ci95[0], records[1].ci95[1])
    assert found.ci95 == pytest.approx(wanted, rel=1e-6)
    wide = [
        drift.Drift(v, statistics.mean_interval(x), x, [(0.0, 1.0)] * 4, s, 0.1)
        for v, x, s in ((1.0, np.array([-1.0, 3.0, 0.0, 2.0]), 60.0), (2.0, np.array([0.0, 4.0, 1.0, 3.0]), 20.0))
    ]
    pooled = drift.pool_drifts(wide)
    sem = stats.sem([-1.0, 3.0, 0.0, 2.0])
    spread = np.sqrt(np.sum(weight**2)) * sem
    nu = np.sum(weight**2) ** 2 / np.sum(weight**4 / 3)
    assert pooled.agree
    assert pooled.ci95[1] - pooled.value == pytest.approx(stats.t.ppf(0.975, nu) * spread, rel=1e-6)


NAME = "drift_air_deg_per_min.smoother"


def test_a_smoother_that_may_be_off_by_half_a_degree_may_drift_by_as_much_over_the_record() -> None:
    """Two sigma of 0.5 deg over 60 s: 1 deg/min either way of a row that never leaves it."""
    t = np.arange(0.0, 60.0, 0.02)
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    row = flights.row(t, q)
    case = flights.case([row], [Segment("continuous", 0, 60), Segment("airborne", 0, 60)], (t, q), kind="smoother")
    case.reference.sigma = ReferenceSigma(*np.full((2, len(t)), 0.5))
    answer = drift.compute_air_drift(case, row, "airborne")[NAME]
    assert answer.value == pytest.approx(0.0, abs=1e-6)
    assert answer.ci95 == pytest.approx((-1.0, 1.0), rel=0.05)


# On simulated flights: a drift that is told goes the way the error against truth goes, and a bound holds.

LOGS = ("ardupilot/copter_long.bin", "ardupilot/copter_static_hop.bin", "px4/px4_static.ulg", "px4/px4_long.ulg")


@pytest.mark.slow
@pytest.mark.parametrize("name", LOGS)
def test_told_drifts_at_rest_have_the_sign_of_the_error_against_truth_and_bounds_hold(corpus, name):
    """The straight line through the error against truth over each usable rest, by numpy, is the outside answer."""
    case = trial_of(corpus / "sitl" / name, "gyro,mahony,madgwick,complementary")
    told = 0
    for row in (r for r in case.rows if r.kind == "replay"):
        answer = drift.REST_DRIFT.ask(case, row, "rest")["drift_rest_deg_per_min"]
        usable = [spans for _, spans in drift.usable_rests(case, row, "rest")]
        for record, spans in zip(answer.records, usable, strict=True):
            if record.value is None or record.ci95 is None:
                continue
            against, tilt = against_truth(case, row, spans[0])
            if tilt > 5.0:
                continue  # of an attitude that has tipped over, "heading" is a matter of definition
            if not record.ci95[0] <= 0.0 <= record.ci95[1]:
                told += 1
                assert np.sign(record.value) == np.sign(against), (row.name, record)
            assert abs(against) <= 1.05 * max(map(abs, record.ci95)) + 0.1, (row.name, record)
    assert told >= 1, "without a magnetometer every filter drifts"


def against_truth(case, row, span):
    """Least-squares slope in deg/min of the row's heading error over a span, and its largest tilt error."""
    t, q = case.log.truth.t, case.log.truth.q
    inside = (t >= span[0]) & (t <= span[1])
    e = rotation.earth_error(rotation.slerp(row.t, row.q, t[inside]), q[inside])
    slope = np.polyfit(t[inside], np.unwrap(rotation.heading_angle(e)), 1)[0]
    return 60.0 * np.degrees(slope), np.degrees(rotation.tilt_angle(e)).max()
