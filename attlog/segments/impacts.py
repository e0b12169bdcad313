"""Find impact peaks and hard landings in raw samples of every IMU."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, spans
from attlog.core.sorting import median, quantile
from attlog.core.spans import Span
from attlog.flight.model import FlightLog, Imu
from attlog.flight.vehicle import VehicleKind
from attlog.segments.airborne import InAir
from attlog.segments.flight_signs import G
from attlog.segments.heights import height_stream

Array = NDArray[np.float64]
CrashKind = Literal["impact", "overturn", "tumble", "hard_landing"]

# Window after an event in which rest is tested.
REST_BEGINS_S, REST_ENDS_S = 1.5, 4.0
# Rest: maximum rate, and maximum deviation of the force from gravity. Maximum difference between the tilt by attitude
# and by force while motors are driven.
MAX_REST_RATE_DPS, MAX_REST_FORCE_ERROR_M_S2, MAX_TILT_DIFFERENCE_DEG = 60.0, 2.5, 30.0
# Shortest rest that shows how it lies, and step of the search for the last one.
STILL_S, STILL_STEP_S = 0.4, 0.1


# Fall after an impact that was not with the ground: propellers shift a barometer by up to 4 m.
MIN_FALL_M = 5.0


@dataclass(frozen=True, slots=True)
class CrashEvent:
    """Crash or hard landing at ``t`` s.

    ``size`` in ``unit``: g of a peak, deg of the largest tilt, deg/s of a tumble. ``lies_deg``: tilt at rest
    afterwards, None without rest. ``rate``: IMU rate in Hz. ``why``: a sentence with numbers. ``sources``: evidence.
    ``fell_m``: how far it fell in the seconds after an impact, 0 where no height shows it. ``axis``: of an overturn,
    roll or pitch, empty for both.
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
    fell_m: float = 0.0
    axis: Literal["", "roll", "pitch"] = ""

    @property
    def in_air(self) -> bool:
        """True if an impact was above the ground: it fell far afterwards."""
        return self.fell_m > MIN_FALL_M

    @property
    def is_crash(self) -> bool:
        """True if control or the vehicle was lost."""
        return self.kind != "hard_landing"


@dataclass(slots=True)
class TiltTrack:
    """Tilt (n,) in deg of the onboard attitude at ``t`` (n,) s."""

    t: Array
    deg: Array

    def largest(self, t0: float, t1: float) -> float:
        """Return the largest tilt within [t0, t1] s, NaN without a sample."""
        return float(np.max(self.deg[spans.between(self.t, t0, t1)], initial=-np.inf)) if self._any(t0, t1) else np.nan

    def at(self, t: float) -> float:
        """Return the tilt nearest to a time within 1 s, NaN without any."""
        if not len(self.t):
            return np.nan
        k = int(np.clip(np.searchsorted(self.t, t), 0, len(self.t) - 1))
        k = k - 1 if k and abs(self.t[k - 1] - t) < abs(self.t[k] - t) else k
        return float(self.deg[k]) if abs(self.t[k] - t) <= 1.0 else np.nan

    def _any(self, t0: float, t1: float) -> bool:
        part = spans.between(self.t, t0, t1)
        return bool(part.stop > part.start)


def onboard_tilt(log: FlightLog) -> TiltTrack:
    """Return the tilt of the onboard attitude, else of the truth; empty without one."""
    attitude = log.onboard_attitude or log.truth
    if attitude is None or not len(attitude.t):
        return TiltTrack(np.zeros(0), np.zeros(0))
    return TiltTrack(attitude.t, np.degrees(rotation.tilt_angle(attitude.q)))


