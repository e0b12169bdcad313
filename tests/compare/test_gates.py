"""Gates on documents made by hand: what passes, what fails, what is skipped, and who is asked."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import attlog
from attlog import segments
from attlog.compare import gate_file
from attlog.compare.baseline import Baseline, BaselineResult, read_baselines
from attlog.compare.gates import (
    Gate,
    GateLimit,
    GateOutcome,
    Gates,
    SensorGate,
    judge_gates,
    judge_limit,
    judge_sensors,
    smallest_size,
)
from attlog.metrics.metric import Answer, missing
from attlog.metrics.statistics import UnitValues, make_ids
from attlog.result import EstimatorRow, Result
from tests.compare import faulty
from tests.compare.made import result
from tests.conftest import SAMPLES, few
from tests.health.made import MADE, OFFSET, REFUSED, SILENT, SOUND
from tests.words.made import Metrics, lag, merged, noise, row, tilt

AIR = "airborne"


def outcomes(gate: Gate | list[Gate], *rows: EstimatorRow, strict: bool = False) -> list[GateOutcome]:
    gates = gate if isinstance(gate, list) else [gate]
    return judge_gates(Gates(tuple(gates), strict), result(*rows))


def failed(found: list[GateOutcome]) -> list[GateOutcome]:
    return [o for o in found if o.status == "failed"]


def at_most(value: float, metric: str = "tilt_rmse_deg", **more: Any) -> Gate:
    return Gate(metric, (GateLimit("max", value),), **more)


def named(found: list[GateOutcome]) -> dict[str, str]:
    return {o.row: o.status for o in found}


@pytest.mark.parametrize(("limit", "status"), [(2.01, "passed"), (2.0, "passed"), (1.99, "failed")])
def test_a_value_may_reach_its_maximum_and_not_exceed_it(limit: float, status: str) -> None:
    (found,) = outcomes(at_most(limit, window=AIR), row("mekf", tilt(2.0)))
    assert (found.status, found.row, found.window, found.value) == (status, "mekf", AIR, 2.0)
    assert found.check == f"tilt_rmse_deg@airborne max={limit:g}"


@pytest.mark.parametrize(("value", "status"), [(-9.0, "failed"), (9.0, "failed"), (-4.0, "passed")])
def test_where_good_is_zero_the_absolute_value_counts(value: float, status: str) -> None:
    assert outcomes(at_most(5.0, "lag_ms"), row("mekf", lag(value)))[0].status == status


def test_a_minimum_is_not_to_be_fallen_short_of() -> None:
    gate = Gate("coverage_pct", (GateLimit("min", 95.0),))
    for value, status in ((96.0, "passed"), (95.0, "passed"), (94.0, "failed")):
        (found,) = outcomes(gate, row("mekf", {"all": {"coverage_pct": Answer(value, "%", "all")}}))
        assert (found.status, found.excess) == (status, pytest.approx(95.0 / value))


def test_without_filters_every_estimator_is_asked_but_neither_baselines_nor_onboard_nor_the_reference() -> None:
    rows = [
        row("onboard", tilt(9.0), kind="onboard"),
        row("mekf", tilt(1.0)),
        row("eskf", tilt(3.0)),
        row("gyro", tilt(9.0), estimator="gyro"),
        row("accel_mag/imu1", tilt(9.0), estimator="accel_mag"),
        row("smoother", tilt(0.0), is_reference=True),
    ]
    assert named(outcomes(at_most(2.0), *rows)) == {"eskf": "failed", "mekf": "passed"}
    assert named(outcomes(at_most(2.0, filters=("*",)), *rows)) == {"eskf": "failed", "mekf": "passed"}
    assert named(outcomes(at_most(2.0, filters=("onboard", "gyro")), *rows)) == {"onboard": "failed", "gyro": "failed"}
    assert named(outcomes(at_most(2.0, filters=("onb*", "accel_mag")), *rows)) == {
        "onboard": "failed",
        "accel_mag/imu1": "failed",
    }


def test_a_gate_without_filters_on_a_result_without_one_says_so() -> None:
    (found,) = outcomes(at_most(2.0), row("gyro", tilt(1.0), estimator="gyro"))
    assert (found.status, found.cause) == ("failed", "no_row")
    assert found.sentence == (
        "the result has no filter to be judged: the rows are gyro; name them under filters if they are meant"
    )


def test_patterns_name_rows_of_every_imu_and_a_pattern_without_a_row_fails_and_says_so() -> None:
    rows = [row("mekf/imu0", tilt(1.0)), row("mekf/imu1", tilt(1.0)), row("mahony@soft-1", tilt(3.0))]
    found = outcomes(at_most(2.0, filters=("mekf", "*@soft-*", "eskf")), *rows)
    assert named(found) == {"mekf/imu0": "passed", "mekf/imu1": "passed", "mahony@soft-1": "failed", "eskf": "failed"}
    (lost,) = [o for o in found if o.cause == "no_row"]
    assert "no row is called eskf; the rows are mekf/imu0, mekf/imu1, mahony@soft-1" in lost.sentence


def test_a_gate_without_any_row_fails() -> None:
    assert [o.cause for o in failed(outcomes(at_most(2.0)))] == ["no_row"]
    assert [o.cause for o in failed(outcomes(at_most(2.0, optional=True), row("onboard", {}, kind="onboard")))]


@pytest.mark.parametrize("status", ["diverged", "failed"])
@pytest.mark.parametrize("optional", [False, True])
def test_a_row_that_diverged_or_failed_fails_whatever_its_numbers(status: str, optional: bool) -> None:
    lost = row("mekf", tilt(0.1), status=status, reason="tilt error above 30 deg")
    (found,) = outcomes(at_most(2.0, optional=optional), lost)
    assert (found.status, found.cause) == ("failed", "row")
    assert "above 30 deg" in found.sentence


def test_an_unanswered_metric_fails_and_an_optional_one_is_skipped_never_passed() -> None:
    silent: Metrics = {AIR: {"lag_ms": missing("no_events", "no step; 3 are needed", "ms", AIR)}}
    for metrics in (silent, {AIR: {}}, {}):
        assert [o.status for o in outcomes(at_most(5.0, "lag_ms", window=AIR), row("a", metrics))] == ["failed"]
        skipped = outcomes(at_most(5.0, "lag_ms", window=AIR, optional=True), row("a", metrics))
        assert [(o.status, o.cause) for o in skipped] == [("skipped", "unanswered")]
    assert "no step" in outcomes(at_most(5.0, "lag_ms"), row("a", silent))[0].sentence


def test_numbers_of_a_log_that_cannot_judge_are_no_answer() -> None:
    blind = row("a", tilt(0.1), status="not_judged", reason="the accelerometer stands still")
    assert outcomes(at_most(2.0), blind)[0].cause == "unanswered"
    assert "stands still" in outcomes(at_most(2.0), blind)[0].sentence


def test_without_a_window_the_first_of_the_metrics_own_counts() -> None:
    both = merged(tilt(1.0), tilt(9.0, window="all"), noise(0.5), noise(0.1, "hover"))
    assert outcomes(at_most(2.0), row("a", both))[0].window == AIR
    assert outcomes(at_most(2.0), row("a", tilt(1.0, window="all")))[0].window == "all"
    (quiet,) = outcomes(at_most(0.2, "noise_tilt_deg"), row("a", both))
    assert (quiet.window, quiet.status) == ("rest", "failed")
    assert outcomes(at_most(0.2, "noise_tilt_deg"), row("a", noise(0.1, "hover")))[0].cause == "unanswered"


def test_a_window_that_was_not_analysed_says_how() -> None:
    (found,) = outcomes(at_most(2.0, window="20:30"), row("a", tilt(1.0)))
    assert (found.status, "analyse with --window 20:30" in found.sentence) == ("failed", True)


@pytest.mark.parametrize("status", ["diverged", "failed"])
def test_an_onboard_attitude_that_is_lost_is_no_measure_for_others(status: str) -> None:
    """1.2 deg is within 1.5 times the onboard attitude's 1.0 deg, but that attitude itself was lost."""
    gate = Gate("tilt_rmse_deg", (GateLimit("max_ratio_to_onboard", 1.5),), filters=("a",))
    (sound,) = outcomes(gate, row("onboard", tilt(1.0), kind="onboard"), row("a", tilt(1.2)))
    lost = row("onboard", tilt(1.0), kind="onboard", status=status, reason="tilt error above 30 deg")
    (found,) = outcomes(gate, lost, row("a", tilt(1.2)))
    assert (sound.status, found.status, found.cause) == ("passed", "failed", "unanswered")
    assert "above 30 deg" in found.sentence


