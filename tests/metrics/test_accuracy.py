"""Errors against the reference, and their intervals."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.core import rotation
from attlog.flight.model import Stream
from attlog.metrics import accuracy, ranking, statistics
from attlog.metrics.traces import onboard_bias
from attlog.reference.model import ReferenceSigma
from attlog.segments.model import Segment
from tests.metrics import flights

T = np.arange(0.0, 100.0, 0.02)
LEVEL = rotation.from_euler(0.0 * T, 0.0 * T, 0.7)
SEGMENTS = [Segment("continuous", 0, 100), Segment("airborne", 40, 100), Segment("hover", 60, 70)]


def answers(roll_deg, heading_deg=0.0, window="all", **fields):
    q = rotation.from_euler(np.radians(roll_deg) + 0 * T, 0 * T, 0.7 + np.radians(heading_deg) + 0 * T)
    row = flights.row(T, q, **fields)
    case = flights.case([row], SEGMENTS, (T[::5], LEVEL[::5]), scoring_start=15.0)
    return flights.ask(accuracy.METRIC_GROUPS, case, row, window)


def test_angles_are_told_apart_in_degrees():
    found = answers(3.0, -4.0)
    assert found["tilt_rmse_deg"].value == pytest.approx(3.0, abs=1e-6)
    assert found["heading_rmse_deg"].value == pytest.approx(4.0, abs=0.01)
    assert found["total_rmse_deg"].value == pytest.approx(5.0, abs=0.01)


def test_the_root_mean_square_shows_a_burst_and_the_95th_percentile_does_not():
    found = answers(np.where((T > 50) & (T < 51), 40.0, 0.5))
    assert found["tilt_p95_deg"].value == pytest.approx(0.5, abs=1e-6)
    assert found["tilt_rmse_deg"].value > 4.0


def test_the_window_and_the_scoring_start_decide_what_counts():
    error = np.where(T < 15, 90.0, np.where((T >= 60) & (T <= 70), 2.0, 1.0))
    assert answers(error)["tilt_p95_deg"].value == pytest.approx(2.0)
    assert answers(error, window="hover")["tilt_rmse_deg"].value == pytest.approx(2.0, abs=0.03)
    assert answers(error, window="20:30")["tilt_rmse_deg"].value == pytest.approx(1.0)
    assert answers(error, window="1:10")["tilt_rmse_deg"].code == "not_covered"


def test_a_handful_of_samples_is_no_evidence():
    assert answers(1.0, window="20:20.5")["total_rmse_deg"].code == "not_covered"
    short = answers(1.0, window="20:22")["total_rmse_deg"]
    assert short.value == pytest.approx(1.0)
    assert short.ci95 is None
    assert not short.ranked


@pytest.mark.parametrize("time_constant", [0.3, 3.0, 12.0, 40.0])
@pytest.mark.parametrize(("statistic", "truth"), [("rmse", 2**0.5), ("p95", 2.4477)])
def test_intervals_cover_the_value_of_a_first_order_process_whatever_its_time_constant(statistic, truth, time_constant):
    """Two such errors at right angles, as in tilt, for 120 s: the sizes of the Rayleigh distribution."""
    rng, hits = np.random.default_rng(2), 0
    for _ in range(100):
        x = np.hypot(*(flights.coloured(rng, 600, 0.2, 1.0, time_constant) for _ in range(2)))
        _, ci = statistics.ErrorSize(x, 120.0).of(statistic)
        hits += ci[0] <= truth <= ci[1]
    assert hits >= 92


@pytest.mark.parametrize("shared", [0.0, 1.0], ids=["independent", "shared"])
def test_an_error_against_a_reference_that_is_wrong_covers_the_true_one(shared):
    """A row with an error of its own, and one that has all of the reference's error beside a small one of its own."""
    t = np.arange(0.0, 100.0, 0.1)
    of_reference = np.radians(0.3) * np.sin(2 * np.pi * t / 41.0 + 0.3)
    own = np.radians(0.1 if shared else 2.0) * np.sin(2 * np.pi * t / 17.0)
    level, row_roll = rotation.from_euler(of_reference, 0 * t, 0 * t), shared * of_reference + own
    row = flights.row(t, rotation.from_euler(row_roll, 0 * t, 0 * t))
    case = flights.case([row], [Segment("continuous", 0, 100), Segment("airborne", 0, 100)], (t, level))
    with_sigma(case, 0.22, 0.22)
    seen = flights.ask(accuracy.METRIC_GROUPS, case, row, "airborne")
    low, high = seen["tilt_rmse_deg"].ci95
    assert low <= np.degrees(np.sqrt(np.mean(row_roll**2))) <= high
    if shared:
        assert seen["tilt_rmse_deg"].value < 0.5 * np.degrees(np.sqrt(np.mean(row_roll**2)))
        assert seen["tilt_rmse_deg"].ci95[0] == 0.0