@dataclass(slots=True)
class CrashContext:
    """Input of the crash rules: log, signs of flight, armed spans, end of the log, tilt."""

    log: FlightLog
    air: InAir
    armed: list[Span]
    end: float
    tilt: TiltTrack

    def flies_at(self, t: float) -> bool:
        """Return whether the vehicle is in the air at a time."""
        return any(a <= t <= b for a, b in self.air.spans)

    @property
    def disarmed_s(self) -> float | None:
        """Time of the last disarming in s, None without one."""
        return self.armed[-1][1] if self.armed and self.armed[-1][1] < self.end else None

    def disarms_after(self, t: float) -> bool:
        """Return whether it is disarmed from ``t`` s on; many a log stops then."""
        line = self.log.state.armed
        return line is not None and any(
            at >= t and not value for at, value in zip(line.t.tolist(), line.value, strict=True)
        )

    def driven_at(self, t0: float, t1: float) -> bool:
        """Return whether the vehicle was driven for most of [t0, t1] s."""
        part = spans.between(self.air.grid.t, t0, t1)
        return bool(np.mean(self.air.driven[part]) > 0.5) if part.stop > part.start else False


def rest_tilt(context: CrashContext, t: float) -> float | None:
    """Return the tilt in deg at rest after ``t`` s by an accelerometer, None without rest.

    The replayed IMU is used, else the next one with samples whose mean force is gravity. With motors driven the onboard
    attitude has to agree, because rotor thrust adds to the force.
    """
    t0, t1 = t + REST_BEGINS_S, t + REST_ENDS_S
    replayed = context.log.replay_imu
    for imu in sorted(context.log.imus, key=lambda one: one is not replayed):
        angle = _rest_tilt_of(context, imu, t0, t1)
        if angle is None:
            continue
        own = context.tilt.at(0.5 * (t0 + t1))
        if context.driven_at(t0, t1) and np.isfinite(own) and abs(own - angle) > MAX_TILT_DIFFERENCE_DEG:
            return None
        return angle
    return None


def _rest_tilt_of(context: CrashContext, imu: Imu, t0: float, t1: float) -> float | None:
    """Return the tilt in deg at rest by an IMU, None if it moves or its samples end within 0.5 s."""
    t = imu.acc.t_best[spans.between(imu.acc.t_best, t0, t1)]
    return _tilt_while_still(context, imu, t0, t1) if len(t) and t[-1] - t0 >= 0.5 else None


def _tilt_while_still(context: CrashContext, imu: Imu, t0: float, t1: float) -> float | None:
    """Return the angle in deg between static down and an IMU's mean force, None if moving."""
    n = min(len(imu.acc.t_best), len(imu.acc.x), len(imu.gyro.x))
    part = spans.between(imu.acc.t_best[:n], t0, t1)
    acc, gyro = imu.acc.x[part], imu.gyro.x[part]
    good = rotation.finite_rows(acc) & rotation.finite_rows(gyro)
    if np.count_nonzero(good) < 3:
        return None
    force = acc[good].mean(axis=0)
    turning = np.degrees(np.sqrt(np.mean(np.sum(gyro[good] ** 2, axis=1))))
    size = float(np.linalg.norm(force))
    if turning > MAX_REST_RATE_DPS or abs(size - G) > MAX_REST_FORCE_ERROR_M_S2:
        return None
    return float(np.degrees(np.arccos(np.clip(np.dot(-force / size, static_down(context)), -1.0, 1.0))))


def last_still_tilt(context: CrashContext, t0: float, t1: float) -> float | None:
    """Return the tilt in deg by the accelerometer in the last still 0.4 s of [t0, t1] s, None without any."""
    for imu in sorted(context.log.imus, key=lambda one: one is not context.log.replay_imu):
        for end in np.arange(min(t1, context.end), t0 + STILL_S, -STILL_STEP_S):
            angle = _tilt_while_still(context, imu, float(end) - STILL_S, float(end))
            if angle is not None:
                return angle
    return None