def test_limits_beside_the_onboard_attitude() -> None:
    onboard = row("onboard", merged(tilt(1.0), lag(-2.0)), kind="onboard")
    ratio, above = GateLimit("max_ratio_to_onboard", 1.5), GateLimit("max_above_onboard", 3.0)
    for value, status in ((1.49, "passed"), (1.51, "failed")):
        gate = Gate("tilt_rmse_deg", (ratio,))
        assert outcomes(gate, onboard, row("a", tilt(value)))[0].status == status
    for value, status in ((4.9, "passed"), (-5.1, "failed")):
        assert outcomes(Gate("lag_ms", (above,)), onboard, row("a", lag(value)))[0].status == status
    reference = row("onboard", {}, kind="onboard", is_reference=True)
    for rows in ((), (reference,), (row("onboard", {}, kind="onboard"),)):
        (found,) = outcomes(Gate("lag_ms", (above,)), *rows, row("a", lag(0.0)))
        assert (found.status, found.cause) == ("failed", "unanswered")
        assert ("is the reference itself" in found.sentence) == (rows == (reference,))


def test_strict_gates_fail_rows_that_nobody_asks() -> None:
    rows = [
        row("a", tilt(1.0)),
        row("plug", {}, status="failed", reason="ImportError"),
        row("gyro", {}, estimator="gyro", status="diverged"),
        row("onboard:AHR2", {}, kind="onboard", status="diverged"),
    ]
    asked = at_most(2.0, filters=("a",))
    assert failed(outcomes(asked, *rows)) == []
    (found,) = failed(outcomes(asked, *rows, strict=True))
    assert (found.row, found.check, "ImportError" in found.sentence) == ("plug", "status", True)


