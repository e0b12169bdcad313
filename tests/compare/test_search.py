"""Which setting of a grid is best: on made answers whose truth is known."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from weakref import WeakSet

import numpy as np
import pytest

import attlog
from attlog.compare.grid import parse_grid
from attlog.compare.paired import Difference, Direction, Scale
from attlog.compare.search import SettingResult, SettingsOnLog, Sweep, sweep, sweep_column, swept_questions
from attlog.compare.setting import parse_configuration
from attlog.compare.sweep_report import difference_text, sweep_csv, sweep_document, sweep_rows, sweep_sentences
from attlog.core.errors import UsageError
from attlog.estimators import get
from attlog.metrics.accuracy import BLOCK_S, rmse_of_blocks
from attlog.metrics.metric import Answer, Case, missing
from attlog.metrics.statistics import UnitValues, make_ids
from attlog.pipeline import replay
from tests.conftest import SAMPLES

(TILT,) = swept_questions(["tilt_rmse_deg"])
KP = (0.1, 0.2, 0.4, 0.8, 1.6)
WEATHER = np.exp(0.5 * np.random.default_rng(0).standard_normal(24))
"""What all settings of a log share: blocks with more and less wind."""


def blocks(rmse: float, seed: int, scatter: float = 0.05) -> Answer:
    """An error of this size in 24 blocks, a little of it the setting's own."""
    own = np.exp(scatter * np.random.default_rng(seed).standard_normal(24))
    squares = WEATHER * own
    squares *= rmse**2 / np.mean(squares)
    ids = make_ids(5.0 * np.arange(24))
    told = partial(rmse_of_blocks, ids, squares, length=BLOCK_S["tilt"], sigma=0.0)
    return Answer(rmse, "deg", "all", 24, 120.0, told(ids).ci95, units=UnitValues("mean_square", ids, squares, told))


def settled(answer: Answer, status: str = "ok", unsound: str = "") -> SettingResult:
    return SettingResult({TILT: answer}, status, unsound)


class Made:
    """A log whose tilt error has its minimum at ``best``, in octaves of kp; the base is kp 0.8."""

    mode = ""

    def __init__(self, name: str, best: float, unsound: float = np.inf) -> None:
        self.name, self.best, self.questions, self.unsound = name, best, [TILT], unsound

    def __call__(self, settings: list[dict[str, float]]) -> list[SettingResult]:
        found = []
        for k, setting in enumerate(settings):
            kp = setting.get("kp", 0.8)
            answer = blocks(1.0 + 0.3 * np.log2(kp / self.best) ** 2, 10 * k + len(self.name))
            found.append(settled(answer, unsound="tilt error above 30 deg" if kp >= self.unsound else ""))
        return found

    def why_uncorrected(self, setting: dict[str, float]) -> str:
        return ""


def made(*logs: Made) -> Sweep:
    return sweep("mahony", parse_grid(["kp=" + ",".join(map(str, KP))], get("mahony")), list(logs))  # type: ignore[arg-type]


def test_on_one_log_the_best_is_told_from_settings_that_are_worse_and_not_from_its_equal() -> None:
    cells = [[settled(blocks(v, k))] for k, v in enumerate((2.0, 1.001, 1.0, 1.5, 3.0))]
    found = sweep_column(TILT, cells)
    assert found.single == 2
    assert found.own == [2]
    assert found.near == [1, 2]
    assert found.differences[3].direction == "worse"
    low, high = found.differences[3].ci95 or (0.0, 0.0)
    assert low < 1.5 < high


def test_each_log_is_let_go_of_before_the_next() -> None:
    """But the first, which is asked again; a sweep over many logs holds two of them at once."""
    alive: WeakSet[Made] = WeakSet()
    held = []

    def coming() -> Iterator[Made]:
        for name in ("a", "bb", "ccc", "dddd"):
            log = Made(name, 0.2)
            alive.add(log)
            held.append(len(alive))
            yield log
            del log

    axes = parse_grid(["kp=" + ",".join(map(str, KP))], get("mahony"))
    found = sweep("mahony", axes, coming())  # type: ignore[arg-type]
    assert found.logs == ["a", "bb", "ccc", "dddd"]
    assert held == [1, 2, 2, 2]


def test_over_logs_one_setting_is_best_for_all_beside_the_own_optimum_of_each() -> None:
    s = made(Made("a", 0.1), Made("bb", 0.2), Made("ccc", 0.4), Made("dddd", 0.2), Made("eeeee", 0.2))
    c = s.columns[0]
    assert [s.settings[k] for k in c.own if k is not None] == [{"kp": v} for v in (0.1, 0.2, 0.4, 0.2, 0.2)]
    assert c.single == 1
    assert c.score[1] == pytest.approx(np.mean([1.3, 1.0, 1.3, 1.0, 1.0]))
    assert c.differences[4].direction == "worse"
    assert c.differences[s.base].value == pytest.approx(c.differences[3].value, rel=0.05)


