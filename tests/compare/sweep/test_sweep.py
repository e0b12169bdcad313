"""Which setting of a grid is best: on made answers whose truth is known."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from weakref import WeakSet

import numpy as np
import pytest

from attlog.compare.sweep.grid import grid
from attlog.compare.sweep.many import SettingResult, SweptMetric
from attlog.compare.sweep.sweep import Sweep, column, sweep
from attlog.compare.sweep.text import csv_text, document, rows, sentences
from attlog.estimators import get
from attlog.metrics.answer import Answer, missing
from attlog.metrics.errors.rmse import of_blocks
from attlog.metrics.statistics.units import UnitValues, ids_of

TILT = SweptMetric("inclination_rmse_deg", "all", "deg", "low")
LAG = SweptMetric("lag_ms", "all", "ms", "zero")
KP = (0.1, 0.2, 0.4, 0.8, 1.6)
WEATHER = np.exp(0.5 * np.random.default_rng(0).standard_normal(24))
"""What all settings of a log share: blocks with more and less wind."""


def blocks(rmse: float, seed: int, scatter: float = 0.05) -> Answer:
    """An error of this size in 24 blocks, a little of it the setting's own."""
    own = np.exp(scatter * np.random.default_rng(seed).standard_normal(24))
    squares = WEATHER * own
    squares *= rmse**2 / np.mean(squares)
    ids = ids_of(5.0 * np.arange(24))
    told = partial(of_blocks, ids, squares)
    return Answer(rmse, "deg", "all", 24, 120.0, told(ids).ci95, units=UnitValues("mean_square", ids, squares, told))


def settled(answer: Answer, status: str = "ok", unsound: str = "") -> SettingResult:
    return SettingResult({TILT: answer}, status, unsound)


class Made:
    """A log whose tilt error has its minimum at ``best``, in octaves of kp; the base is kp 0.8."""

    def __init__(self, name: str, best: float, asked: list[SweptMetric] | None = None, unsound: float = np.inf) -> None:
        self.name, self.best, self.asked, self.unsound = name, best, asked or [TILT], unsound

    def __call__(self, settings: list[dict[str, float]]) -> list[SettingResult]:
        found = []
        for k, setting in enumerate(settings):
            kp = setting.get("kp", 0.8)
            answer = blocks(1.0 + 0.3 * np.log2(kp / self.best) ** 2, 10 * k + len(self.name))
            found.append(settled(answer, unsound="tilt error above 30 deg" if kp >= self.unsound else ""))
        return found

    def why_not_best(self, setting: dict[str, float]) -> str:
        return ""


def made(*logs: Made) -> Sweep:
    return sweep("mahony", grid(["kp=" + ",".join(map(str, KP))], get("mahony")), list(logs))  # type: ignore[arg-type]


def test_on_one_log_the_best_is_told_from_settings_that_are_worse_and_not_from_its_equal() -> None:
    cells = [[settled(blocks(v, k))] for k, v in enumerate((2.0, 1.001, 1.0, 1.5, 3.0))]
    found = column(TILT, cells)
    assert found.single == 2
    assert found.own == [2]
    assert found.near == [1, 2]
    assert found.beside[3].worse
    low, high = found.beside[3].ci95 or (0.0, 0.0)
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

    axes = grid(["kp=" + ",".join(map(str, KP))], get("mahony"))
    found = sweep("mahony", axes, coming())  # type: ignore[arg-type]
    assert found.logs == ["a", "bb", "ccc", "dddd"]
    assert held == [1, 2, 2, 2]


def test_over_logs_one_setting_is_best_for_all_beside_the_own_optimum_of_each() -> None:
    s = made(Made("a", 0.1), Made("bb", 0.2), Made("ccc", 0.4), Made("dddd", 0.2), Made("eeeee", 0.2))
    c = s.columns[0]
    assert [s.settings[k] for k in c.own if k is not None] == [{"kp": v} for v in (0.1, 0.2, 0.4, 0.2, 0.2)]
    assert c.single == 1
    assert c.score[1] == pytest.approx(np.mean([1.3, 1.0, 1.3, 1.0, 1.0]))
    assert c.beside[4].worse
    assert c.beside[s.base].value == pytest.approx(c.beside[3].value, rel=0.05)