def static_down(context: CrashContext) -> Array:
    """Return down (3,) in body axes at rest: z, or of a tail-sitter as before its first flight."""
    level = np.array([0.0, 0.0, 1.0])
    first = min((a for a, _ in context.air.spans), default=0.0)
    grid = context.air.grid
    before = (grid.t < first - 1.0) & grid.known & (np.nan_to_num(grid.dynamics) < 0.0)
    if context.log.kind is not VehicleKind.VTOL or np.count_nonzero(before) < 10:
        return level
    force = -grid.force[before].mean(axis=0)
    down: Array = force / max(float(np.linalg.norm(force)), 1e-9)
    return level if down[2] > 0.5 else down


def max_rate_dps(context: CrashContext, t0: float, t1: float) -> float:
    """Return the fastest rate in deg/s of any IMU within [t0, t1] s, 0 without a finite sample."""
    largest = 0.0
    for imu in context.log.imus:
        x = imu.gyro.x[spans.between(imu.gyro.t_best, t0, t1)]
        largest = max(largest, float(np.degrees(np.fmax.reduce(rotation.length(x), initial=0.0))))
    return largest


# --- impact peaks ------------------------------------------------------------------------------------------------

# Minimum peak of a hard landing, of an impact, of a hard landing in a simulator (stiff ground), and of an impact that
# is confirmed only by the tilt before it.
MIN_HARD_LANDING_G, MIN_IMPACT_G, MIN_SIMULATED_LANDING_G, MIN_VIOLENT_G = 3.0, 4.0, 10.0, 8.0
# Time before and after a flight in which peaks count.
BEFORE_S, AFTER_S = 1.5, 2.5
# Minimum ratio of a peak to the 98 % quantile of the seconds before it, which excludes vibration.
PEAK_FACTOR, PEAK_BEFORE_S = 1.8, 5.0
# Maximum distance of the IMU from the spin axis; the centripetal force of that arm is subtracted.
MAX_SENSOR_ARM_M = 0.1
# Evidence of an impact: tilt at rest, undriven and driven; largest tilt soon after; end of the log; spin with tilt;
# tilt just before.
MIN_LYING_DEG, MIN_LYING_DRIVEN_DEG = 20.0, 45.0
MIN_FALLEN_DEG, FALL_S = 75.0, 3.0  # tilt after an impact, and time until then
LOG_STOPS_S = 1.0  # power is lost in the impact
MIN_SPIN_DPS, MIN_SPIN_TILT_DEG = 250.0, 30.0  # around the peak
MIN_LEAN_DEG = 20.0  # before a violent peak
MIN_KILLED_TILT_DEG, DISARMED_S = 40.0, 3.0  # around a violent peak, and the time until it was disarmed for good
# Largest tilt in the next seconds of a vehicle that landed hard.
MAX_LANDED_DEG = 45.0
# Tilt that counts as upright.
MAX_UPRIGHT_DEG = 60.0
# Largest height by the barometer at a touch-down from which a vehicle bounces.
MAX_BOUNCE_M = 1.0
# Samples of one contact, distance of contacts in a group, and how much harder a later one is.
CONTACT_S, MAX_CONTACT_GAP_S, HARDER_RATIO = 0.4, 1.0, 1.1
# Still in the air after this time: no crash.
FLIES_ON_S = 6.0
# Minimum IMU rate that resolves an impact peak; at 25 Hz a third of the peak is left.
MIN_IMPACT_HZ = 40.0


class ImpactPeak(NamedTuple):
    """Contact of ``g`` (standard gravity) at ``t`` s; ``rate`` of the IMU in Hz.

    ``most``: largest force in g of the contacts up to 1 s apart. ``follows``: a harder one after another of these.
    """

    t: float
    g: float
    source: str
    rate: float
    most: float
    follows: bool = False


def shows_impacts(log: FlightLog) -> bool:
    """Return whether an IMU of the log is fast enough to resolve an impact peak."""
    return any(imu.acc.rate >= MIN_IMPACT_HZ for imu in log.imus)


