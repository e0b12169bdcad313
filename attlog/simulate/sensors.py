"""Slow sensors: sampling with jitter, loss and faults; battery, rotor speeds, magnetometer, GNSS, barometer."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.flight.calibration import MOUNTING_EULER_DEG, euler_matrix
from attlog.simulate.environment import LAPSE_K_PER_M, SEA_KELVIN, generator, geodetic, height_of, pressure
from attlog.simulate.flight import BaroStream, BatteryStream, Fix, GnssStream, MagStream, RpmStream, Truth
from attlog.simulate.scenario import PlantedFault, Scenario
from attlog.simulate.sensor_settings import Span

Array = NDArray[np.float64]


def sampling_instants(
    rate_hz: float, seconds: float, jitter_s: float, random: np.random.Generator, phase: float = 1.0
) -> Array:
    """Return times of measurement (n,) s up to ``seconds``; the first is ``phase`` of a period after 0.

    Jitter is normal about the raster, kept within 0.45 of a period so that samples stay in order.
    """
    nominal: Array = (np.arange(int(seconds * rate_hz + 1.0), dtype=np.float64) + phase) / rate_hz
    nominal = nominal[nominal <= seconds + 1e-9]
    moved = jitter_s * random.standard_normal(len(nominal))
    jittered = nominal + np.clip(moved, -0.45 / rate_hz, 0.45 / rate_hz)
    return jittered[(jittered > 0) & (jittered <= seconds + 1e-9)]


def kept_samples(t: Array, loss_pct: float, gaps: tuple[Span, ...], random: np.random.Generator) -> NDArray[np.bool_]:
    """Return which samples at ``t`` (n,) s arrive; others are lost at random or in a gap (from, to)."""
    arrives = random.random(len(t)) >= loss_pct / 100.0
    for begin, end in gaps:
        arrives &= (t < begin) | (t >= end)
    return arrives


def is_acting(fault: PlantedFault, t: Array) -> NDArray[np.bool_]:
    """Return at which of the times (n,) s a fault acts."""
    end = np.inf if fault.seconds is None or fault.kind == "ramp" else fault.t + fault.seconds
    mask: NDArray[np.bool_] = (t >= fault.t) & (t < end)
    return mask


def ramp_share(fault: PlantedFault, t: Array) -> Array:
    """Return the share (n,), 0 to 1, of a ramp at times (n,) s."""
    share: Array = np.clip((t - fault.t) / (fault.seconds or 1.0), 0.0, 1.0)
    return share


def rotor_health(scenario: Scenario, t: Array) -> Array:
    """Return the thrust of each rotor over a sound one's at the same speed, (n, 4), at times (n,) s."""
    health = np.ones((len(t), 4))
    for fault in scenario.fault:
        if fault.part == "rotor" and fault.kind in ("off", "scale", "ramp"):
            factor = 0.0 if fault.kind == "off" else fault.factor
            share = ramp_share(fault, t) if fault.kind == "ramp" else is_acting(fault, t)
            health[:, fault.instance] *= 1.0 + share * (factor - 1.0)
    return health


def arriving_samples(faults: list[PlantedFault], t: Array) -> NDArray[np.bool_]:
    """Return which samples at ``t`` (n,) s faults suppress."""
    gone = np.zeros(len(t), bool)
    for fault in faults:
        if fault.kind == "silent":
            gone |= is_acting(fault, t)
    return gone


def damage(faults: list[PlantedFault], t: Array, x: Array, last: Array, seed: int = 0) -> Array:
    """Return samples ``x`` (n, k) at ``t`` (n,) s with acting faults; ``last`` (k,): the sample before.

    Random faults draw by the sample's time, so that samples one by one and all at once give the same.
    """
    x = x.copy()
    for number, fault in enumerate(faults):
        now = np.flatnonzero(is_acting(fault, t))
        if not len(now):
            continue
        k = x.shape[1]
        if fault.kind == "stuck":
            x[now] = x[now[0] - 1] if now[0] > 0 else last
        elif fault.kind == "zero":
            x[now] = 0.0
        elif fault.kind == "offset":
            x[now] += np.array(fault.value[:k])
        elif fault.kind == "ramp":
            x[now] += np.outer(ramp_share(fault, t[now]), fault.value[:k])
        elif fault.kind == "scale":
            x[now] *= fault.factor
        elif fault.kind == "flipped":
            x[now, : min(k, 2)] *= -1.0
        elif fault.kind in ("noise", "spikes"):
            for i in now:
                random = generator(seed, "fault", number, fault.part, round(float(t[i]) * 1e6))
                drawn = random.standard_normal(k)
                if fault.kind == "noise" or random.random() * 100.0 < fault.share_pct:
                    x[i] += fault.size * (drawn if fault.kind == "noise" else drawn / np.linalg.norm(drawn))
    return x


