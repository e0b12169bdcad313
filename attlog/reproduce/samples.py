"""The inertial and magnetic samples of a simulated flight, filters run over them, angles for people."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.base import rotation
from attlog.estimators.engine.samples import Sampling
from attlog.simulate.autopilot.loop import EstimatorChoice

if TYPE_CHECKING:
    from attlog.simulate.flight import Flight

Array = NDArray[np.float64]
AXES = ("roll", "pitch", "heading")
NOBODY = EstimatorChoice("truth")
"""On the bench nothing flies on an estimate: filters are run over the samples afterwards."""


@dataclass(frozen=True, slots=True)
class FlightSamples:
    """What a filter gets: ``gyr`` rad/s, ``acc`` m/s^2, ``mag`` T (n, 3; NaN rows without a new one) at ``t`` (n,) s;
    and what it should find, ``q`` (n, 4). Heading counts from true north, ``declination_deg`` east of it is the field.
    """

    t: Array
    gyr: Array
    acc: Array
    mag: Array | None
    dt: Array
    sampling: Sampling
    q: Array
    declination_deg: float


@dataclass(frozen=True, slots=True)
class FilterOutput:
    """What a filter found: ``q`` (n, 4) at ``t`` (n,) s and ``truth`` (n, 4) at the same times."""

    t: Array
    q: Array
    truth: Array

    @property
    def angles(self) -> Array:
        """Roll, pitch, heading (n, 3) in deg, heading without jumps."""
        return angles(self.q)

    @property
    def errors(self) -> Array:
        """Errors of roll, pitch and heading (n, 3) in deg, within 180 deg."""
        return np.asarray(np.degrees(rotation.wrap(rotation.to_euler(self.q) - rotation.to_euler(self.truth))))

    @property
    def tilt_error(self) -> Array:
        """The angle (n,) in deg between the true vertical and the one that was found."""
        return np.asarray(np.degrees(rotation.inclination_angle(rotation.error(self.q, self.truth))))

    @property
    def heading_error(self) -> Array:
        """The error (n,) in deg about the vertical."""
        return np.asarray(np.degrees(rotation.heading_angle(rotation.error(self.q, self.truth))))


def samples(flight: Flight, *, mag: bool = True) -> FlightSamples:
    """The first inertial unit of a flight, with the first magnetometer placed on its times unless ``mag`` is False."""
    imu = flight.imus[0]
    t = imu.t_sample
    field = None
    if mag and flight.mags:
        field = estimators.place(t, flight.mags[0].t_sample, flight.mags[0].field)
    q = rotation.slerp(flight.truth.t, flight.truth.q, np.minimum(t, flight.truth.t[-1]))
    return FlightSamples(t, imu.gyro, imu.acc, field, imu.dt, imu.sampling, q, flight.declination_deg)


def run(row: str, s: FlightSamples, q0: Array | None = None) -> FilterOutput:
    """A filter (``mahony@xu-0.6``) over the samples, from its own start or from ``q0`` (4,)."""
    found = estimators.estimate(
        row, s.t, s.gyr, s.acc, s.mag, sampling=s.sampling, dt=s.dt, q0=q0, declination=s.declination_deg
    )
    return FilterOutput(found.t, found.q, s.q[np.searchsorted(s.t, found.t)])


def gravity_error(s: FlightSamples, found: FilterOutput) -> Array:
    """|e| (n,): the sine of the angle between measured gravity and that of the attitude found (Lyu 13-15)."""
    acc = s.acc[np.searchsorted(s.t, found.t)]
    seen = -acc / np.linalg.norm(acc, axis=1, keepdims=True)
    expected = rotation.rotate_inverse(found.q, np.array([0.0, 0.0, 1.0]))
    return np.asarray(np.linalg.norm(np.cross(seen, expected), axis=1))


def angles(q: Array) -> Array:
    """Roll, pitch, heading (n, 3) in deg of attitudes (n, 4), heading without jumps."""
    found = np.array(rotation.to_euler(q))
    found[:, 2] = np.unwrap(found[:, 2])
    return np.asarray(np.degrees(found))


def rms(x: Array) -> float:
    """The root of the mean square of what is finite."""
    return float(np.sqrt(np.nanmean(np.square(x))))
