"""What a search makes small: weights, ratios to the default gains, and what is left out in turn."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.compare import tune as tuning
from attlog.compare.diff import NEGLIGIBLE
from attlog.compare.grid import SearchResult, parse_free_parameters
from attlog.compare.search import SettingResult, SettingsOnLog, swept_questions
from attlog.compare.setting import parse_configuration
from attlog.compare.tune import (
    UNSOUND_COST,
    LogPart,
    Tuning,
    make_folds,
    objective_cost,
    parse_objective,
    split_parts,
    tune,
)
from attlog.compare.tune_report import paste_lines, tune_document, tune_page, tune_sentences
from attlog.core.errors import LogUnusable, UsageError
from attlog.flight.model import Attitude, FlightLog
from attlog.metrics.accuracy import BLOCK_S, rmse_of_blocks
from attlog.metrics.metric import Answer, missing
from attlog.metrics.statistics import UnitValues, make_ids
from attlog.testing.motions import GRAVITY, Noise, motion
from tests.report.browser import Visit
from tests.segments.flights import imu_log

OBJECTIVE = parse_objective(["tilt=1,lag=3"])
TILT, LAG = (t.question for t in OBJECTIVE)
DEG, MS = NEGLIGIBLE["deg"], NEGLIGIBLE["ms"]


def setting_result(tilt: float | None, lag: float, unsound: str = "") -> SettingResult:
    answer = missing("no_reference", "none", "deg", "all") if tilt is None else Answer(tilt, "deg", "all")
    return SettingResult({TILT: answer, LAG: Answer(lag, "ms", "all")}, "ok", unsound)


def test_the_cost_is_the_weighted_mean_of_log_ratios_over_the_parts() -> None:
    parts = [LogPart(0, "a"), LogPart(1, "b")]
    base = {0: setting_result(2.0, 4.0), 1: setting_result(1.0, -4.0)}
    now = {0: setting_result(1.0, -2.0), 1: setting_result(1.0, 8.0)}
    tilt = 0.5 * np.log((1 + DEG) / (2 + DEG))
    lag = 0.5 * (np.log((2 + MS) / (4 + MS)) + np.log((8 + MS) / (4 + MS)))
    assert objective_cost(OBJECTIVE, parts, now, base) == pytest.approx((tilt + 3 * lag) / 4)
    assert objective_cost(OBJECTIVE, parts, base, base) == 0.0


def test_a_setting_that_fails_costs_more_than_any_other_and_a_part_without_value_nothing() -> None:
    part, base = [LogPart(0, "a")], {0: setting_result(2.0, 4.0)}
    assert objective_cost(OBJECTIVE, part, {0: setting_result(0.1, 0.0, "diverged")}, base) == UNSOUND_COST
    assert objective_cost(OBJECTIVE, part, {0: setting_result(None, 4.0)}, base) == pytest.approx(UNSOUND_COST / 4)
    assert objective_cost(OBJECTIVE, part, {0: setting_result(1.0, 4.0)}, {0: setting_result(None, 4.0)}) == 0.0
    assert objective_cost(OBJECTIVE, part, {0: setting_result(9e9, 4.0)}, base) == pytest.approx(UNSOUND_COST / 4)


def test_terms_have_short_names_and_weights() -> None:
    found = parse_objective(["tilt", "noise=0.5,lag_ms@airborne=0.2"])
    assert [(t.question.name, t.weight) for t in found] == [
        ("tilt_rmse_deg", 1.0),
        ("noise_tilt_deg@hover", 0.5),
        ("lag_ms@airborne", 0.2),
    ]


def test_everything_wrong_with_an_objective_is_told_at_once() -> None:
    with pytest.raises(UsageError) as refused:
        parse_objective(["tild=1,noise=-1", "lag=x", "tilt=nan"])
    said = str(refused.value).split("\n")
    assert len(said) == 4
    assert "did you mean tilt" in said[0]
    with pytest.raises(UsageError, match="no objective"):
        parse_objective([])


def blocks() -> Answer:
    ids, squares = make_ids([15.0, 20.0, 25.0, 30.0]), np.array([1.0, 1.0, 9.0, 9.0])
    told = partial(rmse_of_blocks, ids, squares, length=BLOCK_S["tilt"], sigma=0.0)
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
        found = make_folds(parts)
        assert len(found) == groups
        assert sorted(p.log for group in found for p in group) == list(range(count))


def test_blocks_of_one_log_begin_with_the_log_and_end_with_its_scoring() -> None:
    """Rest before the start of scoring has its evidence too."""
    case: Any = SimpleNamespace(
        segments=SimpleNamespace(spans=lambda window: [(2.0, 100.0)]),
        reference=SimpleNamespace(scoring=SimpleNamespace(start=20.0, end=80.0)),
    )
    one: Any = SimpleNamespace(name="x", case=case)
    assert [(p.t0, p.t1) for p in split_parts([one])] == [(2.0, 35.0), (35.0, 50.0), (50.0, 65.0), (65.0, 80.0)]
    assert split_parts([one, one]) == [LogPart(0, "x"), LogPart(1, "x")]


# What a part is judged by was found without it.

LEFT_OUT_TERMS = parse_objective(["tilt=1"])


class MadeLog(SimpleNamespace):
    """A log on which the tilt error is 1 deg and as much more as kp is away from the ``best`` there."""

    mode = ""

    def __call__(self, settings: list[dict[str, Any]]) -> list[SettingResult]:
        values = [1.0 + 5.0 * abs(s.get("kp", 1.0) - self.best) for s in settings]
        return [SettingResult({LEFT_OUT_TERMS[0].question: Answer(v, "deg", "all")}, "ok", "") for v in values]


def on_a_grid(free: object, costs: Any, *_: object) -> SearchResult:
    """The best of eleven settings."""
    settings = [{"kp": round(0.1 * k, 1)} for k in range(11)]
    found = costs(settings)
    return SearchResult(settings[int(found.argmin())], float(found.min()), [])


def test_the_gains_of_a_fold_are_the_best_of_the_other_logs_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tuning, "minimize", on_a_grid)
    logs: list[Any] = [MadeLog(name="low", best=0.2, questions=()), MadeLog(name="high", best=0.8, questions=())]
    found = tuning.tune("mahony", [], LEFT_OUT_TERMS, logs, [], {"kp": 1.0}, 6, 1)
    assert {fold.left_out[0].name: fold.found.setting["kp"] for fold in found.folds} == {"low": 0.8, "high": 0.2}
    (judged,) = found.scores
    assert judged.after == pytest.approx([4.0, 4.0])


# Tuned gains: a planted optimum is found, gains hold where they were not found, and nothing is promised without.

GYRO, ACC = 0.004, 0.05
PLANTED = GYRO * GRAVITY / ACC
"""A first-order filter of gain k adds the gyro's walk, n_g^2 / 2k, and the accelerometer's angle noise,
(n_a / g)^2 k / 2: the sum is least where k = n_g g / n_a (Higgins1975)."""
ABOUT = {"attlog": {"version": "1"}, "command": "attlog tune", "logs": [{"reference": "truth"}]}


def noisy(seed: int, seconds: float = 150.0) -> FlightLog:
    """A vehicle that rocks slowly, white noise of known density on gyro and accelerometer, and its true attitude."""
    made = motion(
        lambda t: (0.2 * np.sin(0.3 * t), 0.15 * np.sin(0.2 * t), 0.0 * t),
        seconds,
        50.0,
        noise=Noise(GYRO, ACC),
        seed=seed,
    )
    log = imu_log(made.t, made.gyr, made.acc)
    log.truth = Attitude(made.t, made.q, "SIM")
    log.path = Path(f"made{seed}.bin")
    return log


def tuned(
    logs: list[FlightLog], ranges: list[str], terms: str = "tilt", start: float = 5.0, generations: int = 4
) -> Tuning:
    asked, base = parse_objective([terms]), parse_configuration(f"mahony:kp={start},ki=0")
    cases = [attlog.prepare(log) for log in logs]
    on = [SettingsOnLog(c, base, [t.question for t in asked], guarded=True) for c in cases]
    elsewhere = [SettingsOnLog(c, base, swept_questions(["noise_tilt_deg", "tilt_rmse_deg"])) for c in cases]
    free = parse_free_parameters(ranges, base.row.estimator)
    return tune("mahony", free, asked, on, elsewhere, {f.name: on[0].values[f.name] for f in free}, generations, 0)


@pytest.fixture(scope="module")
def planted() -> Tuning:
    return tuned([noisy(seed, 100.0) for seed in range(4)], ["kp=0.05..20log"], generations=2)


def test_a_planted_optimum_is_found(planted: Tuning) -> None:
    """The variance is 3 % above its minimum at 1.3 times the best gain: a few minutes of noise tell it no better."""
    assert float(planted.found.setting["kp"]) == pytest.approx(PLANTED, rel=0.3)
    for fold in planted.folds:
        assert float(fold.found.setting["kp"]) == pytest.approx(PLANTED, rel=0.4)


def test_its_worth_on_logs_left_out_is_what_theory_gives(planted: Tuning) -> None:
    """From 5 to the optimum the error falls by the root of (k/k* + k*/k) / 2."""
    ratio = 5.0 / PLANTED
    expected = 1.0 / np.sqrt(0.5 * (ratio + 1.0 / ratio))
    tilt = planted.scores[0]
    assert tilt.difference.value == pytest.approx(expected, rel=0.1)
    assert tilt.difference.interval_side == -1
    assert (tilt.better, tilt.worse) == (4, 0)
    assert np.exp(planted.cost_left_out) == pytest.approx(expected, rel=0.1)


@pytest.mark.slow
def test_no_gain_is_promised_where_the_filter_is_at_its_best_already() -> None:
    found = tuned([noisy(seed, 100.0) for seed in range(3)], ["kp=0.1..10log"], start=PLANTED, generations=2)
    assert found.scores[0].difference.interval_side == 0
    said = next(s for s in tune_sentences(found, {"truth": 3}) if "No significant gain" in s)
    left_out = 100.0 * (1.0 - np.exp(found.cost_left_out))
    assert f" {'falls' if left_out >= 0 else 'rises'} by {abs(left_out):.0f} % on what was left out" in said
    assert "by -" not in said


@pytest.mark.slow
def test_one_log_alone_is_tuned_over_blocks_of_its_time() -> None:
    found = tuned([noisy(7, 300.0)], ["kp=0.05..20log"])
    assert [p.name for p in found.parts][1:] == ["86 to 157 s", "157 to 229 s", "229 to 300 s"]
    assert float(found.found.setting["kp"]) == pytest.approx(PLANTED, rel=0.4)
    assert found.scores[0].better == 4
    assert any("4 blocks of time of one log" in text for text in tune_sentences(found, {}))


@pytest.mark.slow
def test_the_same_seed_gives_the_same_answer(planted: Tuning) -> None:
    again = tuned([noisy(seed, 100.0) for seed in range(4)], ["kp=0.05..20log"], generations=2)
    assert tune_document(again, {}) == tune_document(planted, {})


def test_what_is_told_can_be_pasted_and_read(planted: Tuning) -> None:
    kp = planted.found.setting["kp"]
    assert paste_lines(planted) == [f"mahony:kp={kp}"]
    own = replace(planted, filter="px4_q", found=replace(planted.found, setting={"ATT_W_ACC": 0.3}))
    assert paste_lines(own) == ["px4_q:ATT_W_ACC=0.3", "ATT_W_ACC,0.3"]
    assert parse_configuration(paste_lines(planted)[0]).row.params == {"kp": kp}
    said = "\n".join(tune_sentences(planted, {"truth": 3, "onboard": 1}))
    assert said.startswith("Worth taking"), "the answer stands first"
    assert "1 log of 4 can only be compared with the onboard attitude" in said
    page = tune_page(planted, ABOUT)
    assert "default-src &#39;none&#39;" in page
    assert "Worth taking" in page.replace("\u00a0", " ")
    assert json.loads(json.dumps(tune_document(planted, {}), allow_nan=False))["schema"] == "attlog-tune/2"


@pytest.mark.slow
def test_every_setting_that_was_tried_is_drawn(planted: Tuning, tmp_path: Path, browser: Any) -> None:
    path = tmp_path / "tune.html"
    path.write_text(tune_page(planted, ABOUT), encoding="utf-8")
    visit = Visit(browser, path)
    assert visit.figures() == {"tried0": True}
    assert visit.complaints == []
    (dots,) = visit.page.evaluate("document.getElementById('tried0').data.map((t) => [t.x, t.marker.color])")
    assert sorted(dots[0]) == pytest.approx(sorted(float(s["kp"]) for s, _ in planted.found.tried), rel=1e-4)
    red = [x for x, colour in zip(*dots, strict=True) if dots[1].count(colour) == 1]
    assert red == [pytest.approx(planted.found.setting["kp"], rel=1e-4)]
    shapes = visit.page.evaluate("document.getElementById('tried0').layout.shapes.map((s) => [s.x0, s.x1])")
    again = [float(fold.found.setting["kp"]) for fold in planted.folds]
    assert shapes == [pytest.approx([min(again), max(again)], rel=1e-4)]
    visit.close()


def test_nothing_to_judge_by_is_refused_with_the_reason() -> None:
    with pytest.raises(LogUnusable, match=r"two logs with a value of the objective .*step"):
        tuned([noisy(seed, 40.0) for seed in range(2)], ["kp=0.1..10log"], terms="step")


def test_a_metric_without_units_cannot_be_split_over_one_log() -> None:
    with pytest.raises(UsageError, match="give several logs"):
        tuned([noisy(1, 40.0)], ["kp=0.1..10log"], terms="tilt_p95_deg")


@pytest.mark.slow
def test_flights_left_out_are_improved(corpus: Path) -> None:
    names = [f"px4_{name}.ulg" for name in ("hover", "steps", "wind", "yaw", "gnssloss", "static")]
    base, asked = parse_configuration("mahony"), parse_objective(["tilt"])
    on = [
        SettingsOnLog(attlog.prepare(corpus / "sitl" / "px4" / n), base, [t.question for t in asked], guarded=True)
        for n in names
    ]
    free = parse_free_parameters(["kp=0.03..3log", "ki=0.0001..0.1log"], base.row.estimator)
    found = tune("mahony", free, asked, on, [], {f.name: on[0].values[f.name] for f in free}, 4, 0)
    assert found.scores[0].difference.interval_side == -1
    assert found.scores[0].better >= 5