def impact_peaks(imus: list[Imu], within: list[Span], least_g: float) -> list[ImpactPeak]:
    """Return contacts of all units within spans, above ``least_g`` and above preceding vibration.

    A contact begins with the first sample above half the largest force of its group; the largest force of 0.4 s is its
    size. A later one of the group counts where it is harder.
    """
    samples = [_samples_above(imu, within, least_g) for imu in imus]
    t = np.concatenate([np.zeros(0), *(t for t, _ in samples)])
    g = np.concatenate([np.zeros(0), *(g for _, g in samples)])
    unit = np.repeat(np.arange(len(samples)), [len(t) for t, _ in samples])
    order = np.argsort(t, kind="stable")
    rates = [imu.acc.rate if len(own) else 0.0 for imu, (own, _) in zip(imus, samples, strict=True)]
    found: list[ImpactPeak] = []
    for group in np.split(order, np.flatnonzero(np.diff(t[order]) > MAX_CONTACT_GAP_S) + 1) if len(order) else []:
        rest, last, most = group, 0.0, float(g[group].max())
        while len(rest) and g[rest].max() > HARDER_RATIO * last:
            first = float(t[rest[np.argmax(g[rest] >= max(least_g, 0.5 * g[rest].max()))]])
            contact = rest[(t[rest] >= first) & (t[rest] <= first + CONTACT_S)]
            hardest = contact[np.argmax(g[contact])]
            source, rate, last = imus[unit[hardest]].acc.source, rates[unit[hardest]], float(g[hardest])
            found.append(ImpactPeak(first, last, source, rate, most, rest is not group))
            rest = rest[t[rest] > first + CONTACT_S]
    return found


def _samples_above(imu: Imu, within: list[Span], least_g: float) -> tuple[Array, Array]:
    """Return times and forces (n,) in g of a unit's samples above a limit that stand out of vibration."""
    t, force = imu.acc.t_best, rotation.length(imu.acc.x) / G
    n = min(len(t), len(force), len(imu.gyro.x))
    t, force = t[:n], force[:n]
    hit = np.flatnonzero((force > least_g) & np.isfinite(force) & spans.inside(t, within))
    spinning = rotation.length(imu.gyro.x[hit]) ** 2 * MAX_SENSOR_ARM_M / G
    hit = hit[force[hit] > least_g + np.where(spinning > 0.25, spinning, 0.0)]
    kept = []
    for group in np.split(hit, np.flatnonzero(np.diff(t[hit]) > MAX_CONTACT_GAP_S) + 1) if len(hit) else []:
        peak = float(np.max(force[group]))
        first = group[np.argmax(force[group] > max(least_g, 0.5 * peak))]
        before = force[spans.between(t, t[first] - PEAK_BEFORE_S, t[first] - 0.1)]
        before = before[np.isfinite(before)]
        if len(before) <= 10 or peak >= PEAK_FACTOR * float(quantile(before, 0.98)):
            kept.append(group)
    good = np.concatenate(kept) if kept else np.zeros(0, np.int64)
    return t[good], force[good]


def find_impacts(context: CrashContext) -> list[CrashEvent]:
    """Return impacts, which need further evidence, and hard landings at a flight's end."""
    around = spans.merge((a - BEFORE_S, b + AFTER_S) for a, b in context.air.spans)
    around = spans.intersect(around, [(a, b + AFTER_S) for a, b in context.armed])
    disarmed = context.disarmed_s
    around = spans.merge([*around, *([] if disarmed is None else [(disarmed - DISARMED_S, disarmed + CONTACT_S)])])
    least_g = MIN_SIMULATED_LANDING_G if context.log.simulated else MIN_HARD_LANDING_G
    found: list[CrashEvent] = []
    for peak in impact_peaks(context.log.imus, around, MIN_HARD_LANDING_G):
        why = _impact_reason(context, peak) if peak.most > MIN_IMPACT_G else ""
        lying = rest_tilt(context, peak.t)
        size, source = f"an impact of {peak.g:.1f} g", (peak.source,)
        if why:
            text = f"{size}, {why}"
            fell_m = _fell_m(context, peak.t)
            found.append(CrashEvent("impact", peak.t, peak.t, peak.g, "g", text, lying, peak.rate, source, fell_m))
            continue
        upright = not context.tilt.largest(peak.t, peak.t + FALL_S) > MAX_LANDED_DEG
        if peak.g > least_g and upright and _at_flight_end(context, peak.t):
            text = f"{size} as it landed"
            landing = CrashEvent("hard_landing", peak.t, peak.t, peak.g, "g", text, lying, peak.rate, source)
            before = found[-1] if found and found[-1].kind == "hard_landing" else None
            if before is None or peak.t - before.t > FLIES_ON_S:
                found.append(landing)
            elif peak.t - before.t <= MAX_CONTACT_GAP_S and peak.g > HARDER_RATIO * before.size:
                found[-1] = landing  # what follows are bounces
    return found


