import numpy as np
import pytest
from scipy.signal import lfilter

from attlog import metrics, rotation
from attlog.flight.model import Attitude
from attlog.metrics import drift, drift_air, drift_rest, wander
from attlog.metrics.base import HeadingReference
from attlog.reference.model import Row
from attlog.segments.model import Segment
from tests.metrics import flights


def slope_of(t, e, segment=None):
    return drift.slope(drift.block_means(t, e, np.zeros(len(t), np.int64) if segment is None else segment))


def test_half_a_degree_per_minute_is_found_under_noise_and_two_resets():
    t = np.arange(0.0, 300.0, 0.005)
    segment = np.searchsorted([80.0, 210.0], t, side="right")
    rng = np.random.default_rng(4)
    e = 0.5 / 60.0 * t + rng.standard_normal(len(t)) + np.array([0.0, 12.0, -30.0])[segment]
    found = slope_of(t, e, segment)
    assert found.value == pytest.approx(0.5, abs=0.1)
    assert found.ci95[0] <= 0.5 <= found.ci95[1]
    assert found.ci95[1] - found.ci95[0] < 0.5


def test_a_reset_that_is_not_cut_would_count_as_drift():
    t = np.arange(0.0, 100.0, 0.02)
    segment = (t >= 52.0).astype(np.int64)
    e = np.where(segment == 1, 15.0, 0.0)
    assert slope_of(t, e, segment).value == pytest.approx(0.0, abs=1e-9)
    assert abs(slope_of(t, e).value) > 1.0


def test_a_heading_that_wraps_drifts_on():
    t = np.arange(0.0, 120.0, 0.02)
    e = (179.0 + 2.0 / 60.0 * t + 180.0) % 360.0 - 180.0
    assert slope_of(t, e).value == pytest.approx(2.0, abs=1e-6)


def heading_noise(kind, n, step, rng):
    white = rng.standard_normal(n)
    if kind == "white":
        return white
    if kind == "walk":
        return 0.1 * np.sqrt(step) * np.cumsum(white)
    a = np.exp(-step / 5.0)
    return lfilter([np.sqrt(1 - a * a)], [1, -a], white, zi=[a * rng.standard_normal()])[0]


def coverage(kind, seconds, runs, seed=5):
    step, rng, hits = 0.1, np.random.default_rng(seed), 0
    t = np.arange(0.0, seconds, step)
    for _ in range(runs):
        found = slope_of(t, 0.5 / 60.0 * t + heading_noise(kind, len(t), step, rng))
        hits += found.ci95[0] <= 0.5 <= found.ci95[1]
    return hits / runs


@pytest.mark.parametrize("kind", ["white", "coloured", "walk"])
def test_the_interval_covers_the_drift(kind):
    assert 0.85 <= coverage(kind, 60.0, 60) <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [20.0, 60.0, 119.0, 121.0, 300.0])
@pytest.mark.parametrize("kind", ["white", "coloured", "walk"])
def test_the_interval_covers_in_88_to_100_percent_of_200_runs(kind, seconds):
    assert 0.88 <= coverage(kind, seconds, 200) <= 1.0


def test_less_than_20_s_is_no_value():
    t = np.arange(0.0, 18.0, 0.02)
    found = drift.answer(slope_of(t, 0.01 * t), "rest", "rest")
    assert found.code == "record_too_short"
    assert "20 s" in found.reason


def test_a_wide_interval_is_shown_but_not_ranked():
    t = np.arange(0.0, 30.0, 0.02)
    e = 20.0 * np.sin(2 * np.pi * t / 25.0)
    found = drift.answer(slope_of(t, e), "airborne", "onboard")
    assert found.value is not None
    assert not found.ranked
    assert "not measurable" in found.reason


def test_a_rate_that_changes_steadily_is_told():
    t = np.arange(0.0, 240.0, 0.02)
    e = 1e-4 * t**2 + 1e-3 * np.random.default_rng(0).standard_normal(len(t))
    first, last = slope_of(t, e).changes
    assert first == pytest.approx(60 * 2e-4 * 20.0, rel=0.1)
    assert last == pytest.approx(60 * 2e-4 * 220.0, rel=0.1)
    assert slope_of(t, 0.01 * t + np.sin(t)).changes is None


def test_rests_that_agree_are_pooled_and_rests_that_do_not_span_their_range():
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 60.0, 0.02)
    same = [slope_of(t, 0.01 * t + 0.05 * rng.standard_normal(len(t))) for _ in range(3)]
    pooled = drift.together(same)
    assert pooled.notes["agree"]
    assert pooled.value == pytest.approx(0.6, abs=0.05)
    moved = slope_of(t, 0.11 * t + 0.05 * rng.standard_normal(len(t)))
    apart = drift.together([*same, moved])
    assert not apart.notes["agree"]
    assert apart.ci95[0] < 0.62
    assert apart.ci95[1] > 6.58
    assert not drift.answer(apart, "rest", "rest").ranked


REST = [
    Segment("continuous", 0, 100),
    Segment("rest.long", 0, 40),
    Segment("airborne", 45, 100),
    Segment("rest.long", 95, 96),
]