def interpolate_truth(x: Array, t: Array, period: float) -> Array:
    """Return rows of ``x`` (n, ...), taken every ``period`` s from 0 on, interpolated at ``t`` (m,) s."""
    where = t / period
    low = np.minimum(where.astype(int), len(x) - 2)
    u = (where - low).reshape(-1, *[1] * (x.ndim - 1))
    between: Array = x[low] * (1.0 - u) + x[low + 1] * u
    return between


def interpolate_attitude(q: Array, t: Array, period: float) -> Array:
    """Return attitudes (m, 4) at ``t`` (m,) s; within a period the chord equals the arc to 1e-6 rad."""
    return rotation.normalize(interpolate_truth(q, t, period))


class SlowSensor(ABC):
    """Instance ``number`` of a ``kind``: samples at their own instants of a motion that still grows."""

    def __init__(
        self,
        kind: str,
        number: int,
        scenario: Scenario,
        seed: int,
        rate_hz: float,
        jitter_s: float,
        delay_s: float,
        loss_pct: float = 0.0,
        gaps: tuple[Span, ...] = (),
        hidden_delay_s: float = 0.0,
    ) -> None:
        timing = generator(seed, kind, number, "timing")
        phase = float(timing.uniform(0.1, 1.0))
        self.instants = sampling_instants(rate_hz, scenario.seconds, jitter_s, timing, phase)
        self.due: list[float] = [*self.instants.tolist(), math.inf]
        self.kept = kept_samples(self.instants, loss_pct, gaps, generator(seed, kind, number, "loss"))
        self.t_sample = self.instants + hidden_delay_s
        self.t = self.t_sample + delay_s
        self.period = 1.0 / scenario.loop.rate_hz
        self.scenario, self.seed, self.number = scenario, seed, number
        self.faults = [f for f in scenario.fault if f.part == kind and f.instance == number]
        self.next, self.delivered = 0, 0

    def advance(self, truth: Truth, now: float) -> None:
        """Measure every instant up to ``now``, the last row of ``truth``."""
        if self.due[self.next] <= now + 1e-9:
            end = int(np.searchsorted(self.instants, now + 1e-9, side="right"))
            self.measure(truth, np.arange(self.next, end))
            self.next = end

    @abstractmethod
    def measure(self, truth: Truth, k: NDArray[np.int64]) -> None:
        """Make the samples of indices ``k`` (m,)."""

    def arrived(self, now: float) -> int | None:
        """Return the newest sample since the last call, None if there is none."""
        found = None
        while self.delivered < self.next and self.t[self.delivered] <= now + 1e-9:
            found = self.delivered if self.kept[self.delivered] else found
            self.delivered += 1
        return found


def battery_current(scenario: Scenario, rotor: Array, t: Array) -> Array:
    """Return the current (n,) A: idle and shaft power over efficiency and voltage.

    ``rotor`` (n, 4): speeds [rad/s] at ``t`` (n,) s. What a rotor lacks in thrust it lacks in torque.
    """
    b, v = scenario.sensors.battery, scenario.vehicle
    shaft = v.torque_m * v.thrust_factor * np.sum(rotor_health(scenario, t) * np.abs(rotor) ** 3, axis=1)
    total: Array = b.idle_a + shaft / (b.efficiency * 0.5 * (b.full_v + b.empty_v))
    return total


def sample_battery(scenario: Scenario, seed: int, truth: Truth) -> BatteryStream:
    """Return the battery monitor's noisy current and voltage, and its own account of the charge."""
    b, period = scenario.sensors.battery, 1.0 / scenario.loop.rate_hz
    random = generator(seed, "battery", 0, "noise")
    t = sampling_instants(b.rate_hz, scenario.seconds, 0.0, random)
    t = t[t <= truth.t[-1]]
    drawn = battery_current(scenario, truth.rotor, truth.t)
    used = np.cumsum(drawn) * period / 3600.0
    volts = b.full_v - (b.full_v - b.empty_v) * used / b.capacity_ah - b.resistance_ohm * drawn
    noise = random.standard_normal((len(t), 2))
    reported = np.maximum(interpolate_truth(drawn, t, period) + b.noise_a * noise[:, 0], 0.0)
    return BatteryStream(
        t, interpolate_truth(volts, t, period) + b.noise_v * noise[:, 1], reported, interpolate_truth(used, t, period)
    )


