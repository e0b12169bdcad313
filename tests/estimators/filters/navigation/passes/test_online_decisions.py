"""When a filter looks for a jump of the gyro bias and when it takes one: each limit from both sides.

A runner whose innovations, gains and likelihoods are declared stands for the filter.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from attlog.estimators.filters.navigation.passes import online
from attlog.estimators.filters.navigation.passes.jumps import gains
from attlog.estimators.filters.navigation.schedule import Schedule

STEP_S, SECONDS = 0.1, 30
NODES = round(SECONDS / STEP_S)
OPENED = np.radians(3.0)


def shock(gain: float, dps: float) -> np.ndarray:
    """The scores (12,) of a jump about z that gains so much and is so large: both are functions of two numbers."""
    size = np.radians(dps)

    def found(log: float) -> np.ndarray:
        row = np.zeros(12)
        row[[3, 7, 11]] = np.exp(log)
        row[2] = -size * (np.exp(log) + OPENED**-2)
        return row

    least = np.log(3.0 / size**2)
    return found(brentq(lambda log: gains(found(log)[None])[0][0] - gain, least, least + 10.0))


class Declared:
    """A runner: innovations do not fit after ``bad`` s, a jump at ``at`` s has these gains."""

    def __init__(self, at: float = 12.0, bad: float = 12.2, **given: Any) -> None:
        own = {"gain": 60.0, "dps": 2.0, "real": 60.0, "gnss": 0.0, "end": 1e9}
        self.own = SimpleNamespace(**(own | given))
        self.at, self.bad = at, bad
        self.inputs = SimpleNamespace(sensed_at=100.0 + STEP_S * np.arange(NODES))
        self.looks: list[tuple[int, int]] = []

    def begun(self, schedule: Schedule, begin: Any) -> tuple[Any, list[np.ndarray]]:
        ratio = np.full((NODES, 4), np.nan)
        when = STEP_S * np.arange(NODES)
        ratio[::2, 0] = np.where((when >= self.bad) & (when < self.own.end), 0.6, 0.3)[::2]
        return SimpleNamespace(ratio=ratio, memory=None), [np.zeros(4), np.zeros(39), np.zeros(39 * 40), np.zeros(18)]

    def run(self, a: int, b: int, found: Any, state: list[np.ndarray], *_: Any) -> None:
        state[1][0] = b

    def shocks(self, schedule: Schedule, begin: Any, par: Any, state: list[np.ndarray], a: int, b: int) -> Any:
        assert state[1][0] == a
        scores = np.zeros((b - a, 12))
        scores[:, [3, 7, 11]] = 1.0
        k = round(self.at / STEP_S)
        opened = schedule.jump[k] > 0.0
        if a <= k < b:
            scores[k - a] = shock(self.own.gain, self.own.dps)
        if not opened:
            self.looks.append((a, b))
        after = [x.copy() for x in state]
        after[1][0] = b
        after[3][17] += self.own.real if opened else 0.0
        by_group = np.zeros(8)
        if opened:
            by_group[:5] = 0.25 * self.own.gnss
            by_group[4] = -1e3
        return scores, after, by_group


def filtered(runner: Declared) -> tuple[Any, Any, Schedule]:
    none: Any = np.zeros(0)
    schedule = Schedule(np.arange(NODES), *([none] * 9), jump=np.zeros(NODES))  # type: ignore[call-arg]
    told: Any = runner
    found, jumps = online.filtered(told, schedule, None, none)  # type: ignore[arg-type]
    assert (schedule.jump == 0.0).all()
    return found, jumps, schedule


@pytest.mark.parametrize(
    ("limit", "taken"),
    [
        ({}, True),
        ({"gain": 40.5}, True),
        ({"gain": 39.5}, False),
        ({"dps": 3.95}, True),
        ({"dps": 4.05}, False),
        ({"dps": 0.21}, True),
        ({"dps": 0.19}, False),
        ({"real": 40.1}, True),
        ({"real": 39.9}, False),
        ({"gnss": -4.9}, True),
        ({"gnss": -5.1}, False),
    ],
)
def test_a_jump_is_taken_that_gains_40_is_below_4_deg_s_and_costs_gnss_less_than_5(limit: Any, taken: bool) -> None:
    found, jumps, _ = filtered(Declared(**limit))
    assert len(jumps) == taken
    if taken:
        assert jumps[0].t == pytest.approx(112.0)
        assert np.degrees(jumps[0].size) == pytest.approx([0.0, 0.0, limit.get("dps", 2.0)])
    assert found.memory is not None


def test_what_a_jump_turned_while_its_time_was_unsure_by_half_a_second_widens_the_attitude() -> None:
    runner = Declared(end=13.0)
    kept: list[Any] = []
    begun = runner.begun
    runner.begun = lambda *x: kept.append(begun(*x)) or kept[0]  # type: ignore[method-assign]
    filtered(runner)
    P = kept[0][1][2].reshape(39, 40)
    want = np.zeros((39, 40))
    want[2, 2] = (0.5 * np.radians(2.0)) ** 2
    assert pytest.approx(want) == P


def test_a_jump_in_the_last_0_3_s_waits_for_the_next_look() -> None:
    """Innovations are asked for each second: what jumped at 12.5 s is told by 13 s, at 12.7 s by 14 s."""
    for at, looks in ((12.5, 1), (12.7, 2)):
        runner = Declared(at=at)
        runner.own.end = 14.0
        assert len(filtered(runner)[1]) == 1
        assert len(runner.looks) == looks


def test_it_looks_only_while_innovations_do_not_fit_over_ten_seconds_and_seldom_in_vain() -> None:
    """From 12.2 s on: after five looks, one a second, in vain at every fifth second of the run only."""
    runner = Declared(gain=10.0)
    assert filtered(runner)[1] == ()
    ends = [b for _, b in runner.looks]
    assert ends == [130, 140, 150, 160, 170, 210, 260]
    for a, b in runner.looks:
        assert (b - 1 - a) * STEP_S <= 10.0 + 1e-9
        assert (b - 1 - (a - 10)) * STEP_S > 10.0


def test_looks_start_anew_after_innovations_fitted() -> None:
    runner = Declared(gain=10.0, end=16.0)
    ratio = runner.begun(None, None)[0].ratio  # type: ignore[arg-type]
    ratio[200:, 3] = 0.6
    begun = runner.begun
    runner.begun = lambda *x: (SimpleNamespace(ratio=ratio, memory=None), begun(*x)[1])  # type: ignore[method-assign]
    filtered(runner)
    assert [b for _, b in runner.looks] == [130, 140, 150, 160, 210, 220, 230, 240, 250, 260]


def test_velocities_or_fields_that_miss_by_half_their_gate_have_grown_and_no_single_one_counts_above_nine() -> None:
    nan = np.nan
    for column, counts in ((0, True), (1, False), (2, False), (3, True)):
        ratio = np.full((4, 4), nan)
        ratio[:2, column] = [0.41, 0.61]
        assert online.grown(ratio) is counts
        ratio[:2, column] = [0.39, 0.59]
        assert not online.grown(ratio)
    many = np.full((19, 4), 0.0)
    many[0] = 1e6
    assert not online.grown(many)
    assert online.grown(many[:17])
    assert not online.grown(np.full((4, 4), nan))


def test_four_jumps_are_the_most() -> None:
    runner = Declared(bad=2.0)
    shocks = runner.shocks

    def again(*given: Any) -> Any:
        runner.at = STEP_S * (given[5] - 8)
        return shocks(*given)

    runner.shocks = again  # type: ignore[method-assign]
    assert len(filtered(runner)[1]) == 4