def test_worst_first() -> None:
    rows = [row("a", tilt(3.0)), row("b", tilt(9.0)), row("c", tilt(1.0)), row("d", {}), row("e", {}, status="failed")]
    assert [o.row for o in outcomes(at_most(2.0), *rows)] == ["e", "b", "a", "d", "c"]


def blocks(rmse: float, spread: float = 0.2, n: int = 24, seed: int = 0) -> Answer:
    """An RMSE of blocks that scatter; the same seed gives the same blocks but for their size."""
    squares = np.exp(spread * np.random.default_rng(seed).normal(size=n))
    squares *= rmse**2 / np.mean(squares)
    units = UnitValues("mean_square", make_ids(5.0 * np.arange(n)), squares)
    return Answer(rmse, "deg", AIR, n, 5.0 * n, (0.6 * rmse, 1.7 * rmse), units=units)


def beside(now: Answer, before: Answer, limit: GateLimit, *, same_log: bool = True) -> str:
    """The status of a row whose baseline is the same row of another run."""
    metric = "tilt_rmse_deg"
    old = result(row("a", {AIR: {metric: before}}))

    class One(Baseline):
        def of(self, log: Any) -> BaselineResult | str:
            return BaselineResult(old, same_log)

    gate = Gate(metric, (limit,), baseline=Path("x"))
    (found,) = judge_gates(Gates((gate,), False), result(row("a", {AIR: {metric: now}})), {Path("x"): One("x")})
    return found.status


