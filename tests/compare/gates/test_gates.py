"""Gates on documents made by hand: what passes, what fails, what is skipped, and who is asked."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.compare.gates.baseline import Baseline, BaselineResult
from attlog.compare.gates.gates import Gate, Gates, judge
from attlog.compare.gates.limits import GateLimit, at_least, judged
from attlog.compare.gates.outcome import GateOutcome
from attlog.metrics.answer import Answer, missing
from attlog.metrics.statistics.units import UnitValues, ids_of
from attlog.result import EstimatorRow
from tests.compare.made import result
from tests.present.made import Metrics, lag, merged, noise, row, tilt

AIR = "airborne"


def outcomes(gate: Gate | list[Gate], *rows: EstimatorRow, strict: bool = False) -> list[GateOutcome]:
    gates = gate if isinstance(gate, list) else [gate]
    return judge(Gates(tuple(gates), strict), result(*rows))


def failed(found: list[GateOutcome]) -> list[GateOutcome]:
    return [o for o in found if o.status == "failed"]


def at_most(value: float, metric: str = "inclination_rmse_deg", **more: Any) -> Gate:
    return Gate(metric, (GateLimit("max", value),), **more)


def named(found: list[GateOutcome]) -> dict[str, str]:
    return {o.row: o.status for o in found}


@pytest.mark.parametrize(("limit", "status"), [(2.01, "passed"), (2.0, "passed"), (1.99, "failed")])
def test_a_value_may_reach_its_maximum_and_not_exceed_it(limit: float, status: str) -> None:
    (found,) = outcomes(at_most(limit, window=AIR), row("mekf", tilt(2.0)))
    assert (found.status, found.row, found.window, found.value) == (status, "mekf", AIR, 2.0)
    assert found.check == f"inclination_rmse_deg@airborne max={limit:g}"


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
    gate = Gate("inclination_rmse_deg", (GateLimit("max_ratio_to_onboard", 1.5),), filters=("a",))
    (sound,) = outcomes(gate, row("onboard", tilt(1.0), kind="onboard"), row("a", tilt(1.2)))
    lost = row("onboard", tilt(1.0), kind="onboard", status=status, reason="tilt error above 30 deg")
    (found,) = outcomes(gate, lost, row("a", tilt(1.2)))
    assert (sound.status, found.status, found.cause) == ("passed", "failed", "unanswered")
    assert "above 30 deg" in found.sentence


def test_limits_beside_the_onboard_attitude() -> None:
    onboard = row("onboard", merged(tilt(1.0), lag(-2.0)), kind="onboard")
    ratio, above = GateLimit("max_ratio_to_onboard", 1.5), GateLimit("max_above_onboard", 3.0)
    for value, status in ((1.49, "passed"), (1.51, "failed")):
        gate = Gate("inclination_rmse_deg", (ratio,))
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
    units = UnitValues("mean_square", ids_of(5.0 * np.arange(n)), squares)
    return Answer(rmse, "deg", AIR, n, 5.0 * n, (0.6 * rmse, 1.7 * rmse), units=units)


def beside(now: Answer, before: Answer, limit: GateLimit, *, same_log: bool = True) -> str:
    """The status of a row whose baseline is the same row of another run."""
    metric = "inclination_rmse_deg"
    old = result(row("a", {AIR: {metric: before}}))

    class One(Baseline):
        def of(self, log: Any) -> BaselineResult | str:
            return BaselineResult(old, same_log)

    gate = Gate(metric, (limit,), baseline=Path("x"))
    (found,) = judge(Gates((gate,), False), result(row("a", {AIR: {metric: now}})), {Path("x"): One("x")})
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
    least = at_least(now, before, "low", same_log=True)
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
        return judged(
            GateLimit("baseline", 0.0), "inclination_p95_deg", "low", p95[0], p95[1], decided=(rmse[0], rmse[1])
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
        assert judged(limit, "overshoot_pct", "zero", a, b, same_log=same).passed == passed


def test_a_baseline_without_the_log_or_the_row_leaves_a_gate_unanswered() -> None:
    gate = Gate("lag_ms", (GateLimit("baseline", 0.0),), baseline=Path("main.json"))
    now = result(row("a", lag(1.0)), row("b", lag(1.0)))
    place = Baseline("main.json")
    (a, b) = judge(Gates((gate,), False), now, {Path("main.json"): place})
    assert (a.cause, b.cause) == ("unanswered", "unanswered")
    assert "main.json has no result of this log" in a.sentence
    spared = judge(Gates((replace(gate, optional=True),), False), now, {Path("main.json"): place})
    assert [o.status for o in spared] == ["skipped", "skipped"]


def test_the_excess_of_a_limit_of_zero_is_finite_only_at_zero() -> None:
    assert judged(GateLimit("max", 0.0), "lag_ms", "zero", Answer(0.0, "ms", AIR)).passed
    assert math.isinf(judged(GateLimit("max", 0.0), "lag_ms", "zero", Answer(1.0, "ms", AIR)).excess)


def test_the_row_of_the_baseline_bears_the_same_name_or_is_the_only_one_of_that_filter() -> None:
    def against(name: str, *before: EstimatorRow) -> GateOutcome:
        old = result(*before)

        class One(Baseline):
            def of(self, log: Any) -> BaselineResult | str:
                return BaselineResult(old, True)

        gate = Gate("lag_ms", (GateLimit("max_above_baseline", 0.5),), baseline=Path("x"))
        now = result(row(name, lag(1.0), estimator="mahony"))
        return judge(Gates((gate,), False), now, {Path("x"): One("x")})[0]

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
    assert found.sentence == f"a: inclination_rmse_deg {words}"


def test_ratios_and_differences_are_shown_apart_from_their_limit_too() -> None:
    onboard = row("onboard", merged(tilt(1.0), lag(0.0)), kind="onboard")
    (found,) = outcomes(
        Gate("inclination_rmse_deg", (GateLimit("max_ratio_to_onboard", 1.2),)), onboard, row("a", tilt(1.2034))
    )
    assert "1.203 times, at most 1.2 times" in found.sentence
    (found,) = outcomes(Gate("lag_ms", (GateLimit("max_above_onboard", 3.0),)), onboard, row("a", lag(3.0004)))
    assert "3.0004 ms, at most +3 ms" in found.sentence


def test_a_value_at_its_limit_passes_whatever_the_last_bit_of_the_product() -> None:
    assert 1.3 * 0.7 < 0.91
    limit, other = GateLimit("max_ratio_to_onboard", 1.3), Answer(0.7, "deg", "all")
    assert judged(limit, "total_rmse_deg", "low", Answer(0.91, "deg", "all"), other).passed
    assert not judged(limit, "total_rmse_deg", "low", Answer(0.91001, "deg", "all"), other).passed
