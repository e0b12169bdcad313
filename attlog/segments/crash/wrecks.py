"""How flights ended, and from when to when a vehicle was a wreck.

Sizes are those of docs/story.md, measured on real crashes, hard landings and aerobatics. What an autopilot
says of a crash is evidence beside these, never a crash by itself: flags come from benches and hands, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import FlightLog
from attlog.segments import spans
from attlog.segments.airborne.grid import STEP_S, Grid, runs
from attlog.segments.airborne.in_air import InAir
from attlog.segments.crash.blows import AFTER_S, impacts
from attlog.segments.crash.overturns import OVER_DEG, UPRIGHT_S, falls, overturns, tipped, tumbles
from attlog.segments.crash.scene import SETTLES_S, Ending, Scene, tilt_of
from attlog.segments.spans import Span

Mask = NDArray[np.bool_]

STANDS_S, STANDS_DEG, STEADY_M_S2 = 2.0, 25.0, 0.3
APART_S, AFTER_GAP_S = 5.0, 1.0


@dataclass(frozen=True, slots=True)
class Wreck:
    """From a crash at ``t0`` s until the vehicle stood upright again, or the log ended, at ``t1`` s.

    ``blow`` s: the first impact of the crash, without one ``t0``. ``why``: a sentence with the numbers.
    """

    t0: float
    blow: float
    t1: float
    why: str


@dataclass(frozen=True, slots=True)
class Flown:
    """The flights of a log, how they ended, and when it was a wreck."""

    flights: list[Span]
    endings: list[Ending]
    wrecks: list[Wreck]


def find(log: FlightLog, air: InAir, armed: list[Span] | None, end: float) -> Flown:
    """Flights without those of wrecks, and how they ended, in time order.

    ``armed``: None where unknown; ``end``: of the log. A flight ends with the first crash in it. A later one counts
    once the vehicle has stood upright, still and undriven.
    """
    if not log.kind.flies or not len(air.grid.t):
        return Flown([], [], [])
    scene = Scene(log, air, armed if armed is not None else [(float(air.grid.t[0]), end)], end, tilt_of(log))
    found = [*impacts(scene), *overturns(scene), *tumbles(scene)]
    found += tipped(scene, [e for e in found if e.is_crash])
    crashes = [e for e in found if e.is_crash]
    found += [e for e in falls(scene) if not any(abs(c.t - e.t) < UPRIGHT_S for c in crashes)]
    return _without_wrecks(scene, sorted(found, key=lambda e: e.t))


def _without_wrecks(scene: Scene, found: list[Ending]) -> Flown:
    """Flights that end with the first crash in them, those of a wreck left out, and the endings that count."""
    kept: list[Ending] = []
    wrecks: list[Wreck] = []
    crash: list[Ending] = []

    def close(t1: float) -> None:
        blow = next((e.t for e in crash if e.kind == "impact"), crash[0].t)
        wrecks.append(Wreck(crash[0].t, blow, t1, "; ".join(e.why for e in crash)))
        crash.clear()

    times: list[tuple[float, Ending | None]] = [(a, None) for a, _ in scene.air.spans]
    times += [(e.t, e) for e in found]
    for t, ending in sorted(times, key=lambda x: (x[0], x[1] is not None)):
        if crash:
            stood = _stood(scene.air.grid, scene.air.driven, crash[0].t, t)
            if stood is not None:
                close(stood)
        if ending is None:
            continue
        same = crash and ending.is_crash and t - crash[-1].t_end < UPRIGHT_S and _adds(crash[-1], ending)
        if not crash or same:
            kept.append(ending)
            crash += [ending] if ending.is_crash else []
    if crash:
        close(scene.end)
    lost = spans.complement([(w.blow, w.t1) for w in wrecks], -np.inf, np.inf)
    flown = spans.intersect(scene.air.spans, lost)
    begun = {a for a, _ in scene.air.spans}
    blows = [e.t for e in kept if e.kind == "impact"]
    stretched = [(a, next((e for e in blows if b < e <= b + AFTER_S), b)) for a, b in flown if a in begun]
    return Flown(stretched, kept, wrecks)


def _adds(last: Ending, ending: Ending) -> bool:
    """Whether an ending tells more of the same crash: of another kind, or turned over after it had but fallen over."""
    return ending.kind != last.kind or (last.unit == "deg" and last.size < OVER_DEG < ending.size)


def _stood(grid: Grid, driven: Mask, crash: float, t: float) -> float | None:
    """From when it stood upright, still and undriven before a time: for 2 s, after a gap of 5 s for 1 s; else None."""
    part = spans.between(grid.t, crash + SETTLES_S, t)
    if part.stop <= part.start:
        return None
    upright = -grid.force[:, 2] > np.cos(np.radians(STANDS_DEG)) * rotation.length(grid.force)
    gap_ends = [b for a, b in runs(~grid.known[part]) if (b - a) * STEP_S >= APART_S]
    for a, b in runs((upright & ~driven & grid.known)[part]):
        count = round((STANDS_S if a not in gap_ends else AFTER_GAP_S) / STEP_S)
        for k in range(part.start + a, part.start + b - count + 1, max(count // 2, 1)):
            if float(np.sqrt(np.sum(np.var(grid.force[k : k + count], axis=0)))) < STEADY_M_S2:
                return float(grid.t[k])
    return None
