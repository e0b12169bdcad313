"""Xu's experiment for one seed: a waypoint mission, and gains of Mahony's filter run over what its sensors logged."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.reproduce import band
from attlog.reproduce.samples import NOBODY, FilterOutput, FlightSamples, rms, run, samples
from attlog.simulate.fly import fly
from attlog.simulate.scenario.scenario import Scenario, load
from attlog.simulate.sensors.settings import ImuSettings, MagSettings, SensorSettings

Array = NDArray[np.float64]
Triple = tuple[float, float, float]

FIXED = {0.6: "mahony@xu-0.6", 1.1: "mahony@xu-1.1", 2.0: "mahony@xu-2"}
ADAPTIVE = "mahony_adaptive@xu"
SWEPT = (0.03, 0.06, 0.1, 0.2, 0.3, 0.45, 0.6, 0.85, 1.1, 1.5, 2.0, 3.0)
BAND_HZ = (0.2, 5.0)
"""Slower is drift and manoeuvre, faster is beyond what a logged IMU of 25 Hz can show."""


def gain(kp: float) -> str:
    """Xu's filter with another gain."""
    return FIXED.get(kp, f"mahony@xu-0.6:kp={kp:g}")


COSTED = (gain(0.6), "mahony_dcm:kp=0.6,ki=0,mag_gain=1,acc_form=direction,integrator=first_order")
"""The same filter on the quaternion and on the rotation matrix."""
ROWS = (*map(gain, SWEPT), ADAPTIVE)


@dataclass(frozen=True, slots=True)
class XuSeed:
    """What one seed gave by row, in the air: RMS of the error of (roll, pitch, heading) within BAND_HZ in deg, the
    dominant frequency of each and that of its zero crossings (upwards) in Hz, the RMS error of tilt and of heading in
    deg, and of roll and pitch averaged over 1 / BAND_HZ[0].
    """

    rms: dict[str, Triple]
    hz: dict[str, Triple]
    crossing: dict[str, Triple]
    tilt: dict[str, float]
    heading: dict[str, float]
    slow: dict[str, float]


def mission() -> Scenario:
    """The library's waypoints: around a square of 30 m, nose ahead, in wind. No filter changes the flight."""
    sensors = SensorSettings(imu=(ImuSettings(rate_hz=200.0),), mag=(MagSettings(rate_hz=50.0),))
    return load("waypoints").changed(sensors=sensors, estimator=NOBODY)


def flown(seed: int) -> FlightSamples:
    """What the sensors of one mission logged."""
    return samples(fly(mission(), seed))


@functools.cache
def air() -> tuple[float, float]:
    """From the first waypoint to the landing, s."""
    commands = mission().command
    return next(c.t for c in commands if c.do == "goto"), next(c.t for c in commands if c.do == "land")


def in_the_air(t: Array) -> NDArray[np.bool_]:
    """Which times (n,) lie between the first waypoint and the landing."""
    begin, end = air()
    return np.asarray((t >= begin) & (t < end))


def one_seed(seed: int) -> XuSeed:
    """All gains over one mission."""
    s = flown(seed)
    found = {row: run(row, s) for row in ROWS}
    spectra = {row: _spectra(one) for row, one in found.items()}
    air = {row: in_the_air(one.t) for row, one in found.items()}
    return XuSeed(
        {row: three([x.rms(BAND_HZ) for x in axes]) for row, axes in spectra.items()},
        {row: three([x.dominant_hz(BAND_HZ) for x in axes]) for row, axes in spectra.items()},
        {row: three([x.crossing_hz(BAND_HZ) for x in axes]) for row, axes in spectra.items()},
        {row: rms(one.tilt_error[air[row]]) for row, one in found.items()},
        {row: rms(one.heading_error[air[row]]) for row, one in found.items()},
        {row: slow_deg(one.t[air[row]], one.errors[air[row], :2]) for row, one in found.items()},
    )


def slow_deg(t: Array, error: Array) -> float:
    """RMS of both columns of an error (n, 2) together, averaged over 1 / BAND_HZ[0], in its unit."""
    size = round((len(t) - 1) / float(t[-1] - t[0]) / BAND_HZ[0])
    total = np.cumsum(np.vstack([np.zeros((1, 2)), error]), axis=0)
    return math.sqrt(2.0) * rms((total[size:] - total[:-size]) / size)


def _spectra(found: FilterOutput) -> list[band.Spectrum]:
    part = in_the_air(found.t)
    return [band.spectrum(found.t[part], found.errors[part, axis]) for axis in range(3)]


def three(values: list[float]) -> Triple:
    """Roll, pitch, heading."""
    return values[0], values[1], values[2]