def test_a_heading_whose_offset_was_removed_is_not_ranked_among_those_with_a_north():
    q = rotation.from_euler(0.01 + 0 * T, 0 * T, 0.7)
    rows = [flights.row(T, q, "gyro", heading_offset_deg=30.0), flights.row(T, q, "mahony")]
    case = flights.case(rows, SEGMENTS, (T[::5], LEVEL[::5]))
    assert not flights.ask(accuracy.METRIC_GROUPS, case, rows[0], "all")["heading_rmse_deg"].ranked
    assert flights.ask(accuracy.METRIC_GROUPS, case, rows[0], "all")["tilt_rmse_deg"].ranked
    alone = flights.case(rows[:1], SEGMENTS, (T[::5], LEVEL[::5]))
    assert flights.ask(accuracy.METRIC_GROUPS, alone, rows[0], "all")["heading_rmse_deg"].ranked


def test_without_a_reference_there_is_a_code():
    row = flights.row(T, LEVEL)
    assert (
        flights.ask(accuracy.METRIC_GROUPS, flights.case([row], SEGMENTS), row, "all")["total_rmse_deg"].code
        == "no_reference"
    )
    case = flights.case([row], SEGMENTS, (T, LEVEL), "onboard")
    row.is_reference = True
    assert flights.ask(accuracy.METRIC_GROUPS, case, row, "all")["total_rmse_deg"].code == "not_applicable"


def drifting_rows(tilts_deg, seconds=90.0, kind="truth"):
    """Rows whose tilt and heading are off by a wobble of the given size, against a level reference at 10 Hz."""
    t = np.arange(0.0, seconds, 0.1)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    rows = []
    for k, size in enumerate(tilts_deg):
        wobble = np.radians(size) * np.sin(2 * np.pi * t / 2.0 + k)
        rows.append(flights.row(t, rotation.from_euler(wobble, 0 * t, wobble), f"row{k}"))
    whole = [Segment("continuous", 0, seconds), Segment("airborne", 0, seconds)]
    return flights.case(rows, whole, (t, level), kind=kind, scoring_start=15.0), rows


def test_rows_are_compared_in_blocks_of_5_s_of_tilt_and_15_s_of_heading():
    case, rows = drifting_rows([1.0, 3.0])
    found = flights.ask(accuracy.METRIC_GROUPS, case, rows[0], "airborne")
    tilt, heading = found["tilt_rmse_deg"].units, found["heading_rmse_deg"].units
    assert tilt.ids.tolist() == [1000 * (15 + 5 * k) for k in range(15)][: len(tilt.ids)]
    assert (len(tilt.ids) in (14, 15), len(heading.ids) in (4, 5)) == (True, True)
    assert np.sqrt(tilt.values) == pytest.approx(1.0 / np.sqrt(2), rel=0.1)
    assert tilt.on(tilt.ids[:3]).value == pytest.approx(np.sqrt(tilt.values[:3].mean()))


def test_a_block_that_is_not_scored_or_half_empty_is_none():
    case, rows = drifting_rows([1.0, 3.0])
    e = rows[0].errors
    e.scored &= (e.t < 30.0) | (e.t > 32.0)
    assert 30_000 not in accuracy.block_units(case, rows[0], "airborne", "tilt").ids
    assert 25_000 in accuracy.block_units(case, rows[0], "airborne", "tilt").ids
    case.reference.scoring.unscored = [(40.0, 52.0)]
    ids = accuracy.block_units(case, rows[1], "airborne", "tilt").ids
    assert not ((ids > 35_000) & (ids < 52_000)).any()


