"""Blows, impacts, overturns, tumbles and hard landings: how flights ended, from raw samples of every IMU.

Sizes are those of docs/story.md, measured on real crashes, hard landings and aerobatics. What an autopilot
says of a crash is evidence beside these, never a crash by itself: flags come from benches and hands, too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import FlightLog, Imu
from attlog.flight.vehicle import VehicleKind
from attlog.segments import spans
from attlog.segments.grid import STEP_S, G, Grid, runs
from attlog.segments.in_air import InAir
from attlog.segments.spans import Span

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kind = Literal["impact", "overturn", "tumble", "hard_landing"]

HARD_G, BLOW_G, SIMULATED_G, VIOLENT_G = 3.0, 4.0, 10.0, 8.0
BEFORE_S, AFTER_S = 1.5, 2.5
OUT, USUAL_S = 1.8, 5.0
"""A blow stands out this many times from the 98 % of the seconds before it; vibration does not."""
ARM_M = 0.1
"""Sensors lie up to this far from where a spinning vehicle turns around: what it feels of that is no blow."""
SETTLES_S, SETTLED_S = 1.5, 4.0
LYING_DPS, LYING_M_S2, AGREES_DEG = 60.0, 2.5, 30.0
LIES_DEG, LIES_DRIVEN_DEG, TIPPED_DEG = 20.0, 45.0, 30.0
FELL_DEG, FELL_S = 75.0, 3.0
STOPS_S = 1.0
SPUN_DPS, SPUN_DEG = 250.0, 30.0
LEANING_DEG = 20.0
LATER_S = 6.0
OVER_DEG, OVER_S, INVERTED_DEG, INVERTED_S = 90.0, 0.2, 120.0, 0.05
UPRIGHT_DEG, UPRIGHT_S = 60.0, 5.0
TURNED_DPS, TURNED_S = 100.0, 3.0
TUMBLE_DPS, TUMBLE_S = 400.0, 0.3
STANDS_S, STANDS_DEG, STEADY_M_S2 = 2.0, 25.0, 0.3
APART_S, AFTER_GAP_S = 5.0, 1.0
FAST_HZ = 40.0
"""From this rate of an IMU the blow of a crash shows; at 25 Hz a third of its peak is left."""


@dataclass(frozen=True, slots=True)
class Blow:
    """A force (g) at ``t`` s that stands out of what was before, by a unit of the log."""

    t: float
    g: float
    source: str
    rate: float


@dataclass(frozen=True, slots=True)
class Ending:
    """How a flight, or an attempt at one, ended at ``t`` s: by a crash or by a hard landing.

    ``size`` in ``unit``: g of a blow, deg of the largest tilt, deg/s of a tumble. ``lies_deg``: the angle at which
    it lay afterwards, None where it did not lie still. ``why``: a sentence with numbers; ``sources``: what tells it.
    """

    kind: Kind
    t: float
    t_end: float
    size: float
    unit: str
    why: str
    lies_deg: float | None = None
    rate: float = 0.0
    sources: tuple[str, ...] = ()

    @property
    def is_crash(self) -> bool:
        """Whether control or the vehicle was lost."""
        return self.kind != "hard_landing"


@dataclass(slots=True)
class Tilt:
    """Tilt (n,) in deg of the onboard attitude at ``t`` (n,) s."""

    t: Array
    deg: Array

    def largest(self, t0: float, t1: float) -> float:
        """The largest within [t0, t1] s, NaN without a sample."""
        return float(np.max(self.deg[spans.between(self.t, t0, t1)], initial=-np.inf)) if self._any(t0, t1) else np.nan

    def at(self, t: float) -> float:
        """The nearest to a time within 1 s, NaN without one."""
        if not len(self.t):
            return np.nan
        k = int(np.clip(np.searchsorted(self.t, t), 0, len(self.t) - 1))
        k = k - 1 if k and abs(self.t[k - 1] - t) < abs(self.t[k] - t) else k
        return float(self.deg[k]) if abs(self.t[k] - t) <= 1.0 else np.nan

    def _any(self, t0: float, t1: float) -> bool:
        part = spans.between(self.t, t0, t1)
        return bool(part.stop > part.start)


def tilt_of(log: FlightLog) -> Tilt:
    """The tilt of the onboard attitude, else of the truth; empty without one."""
    attitude = log.onboard_attitude or log.truth
    if attitude is None or not len(attitude.t):
        return Tilt(np.zeros(0), np.zeros(0))
    return Tilt(attitude.t, np.degrees(rotation.inclination_angle(attitude.q)))


def fast_enough(log: FlightLog) -> bool:
    """Whether some IMU of the log is fast enough to show the blow of a crash."""
    return any(imu.acc.rate >= FAST_HZ for imu in log.imus)


def find(log: FlightLog, air: InAir, armed: list[Span] | None, end: float) -> tuple[list[Span], list[Ending]]:
    """Flights without those of wrecks, and how they ended, in time order.

    ``armed``: None where unknown; ``end``: of the log. A flight ends with the first crash in it. A later one counts
    once the vehicle has stood upright, still and undriven.
    """
    if not log.kind.flies or not len(air.grid.t):
        return air.spans, []
    seen = _Seen(log, air, armed if armed is not None else [(float(air.grid.t[0]), end)], end, tilt_of(log))
    found = [*_impacts(seen), *_overturns(seen), *_tumbles(seen)]
    found += _tipped(seen, [e for e in found if e.is_crash])
    return _without_wrecks(seen, sorted(found, key=lambda e: e.t))


@dataclass(slots=True)
class _Seen:
    """What the rules look at."""

    log: FlightLog
    air: InAir
    armed: list[Span]
    end: float
    tilt: Tilt

    def flies_at(self, t: float) -> bool:
        """Whether it is in the air at a time."""
        return any(a <= t <= b for a, b in self.air.spans)

    def driven_at(self, t0: float, t1: float) -> bool:
        """Whether it was driven for most of [t0, t1] s."""
        part = spans.between(self.air.grid.t, t0, t1)
        return bool(np.mean(self.air.driven[part]) > 0.5) if part.stop > part.start else False


def blows(imu: Imu, within: list[Span], least_g: float) -> list[Blow]:
    """Blows above ``least_g`` that stand out of the seconds before them, within spans."""
    t, force = imu.acc.t_best, rotation.length(imu.acc.x) / G
    n = min(len(t), len(force), len(imu.gyro.x))
    t, force = t[:n], force[:n]
    hit = np.flatnonzero((force > least_g) & spans.inside(t, within))
    if not len(hit):
        return []
    spinning = rotation.length(imu.gyro.x[hit]) ** 2 * ARM_M / G
    hit = hit[force[hit] > least_g + np.where(spinning > 0.25, spinning, 0.0)]
    found: list[Blow] = []
    groups = np.split(hit, np.flatnonzero(np.diff(t[hit]) > 1.0) + 1) if len(hit) else []
    for group in groups:
        peak = float(np.max(force[group]))
        first = group[np.argmax(force[group] > max(least_g, 0.5 * peak))]
        before = force[spans.between(t, t[first] - USUAL_S, t[first] - 0.1)]
        if len(before) > 10 and peak < OUT * float(np.quantile(before, 0.98)):
            continue
        found.append(Blow(float(t[first]), peak, imu.acc.source, imu.acc.rate))
    return found


def lies(seen: _Seen, t: float) -> float | None:
    """The angle (deg) at which the vehicle lies after ``t`` s by its accelerometer, None where it does not lie still.

    With motors driven the onboard attitude has to agree, for rotors push, too.
    """
    t0, t1 = t + SETTLES_S, t + SETTLED_S
    for imu in seen.log.imus[:1] if seen.log.replay_imu is None else [seen.log.replay_imu]:
        part = spans.between(imu.acc.t_best, t0, t1)
        acc, gyro = imu.acc.x[part], imu.gyro.x[part]
        good = rotation.finite(acc) & rotation.finite(gyro)
        if np.count_nonzero(good) < 3 or imu.acc.t_best[part][-1] - t0 < 0.5:
            return None
        force = acc[good].mean(axis=0)
        turning = np.degrees(np.sqrt(np.mean(np.sum(gyro[good] ** 2, axis=1))))
        size = float(np.linalg.norm(force))
        if turning > LYING_DPS or abs(size - G) > LYING_M_S2:
            return None
        angle = float(np.degrees(np.arccos(np.clip(np.dot(-force / size, _stands(seen)), -1.0, 1.0))))
        if seen.driven_at(t0, t1):
            own = seen.tilt.at(0.5 * (t0 + t1))
            if np.isfinite(own) and abs(own - angle) > AGREES_DEG:
                return None
        return angle
    return None


def _stands(seen: _Seen) -> Array:
    """Down in body axes as the vehicle stands: along z, but for a tail-sitter as it stood before its first flight."""
    level = np.array([0.0, 0.0, 1.0])
    first = min((a for a, _ in seen.air.spans), default=0.0)
    grid = seen.air.grid
    before = (grid.t < first - 1.0) & grid.known & (np.nan_to_num(grid.dynamics) < 0.0)
    if seen.log.kind is not VehicleKind.VTOL or np.count_nonzero(before) < 10:
        return level
    force = -grid.force[before].mean(axis=0)
    down: Array = force / max(float(np.linalg.norm(force)), 1e-9)
    return level if down[2] > 0.5 else down


def _impacts(seen: _Seen) -> list[Ending]:
    """Blows in flight or beside it: impacts where something says so, else hard landings at a flight's end."""
    around = spans.merge((a - BEFORE_S, b + AFTER_S) for a, b in seen.air.spans)
    around = spans.intersect(around, [(a, b + AFTER_S) for a, b in seen.armed])
    every = [b for imu in seen.log.imus for b in blows(imu, around, HARD_G)]
    found: list[Ending] = []
    for blow in _together(every):
        why = _is_impact(seen, blow) if blow.g > BLOW_G else ""
        lying = lies(seen, blow.t)
        if why:
            found.append(
                Ending("impact", blow.t, blow.t, blow.g, "g", f"a blow of {blow.g:.1f} g, {why}", lying, blow.rate,
                       (blow.source,))
            )  # fmt: skip
        elif blow.g > (SIMULATED_G if seen.log.simulated else HARD_G) and _at_an_end(seen, blow.t):
            why = f"a blow of {blow.g:.1f} g as it landed"
            found.append(Ending("hard_landing", blow.t, blow.t, blow.g, "g", why, lying, blow.rate, (blow.source,)))
    return found