def test_on_the_same_log_a_small_steady_change_is_told_where_the_intervals_of_each_could_not() -> None:
    worse = GateLimit("baseline", 0.0)
    assert beside(blocks(1.1), blocks(1.0), worse) == "failed"
    assert beside(blocks(1.1), blocks(1.0), worse, same_log=False) == "passed"  # 0.66 to 1.87 beside 0.6 to 1.7
    assert beside(blocks(9.0), blocks(1.0), worse, same_log=False) == "failed"
    assert beside(blocks(1.0), blocks(1.1), worse) == "passed"
    assert beside(blocks(1.01), blocks(1.0), worse) == "passed"  # up to 2 % means nothing


def test_scatter_from_block_to_block_fails_no_build() -> None:
    worse, ratio = GateLimit("baseline", 0.0), GateLimit("max_ratio_to_baseline", 1.05)
    for limit in (worse, ratio):
        noisy = [beside(blocks(1.1, 1.5, 12, k), blocks(1.0, 1.5, 12, 100 + k), limit) for k in range(20)]
        assert noisy.count("failed") <= 2


def test_beyond_a_limit_it_is_enough_that_the_change_is_told_from_none() -> None:
    before, scatter = blocks(1.0), np.exp(0.5 * np.random.default_rng(1).normal(size=24))
    assert before.units is not None
    squares = before.units.values * scatter
    squares *= 1.3**2 / np.mean(squares)
    units = UnitValues("mean_square", before.units.ids, squares)
    now = Answer(1.3, "deg", AIR, 24, 120.0, (0.8, 2.1), units=units)
    least = smallest_size(now, before, "low", same_log=True)
    assert least is not None
    assert 1.05 < least < 1.25
    assert beside(now, before, GateLimit("max_ratio_to_baseline", 1.25)) == "failed"
    assert beside(now, before, GateLimit("max_above_baseline", 0.25)) == "failed"


def test_limits_beside_a_baseline() -> None:
    now, before = blocks(1.3), blocks(1.0)
    assert beside(now, before, GateLimit("max_ratio_to_baseline", 1.31)) == "passed"
    assert beside(now, before, GateLimit("max_ratio_to_baseline", 1.29)) == "failed"
    assert beside(now, before, GateLimit("max_above_baseline", 0.31)) == "passed"
    assert beside(now, before, GateLimit("max_above_baseline", 0.29)) == "failed"
    assert beside(blocks(0.9), before, GateLimit("max_ratio_to_baseline", 0.8)) == "failed"  # to be better is asked for
    assert beside(blocks(0.7), before, GateLimit("max_ratio_to_baseline", 0.8)) == "passed"


def test_a_percentile_is_told_by_its_root_mean_square() -> None:
    def status(now: float, spread: float) -> bool:
        p95 = [Answer(v, "deg", AIR, 24, 120.0, (0.5 * v, 2.0 * v)) for v in (2.0 * now, 2.0)]
        rmse = blocks(1.0, spread, seed=1), blocks(now, spread, seed=1 if spread < 1.0 else 2)
        return judge_limit(
            GateLimit("baseline", 0.0), "tilt_p95_deg", "low", p95[0], p95[1], decided=(rmse[0], rmse[1])
        ).passed

    assert not status(1.2, 0.2)
    assert status(1.2, 2.0)
    assert status(1.0, 0.2)


def test_without_intervals_the_size_decides_but_two_flights_tell_nothing_of_not_worse() -> None:
    a, b = Answer(2.0, "%", AIR), Answer(1.0, "%", AIR)
    for limit, same, passed in (
        (GateLimit("max_ratio_to_baseline", 1.5), True, False),
        (GateLimit("max_ratio_to_baseline", 1.5), False, False),
        (GateLimit("baseline", 0.0), True, False),
        (GateLimit("baseline", 0.0), False, True),
    ):
        assert judge_limit(limit, "overshoot_pct", "zero", a, b, same_log=same).passed == passed