def test_a_setting_that_fails_on_one_log_is_not_the_best_for_all() -> None:
    s = made(Made("a", 0.4), Made("bb", 0.4, unsound=0.4))
    c = s.columns[0]
    assert (c.single, c.own) == (1, [2, 1])
    assert np.isnan(c.score[2])
    assert c.differences[2].reason == "tilt error above 30 deg"


def test_a_log_on_which_nothing_can_be_judged_is_left_out_with_its_reason() -> None:
    s = made(Made("a", 0.2), Made("bb", 0.2, unsound=0.0))
    c = s.columns[0]
    assert (c.single, c.used, c.left_out) == (1, [0], {1: "tilt error above 30 deg"})
    assert any("Not counted: bb (tilt error above 30 deg)" in text for text in sweep_sentences(s))


def test_agreement_with_the_onboard_attitude_is_not_called_truth() -> None:
    s = made(Made("a", 0.2))
    assert (
        "1 log of 3 can only be compared with the onboard attitude"
        in list(sweep_sentences(s, {"truth": 2, "onboard": 1}))[-1]
    )
    assert not any("onboard" in text for text in sweep_sentences(s, {"truth": 3}))


def test_where_no_setting_can_be_judged_that_is_said() -> None:
    s = made(Made("a", 0.2, unsound=0.0))
    assert s.columns[0].single is None
    assert "no setting of the grid can be judged (tilt error above 30 deg)" in next(sweep_sentences(s))
    assert sweep_rows(s)[1][0][-1] == "no setting has a value on every log"


class Frozen(Made):
    """Its best setting is one that gravity does not correct."""

    def why_uncorrected(self, setting: dict[str, float]) -> str:
        return "it is not corrected by gravity" if setting["kp"] < 0.3 else ""


def test_a_trivial_winner_is_passed_over() -> None:
    s = made(Frozen("a", 0.1))
    assert s.settings[s.columns[0].single or 0] == {"kp": 0.4}
    assert s.cells[0][0].unsound == "it is not corrected by gravity"
    assert s.cells[4][0].unsound == ""


def test_equal_settings_are_equal_to_the_best() -> None:
    same = blocks(1.0, 1)
    found = sweep_column(TILT, [[settled(same)], [settled(same)], [settled(same)]])
    assert found.near == [0, 1]
    assert found.differences[1].value == 1.0
    assert found.differences[1].ci95 == (1.0, 1.0)


def test_a_value_that_is_missing_is_told_with_its_reason() -> None:
    gone = missing("no_events", "no step", "deg", "all")
    found = sweep_column(TILT, [[settled(blocks(1.0, 1))], [settled(gone)], [settled(gone)]])
    assert found.differences[1].reason == "no step"
    assert found.near == [0]


def test_an_optimum_at_the_end_of_a_range_is_said_to_be_there() -> None:
    inside, edge = ("\n".join(sweep_sentences(made(Made("a", best)))) for best in (0.4, 0.1))
    assert "end of the range" not in inside
    assert "end of the range of kp" in edge


def test_no_end_of_a_range_is_named_where_no_setting_is_told_from_the_others() -> None:
    class Flat(Made):
        def __call__(self, settings: list[dict[str, float]]) -> list[SettingResult]:
            return [settled(blocks(1.0, 1)) for _ in settings]

    assert "end of the range" not in "\n".join(sweep_sentences(made(Flat("a", 0.1))))


def test_the_json_and_the_csv_hold_every_setting_on_every_log() -> None:
    s = made(Made("a", 0.2), Made("bb", 0.4))
    found = sweep_document(s, {})
    assert found["schema"] == "attlog-sweep/3"
    assert len(found["settings"]) == len(KP) + 1
    assert found["settings"][1]["logs"][0]["metrics"]["tilt_rmse_deg"]["value"] == pytest.approx(1.0)
    assert found["metrics"][0]["own_optimum"][1]["setting"] == 2
    lines = sweep_csv(s).splitlines()
    assert len(lines) == 1 + 2 * (len(KP) + 1)
    assert lines[1].startswith("kp=0.1,0.1,a,tilt_rmse_deg,all,deg,1.3,")


# Settings on one log: the same answers as one by one, asked once.

ASKED = ("tilt_rmse_deg", "tilt_p95_deg", "noise_tilt_deg", "step_error_deg.0.5s@airborne")
SETTINGS = [{"kp": 0.3, "ki": 0.0}, {"kp": 0.9, "ki": 0.02}, {"kp": 2.0, "ki": 0.0, "mag_form": "vector"}]


@pytest.fixture(scope="module")
def case() -> Case:
    return attlog.prepare(SAMPLES / "px4_steps.ulg")