def _together(every: list[Blow]) -> list[Blow]:
    """Blows within 1 s of each other as one: the earliest time of those that reach half of the largest size."""
    found: list[Blow] = []
    for blow in sorted(every, key=lambda b: b.t):
        if found and blow.t - found[-1].t < 1.0:
            stronger = max(found[-1], blow, key=lambda b: b.g)
            t = found[-1].t if found[-1].g > 0.5 * stronger.g else blow.t
            found[-1] = replace(stronger, t=t)
        else:
            found.append(blow)
    return found


def _is_impact(seen: _Seen, blow: Blow) -> str:
    """What makes an impact of a blow above 4 g; empty where nothing does."""
    t = blow.t
    if seen.flies_at(t + LATER_S):
        return ""
    lying = lies(seen, t)
    driven = seen.driven_at(t + SETTLES_S, t + SETTLED_S)
    if lying is not None and lying > (LIES_DRIVEN_DEG if driven else LIES_DEG):
        return f"and it lay at {lying:.0f} deg"
    fell = seen.tilt.largest(t, t + FELL_S)
    if fell > FELL_DEG:
        return f"and it tilted to {fell:.0f} deg"
    if seen.end - t < STOPS_S:
        return "and the log stops"
    spun = _fastest_dps(seen, t - 0.5, t + 0.5)
    leaned = seen.tilt.largest(t - 0.5, t + 0.5)
    if spun > SPUN_DPS and leaned > SPUN_DEG:
        return f"at {spun:.0f} deg/s and {leaned:.0f} deg of tilt"
    leaned = seen.tilt.largest(t - 0.5, t)
    if blow.g > VIOLENT_G and leaned > LEANING_DEG:
        return f"after {leaned:.0f} deg of tilt"
    return ""


