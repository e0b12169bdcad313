"""Closed-form motions with their sensor readings, the estimator under test, and its errors.

A motion is given by formulas for roll, pitch and yaw; nothing is integrated. The gyro is the exact mean rate between
two samples (the rotation vector of ``q_{k-1}* q_k`` over dt, sampling rule ``interval``), specific force and field are
exact at the samples. Noise is declared as densities and drawn from a seeded generator.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core import rotation
from attlog.estimators import Aids, Estimate, Estimator, EstimatorSpec, Measurements, estimate, parse

Array = NDArray[np.float64]
Angles = Callable[[Array], tuple[ArrayLike, ArrayLike, ArrayLike]]

GRAVITY = 9.80665
# Field of central Europe in NED without declination [T]: dip 64 deg, where heading is hardest to find.
FIELD_T = (21e-6, 0.0, 43e-6)


@dataclass(frozen=True, slots=True)
class Noise:
    """White noise densities and a constant gyro bias.

    ``gyro`` [rad/s/sqrt(Hz)], ``acc`` [m/s^2/sqrt(Hz)], ``mag`` [T] per sample, ``bias`` [rad/s].
    """

    gyro: float = 0.0
    acc: float = 0.0
    mag: float = 0.0
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)


# An autopilot's MEMS sensors at rest: data sheet densities of common parts.
CONSUMER_NOISE = Noise(gyro=np.deg2rad(0.01), acc=0.003, mag=0.4e-6)


@dataclass(frozen=True, slots=True)
class Motion:
    """True attitude ``q`` (n, 4) and sensor samples at times ``t``.

    ``t`` (n,) s, ``gyr`` rad/s, ``acc`` m/s^2, ``mag`` T, each (n, 3), body FRD.
    """

    t: Array
    q: Array
    gyr: Array
    acc: Array
    mag: Array

    @property
    def sensors(self) -> tuple[Array, Array, Array, Array]:
        """``t, gyr, acc, mag``, the arguments of ``attlog.estimate``."""
        return self.t, self.gyr, self.acc, self.mag

    def part(self, keep: Any) -> Motion:
        """Select samples (a slice, mask or index array)."""
        return replace(self, t=self.t[keep], q=self.q[keep], gyr=self.gyr[keep], acc=self.acc[keep], mag=self.mag[keep])


def motion(
    angles: Angles,
    seconds: float,
    rate: float = 100.0,
    *,
    acceleration: Callable[[Array], ArrayLike] | None = None,
    noise: Noise = Noise(),
    seed: int = 0,
) -> Motion:
    """Return the motion with roll, pitch, yaw = ``angles(t)`` [rad].

    ``acceleration(t)`` (n, 3) is the earth acceleration [m/s^2, NED], zero by default.
    """
    t = np.arange(round(seconds * rate)) / rate
    roll, pitch, yaw = (np.broadcast_to(np.asarray(a, np.float64), t.shape) for a in angles(t))
    q = rotation.from_euler(roll, pitch, yaw)
    gyr = np.zeros((len(t), 3))
    gyr[1:] = rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) * rate
    specific = np.zeros((len(t), 3)) if acceleration is None else np.array(acceleration(t), np.float64)
    acc = rotation.rotate_inverse(q, specific - np.array([0.0, 0.0, GRAVITY]))
    mag = rotation.rotate_inverse(q, np.array(FIELD_T))
    random = np.random.default_rng(seed)
    gyr += np.array(noise.bias) + noise.gyro * np.sqrt(rate) * random.standard_normal(gyr.shape)
    acc += noise.acc * np.sqrt(rate) * random.standard_normal(acc.shape)
    mag += noise.mag * random.standard_normal(mag.shape)
    return Motion(t, q, gyr, acc, mag)


def still(
    seconds: float,
    rate: float = 100.0,
    *,
    roll: float = 0.0,
    pitch: float = 0.0,
    yaw: float = 0.0,
    noise: Noise = Noise(),
) -> Motion:
    """Return rest at the given attitude [rad]."""
    return motion(lambda t: (roll, pitch, yaw), seconds, rate, noise=noise)


def swing(seconds: float, rate: float = 100.0, *, yaw: float = 0.0, noise: Noise = Noise(), seed: int = 0) -> Motion:
    """Return sines in roll, pitch and yaw, moving from the start.

    Of 35, 25 and 70 deg, around heading ``yaw``.
    """

    def angles(t: Array) -> tuple[Array, Array, Array]:
        return 0.6 * np.sin(1.1 * t + 0.3), 0.45 * np.sin(0.7 * t + 1.0), yaw + 1.2 * np.sin(0.4 * t)

    return motion(angles, seconds, rate, noise=noise, seed=seed)


def flight(seconds: float, rate: float = 100.0, *, noise: Noise = CONSUMER_NOISE, seed: int = 0) -> Motion:
    """Return the swing with accelerations that average to zero.

    Up to 3 m/s^2.
    """

    def angles(t: Array) -> tuple[Array, Array, Array]:
        return 0.5 * np.sin(0.9 * t), 0.4 * np.sin(0.6 * t + 0.5), 2.0 * np.sin(0.25 * t)

    def acceleration(t: Array) -> Array:
        return np.stack([2.0 * np.sin(2.1 * t), 3.0 * np.sin(1.3 * t + 1.0), 1.0 * np.sin(3.1 * t)], axis=-1)

    return motion(angles, seconds, rate, acceleration=acceleration, noise=noise, seed=seed)


def one_turn(axis: int, angle: float = np.deg2rad(30.0), rate: float = 100.0) -> Motion:
    """Return rest, a smooth turn about one axis, and rest.

    3 s, 1 s by ``angle`` [rad], 2 s.
    """

    def angles(t: Array) -> tuple[Array, Array, Array]:
        u = np.clip(t - 3.0, 0.0, 1.0)
        turned = angle * (u - np.sin(2.0 * np.pi * u) / (2.0 * np.pi))
        none = np.zeros_like(t)
        three = [none, none, none]
        three[axis] = turned
        return three[0], three[1], three[2]

    return motion(angles, 6.0, rate)


# The estimator under test.

FIXES = np.arange(0.003, 300.0, 0.2)
# Given to filters that need GNSS: a receiver in place.
IN_PLACE = Aids(velocity=Measurements(FIXES, np.zeros((len(FIXES), 3)), np.full(len(FIXES), 0.1)))


class CheckFailed(AssertionError):
    """Violation of the estimator contract, with expectation and result."""


def require(condition: Any, message: str) -> None:
    """Raise CheckFailed with ``message`` unless the condition holds."""
    if not bool(condition):
        raise CheckFailed(message)


@dataclass(frozen=True, slots=True)
class Subject:
    """The estimator under test, a row with preset and settings."""

    row: EstimatorSpec

    @classmethod
    def of(cls, name: str | EstimatorSpec | Estimator) -> Subject:
        """Make it of a name, a file, a row or an estimator.

        ``NAME[@PRESET][:k=v,...]`` or ``FILE.py``; errors as in ``parse``.
        """
        if isinstance(name, Estimator):
            return cls(EstimatorSpec(name))
        return cls(name if isinstance(name, EstimatorSpec) else parse(name))

    @property
    def estimator(self) -> Estimator:
        return self.row.estimator

    @property
    def uses_mag(self) -> bool:
        return "mag" in self.estimator.uses

    @property
    def uses_acc(self) -> bool:
        return "acc" in self.estimator.uses

    @property
    def corrects_tilt(self) -> bool:
        """True if it uses gravity after the start: it cannot run without."""
        return "acc" in self.estimator.needs

    @property
    def corrects_heading(self) -> bool:
        """True if it uses the field after the start."""
        return self.corrects_tilt and self.uses_mag

    @property
    def needs_gnss(self) -> bool:
        return "gnss" in self.estimator.needs

    @property
    def steps(self) -> bool:
        """True if it takes single samples and a start attitude."""
        return self.estimator.step is not None

    def run(self, m: Motion, **options: Any) -> Estimate:
        """Estimate on a motion's sensors, with the magnetometer if it is used."""
        return self.on(m.t, m.gyr, m.acc, m.mag if self.uses_mag else None, **options)

    def on(self, t: Any, gyr: Any, acc: Any, mag: Any = None, **options: Any) -> Estimate:
        """Estimate on samples, with fixes for a filter that needs them."""
        if self.needs_gnss:
            options.setdefault("aids", IN_PLACE)
        return estimate(self.row, t, gyr, acc, mag, check_units=False, **options)