def test_a_batch_answers_what_single_runs_answer(case: Case) -> None:
    asked = swept_questions(ASKED)
    many = SettingsOnLog(case, parse_configuration("mahony"), asked)(SETTINGS)
    names = ["mahony:" + ",".join(f"{k}={v}" for k, v in s.items()) for s in SETTINGS]
    alone = attlog.evaluate(case, names).estimators
    for settled, row in zip(many, [r for r in alone if r.kind == "replay"], strict=True):
        assert settled.status == row.status
        for metric in asked:
            mine, own = settled.answers[metric], row.metrics[metric.window][metric.metric]
            assert mine.value is not None
            assert mine.value == pytest.approx(own.value, rel=1e-9)
            assert mine.ci95 == pytest.approx(own.ci95, rel=1e-9)


def test_what_comes_before_the_filter_comes_before_every_setting(case: Case) -> None:
    asked = swept_questions(["tilt_rmse_deg"])
    plain, filtered = (
        SettingsOnLog(case, parse_configuration(c), asked)(SETTINGS[:1])[0] for c in ("mahony", "mahony:latency=50")
    )
    assert plain.answers[asked[0]].value != filtered.answers[asked[0]].value


def test_a_setting_is_run_once(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[int] = []
    batch = replay.batch
    monkeypatch.setattr(replay, "batch", lambda *a: ran.append(len(a[4])) or batch(*a))
    on = SettingsOnLog(case, parse_configuration("mahony"), swept_questions(["tilt_rmse_deg"]))
    first = on([SETTINGS[0], SETTINGS[0], SETTINGS[1]])
    again = on([SETTINGS[1], SETTINGS[0]])
    assert sum(ran) == 2
    assert first[0] is first[1] is again[1]


def test_a_filter_that_gravity_does_not_correct_may_win_nothing(case: Case) -> None:
    on = SettingsOnLog(case, parse_configuration("mahony"), swept_questions(["tilt_rmse_deg"]))
    assert "gravity" in on.why_uncorrected({"kp": 0.0, "ki": 0.0})
    assert on.why_uncorrected({"kp": 0.5}) == ""


def test_everything_wrong_with_the_metrics_is_told_at_once() -> None:
    with pytest.raises(UsageError) as refused:
        swept_questions(["tilt_rms_deg", "lag_ms@", "cost_ns"])
    said = str(refused.value)
    assert "did you mean tilt_rmse_deg" in said
    assert "no window" in said
    assert "cost_ns" in said
    assert [w.name for w in swept_questions(["noise_tilt_deg@hover", "noise_tilt_deg@hover", "lag_ms"])] == [
        "noise_tilt_deg@hover",
        "lag_ms",
    ]


def test_a_window_that_is_none_is_refused(case: Case) -> None:
    with pytest.raises(UsageError, match="noise_tilt_deg@flight"):
        SettingsOnLog(case, parse_configuration("mahony"), swept_questions(["noise_tilt_deg@flight"]))


def test_a_filter_that_needs_a_magnetometer_says_so_of_a_log_without(tmp_path: Path) -> None:
    case = attlog.prepare(SAMPLES / "px4_steps.ulg", {"mag": "none"})
    needs = tmp_path / "needs.py"
    needs.write_text(
        '"""Needs."""\nNEEDS = {"gyro", "acc", "mag"}\nSTATE = {"q": 4}\n'
        "def start(params, acc, mag, q0):\n    return q0\ndef step(state, params, dt, gyr, acc, mag):\n    pass\n"
    )
    with pytest.raises(UsageError, match="needs a magnetometer"):
        SettingsOnLog(case, parse_configuration(str(needs)), swept_questions(["tilt_rmse_deg"]))([{}])


# What is said of a setting beside the best.


@pytest.mark.parametrize(
    ("scale", "value", "ci95", "worse", "ends"),
    [
        ("ratio", 1.27, (1.15, 1.41), True, "worse"),
        ("ratio", 1.27, (1.02, 1.6), False, "not significant among so many"),
        ("ratio", 1.27, (0.95, 1.7), False, "not significant"),
        ("ratio", 1.27, None, False, "not significant"),
        ("difference", 0.4, (0.1, 0.7), False, "not significant among so many"),
        ("difference", 0.4, (-0.1, 0.9), False, "not significant"),
    ],
)
def test_an_interval_alone_is_told_apart_from_one_that_holds_among_all_settings(
    scale: Scale, value: float, ci95: tuple[float, float] | None, worse: bool, ends: str
) -> None:
    """A ratio is significant beyond 1, a difference beyond 0."""
    direction: Direction = "worse" if worse else "not significant"
    found = Difference(scale, value, ci95, direction=direction)
    assert difference_text(found, "ms").endswith(f", {ends}")


def test_a_setting_without_value_says_why_and_equal_ones_that_they_are_equal() -> None:
    assert difference_text(Difference("ratio", reason="too few steps"), "ms") == "too few steps"
    assert difference_text(Difference("ratio"), "ms") == "no value"
    assert difference_text(Difference("ratio", 1.0, (1.0, 1.0), direction="same"), "ms") == "equal to it"