def _at_an_end(seen: _Seen, t: float) -> bool:
    return any(b - BEFORE_S <= t <= b + AFTER_S for _, b in seen.air.spans)


def _fastest_dps(seen: _Seen, t0: float, t1: float) -> float:
    """The fastest rate in deg/s of any IMU within [t0, t1] s, 0 without a sample."""
    largest = 0.0
    for imu in seen.log.imus:
        x = imu.gyro.x[spans.between(imu.gyro.t_best, t0, t1)]
        if len(x):
            largest = max(largest, float(np.degrees(np.nanmax(rotation.length(x)))))
    return largest


def _overturns(seen: _Seen) -> list[Ending]:
    """Tilts beyond 90 deg that came from being upright, that the IMU confirms, and that are no aerobatics."""
    t, deg = seen.tilt.t, seen.tilt.deg
    if not len(t):
        return []
    allowed = spans.merge([*seen.armed, *seen.air.spans])
    limit = OVER_DEG
    found: list[Ending] = []
    for a, b in runs((deg > limit) & spans.inside(t, allowed)):
        until = float(min(t[min(b, len(t) - 1)], t[b - 1] + 0.5))
        largest = float(np.max(deg[a:b]))
        inverted = [(i, j) for i, j in runs(deg[a:b] > INVERTED_DEG)]
        long = until - t[a] >= OVER_S
        long |= any(t[min(a + j, len(t) - 1)] - t[a + i] >= INVERTED_S for i, j in inverted)
        upright = deg[spans.between(t, t[a] - UPRIGHT_S, float(t[a]))]
        if not long or not len(upright) or np.min(upright) > UPRIGHT_DEG or not _felt(seen, float(t[a]), until):
            continue
        if found and t[a] - found[-1].t_end < UPRIGHT_S:
            last = found[-1]
            found[-1] = replace(last, t_end=until, size=max(last.size, largest))
            continue
        lying = lies(seen, until)
        beyond = lying is not None and lying > LIES_DRIVEN_DEG
        if seen.flies_at(float(t[a]) + LATER_S) and not beyond and not _hit(seen, float(t[a]), until):
            continue
        if not _ends_badly(seen, float(t[a]), until, lying):
            continue
        why = f"it turned over to {largest:.0f} deg"
        found.append(Ending("overturn", float(t[a]), until, largest, "deg", why, lying, sources=(_attitude(seen),)))
    return found


