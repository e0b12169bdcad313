"""How flights ended: impacts, overturns, tumbles, hard landings, and the time in which a vehicle was a wreck."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans
from attlog.core.spans import Span
from attlog.flight.model import FlightLog
from attlog.segments.airborne import InAir
from attlog.segments.flight_signs import STEP_S, G, Grid, true_runs
from attlog.segments.impacts import (
    AFTER_S,
    AGREES_DEG,
    BEFORE_S,
    FELL_S,
    LATER_S,
    LIES_DRIVEN_DEG,
    LYING_M_S2,
    MIN_IMPACT_G,
    REST_BEGINS_S,
    REST_ENDS_S,
    CrashContext,
    CrashEvent,
    find_impacts,
    impact_peaks,
    max_rate_dps,
    onboard_tilt,
    rest_tilt,
    shows_impacts,
    static_down,
)

__all__ = ["CrashEvent", "FlightOutcome", "Wreck", "find_crashes", "shows_impacts"]


# Overturns and tumbles: control lost without a blow, or before one.

OVER_DEG, OVER_S, INVERTED_DEG, INVERTED_S = 90.0, 0.2, 120.0, 0.05
UPRIGHT_DEG, UPRIGHT_S = 60.0, 5.0
TURNED_DPS, TURNED_S = 100.0, 3.0
TUMBLE_DPS, TUMBLE_S = 400.0, 0.3
TIPPED_DEG, STOOD_DEG, LIES_S = 30.0, 15.0, 3.0
REPORTED_S = 10.0


def find_overturns(scene: CrashContext) -> list[CrashEvent]:
    """Tilts beyond 90 deg that came from being upright, that the IMU confirms, and that are no aerobatics."""
    t, deg = scene.tilt.t, scene.tilt.deg
    if not len(t):
        return []
    allowed = spans.merge([*scene.armed, *scene.air.spans])
    limit = OVER_DEG
    found: list[CrashEvent] = []
    for a, b in true_runs((deg > limit) & spans.inside(t, allowed)):
        until = float(min(t[min(b, len(t) - 1)], t[b - 1] + 0.5))
        largest = float(np.max(deg[a:b]))
        inverted = [(i, j) for i, j in true_runs(deg[a:b] > INVERTED_DEG)]
        long = until - t[a] >= OVER_S
        long |= any(t[min(a + j, len(t) - 1)] - t[a + i] >= INVERTED_S for i, j in inverted)
        upright = deg[spans.between(t, t[a] - UPRIGHT_S, float(t[a]))]
        if (
            not long
            or not len(upright)
            or np.min(upright) > UPRIGHT_DEG
            or not _imu_confirms(scene, float(t[a]), until)
        ):
            continue
        if found and t[a] - found[-1].t_end < UPRIGHT_S:
            most = max(found[-1].size, largest)
            found[-1] = replace(found[-1], t_end=until, size=most, why=_overturn_text(most))
            continue
        lying = rest_tilt(scene, until)
        beyond = lying is not None and lying > LIES_DRIVEN_DEG
        if scene.flies_at(float(t[a]) + LATER_S) and not beyond and not _has_impact(scene, float(t[a]), until):
            continue
        if not _was_driven(scene, float(t[a]), until, lying):
            continue
        source = (_attitude_source(scene),)
        found.append(
            CrashEvent("overturn", float(t[a]), until, largest, "deg", _overturn_text(largest), lying, sources=source)
        )
    return found


def _overturn_text(deg: float) -> str:
    return f"it turned over to {deg:.0f} deg"


def _tumble_text(dps: float) -> str:
    return f"it tumbled at up to {dps:.0f} deg/s that nobody asked for"


def _attitude_source(scene: CrashContext) -> str:
    attitude = scene.log.onboard_attitude or scene.log.truth
    return attitude.source if attitude is not None else ""


def _was_driven(scene: CrashContext, t: float, until: float, lying: float | None) -> bool:
    """Whether what turned over was in flight or at lift-off: driven or in the air as it turned."""
    grid = scene.air.grid
    part = spans.between(grid.t, t - 3.0, t + 0.5)
    driven = bool(scene.air.driven[part].any()) if part.stop > part.start else False
    return driven or any(a - BEFORE_S <= t <= b + AFTER_S for a, b in scene.air.spans)


def _has_impact(scene: CrashContext, t0: float, t1: float) -> bool:
    """Whether there is a blow from 3 s before to 3 s after."""
    within = [(t0 - FELL_S, t1 + FELL_S)]
    return any(impact_peaks(imu, within, MIN_IMPACT_G) for imu in scene.log.imus)


def _imu_confirms(scene: CrashContext, t0: float, t1: float) -> bool:
    """Whether the IMU itself shows a turn: a fast rate before, or gravity from the side or above afterwards.

    Without an IMU in the log the autopilot's own report of a crash stands in.
    """
    if not scene.log.imus:
        reports = [p.t for p in scene.log.problems if p.code == "crash" and p.t is not None]
        return any(t0 - TURNED_S <= t <= t1 + REPORTED_S for t in reports)
    if max_rate_dps(scene, t0 - TURNED_S, t0 + 0.5) > TURNED_DPS:
        return True
    lying = rest_tilt(scene, t0)
    return lying is not None and lying > UPRIGHT_DEG


def find_tumbles(scene: CrashContext) -> list[CrashEvent]:
    """Rates above 400 deg/s in the air that nobody asked for."""
    imu = scene.log.replay_imu or next(iter(scene.log.imus), None)
    wanted = scene.log.setpoints.rates
    if imu is None or wanted is None or len(wanted.t) < 2 or scene.log.kind.winged:
        return []
    t, rate = imu.gyro.t_best, np.degrees(rotation.length(imu.gyro.x))
    asked = np.degrees(rotation.length(np.nan_to_num(wanted.x, posinf=0.0, neginf=0.0)))
    found: list[CrashEvent] = []
    for a, b in true_runs(
        (rate > TUMBLE_DPS) & spans.inside(t, spans.merge((x, y + BEFORE_S) for x, y in scene.air.spans))
    ):
        least = TUMBLE_S if scene.end - t[b - 1] > 0.5 else 0.1
        if t[b - 1] - t[a] < least or scene.flies_at(float(t[a]) + LATER_S):
            continue
        around = asked[spans.between(wanted.t, t[a] - 0.1, t[b - 1] + 0.1)]
        fastest = float(rate[a:b].max())
        if len(around) and float(np.max(around)) > 0.5 * float(np.median(rate[a:b])):
            continue
        if found and t[a] - found[-1].t_end < UPRIGHT_S:
            most = max(found[-1].size, fastest)
            found[-1] = replace(found[-1], t_end=float(t[b - 1]), size=most, why=_tumble_text(most))
            continue
        source = (imu.gyro.source,)
        found.append(
            CrashEvent("tumble", float(t[a]), float(t[b - 1]), fastest, "deg/s", _tumble_text(fastest), sources=source)
        )
    return found


def find_tipped(scene: CrashContext, crashes: list[CrashEvent]) -> list[CrashEvent]:
    """Flights that end without a blow, and after which the vehicle lies beyond 30 deg."""
    found = []
    for _, b in scene.air.spans:
        if any(abs(e.t - b) < UPRIGHT_S for e in crashes):
            continue
        lying = rest_tilt(scene, b)
        if lying is not None and lying > TIPPED_DEG and not scene.driven_at(b + REST_BEGINS_S, b + REST_ENDS_S):
            why = f"it ended tipped over, at {lying:.0f} deg"
            found.append(CrashEvent("overturn", b, b, lying, "deg", why, lying, sources=("accelerometer",)))
    return found


def find_falls(scene: CrashContext) -> list[CrashEvent]:
    """Falls from standing with motors driven: tilt and accelerometer pass 30 deg together and stay there for 3 s.

    In flight the force of rotors does not lean with the tilt; wings are another matter.
    """
    grid = scene.air.grid
    if grid.slow or scene.log.kind.winged or not np.isfinite(grid.down[:, 0]).any():
        return []
    down, force = static_down(scene), rotation.length(grid.force)
    tilt = np.degrees(np.arccos(np.clip(np.nan_to_num(grid.down @ down, nan=1.0), -1.0, 1.0)))
    leans = np.degrees(np.arccos(np.clip(-grid.force @ down / np.maximum(force, 1e-9), -1.0, 1.0)))
    lying = (tilt > TIPPED_DEG) & (leans > TIPPED_DEG) & (np.abs(tilt - leans) < AGREES_DEG) & grid.known
    lying &= np.abs(force - G) < LYING_M_S2
    before, found = round(UPRIGHT_S / STEP_S), []
    for a, b in true_runs(lying):
        stood = np.maximum(tilt, leans)[max(a - before, 0) : a]
        if (b - a) * STEP_S < LIES_S or not len(stood) or stood.min() > STOOD_DEG or not scene.air.driven[a]:
            continue
        lean = float(np.median(tilt[a:b]))
        t, t_end = float(grid.t[a]), float(grid.t[b - 1])
        passed = scene.tilt.t[spans.between(scene.tilt.t, t - 1.0, t + 0.5)]
        above = scene.tilt.deg[spans.between(scene.tilt.t, t - 1.0, t + 0.5)] > TIPPED_DEG
        t = float(passed[np.argmax(above)]) if above.any() else t
        why = f"it fell over and lay at {lean:.0f} deg"
        found.append(
            CrashEvent("overturn", t, t_end, lean, "deg", why, lean, sources=(_attitude_source(scene), "accelerometer"))
        )
    return found


# How flights ended, and from when to when a vehicle was a wreck.
#
# Sizes are those of docs/story.md, measured on real crashes, hard landings and aerobatics. What an autopilot
# says of a crash is evidence beside these, never a crash by itself: flags come from benches and hands, too.

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
class FlightOutcome:
    """The flights of a log, how they ended, and when it was a wreck."""

    flights: list[Span]
    endings: list[CrashEvent]
    wrecks: list[Wreck]


def find_crashes(log: FlightLog, air: InAir, armed: list[Span] | None, end: float) -> FlightOutcome:
    """Flights without those of wrecks, and how they ended, in time order.

    ``armed``: None where unknown; ``end``: of the log. A flight ends with the first crash in it. A later one counts
    once the vehicle has stood upright, still and undriven.
    """
    if not log.kind.flies or not len(air.grid.t):
        return FlightOutcome([], [], [])
    scene = CrashContext(
        log, air, armed if armed is not None else [(float(air.grid.t[0]), end)], end, onboard_tilt(log)
    )
    found = [*find_impacts(scene), *find_overturns(scene), *find_tumbles(scene)]
    found += find_tipped(scene, [e for e in found if e.is_crash])
    crashes = [e for e in found if e.is_crash]
    found += [e for e in find_falls(scene) if not any(abs(c.t - e.t) < UPRIGHT_S for c in crashes)]
    return _flights_before_wrecks(scene, sorted(found, key=lambda e: e.t))


def _flights_before_wrecks(scene: CrashContext, found: list[CrashEvent]) -> FlightOutcome:
    """Flights that end with the first crash in them, those of a wreck left out, and the endings that count."""
    kept: list[CrashEvent] = []
    wrecks: list[Wreck] = []
    crash: list[CrashEvent] = []

    def close(t1: float) -> None:
        blow = next((e.t for e in crash if e.kind == "impact"), crash[0].t)
        wrecks.append(Wreck(crash[0].t, blow, t1, "; ".join(e.why for e in crash)))
        crash.clear()

    times: list[tuple[float, CrashEvent | None]] = [(a, None) for a, _ in scene.air.spans]
    times += [(e.t, e) for e in found]
    for t, ending in sorted(times, key=lambda x: (x[0], x[1] is not None)):
        if crash:
            stood = _stood_since(scene.air.grid, scene.air.driven, crash[0].t, t)
            if stood is not None:
                close(stood)
        if ending is None:
            continue
        same = crash and ending.is_crash and t - crash[-1].t_end < UPRIGHT_S and _same_crash(crash[-1], ending)
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
    return FlightOutcome(stretched, kept, wrecks)


def _same_crash(last: CrashEvent, ending: CrashEvent) -> bool:
    """Whether an ending tells more of the same crash: of another kind, or turned over after it had but fallen over."""
    return ending.kind != last.kind or (last.unit == "deg" and last.size < OVER_DEG < ending.size)


def _stood_since(grid: Grid, driven: Mask, crash: float, t: float) -> float | None:
    """From when it stood upright, still and undriven before a time: for 2 s, after a gap of 5 s for 1 s; else None."""
    part = spans.between(grid.t, crash + REST_BEGINS_S, t)
    if part.stop <= part.start:
        return None
    upright = -grid.force[:, 2] > np.cos(np.radians(STANDS_DEG)) * rotation.length(grid.force)
    gap_ends = [b for a, b in true_runs(~grid.known[part]) if (b - a) * STEP_S >= APART_S]
    for a, b in true_runs((upright & ~driven & grid.known)[part]):
        count = round((STANDS_S if a not in gap_ends else AFTER_GAP_S) / STEP_S)
        for k in range(part.start + a, part.start + b - count + 1, max(count // 2, 1)):
            if float(np.sqrt(np.sum(np.var(grid.force[k : k + count], axis=0)))) < STEADY_M_S2:
                return float(grid.t[k])
    return None
