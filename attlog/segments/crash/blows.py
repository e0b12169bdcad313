"""Blows: impacts and hard landings, from raw samples of every IMU."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from attlog.base import rotation
from attlog.flight.model import FlightLog, Imu
from attlog.segments import spans
from attlog.segments.airborne.grid import G
from attlog.segments.crash.scene import SETTLED_S, SETTLES_S, Ending, Scene, fastest_dps, lies
from attlog.segments.spans import Span

HARD_G, BLOW_G, SIMULATED_G, VIOLENT_G = 3.0, 4.0, 10.0, 8.0
BEFORE_S, AFTER_S = 1.5, 2.5
OUT, USUAL_S = 1.8, 5.0
"""A blow stands out this many times from the 98 % of the seconds before it; vibration does not."""
ARM_M = 0.1
"""Sensors lie up to this far from where a spinning vehicle turns around: what it feels of that is no blow."""
LIES_DEG, LIES_DRIVEN_DEG = 20.0, 45.0
FELL_DEG, FELL_S = 75.0, 3.0
STOPS_S = 1.0
SPUN_DPS, SPUN_DEG = 250.0, 30.0
LEANING_DEG = 20.0
LATER_S = 6.0
FAST_HZ = 40.0
"""From this rate of an IMU the blow of a crash shows; at 25 Hz a third of its peak is left."""


@dataclass(frozen=True, slots=True)
class Blow:
    """A force (g) at ``t`` s that stands out of what was before, by a unit of the log."""

    t: float
    g: float
    source: str
    rate: float


def fast_enough(log: FlightLog) -> bool:
    """Whether some IMU of the log is fast enough to show the blow of a crash."""
    return any(imu.acc.rate >= FAST_HZ for imu in log.imus)


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


def impacts(scene: Scene) -> list[Ending]:
    """Blows in flight or beside it: impacts where something says so, else hard landings at a flight's end."""
    around = spans.merge((a - BEFORE_S, b + AFTER_S) for a, b in scene.air.spans)
    around = spans.intersect(around, [(a, b + AFTER_S) for a, b in scene.armed])
    every = [b for imu in scene.log.imus for b in blows(imu, around, HARD_G)]
    found: list[Ending] = []
    for blow in _together(every):
        why = _is_impact(scene, blow) if blow.g > BLOW_G else ""
        lying = lies(scene, blow.t)
        if why:
            found.append(
                Ending(
                    "impact",
                    blow.t,
                    blow.t,
                    blow.g,
                    "g",
                    f"a blow of {blow.g:.1f} g, {why}",
                    lying,
                    blow.rate,
                    (blow.source,),
                )
            )
        elif blow.g > (SIMULATED_G if scene.log.simulated else HARD_G) and _at_an_end(scene, blow.t):
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


def _is_impact(scene: Scene, blow: Blow) -> str:
    """What makes an impact of a blow above 4 g; empty where nothing does."""
    t = blow.t
    if scene.flies_at(t + LATER_S):
        return ""
    lying = lies(scene, t)
    driven = scene.driven_at(t + SETTLES_S, t + SETTLED_S)
    if lying is not None and lying > (LIES_DRIVEN_DEG if driven else LIES_DEG):
        return f"and it lay at {lying:.0f} deg"
    fell = scene.tilt.largest(t, t + FELL_S)
    if fell > FELL_DEG:
        return f"and it tilted to {fell:.0f} deg"
    if scene.end - t < STOPS_S:
        return "and the log stops"
    spun = fastest_dps(scene, t - 0.5, t + 0.5)
    leaned = scene.tilt.largest(t - 0.5, t + 0.5)
    if spun > SPUN_DPS and leaned > SPUN_DEG:
        return f"at {spun:.0f} deg/s and {leaned:.0f} deg of tilt"
    leaned = scene.tilt.largest(t - 0.5, t)
    if blow.g > VIOLENT_G and leaned > LEANING_DEG:
        return f"after {leaned:.0f} deg of tilt"
    return ""


def _at_an_end(scene: Scene, t: float) -> bool:
    return any(b - BEFORE_S <= t <= b + AFTER_S for _, b in scene.air.spans)