def turning(dps, seconds=100.0, hz=50.0):
    t = np.arange(0.0, seconds, 1.0 / hz)
    return t, rotation.from_euler(0.05, -0.1, 2.5 + np.radians(dps) * t)


def test_drift_at_rest_is_the_rows_own_turn_and_names_the_bias_it_implies():
    row = flights.row(*turning(0.03))
    row.bias = np.tile(np.radians([0.0, 0.0, 0.01]), (len(row.t), 1))
    answer = drift_rest.compute(flights.case([row], REST), row, "rest")["drift_rest_deg_per_min"]
    assert answer.value == pytest.approx(1.8, abs=1e-6)
    assert answer.detail["implied_bias_dps"] == pytest.approx(0.03)
    assert answer.detail["own_bias_z_dps"] == pytest.approx(0.01)


def test_drift_in_the_air_is_against_the_reference_and_each_heading_reference():
    t, still = turning(0.0)
    row = flights.row(*turning(0.02))
    case = flights.case([row], REST, (t[::2], still[::2]), "truth", scoring_start=15.0)
    segment = (t[::5] > 70).astype(np.int64)
    heading = np.degrees(2.5) + 0.01 * t[::5] + 9.0 * segment
    case.heading_references["mag"] = HeadingReference("mag", t[::5], heading, segment, "compass")
    answers = drift_air.compute(case, row, "airborne")
    assert answers["drift_air_deg_per_min.truth"].value == pytest.approx(1.2, abs=1e-3)
    assert answers["drift_air_deg_per_min.mag"].value == pytest.approx(0.6, abs=1e-3)
    assert answers["drift_air_deg_per_min.gnss_yaw"].code == "no_gnss"
    assert drift_air.compute(case, row, "rest") == {}


def test_the_heading_reference_is_not_measured_against_itself():
    t, still = turning(0.0)
    row = flights.row(t, still, "onboard")
    row.kind = "onboard"
    case = flights.case([row], REST, (t[::2], still[::2]), "onboard")
    assert drift_air.compute(case, row, "airborne")["drift_air_deg_per_min.onboard"].code == "not_applicable"


def test_a_refused_attitude_is_no_heading_reference_and_every_comparison_says_why():
    t, still = turning(0.0)
    row = flights.row(t, still)
    case = flights.case([row], REST)
    case.reference.fault = "ATT disagrees with gravity at rest by 30 deg"
    case.reference.refused = {"onboard": case.reference.fault}
    answers = metrics.compute(case, row, ["all"])["all"]
    for name in ("drift_air_deg_per_min.onboard", "lag_ms", "inclination_rmse_deg", "recovery_s"):
        assert answers[name].code == "no_reference"
        assert answers[name].reason == case.reference.fault


def test_wander_is_what_the_mean_drift_leaves():
    t, _ = turning(0.0)
    swing = np.radians(0.2) * np.sin(2 * np.pi * t / 6.0)
    row = flights.row(t, rotation.from_euler(0.0, 0.0, np.radians(0.05) * t + swing))
    answer = wander.compute(flights.case([row], REST), row, "rest")["wander_deg"]
    assert answer.value == pytest.approx(0.2 / np.sqrt(2), rel=0.1)
    assert answer.ci95[0] < answer.value < answer.ci95[1]


def test_too_short_records_say_the_time_that_is_missing():
    t = np.arange(0.0, 12.0, 0.1)
    short = drift.slope(drift.block_means(t, 0.01 * t, np.zeros(len(t), np.int64)))
    assert drift.answer(short, "rest", "rest").reason == "12 s of usable rest; 20 s are needed"
    t = np.arange(0.0, 30.0, 0.1)
    broken = drift.slope(drift.block_means(t, 0.01 * t, np.floor(t / 2).astype(np.int64)))
    assert "30 s of flight comparable with onboard in pieces too short" in drift.answer(broken, "all", "onboard").reason


def test_a_reset_of_the_onboard_attitude_at_rest_is_no_drift():
    t = np.arange(0.0, 60.0, 0.02)
    heading = np.where(t < 32.3, 0.0, np.radians(15.0))
    q = rotation.from_euler(0 * t, 0 * t, heading)
    onboard = Row("onboard", "onboard", t, q, np.zeros(len(t), np.int64), uses_mag=True, estimator="ATT")
    rest = Segment("rest.long", 0.0, 60.0)
    cut = flights.case([onboard], [rest, Segment("reset", 32.28, 32.3)])
    cut.log.attitudes["ATT"] = Attitude(t, q, "ATT")
    cut.log.onboard = "ATT"
    blocks = drift_rest.rest_blocks(cut, onboard, (0.0, 60.0))
    assert abs(drift.slope(blocks).value) < 1e-6
    uncut = flights.case([onboard], [rest])
    uncut.log.attitudes, uncut.log.onboard = cut.log.attitudes, "ATT"
    assert drift.slope(drift_rest.rest_blocks(uncut, onboard, (0.0, 60.0))).value > 1.0