def _impact_reason(context: CrashContext, peak: ImpactPeak) -> str:
    """Return the evidence that a peak above 4 g is an impact; empty without evidence."""
    t = peak.t
    if context.flies_at(t + FLIES_ON_S) and not _lies_over(context, t):
        return ""
    lying = rest_tilt(context, t)
    driven = context.driven_at(t + REST_BEGINS_S, t + REST_ENDS_S)
    if lying is not None and lying > (MIN_LYING_DRIVEN_DEG if driven else MIN_LYING_DEG):
        return f"and it lay at {lying:.0f} deg"
    fell = context.tilt.largest(t, t + FALL_S)
    if fell > MIN_FALLEN_DEG:
        return f"and it tilted to {fell:.0f} deg"
    flown = any(a - BEFORE_S <= t <= b + AFTER_S for a, b in context.air.spans)
    if flown and context.end - t < LOG_STOPS_S and not context.disarms_after(t):
        return "and the log stops"
    spun = max_rate_dps(context, t - 0.5, t + 0.5)
    leaned = context.tilt.largest(t - 0.5, t + 0.5)
    if spun > MIN_SPIN_DPS and leaned > MIN_SPIN_TILT_DEG:
        return f"at {spun:.0f} deg/s and {leaned:.0f} deg of tilt"
    disarmed = context.disarmed_s
    killed = disarmed is not None and 0.0 <= disarmed - t <= DISARMED_S
    if peak.most > MIN_VIOLENT_G and leaned > MIN_KILLED_TILT_DEG and killed:
        return f"at {leaned:.0f} deg of tilt, and it was disarmed"
    leaned = context.tilt.largest(t - 0.5, t)
    if peak.most > MIN_VIOLENT_G and leaned > MIN_LEAN_DEG:
        return f"after {leaned:.0f} deg of tilt"
    return ""


def _lies_over(context: CrashContext, t: float) -> bool:
    """Return whether a vehicle without wings stays far tilted after an impact, with whatever drive."""
    later = context.tilt.deg[spans.between(context.tilt.t, t + 0.5 * FLIES_ON_S, t + FLIES_ON_S)]
    return not context.log.kind.winged and len(later) > 0 and float(median(later)) > MAX_UPRIGHT_DEG


def _fell_m(context: CrashContext, t: float) -> float:
    """Return how far the vehicle fell within 6 s after an impact, 0 without a height."""
    stream = height_stream(context.log)
    if stream is None:
        return 0.0
    later = stream.x[spans.between(stream.t, t, t + FLIES_ON_S), 0]
    return float(max(np.interp(t, stream.t, stream.x[:, 0]) - np.min(later), 0.0)) if len(later) else 0.0


def _at_flight_end(context: CrashContext, t: float) -> bool:
    """Return whether a flight ends at a time, or soon after a touch-down from which it bounced."""
    if any(b - BEFORE_S <= t <= b + AFTER_S for _, b in context.air.spans):
        return True
    grid = context.air.grid
    above = [float(level.above[grid.index(t)]) for level in context.air.levels[:1]]
    return any(b - FLIES_ON_S <= t <= b for _, b in context.air.spans) and any(x < MAX_BOUNCE_M for x in above)