@pytest.mark.parametrize(("kind", "ranked"), [("truth", True), ("smoother", True), ("onboard", False)])
def test_heading_errors_are_ranked_only_against_truth_or_smoother(kind, ranked):
    case, rows = drifting_rows([1.0, 3.0], kind=kind)
    found = flights.ask(accuracy.METRIC_GROUPS, case, rows[0], "airborne")
    for angle in ("heading", "total"):
        assert found[f"{angle}_rmse_deg"].ranked == ranked
    assert found["tilt_rmse_deg"].ranked


def with_sigma(case, tilt, heading):
    """The case with a smoother that says how wrong it may be."""
    reference = case.reference
    reference.kind = "smoother"
    reference.sigma = ReferenceSigma(*(np.full(len(reference.t), s) for s in (tilt, heading)))
    return case


def test_differences_below_the_sigma_of_a_smoother_tell_nobody_apart():
    """The same two rows, once against a smoother that is sure of itself and once against one that is not."""
    table = {}
    for sigma in (0.05, 0.5):
        case, rows = drifting_rows([1.0, 1.5])
        with_sigma(case, sigma, 2 * sigma)
        found = [flights.ask(accuracy.METRIC_GROUPS, case, row, "airborne") for row in rows]
        floors = [found[0][f"{angle}_rmse_deg"].floor for angle in ("tilt", "heading", "total")]
        assert floors == pytest.approx([sigma, 2 * sigma, np.sqrt(5) * sigma], rel=1e-6)
        column = {row.name: a["tilt_rmse_deg"] for row, a in zip(rows, found, strict=True)}
        table[sigma] = ranking.family(column, "low").significant
    assert table == {0.05: [("row0", "row1")], 0.5: []}


def test_the_sigma_of_the_window_counts_and_not_that_of_the_whole_log():
    case, rows = drifting_rows([1.0, 1.5])
    with_sigma(case, 0.1, 0.1)
    case.reference.sigma.tilt_deg[case.reference.t < 50.0] = 1.0
    assert flights.ask(accuracy.METRIC_GROUPS, case, rows[0], "60:80")["tilt_rmse_deg"].floor == pytest.approx(0.1)


@pytest.mark.parametrize(("heading_by", "code"), [("own", None), ("onboard", None), ("none", "no_reference")])
def test_whose_heading_a_smoother_has_decides_what_heading_errors_mean(heading_by, code):
    case, rows = drifting_rows([1.0, 3.0])
    with_sigma(case, 0.1, 0.1)
    case.reference.heading.by, case.reference.heading.why = heading_by, "the smoother's own heading sigma is 4.0 deg"
    found = flights.ask(accuracy.METRIC_GROUPS, case, rows[0], "airborne")
    for angle in ("heading", "total"):
        answer = found[f"{angle}_rmse_deg"]
        assert answer.code == code
        assert answer.ranked == (heading_by == "own")
    assert found["tilt_rmse_deg"].ranked
    rows[1].heading_shared = heading_by == "onboard"
    shared = flights.ask(accuracy.METRIC_GROUPS, case, rows[1], "airborne")["heading_rmse_deg"]
    assert (shared.code == "not_applicable") == (heading_by == "onboard")


def test_a_row_made_as_the_reference_is_not_ranked_against_it():
    case, rows = drifting_rows([1.0, 3.0])
    with_sigma(case, 0.1, 0.1)
    rows[0].estimator = "smoother"
    assert not flights.ask(accuracy.METRIC_GROUPS, case, rows[0], "airborne")["tilt_rmse_deg"].ranked
    assert flights.ask(accuracy.METRIC_GROUPS, case, rows[1], "airborne")["tilt_rmse_deg"].ranked


