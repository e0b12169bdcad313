"""What a search makes small: weights, ratios to the default gains, and what is left out in turn."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.base.errors import UsageError
from attlog.compare.diff.tolerance import SMALLEST
from attlog.compare.sweep.many import SettingResult, SweptMetric
from attlog.compare.tune.folds import LogPart, folds, parts_of
from attlog.compare.tune.objective import UNSOUND, cost, objective
from attlog.metrics.answer import Answer, missing
from attlog.metrics.errors.rmse import of_blocks
from attlog.metrics.statistics.units import UnitValues, ids_of

TERMS = objective(["tilt=1,lag=3"])
TILT, LAG = (t.metric for t in TERMS)
DEG, MS = SMALLEST["deg"], SMALLEST["ms"]


def settled(tilt: float | None, lag: float, unsound: str = "") -> SettingResult:
    answer = missing("no_reference", "none", "deg", "all") if tilt is None else Answer(tilt, "deg", "all")
    return SettingResult({TILT: answer, LAG: Answer(lag, "ms", "all")}, "ok", unsound)


def test_the_cost_is_the_weighted_mean_of_log_ratios_over_the_parts() -> None:
    parts = [LogPart(0, "a"), LogPart(1, "b")]
    base = {0: settled(2.0, 4.0), 1: settled(1.0, -4.0)}
    now = {0: settled(1.0, -2.0), 1: settled(1.0, 8.0)}
    tilt = 0.5 * np.log((1 + DEG) / (2 + DEG))
    lag = 0.5 * (np.log((2 + MS) / (4 + MS)) + np.log((8 + MS) / (4 + MS)))
    assert cost(TERMS, parts, now, base) == pytest.approx((tilt + 3 * lag) / 4)
    assert cost(TERMS, parts, base, base) == 0.0


def test_a_setting_that_fails_costs_more_than_any_other_and_a_part_without_value_nothing() -> None:
    part, base = [LogPart(0, "a")], {0: settled(2.0, 4.0)}
    assert cost(TERMS, part, {0: settled(0.1, 0.0, "diverged")}, base) == UNSOUND
    assert cost(TERMS, part, {0: settled(None, 4.0)}, base) == pytest.approx(UNSOUND / 4)
    assert cost(TERMS, part, {0: settled(1.0, 4.0)}, {0: settled(None, 4.0)}) == 0.0
    assert cost(TERMS, part, {0: settled(9e9, 4.0)}, base) == pytest.approx(UNSOUND / 4)


def test_terms_have_short_names_and_weights() -> None:
    found = objective(["tilt", "noise=0.5,lag_ms@airborne=0.2"])
    assert [(t.metric.name, t.weight) for t in found] == [
        ("inclination_rmse_deg", 1.0),
        ("noise_tilt_deg@hover", 0.5),
        ("lag_ms@airborne", 0.2),
    ]


def test_everything_wrong_with_an_objective_is_told_at_once() -> None:
    with pytest.raises(UsageError) as refused:
        objective(["tild=1,noise=-1", "lag=x", "tilt=nan"])
    said = str(refused.value).split("\n")
    assert len(said) == 4
    assert "did you mean tilt" in said[0]
    with pytest.raises(UsageError, match="no objective"):
        objective([])


def blocks() -> Answer:
    ids, squares = ids_of([15.0, 20.0, 25.0, 30.0]), np.array([1.0, 1.0, 9.0, 9.0])
    told = partial(of_blocks, ids, squares)
    return Answer(told(ids).value, "deg", "all", 4, 20.0, units=UnitValues("mean_square", ids, squares, told))


def test_a_block_of_time_holds_the_units_that_begin_in_it() -> None:
    early, late = (LogPart(0, "x", a, b).of(blocks()) for a, b in ((0.0, 25.0), (25.0, 40.0)))
    assert early is not None
    assert late is not None
    assert (early.value, late.value) == (1.0, 3.0)
    assert early.units is not None
    assert early.units.ids.tolist() == [15000, 20000]
    assert LogPart(0, "x", 40.0, 50.0).of(blocks()) is None
    assert LogPart(0, "x", 0.0, 50.0).of(Answer(1.0, "deg", "all")) is None
    assert LogPart(0, "x").value(Answer(1.0, "deg", "all")) == 1.0


def test_every_part_is_left_out_once() -> None:
    for count, groups in ((2, 2), (5, 5), (12, 5)):
        parts = [LogPart(k, str(k)) for k in range(count)]
        found = folds(parts)
        assert len(found) == groups
        assert sorted(p.log for group in found for p in group) == list(range(count))


def test_a_wanted_metric_is_a_key() -> None:
    assert TILT == SweptMetric("inclination_rmse_deg", "all", "deg", "low")


def test_blocks_of_one_log_begin_with_the_log_and_end_with_its_scoring() -> None:
    """Rest before the start of scoring has its evidence too."""
    case: Any = SimpleNamespace(
        segments=SimpleNamespace(spans=lambda window: [(2.0, 100.0)]),
        reference=SimpleNamespace(scoring_start=20.0, end=80.0),
    )
    one: Any = SimpleNamespace(name="x", case=case)
    assert [(p.t0, p.t1) for p in parts_of([one])] == [(2.0, 35.0), (35.0, 50.0), (50.0, 65.0), (65.0, 80.0)]
    assert parts_of([one, one]) == [LogPart(0, "x"), LogPart(1, "x")]