def sample_rpm(scenario: Scenario, seed: int, truth: Truth) -> RpmStream | None:
    """Return reported rotor speeds, None without such telemetry; standing rotors report 0."""
    s = scenario.sensors.rpm
    if s is None:
        return None
    random = generator(seed, "rpm", 0, "noise")
    t = sampling_instants(s.rate_hz, scenario.seconds, 0.0, random)
    t = t[t <= truth.t[-1]]
    true = interpolate_truth(truth.rotor, t, 1.0 / scenario.loop.rate_hz) * 30.0 / math.pi
    reported = np.where(true > 1.0, np.maximum(true + s.noise_rpm * random.standard_normal(true.shape), 0.0), 0.0)
    return RpmStream(t, s.step_rpm * np.round(reported / s.step_rpm) if s.step_rpm > 0 else reported)


class MagSensor(SlowSensor):
    """``field = soft_iron R_mount^T R_set R_mounted^T (R^T B + hard iron + current) + noise``, clipped, rounded, T."""

    def __init__(self, scenario: Scenario, number: int, seed: int) -> None:
        s = scenario.sensors.mag[number]
        super().__init__(
            "mag", number, scenario, seed, s.rate_hz, s.jitter_s, s.delay_s, s.loss_pct, s.gaps, s.hidden_delay_s
        )
        self.kept &= ~arriving_samples(self.faults, self.instants)
        spread = generator(seed, "mag", number, "iron").standard_normal(3)
        self.hard = (np.array(s.hard_iron_ut) + s.hard_iron_spread_ut * spread) * 1e-6
        mount = rotation.to_matrix(rotation.from_euler(*np.radians(s.rotation_deg)))
        turned = euler_matrix(*MOUNTING_EULER_DEG[s.orientation]) @ euler_matrix(*MOUNTING_EULER_DEG[s.mounted]).T
        self.matrix: Array = np.array(s.soft_iron) @ mount.T @ turned
        noise = generator(seed, "mag", number, "noise").standard_normal((len(self.instants), 3))
        self.noise = noise * s.noise_ut_rthz * 1e-6 * math.sqrt(s.rate_hz)
        self.per_ampere = np.array(s.current_ut_a) * 1e-6
        self.limit, self.step, self.rate_hz = s.range_ut * 1e-6, s.step_ut * 1e-6, s.rate_hz
        self.field = np.zeros((len(self.instants), 3))

    def measure(self, truth: Truth, k: NDArray[np.int64]) -> None:
        t = self.instants[k]
        b = rotation.rotate_inverse(
            interpolate_attitude(truth.q, t, self.period), interpolate_truth(truth.field, t, self.period)
        )
        b = b + self.hard
        if self.per_ampere.any():
            rotor = interpolate_truth(truth.rotor, t, self.period)
            b = b + battery_current(self.scenario, rotor, t)[:, None] * self.per_ampere
        x = b @ self.matrix.T + self.noise[k]
        x = np.clip(x, -self.limit, self.limit)
        if self.step > 0:
            x = self.step * np.floor(x / self.step + 0.5)
        if self.faults:
            last = self.field[k[0] - 1] if k[0] else np.zeros(3)
            x = damage(self.faults, t, x, last, self.seed)
        self.field[k] = x

    def stream(self) -> MagStream:
        """Return all samples that arrived."""
        keep = np.flatnonzero(self.kept[: self.next])
        return MagStream(self.number, self.rate_hz, self.t[keep], self.t_sample[keep], self.field[keep])


# Accuracy that a receiver reports without a fix, m.
STILL_UNKNOWN = 99.0