def test_a_setting_that_fails_on_one_log_is_not_the_best_for_all() -> None:
    s = made(Made("a", 0.4), Made("bb", 0.4, unsound=0.4))
    c = s.columns[0]
    assert (c.single, c.own) == (1, [2, 1])
    assert np.isnan(c.score[2])
    assert c.beside[2].why == "tilt error above 30 deg"


def test_a_log_on_which_nothing_can_be_judged_is_left_out_with_its_reason() -> None:
    s = made(Made("a", 0.2), Made("bb", 0.2, unsound=0.0))
    c = s.columns[0]
    assert (c.single, c.used, c.left_out) == (1, [0], {1: "tilt error above 30 deg"})
    assert any("Not counted: bb (tilt error above 30 deg)" in text for text in sentences(s))


def test_agreement_with_the_onboard_attitude_is_not_called_truth() -> None:
    s = made(Made("a", 0.2))
    assert (
        "1 log of 3 can only be compared with the onboard attitude"
        in list(sentences(s, {"truth": 2, "onboard": 1}))[-1]
    )
    assert not any("onboard" in text for text in sentences(s, {"truth": 3}))


def test_where_no_setting_can_be_judged_that_is_said() -> None:
    s = made(Made("a", 0.2, unsound=0.0))
    assert s.columns[0].single is None
    assert "no setting of the grid can be judged (tilt error above 30 deg)" in next(sentences(s))
    assert rows(s)[1][0][-1] == "no setting has a value on every log"


class Frozen(Made):
    """Its best setting is one that gravity does not correct."""

    def why_not_best(self, setting: dict[str, float]) -> str:
        return "it is not corrected by gravity" if setting["kp"] < 0.3 else ""


def test_a_trivial_winner_is_passed_over() -> None:
    s = made(Frozen("a", 0.1))
    assert s.settings[s.columns[0].single or 0] == {"kp": 0.4}
    assert s.cells[0][0].unsound == "it is not corrected by gravity"
    assert s.cells[4][0].unsound == ""


def test_equal_settings_are_equal_to_the_best() -> None:
    same = blocks(1.0, 1)
    found = column(TILT, [[settled(same)], [settled(same)], [settled(same)]])
    assert found.near == [0, 1]
    assert found.beside[1].value == 1.0
    assert found.beside[1].ci95 == (1.0, 1.0)


def test_a_value_that_is_missing_is_told_with_its_reason() -> None:
    gone = missing("no_events", "no step", "deg", "all")
    found = column(TILT, [[settled(blocks(1.0, 1))], [settled(gone)], [settled(gone)]])
    assert found.beside[1].why == "no step"
    assert found.near == [0]


def test_an_optimum_at_the_end_of_a_range_is_said_to_be_there() -> None:
    inside, edge = ("\n".join(sentences(made(Made("a", best)))) for best in (0.4, 0.1))
    assert "end of the range" not in inside
    assert "end of the range of kp" in edge


def test_no_end_of_a_range_is_named_where_no_setting_is_told_from_the_others() -> None:
    class Flat(Made):
        def __call__(self, settings: list[dict[str, float]]) -> list[SettingResult]:
            return [settled(blocks(1.0, 1)) for _ in settings]

    assert "end of the range" not in "\n".join(sentences(made(Flat("a", 0.1))))


def test_the_json_and_the_csv_hold_every_setting_on_every_log() -> None:
    s = made(Made("a", 0.2), Made("bb", 0.4))
    found = document(s, {})
    assert found["schema"] == "attlog-sweep/2"
    assert len(found["settings"]) == len(KP) + 1
    assert found["settings"][1]["logs"][0]["metrics"]["inclination_rmse_deg"]["value"] == pytest.approx(1.0)
    assert found["metrics"][0]["own_optimum"][1]["setting"] == 2
    lines = csv_text(s).splitlines()
    assert len(lines) == 1 + 2 * (len(KP) + 1)
    assert lines[1].startswith("kp=0.1,0.1,a,inclination_rmse_deg,all,deg,1.3,")