def test_a_baseline_without_the_log_or_the_row_leaves_a_gate_unanswered() -> None:
    gate = Gate("lag_ms", (GateLimit("baseline", 0.0),), baseline=Path("main.json"))
    now = result(row("a", lag(1.0)), row("b", lag(1.0)))
    place = Baseline("main.json")
    (a, b) = judge_gates(Gates((gate,), False), now, {Path("main.json"): place})
    assert (a.cause, b.cause) == ("unanswered", "unanswered")
    assert "main.json has no result of this log" in a.sentence
    spared = judge_gates(Gates((replace(gate, optional=True),), False), now, {Path("main.json"): place})
    assert [o.status for o in spared] == ["skipped", "skipped"]


def test_the_excess_of_a_limit_of_zero_is_finite_only_at_zero() -> None:
    assert judge_limit(GateLimit("max", 0.0), "lag_ms", "zero", Answer(0.0, "ms", AIR)).passed
    assert math.isinf(judge_limit(GateLimit("max", 0.0), "lag_ms", "zero", Answer(1.0, "ms", AIR)).excess)


def test_the_row_of_the_baseline_bears_the_same_name_or_is_the_only_one_of_that_filter() -> None:
    def against(name: str, *before: EstimatorRow) -> GateOutcome:
        old = result(*before)

        class One(Baseline):
            def of(self, log: Any) -> BaselineResult | str:
                return BaselineResult(old, True)

        gate = Gate("lag_ms", (GateLimit("max_above_baseline", 0.5),), baseline=Path("x"))
        now = result(row(name, lag(1.0), estimator="mahony"))
        return judge_gates(Gates((gate,), False), now, {Path("x"): One("x")})[0]

    default, eager = row("mahony", lag(1.0)), row("mahony:kp=3", lag(9.0), estimator="mahony")
    assert against("mahony:kp=2", default).status == "passed"
    assert against("mahony", default, eager).status == "passed"
    assert "several rows like mahony:kp=2" in against("mahony:kp=2", default, eager).sentence
    assert "no row mahony" in against("mahony", row("mekf", lag(1.0))).sentence
    assert against("mahony/imu1", row("mahony/imu0", lag(1.0), estimator="mahony")).cause == "unanswered"


@pytest.mark.parametrize(
    ("value", "limit", "words"),
    [
        (7.84, 4.0, "7.8° (airborne), at most 4°"),
        (2.04, 2.0, "2.04° (airborne), at most 2°"),
        (2.0000004, 2.0, "2.0000004° (airborne), at most 2°"),
        (1.96, 2.0, "1.96° (airborne), at most 2°"),
        (2.0, 2.0, "2.0° (airborne), at most 2°"),
    ],
)
def test_a_value_is_shown_on_the_side_of_its_limit_that_it_is_on(value: float, limit: float, words: str) -> None:
    (found,) = outcomes(at_most(limit), row("a", tilt(value)))
    assert found.sentence == f"a: tilt_rmse_deg {words}"


def test_a_value_at_its_limit_passes_whatever_the_last_bit_of_the_product() -> None:
    assert 1.3 * 0.7 < 0.91
    limit, other = GateLimit("max_ratio_to_onboard", 1.3), Answer(0.7, "deg", "all")
    assert judge_limit(limit, "total_rmse_deg", "low", Answer(0.91, "deg", "all"), other).passed
    assert not judge_limit(limit, "total_rmse_deg", "low", Answer(0.91001, "deg", "all"), other).passed


# Gates of sensors: verdicts no worse than one, values within limits, and what cannot be told.


def statuses(gate: SensorGate) -> dict[str, str]:
    return {outcome.row: outcome.status for outcome in judge_sensors(gate, MADE)}


def test_a_value_is_held_against_its_limit_by_its_size():
    five, thirty = (GateLimit("max", value) for value in (5.0, 30.0))
    for value, limit, status in ((24.0, five, "failed"), (-24.0, five, "failed"), (-24.0, thirty, "passed")):
        (found,) = judge_sensors(SensorGate("compass_offset", (limit,)), [replace(OFFSET, value=value)])
        assert (found.status, found.value, found.allowed) == (status, value, limit.value)
    assert judge_sensors(SensorGate("compass_offset", (five,)), [OFFSET])[0].excess == 24.0 / 5.0


