"""What crashes are judged by: flights, tilt, how it lay afterwards, how fast it turned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import FlightLog, Imu
from attlog.flight.vehicle import VehicleKind
from attlog.segments import spans
from attlog.segments.airborne.grid import G
from attlog.segments.airborne.in_air import InAir
from attlog.segments.spans import Span

Array = NDArray[np.float64]
Kind = Literal["impact", "overturn", "tumble", "hard_landing"]

SETTLES_S, SETTLED_S = 1.5, 4.0
LYING_DPS, LYING_M_S2, AGREES_DEG = 60.0, 2.5, 30.0
"""It lies where it turns slower and feels gravity alone; with motors driven tilt and force agree to so many degrees."""


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


@dataclass(slots=True)
class Scene:
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


def lies(scene: Scene, t: float) -> float | None:
    """The angle (deg) at which the vehicle lies after ``t`` s by an accelerometer, None where it does not lie still.

    The replayed unit tells; where it has no samples then, or feels another force than gravity, the next one does. With
    motors driven the onboard attitude has to agree, for rotors push, too.
    """
    t0, t1 = t + SETTLES_S, t + SETTLED_S
    replayed = scene.log.replay_imu
    for imu in sorted(scene.log.imus, key=lambda one: one is not replayed):
        angle = _lies_by(scene, imu, t0, t1)
        if angle is None:
            continue
        own = scene.tilt.at(0.5 * (t0 + t1))
        if scene.driven_at(t0, t1) and np.isfinite(own) and abs(own - angle) > AGREES_DEG:
            return None
        return angle
    return None


def _lies_by(scene: Scene, imu: Imu, t0: float, t1: float) -> float | None:
    """The angle (deg) between what carries a unit within [t0, t1] s and what it stands on; None where it moves."""
    n = min(len(imu.acc.t_best), len(imu.acc.x), len(imu.gyro.x))
    part = spans.between(imu.acc.t_best[:n], t0, t1)
    t, acc, gyro = imu.acc.t_best[part], imu.acc.x[part], imu.gyro.x[part]
    good = rotation.finite(acc) & rotation.finite(gyro)
    if np.count_nonzero(good) < 3 or not t[good][-1] - t0 >= 0.5:
        return None
    force = acc[good].mean(axis=0)
    turning = np.degrees(np.sqrt(np.mean(np.sum(gyro[good] ** 2, axis=1))))
    size = float(np.linalg.norm(force))
    if turning > LYING_DPS or abs(size - G) > LYING_M_S2:
        return None
    return float(np.degrees(np.arccos(np.clip(np.dot(-force / size, stands(scene)), -1.0, 1.0))))


def stands(scene: Scene) -> Array:
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


def fastest_dps(scene: Scene, t0: float, t1: float) -> float:
    """The fastest rate in deg/s of any IMU within [t0, t1] s, 0 without a finite sample."""
    largest = 0.0
    for imu in scene.log.imus:
        x = imu.gyro.x[spans.between(imu.gyro.t_best, t0, t1)]
        largest = max(largest, float(np.degrees(np.fmax.reduce(rotation.length(x), initial=0.0))))
    return largest