def _attitude(seen: _Seen) -> str:
    attitude = seen.log.onboard_attitude or seen.log.truth
    return attitude.source if attitude is not None else ""


def _ends_badly(seen: _Seen, t: float, until: float, lying: float | None) -> bool:
    """Whether what turned over was in flight or at lift-off: driven or in the air as it turned."""
    grid = seen.air.grid
    part = spans.between(grid.t, t - 3.0, t + 0.5)
    driven = bool(seen.air.driven[part].any()) if part.stop > part.start else False
    return driven or any(a - BEFORE_S <= t <= b + AFTER_S for a, b in seen.air.spans)


def _hit(seen: _Seen, t0: float, t1: float) -> bool:
    """Whether there is a blow from 3 s before to 3 s after."""
    within = [(t0 - FELL_S, t1 + FELL_S)]
    return any(blows(imu, within, BLOW_G) for imu in seen.log.imus)


def _felt(seen: _Seen, t0: float, t1: float) -> bool:
    """Whether the IMU itself shows a turn: a fast rate before, or gravity from the side or above afterwards."""
    if _fastest_dps(seen, t0 - TURNED_S, t0 + 0.5) > TURNED_DPS:
        return True
    lying = lies(seen, t0)
    return lying is not None and lying > UPRIGHT_DEG