def test_a_least_value_is_asked_of_the_value_itself():
    few = replace(SOUND, question="gnss_quality", value=6.0, unit="")
    assert [o.status for o in judge_sensors(SensorGate("gnss_quality", (GateLimit("min", 8.0),)), [few])] == ["failed"]
    assert [o.status for o in judge_sensors(SensorGate("gnss_quality", (GateLimit("min", 6.0),)), [few])] == ["passed"]


def test_the_worst_verdict_allowed_is_allowed_and_no_worse_one():
    assert statuses(SensorGate("compass_offset", worst="warning")) == {"MAG.0": "passed"}
    assert statuses(SensorGate("compass_offset", worst="ok")) == {"MAG.0": "failed"}
    assert statuses(SensorGate("compass_motors", worst="warning")) == {"MAG.1": "failed"}
    assert statuses(SensorGate("vibration_level", worst="ok")) == {"IMU.0": "passed"}


def test_what_cannot_be_told_fails_unless_unknown_passes_and_is_never_counted_as_passed():
    for question in ("gnss_delay", "notch"):  # asked without an answer, and not asked
        strict, lenient = (SensorGate(question, worst="ok", unknown_passes=passes) for passes in (False, True))
        assert set(statuses(strict).values()) == {"failed"}
        assert set(statuses(lenient).values()) == {"skipped"}
    (found,) = judge_sensors(SensorGate("gnss_delay", (GateLimit("max", 1.0),)), [SILENT])
    assert found.excess == math.inf
    assert SILENT.text in found.sentence


def test_an_answer_without_a_number_keeps_no_limit():
    words = replace(REFUSED, value=None, verdict="ok")
    assert [o.status for o in judge_sensors(SensorGate("compass_motors", (GateLimit("max", 99.0),)), [words])] == [
        "failed"
    ]
    assert [o.status for o in judge_sensors(SensorGate("compass_motors", worst="ok"), [words])] == ["passed"]


def test_only_the_sensors_that_are_named_are_judged():
    both = [OFFSET, replace(OFFSET, sensor="MAG.1", value=1.0)]
    gate = SensorGate("compass_offset", (GateLimit("max", 5.0),), sensors=("MAG.1",))
    assert [(o.row, o.status) for o in judge_sensors(gate, both)] == [("MAG.1", "passed")]
    assert len(judge_sensors(replace(gate, sensors=("MAG.*",)), both)) == 2
    (missing,) = judge_sensors(replace(gate, sensors=("MAG.7",)), both)
    assert (missing.status, missing.row) == ("failed", "MAG.7")


def test_gates_of_sensors_stand_among_the_others_worst_first():
    result = Result({}, "", {}, {}, checks=list(MADE))
    gates = (SensorGate("vibration_level", worst="ok"), SensorGate("compass_offset", (GateLimit("max", 5.0),)))
    found = judge_gates(Gates(health=gates), result)
    assert [o.check for o in found] == ["health.compass_offset max=5", "health.vibration_level verdict=ok"]
    assert found[0].sentence == "MAG.0: compass_offset 24.0 µT, at most 5 µT"


# Flights made worse on purpose: each fault is caught by the gate meant for it, and by none of the others.

GATES = """
[gates]
lag_ms = { max = 5, filters = ["mekf"], optional = true }
step_error_pct.0.5s = { max = 2.5, filters = ["mekf"] }
drift_air_deg_per_min.truth = { max = 10, filters = ["mekf"] }
total_p95_deg = { max = 30, filters = ["mekf"] }
"""
LAG, STEP, DRIFT = "lag_ms max=5", "step_error_pct.0.5s max=2.5", "drift_air_deg_per_min.truth max=10"
TOTAL = "total_p95_deg max=30"
SAMPLE_FLIGHTS = ("px4_steps.ulg", "copter_steps_stabilize.bin")
FLIGHTS = (
    *SAMPLE_FLIGHTS,
    *(pytest.param(f"px4_{n}.ulg", marks=pytest.mark.slow) for n in ("yaw", "aggressive", "wind")),
)