def tilt_deg(q: Array, truth: Array) -> Array:
    """Return tilt errors (n,) in deg."""
    return np.rad2deg(rotation.tilt_angle(rotation.earth_error(q, truth)))


def heading_deg(q: Array, truth: Array) -> Array:
    """Return signed heading errors (n,) in deg."""
    return np.rad2deg(rotation.heading_angle(rotation.earth_error(q, truth)))


def total_deg(q: Array, truth: Array) -> Array:
    """Return total errors (n,) in deg."""
    return np.rad2deg(rotation.total_angle(rotation.earth_error(q, truth)))


def require_attitudes(e: Estimate, t: Array | None = None) -> None:
    """Raise CheckFailed unless the estimate holds finite unit quaternions (at the times ``t``)."""
    require(e.q.shape == (len(e.t), 4), f"attitudes have shape {e.q.shape} for {len(e.t)} times")
    require(np.isfinite(e.q).all(), f"{int((~np.isfinite(e.q).all(axis=1)).sum())} attitudes are not finite")
    off = np.abs(np.sqrt(np.sum(e.q**2, axis=1)) - 1.0)
    require(off.max(initial=0.0) < 1e-6, f"quaternions are not of unit length: off by {off.max(initial=0.0):.2g}")
    if t is not None:
        require(np.array_equal(e.t, t), f"{len(e.t)} attitudes for {len(t)} good samples, or at other times")