def _tumbles(seen: _Seen) -> list[Ending]:
    """Rates above 400 deg/s in the air that nobody asked for."""
    imu = seen.log.replay_imu or next(iter(seen.log.imus), None)
    wanted = seen.log.rate_setpoints
    if imu is None or wanted is None or len(wanted.t) < 2 or seen.log.kind.winged:
        return []
    t, rate = imu.gyro.t_best, np.degrees(rotation.length(imu.gyro.x))
    asked = np.degrees(rotation.length(np.nan_to_num(wanted.x)))
    found: list[Ending] = []
    for a, b in runs((rate > TUMBLE_DPS) & spans.inside(t, spans.merge((x, y + BEFORE_S) for x, y in seen.air.spans))):
        least = TUMBLE_S if seen.end - t[b - 1] > 0.5 else 0.1
        if t[b - 1] - t[a] < least or seen.flies_at(float(t[a]) + LATER_S):
            continue
        around = asked[spans.between(wanted.t, t[a] - 0.1, t[b - 1] + 0.1)]
        fastest = float(rate[a:b].max())
        if len(around) and float(np.max(around)) > 0.5 * float(np.median(rate[a:b])):
            continue
        why = f"it tumbled at up to {fastest:.0f} deg/s that nobody asked for"
        if found and t[a] - found[-1].t_end < UPRIGHT_S:
            found[-1] = replace(found[-1], t_end=float(t[b - 1]), size=max(found[-1].size, fastest))
            continue
        found.append(Ending("tumble", float(t[a]), float(t[b - 1]), fastest, "deg/s", why, sources=(imu.gyro.source,)))
    return found


def _tipped(seen: _Seen, crashes: list[Ending]) -> list[Ending]:
    """Flights that end without a blow, and after which the vehicle lies beyond 30 deg."""
    found = []
    for _, b in seen.air.spans:
        if any(abs(e.t - b) < UPRIGHT_S for e in crashes):
            continue
        lying = lies(seen, b)
        if lying is not None and lying > TIPPED_DEG and not seen.driven_at(b + SETTLES_S, b + SETTLED_S):
            why = f"it ended tipped over, at {lying:.0f} deg"
            found.append(Ending("overturn", b, b, lying, "deg", why, lying, sources=("accelerometer",)))
    return found


def _without_wrecks(seen: _Seen, found: list[Ending]) -> tuple[list[Span], list[Ending]]:
    """Spans that end at the first crash in them, those of a wreck left out, and the endings that count."""
    kept: list[Ending] = []
    flown: list[Span] = []
    crashed: float | None = None
    events: list[tuple[float, int, Span | Ending]] = [(a, 0, (a, b)) for a, b in seen.air.spans]
    events += [(e.t, 1, e) for e in found]
    for t, _, event in sorted(events, key=lambda x: (x[0], x[1])):
        again = crashed is None or _stood(seen.air.grid, seen.air.driven, crashed, t)
        if isinstance(event, Ending):
            last = kept[-1] if kept else None
            same = last is not None and last.is_crash and event.t - last.t_end < UPRIGHT_S and event.kind != last.kind
            if again or same:
                kept.append(event)
                crashed = (event.t if crashed is None or again else crashed) if event.is_crash else crashed
                flown = [(a, min(b, max(event.t, a))) if event.is_crash and a <= event.t else (a, b) for a, b in flown]
        elif again:
            flown.append(event)
    ends = [e.t for e in kept if e.kind == "impact"]
    stretched = [(a, next((e for e in ends if b < e <= b + AFTER_S), b)) for a, b in flown]
    return [s for s in stretched if s[1] > s[0]], kept


def _stood(grid: Grid, driven: Mask, crash: float, t: float) -> bool:
    """Whether it stood upright, still and undriven between a crash and a time: for 2 s, after a gap of 5 s for 1 s."""
    part = spans.between(grid.t, crash + SETTLES_S, t)
    if part.stop <= part.start:
        return False
    upright = -grid.force[:, 2] > np.cos(np.radians(STANDS_DEG)) * rotation.length(grid.force)
    gap_ends = [b for a, b in runs(~grid.known[part]) if (b - a) * STEP_S >= APART_S]
    for a, b in runs((upright & ~driven & grid.known)[part]):
        count = round((STANDS_S if a not in gap_ends else AFTER_GAP_S) / STEP_S)
        for k in range(part.start + a, part.start + b - count + 1, max(count // 2, 1)):
            if float(np.sqrt(np.sum(np.var(grid.force[k : k + count], axis=0)))) < STEADY_M_S2:
                return True
    return False