class GnssSensor(SlowSensor):
    """Fixes in earth axes; the antenna's lever arm acts on position and velocity."""

    def __init__(self, scenario: Scenario, number: int, seed: int) -> None:
        s = self.settings = scenario.sensors.gnss[number]
        super().__init__("gnss", number, scenario, seed, s.rate_hz, s.jitter_s, s.delay_s, s.loss_pct)
        self.kept &= ~arriving_samples(self.faults, self.instants)
        count = len(self.instants)
        white = generator(seed, "gnss", number, "noise").standard_normal((count, 6))
        self.noise = white * np.array([s.noise_h_m] * 2 + [s.noise_v_m] + [s.noise_speed_m_s] * 3)
        stays = math.exp(-1.0 / (s.rate_hz * s.wander_s))
        drawn = generator(seed, "gnss", number, "wander").standard_normal((count, 3)) * [1.0, 1.0, 2.0]
        wander = np.zeros((count, 3))
        value = np.zeros(3)
        for k in range(count):
            value = drawn[k] if k == 0 else stays * value + math.sqrt(1.0 - stays * stays) * drawn[k]
            wander[k] = value
        self.noise[:, :3] += s.wander_m * wander
        self.fixed = self.instants >= s.first_fix_s
        for begin, end in s.outages:
            self.fixed &= (self.instants < begin) | (self.instants >= end)
        self.pv = np.zeros((count, 6))

    def measure(self, truth: Truth, k: NDArray[np.int64]) -> None:
        t, arm = self.instants[k], np.array(self.settings.antenna_m)
        self.pv[k, :3] = interpolate_truth(truth.p, t, self.period)
        self.pv[k, 3:] = interpolate_truth(truth.v, t, self.period)
        if arm.any():
            q = interpolate_attitude(truth.q, t, self.period)
            self.pv[k, :3] += rotation.rotate(q, arm)
            self.pv[k, 3:] += rotation.rotate(q, np.cross(interpolate_truth(truth.w, t, self.period), arm))
        self.pv[k] += self.noise[k]
        for part in (slice(0, 3), slice(3, 6)) if self.faults else ():
            last = self.pv[k[0] - 1, part] if k[0] else np.zeros(3)
            faults = [f for f in self.faults if f.kind != "ramp" or part.start == 0]
            self.pv[k, part] = damage(faults, t, self.pv[k, part], last, self.seed)

    def fix(self, k: int) -> Fix | None:
        """Return fix number ``k``, None where there was none."""
        return Fix(float(self.t_sample[k]), self.pv[k, :3], self.pv[k, 3:]) if self.fixed[k] else None

    def stream(self) -> GnssStream:
        """Return all messages that arrived; those without a fix hold no position."""
        s, keep = self.settings, np.flatnonzero(self.kept[: self.next])
        has = self.fixed[keep]
        ned = np.where(has[:, None], self.pv[keep, :3], np.nan)
        lat, lon, alt = geodetic(self.scenario, ned)
        h = math.hypot(math.sqrt(2.0) * s.noise_h_m, math.sqrt(2.0) * s.wander_m)
        v = math.hypot(s.noise_v_m, 2.0 * s.wander_m)
        return GnssStream(
            instance=self.number,
            rate_hz=s.rate_hz,
            t=self.t[keep],
            t_sample=self.t_sample[keep],
            lat=lat,
            lon=lon,
            alt=alt,
            ned=ned,
            vel=np.where(has[:, None], self.pv[keep, 3:], np.nan),
            h_acc=np.where(has, h, STILL_UNKNOWN),
            v_acc=np.where(has, v, STILL_UNKNOWN),
            s_acc=np.where(has, max(math.sqrt(3.0) * s.noise_speed_m_s, 0.01), STILL_UNKNOWN),
            fix=np.where(has, 3, 0),
            satellites=np.where(has, 14, 0),
            utc=self.scenario.place.unix_time + self.t_sample[keep],
        )


class BaroSensor(SlowSensor):
    """Pressure [Pa] with noise, walk and counts, and its height in the standard atmosphere [m]."""

    def __init__(self, scenario: Scenario, number: int, seed: int) -> None:
        s = scenario.sensors.baro[number]
        super().__init__("baro", number, scenario, seed, s.rate_hz, s.jitter_s, s.delay_s, s.loss_pct, s.gaps)
        self.kept &= ~arriving_samples(self.faults, self.instants)
        count = len(self.instants)
        noise = generator(seed, "baro", number, "noise").standard_normal((count, 2))
        walk = np.cumsum(noise[:, 1]) * s.walk_m_rts / math.sqrt(s.rate_hz)
        self.error = s.offset_m + s.noise_m_rthz * math.sqrt(s.rate_hz) * noise[:, 0] + walk
        self.pressure, self.step, self.rate_hz = np.zeros(count), s.step_pa, s.rate_hz

    def measure(self, truth: Truth, k: NDArray[np.int64]) -> None:
        t = self.instants[k]
        height = self.scenario.place.alt_m - interpolate_truth(truth.p, t, self.period)[:, 2] + self.error[k]
        if self.faults:
            last = height_of(self.pressure[k[0] - 1 : k[0]]) if k[0] else height[:1]
            height = damage(self.faults, t, height[:, None], last, self.seed)[:, 0]
        reported = pressure(height)
        self.pressure[k] = self.step * np.round(reported / self.step) if self.step > 0 else reported

    def height(self, k: int) -> float:
        """Return the height [m] above the take-off place of sample ``k``."""
        return float(height_of(self.pressure[k : k + 1])[0]) - self.scenario.place.alt_m

    def stream(self) -> BaroStream:
        """Return all samples that arrived."""
        keep = np.flatnonzero(self.kept[: self.next])
        p = self.pressure[keep]
        height = height_of(p)
        warm = SEA_KELVIN - 273.15 - LAPSE_K_PER_M * height + 20.0
        return BaroStream(self.number, self.rate_hz, self.t[keep], self.t_sample[keep], p, height, warm)