def test_a_record_of_few_blocks_has_a_value_and_no_rank():
    case, rows = drifting_rows([1.0, 3.0], seconds=31.0)
    found = flights.ask(accuracy.METRIC_GROUPS, case, rows[0], "airborne")
    for name in ("tilt_rmse_deg", "heading_rmse_deg"):
        assert found[name].value > 0
        assert (found[name].ranked, "too short to rank" in found[name].reason) == (False, True)


def test_the_95th_percentile_is_not_known_better_than_the_size_of_the_errors():
    rng = np.random.default_rng(4)
    for level in np.exp(0.7 * rng.standard_normal((40, 6))):
        size = statistics.ErrorSize(np.abs(np.repeat(level, 250) * rng.standard_normal(1500)), 30.0)
        value, (low, high) = size.of("p95")
        whole, (least, most) = size.of("rmse")
        assert low / value <= least / whole * (1 + 1e-9)
        assert high / value >= most / whole * (1 - 1e-9)
        assert low < value < high


def test_a_burst_does_not_make_the_error_ten_times_larger():
    x = np.concatenate([np.full(100, 10.0), np.full(900, 0.01)])
    value, (low, high) = statistics.ErrorSize(x, 100.0).of("rmse")
    assert high == pytest.approx(3.0 * value)
    assert low < 0.2 * value


def test_no_interval_of_an_error_ends_beyond_half_a_turn():
    angle = np.concatenate([np.full(100, 170.0), np.full(300, 1.0)])
    for name in ("rmse", "p95"):
        value, ci95 = statistics.ErrorSize(angle, 20.0).of(name)
        assert ci95[0] <= value <= ci95[1] == 180.0


ONBOARD_T = np.arange(0.0, 20.0, 0.01)
Q = np.tile([1.0, 0.0, 0.0, 0.0], (len(ONBOARD_T), 1))


def test_it_is_drawn_in_deg_per_s_at_its_own_times_with_the_onboard_row_only():
    case = flights.case([], [])
    onboard, other = flights.row(ONBOARD_T, Q, "onboard"), flights.row(ONBOARD_T, Q, "filter")
    assert onboard_bias(case, onboard) == []
    x = np.array([[0.01, -0.02, 0.03], [0.02, -0.02, 0.03]])
    case.log.estimator.gyro_bias = Stream(np.array([3.0, 4.0]), x, "rad/s", "FRD", "XKF1:0")
    (trace,) = onboard_bias(case, onboard)
    assert (trace.figure, trace.row) == ("bias", "onboard")
    np.testing.assert_array_equal(trace.t, [3.0, 4.0])
    for k, axis in enumerate("xyz"):
        np.testing.assert_allclose(trace.columns[axis], x[:, k] * 180.0 / np.pi)
    assert onboard_bias(case, other) == []


@pytest.mark.parametrize(
    ("kind", "refused", "ranked"),
    [("onboard", {"smoother": "off gravity"}, False), ("onboard", {}, True), ("truth", {"smoother": "x"}, True)],
)
def test_no_tilt_is_best_against_an_onboard_attitude_that_nothing_confirms(kind, refused, ranked):
    """The reference is off by 1.3 deg as one row is: that row agrees with it, the right one does not."""
    wrong = np.radians(1.3)
    rolls = {"right": 0.0, "wrong_alike": wrong + np.radians(0.3) * np.sin(T)}
    rows = [flights.row(T, rotation.from_euler(roll + 0 * T, 0 * T, 0.7), name=name) for name, roll in rolls.items()]
    case = flights.case(rows, SEGMENTS, (T[::5], rotation.from_euler(wrong + 0 * T[::5], 0 * T[::5], 0.7)), kind, 15.0)
    case.reference.faults.refused = refused
    table = {row.name: {"all": flights.ask(accuracy.METRIC_GROUPS, case, row, "all")} for row in rows}
    found = ranking.rank(table, rows, {m.name: m for group in accuracy.METRIC_GROUPS for m in group.metrics})
    for marks in (found.best, found.ranked):
        assert ("tilt_rmse_deg" in marks.get("all", {})) is ranked
    assert (
        (found.best["all"]["tilt_rmse_deg"] == ["wrong_alike"])
        if ranked
        else table["right"]["all"]["tilt_rmse_deg"].reason
    )