def original(flight: str, request: pytest.FixtureRequest) -> Path:
    """A flight of the samples, else of the corpus."""
    sample = SAMPLES / flight
    return sample if sample.exists() else request.getfixturevalue("corpus") / "sitl" / "px4" / flight


def found(flight: Path, folder: Path, fault: str) -> list[GateOutcome]:
    """The gates that fail on a flight with a fault; a bias begins 5 s after take-off."""
    read = attlog.read(flight)
    start = read.t0_us / 1e6 + segments.build(read).of("airborne")[0].t0 + 5.0
    log = faulty.write(flight, folder / f"flight{flight.suffix}", fault, start)
    (folder / "gates.toml").write_text(GATES)
    result = attlog.analyze(log, {"estimators": ["mekf"], "reference": "truth"})
    return [o for o in judge_gates(gate_file.read_gates(folder / "gates.toml"), result) if o.status == "failed"]


@pytest.mark.parametrize("flight", few(FLIGHTS, 1))
@pytest.mark.parametrize(
    ("fault", "check"), few([("as it was", None), ("bias", DRIFT), ("delay", LAG), ("scale", STEP)], 2)
)
def test_a_fault_is_caught_by_its_gate_alone(
    request: pytest.FixtureRequest, tmp_path: Path, flight: str, fault: str, check: str | None
) -> None:
    outcomes = found(original(flight, request), tmp_path, fault)
    assert {(o.check, o.cause) for o in outcomes} == ({(check, "limit")} if check else set()), outcomes


@pytest.mark.parametrize("flight", few(FLIGHTS, 1))
def test_a_swapped_axis_is_a_row_that_is_lost_and_no_lag_step_or_drift(
    request: pytest.FixtureRequest, tmp_path: Path, flight: str
) -> None:
    outcomes = found(original(flight, request), tmp_path, "swap")
    assert {(o.row, o.cause) for o in outcomes} == {("mekf", "row")}
    assert "status" in {o.check for o in outcomes}
    assert all("diverged: heading error above 45 deg" in o.sentence for o in outcomes)


@pytest.mark.slow
def test_a_swapped_gyro_fails_every_gate_that_asks_and_its_axes_are_told(tmp_path: Path) -> None:
    outcomes = found(SAMPLES / "px4_steps.ulg", tmp_path, "swapped gyro")
    assert {STEP, DRIFT, TOTAL} <= {o.check for o in outcomes}
    assert all("the gyro's x is the attitude's y, y is the attitude's x" in o.sentence for o in outcomes)


@pytest.mark.slow
@pytest.mark.parametrize(("gain", "passes"), few([(0.501, True), (1.5, False)], 1), ids=["a hair", "three times"])
def test_a_changed_gain_is_paired_with_the_run_before(tmp_path: Path, gain: float, passes: bool) -> None:
    def run(kp: float) -> attlog.Result:
        settings = {"reference": "truth", "estimators": [f"mahony:kp={kp}"]}
        result = attlog.analyze(SAMPLES / "px4_steps.ulg", settings)
        result.estimators = [row for row in result.estimators if row.estimator == "mahony"]
        result.estimators[0].name = "mahony"
        return result

    run(0.5).to_json(tmp_path / "main.json")
    (tmp_path / "gates.toml").write_text('[gates]\nbaseline="main.json"\ntilt_rmse_deg={baseline=true}\n')
    read = gate_file.read_gates(tmp_path / "gates.toml")
    outcomes = judge_gates(read, run(gain), read_baselines(gate.baseline for gate in read.gates))
    assert [o.status for o in outcomes if o.check != "status"] == ["passed" if passes else "failed"], outcomes
