"""What crashes are judged by: flights, tilt, how it lay afterwards, how fast it turned."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans
from attlog.core.spans import Span
from attlog.flight.model import FlightLog, Imu
from attlog.flight.vehicle import VehicleKind
from attlog.segments.airborne import InAir
from attlog.segments.flight_signs import G

Array = NDArray[np.float64]
CrashKind = Literal["impact", "overturn", "tumble", "hard_landing"]

REST_BEGINS_S, REST_ENDS_S = 1.5, 4.0
# It lies where it turns slower and feels gravity alone; with motors driven tilt and force agree to so many degrees.
LYING_DPS, LYING_M_S2, AGREES_DEG = 60.0, 2.5, 30.0


@dataclass(frozen=True, slots=True)
class CrashEvent:
    """How a flight, or an attempt at one, ended at ``t`` s: by a crash or by a hard landing.

    ``size`` in ``unit``: g of a blow, deg of the largest tilt, deg/s of a tumble. ``lies_deg``: the angle at which
    it lay afterwards, None where it did not lie still. ``why``: a sentence with numbers; ``sources``: what tells it.
    """

    kind: CrashKind
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
class TiltTrack:
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


def onboard_tilt(log: FlightLog) -> TiltTrack:
    """The tilt of the onboard attitude, else of the truth; empty without one."""
    attitude = log.onboard_attitude or log.truth
    if attitude is None or not len(attitude.t):
        return TiltTrack(np.zeros(0), np.zeros(0))
    return TiltTrack(attitude.t, np.degrees(rotation.tilt_angle(attitude.q)))


@dataclass(slots=True)
class CrashContext:
    """What the rules look at."""

    log: FlightLog
    air: InAir
    armed: list[Span]
    end: float
    tilt: TiltTrack

    def flies_at(self, t: float) -> bool:
        """Whether it is in the air at a time."""
        return any(a <= t <= b for a, b in self.air.spans)

    def driven_at(self, t0: float, t1: float) -> bool:
        """Whether it was driven for most of [t0, t1] s."""
        part = spans.between(self.air.grid.t, t0, t1)
        return bool(np.mean(self.air.driven[part]) > 0.5) if part.stop > part.start else False


def rest_tilt(scene: CrashContext, t: float) -> float | None:
    """The angle (deg) at which the vehicle lies after ``t`` s by an accelerometer, None where it does not lie still.

    The replayed unit tells; where it has no samples then, or feels another force than gravity, the next one does. With
    motors driven the onboard attitude has to agree, for rotors push, too.
    """
    t0, t1 = t + REST_BEGINS_S, t + REST_ENDS_S
    replayed = scene.log.replay_imu
    for imu in sorted(scene.log.imus, key=lambda one: one is not replayed):
        angle = _rest_tilt_of(scene, imu, t0, t1)
        if angle is None:
            continue
        own = scene.tilt.at(0.5 * (t0 + t1))
        if scene.driven_at(t0, t1) and np.isfinite(own) and abs(own - angle) > AGREES_DEG:
            return None
        return angle
    return None


def _rest_tilt_of(scene: CrashContext, imu: Imu, t0: float, t1: float) -> float | None:
    """The angle (deg) between what carries a unit within [t0, t1] s and what it stands on; None where it moves."""
    n = min(len(imu.acc.t_best), len(imu.acc.x), len(imu.gyro.x))
    part = spans.between(imu.acc.t_best[:n], t0, t1)
    t, acc, gyro = imu.acc.t_best[part], imu.acc.x[part], imu.gyro.x[part]
    good = rotation.finite_rows(acc) & rotation.finite_rows(gyro)
    if np.count_nonzero(good) < 3 or not t[good][-1] - t0 >= 0.5:
        return None
    force = acc[good].mean(axis=0)
    turning = np.degrees(np.sqrt(np.mean(np.sum(gyro[good] ** 2, axis=1))))
    size = float(np.linalg.norm(force))
    if turning > LYING_DPS or abs(size - G) > LYING_M_S2:
        return None
    return float(np.degrees(np.arccos(np.clip(np.dot(-force / size, static_down(scene)), -1.0, 1.0))))


def static_down(scene: CrashContext) -> Array:
    """Down (3,) in body axes as the vehicle stands: along z; of a tail-sitter as it stood before its first flight."""
    level = np.array([0.0, 0.0, 1.0])
    first = min((a for a, _ in scene.air.spans), default=0.0)
    grid = scene.air.grid
    before = (grid.t < first - 1.0) & grid.known & (np.nan_to_num(grid.dynamics) < 0.0)
    if scene.log.kind is not VehicleKind.VTOL or np.count_nonzero(before) < 10:
        return level
    force = -grid.force[before].mean(axis=0)
    down: Array = force / max(float(np.linalg.norm(force)), 1e-9)
    return level if down[2] > 0.5 else down


def max_rate_dps(scene: CrashContext, t0: float, t1: float) -> float:
    """The fastest rate in deg/s of any IMU within [t0, t1] s, 0 without a finite sample."""
    largest = 0.0
    for imu in scene.log.imus:
        x = imu.gyro.x[spans.between(imu.gyro.t_best, t0, t1)]
        largest = max(largest, float(np.degrees(np.fmax.reduce(rotation.length(x), initial=0.0))))
    return largest


# Blows: impacts and hard landings, from raw samples of every IMU.

MIN_HARD_LANDING_G, MIN_IMPACT_G, SIMULATED_G, VIOLENT_G = 3.0, 4.0, 10.0, 8.0
BEFORE_S, AFTER_S = 1.5, 2.5
# A blow stands out this many times from the 98 % of the seconds before it; vibration does not.
OUT, USUAL_S = 1.8, 5.0
# Sensors lie up to this far from where a spinning vehicle turns around: what it feels of that is no blow.
ARM_M = 0.1
LIES_DEG, LIES_DRIVEN_DEG = 20.0, 45.0
FELL_DEG, FELL_S = 75.0, 3.0
STOPS_S = 1.0
SPUN_DPS, SPUN_DEG = 250.0, 30.0
LEANING_DEG = 20.0
LATER_S = 6.0
# From this rate of an IMU the blow of a crash shows; at 25 Hz a third of its peak is left.
MIN_IMPACT_HZ = 40.0


@dataclass(frozen=True, slots=True)
class ImpactPeak:
    """A force (g) at ``t`` s that stands out of what was before, by a unit of the log."""

    t: float
    g: float
    source: str
    rate: float


def shows_impacts(log: FlightLog) -> bool:
    """Whether some IMU of the log is fast enough to show the blow of a crash."""
    return any(imu.acc.rate >= MIN_IMPACT_HZ for imu in log.imus)


def impact_peaks(imu: Imu, within: list[Span], least_g: float) -> list[ImpactPeak]:
    """Blows above ``least_g`` that stand out of the seconds before them, within spans."""
    t, force = imu.acc.t_best, rotation.length(imu.acc.x) / G
    n = min(len(t), len(force), len(imu.gyro.x))
    t, force = t[:n], force[:n]
    hit = np.flatnonzero((force > least_g) & spans.inside(t, within))
    if not len(hit):
        return []
    spinning = rotation.length(imu.gyro.x[hit]) ** 2 * ARM_M / G
    hit = hit[force[hit] > least_g + np.where(spinning > 0.25, spinning, 0.0)]
    found: list[ImpactPeak] = []
    groups = np.split(hit, np.flatnonzero(np.diff(t[hit]) > 1.0) + 1) if len(hit) else []
    for group in groups:
        peak = float(np.max(force[group]))
        first = group[np.argmax(force[group] > max(least_g, 0.5 * peak))]
        before = force[spans.between(t, t[first] - USUAL_S, t[first] - 0.1)]
        if len(before) > 10 and peak < OUT * float(np.quantile(before, 0.98)):
            continue
        found.append(ImpactPeak(float(t[first]), peak, imu.acc.source, imu.acc.rate))
    return found


def find_impacts(scene: CrashContext) -> list[CrashEvent]:
    """Blows in flight or beside it: impacts where something says so, else hard landings at a flight's end."""
    around = spans.merge((a - BEFORE_S, b + AFTER_S) for a, b in scene.air.spans)
    around = spans.intersect(around, [(a, b + AFTER_S) for a, b in scene.armed])
    every = [b for imu in scene.log.imus for b in impact_peaks(imu, around, MIN_HARD_LANDING_G)]
    found: list[CrashEvent] = []
    for blow in _merge_peaks(every):
        why = _impact_reason(scene, blow) if blow.g > MIN_IMPACT_G else ""
        lying = rest_tilt(scene, blow.t)
        if why:
            found.append(
                CrashEvent(
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
        elif blow.g > (SIMULATED_G if scene.log.simulated else MIN_HARD_LANDING_G) and _at_flight_end(scene, blow.t):
            why = f"a blow of {blow.g:.1f} g as it landed"
            found.append(CrashEvent("hard_landing", blow.t, blow.t, blow.g, "g", why, lying, blow.rate, (blow.source,)))
    return found


def _merge_peaks(every: list[ImpactPeak]) -> list[ImpactPeak]:
    """Blows within 1 s of each other as one: the earliest time of those that reach half of the largest size."""
    found: list[ImpactPeak] = []
    for blow in sorted(every, key=lambda b: b.t):
        if found and blow.t - found[-1].t < 1.0:
            stronger = max(found[-1], blow, key=lambda b: b.g)
            t = found[-1].t if found[-1].g > 0.5 * stronger.g else blow.t
            found[-1] = replace(stronger, t=t)
        else:
            found.append(blow)
    return found


def _impact_reason(scene: CrashContext, blow: ImpactPeak) -> str:
    """What makes an impact of a blow above 4 g; empty where nothing does."""
    t = blow.t
    if scene.flies_at(t + LATER_S):
        return ""
    lying = rest_tilt(scene, t)
    driven = scene.driven_at(t + REST_BEGINS_S, t + REST_ENDS_S)
    if lying is not None and lying > (LIES_DRIVEN_DEG if driven else LIES_DEG):
        return f"and it lay at {lying:.0f} deg"
    fell = scene.tilt.largest(t, t + FELL_S)
    if fell > FELL_DEG:
        return f"and it tilted to {fell:.0f} deg"
    if scene.end - t < STOPS_S:
        return "and the log stops"
    spun = max_rate_dps(scene, t - 0.5, t + 0.5)
    leaned = scene.tilt.largest(t - 0.5, t + 0.5)
    if spun > SPUN_DPS and leaned > SPUN_DEG:
        return f"at {spun:.0f} deg/s and {leaned:.0f} deg of tilt"
    leaned = scene.tilt.largest(t - 0.5, t)
    if blow.g > VIOLENT_G and leaned > LEANING_DEG:
        return f"after {leaned:.0f} deg of tilt"
    return ""


def _at_flight_end(scene: CrashContext, t: float) -> bool:
    return any(b - BEFORE_S <= t <= b + AFTER_S for _, b in scene.air.spans)
