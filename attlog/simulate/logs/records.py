"""Parts of a flight that the logs of all firmwares need: clock, rates, states as records, texts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from attlog import __version__
from attlog.core.errors import UsageError
from attlog.core.sorting import unique
from attlog.formats import Text
from attlog.simulate.flight import Flight, GnssStream, ImuStream

Array = NDArray[np.float64]
Index = NDArray[np.int64]
T = TypeVar("T")

# Boot clock at the begin of the simulation; 0 means unset in every format.
START_US = 5_000_000
# Low-passes of the vibration level: limit of motion, and smoothing (ArduPilot).
VIBRATION_FLOOR_HZ, VIBRATION_HZ = 5.0, 2.0


def micros(t: Array) -> NDArray[np.uint64]:
    """Return the boot clock (n,) [us] at times (n,) [s] of a flight."""
    return (START_US + np.rint(np.asarray(t, np.float64) * 1e6)).astype(np.uint64)


def logged_samples(t: Array, hz: float) -> Index:
    """Return which values at ``t`` (n,) s are logged at ``hz``: the first in each period; all where ``hz`` is 0."""
    if hz <= 0 or len(t) == 0:
        return np.arange(len(t))
    period = np.floor(t * hz + 1e-6)
    return np.flatnonzero(np.diff(period, prepend=period[0] - 1.0) > 0)


def last_before(t: Array, at: Array) -> Index:
    """Return for each time ``at`` the index of the newest value at ``t`` (n,), the first before it begins."""
    return np.maximum(np.searchsorted(t, at + 1e-9, side="right") - 1, 0)


def state_times(flight: Flight, lines: Sequence[list[tuple[float, Any]]], hz: float) -> Array:
    """Return times (n,) s of states: ``hz`` times a second and at each change."""
    regular = np.arange(0.0, flight.seconds + 1e-9, 1.0 / hz)
    changes = [t for line in lines for t, _ in line if 0.0 <= t <= flight.seconds]
    return unique(np.round(np.concatenate([regular, changes]), 6))


def held_values(line: list[tuple[float, T]], at: Array) -> list[T]:
    """Return the value of a time line at each time."""
    times = np.array([t for t, _ in line])
    return [line[k][1] for k in last_before(times, at)]


def number_modes(modes: Sequence[str], numbers: dict[str, int], firmware: str) -> list[int]:
    """Return modes by the firmware's numbers. UsageError for a mode that it does not have."""
    for mode in modes:
        if mode not in numbers:
            raise UsageError(f"the flight mode {mode} has no number in {firmware}")
    return [numbers[mode] for mode in modes]


def texts(flight: Flight, at_us: int) -> list[Text]:
    """Return the texts of the log: simulated, scenario, estimator, then events."""
    pilot = flight.onboard.estimator
    found = [
        Text(f"attlog {__version__} simulated this flight, seed {flight.seed}", 6, at_us),
        Text(f"scenario: {flight.scenario.name or 'unnamed'}", 6, at_us),
        Text(f"attitude on board: {pilot}, no firmware's" if pilot else "no attitude on board", 6, at_us),
    ]
    return found + [Text(f"simulated {what}", 6, int(micros(np.array(t)))) for t, what in flight.events]


def place_while_lost(gnss: GnssStream) -> tuple[Array, Array, Array, Array]:
    """Return latitude, longitude (n,) deg, height (n,) m, velocity (n, 3) m/s NED as receivers send them.

    Without a fix the last ones, at first 0.
    """
    k = np.maximum.accumulate(np.where(gnss.fix > 0, np.arange(len(gnss.t)), -1))
    lat, lon, alt, vel = (
        np.where((k < 0).reshape(-1, *[1] * (x.ndim - 1)), 0.0, x[np.maximum(k, 0)])
        for x in (gnss.lat, gnss.lon, gnss.alt, gnss.vel)
    )
    return lat, lon, alt, np.where((gnss.fix > 0)[:, None], vel, 0.0)


def vibration(imu: ImuStream) -> Array:
    """Return the vibration level (n, 3) m/s^2 of an accelerometer: above motion, rectified and smoothed."""
    floor = _low_passed(imu.acc, imu.rate_hz, VIBRATION_FLOOR_HZ)
    return np.sqrt(_low_passed((imu.acc - floor) ** 2, imu.rate_hz, VIBRATION_HZ, 0.0))


def _low_passed(x: Array, rate_hz: float, cut_hz: float, start: float | None = None) -> Array:
    """Return ``x`` (n, 3) behind a first-order low-pass from ``start``, else from the first value; kernel to 1e-6."""
    if len(x) == 0:
        return x
    step = 1.0 / rate_hz
    stays = 1.0 - step / (step + 1.0 / (2.0 * np.pi * cut_hz))
    kernel = (1.0 - stays) * stays ** np.arange(int(np.ceil(np.log(1e-6) / np.log(stays))))
    first = x[:1] if start is None else np.full((1, x.shape[1]), start)
    smooth = np.column_stack([np.convolve(axis, kernel)[: len(x)] for axis in (x - first).T])
    return np.asarray(smooth + first, np.float64)


def since_start(flight: Flight) -> Flight:
    """Return the flight without onboard values before the estimator's start: none are published then."""
    board = flight.onboard
    known = np.all(np.isfinite(board.q), axis=1)
    if known.all():
        return flight
    rows = ("t", "q", "bias", "q_setpoint", "rate_setpoint", "thrust_setpoint", "torque_setpoint", "motors")
    kept = {name: x[known] for name in rows if len(x := getattr(board, name)) == len(known)}
    return replace(flight, onboard=replace(board, **kept))


def measured_rates(flight: Flight, at: Array) -> Array:
    """Return the controller's body rates (n, 3) rad/s: the first gyro without the estimated bias."""
    imu, onboard = flight.imus[0], flight.onboard
    rates = imu.gyro[last_before(imu.t_sample, at)]
    bias = onboard.bias[last_before(onboard.t, at)] if len(onboard.bias) else np.zeros(3)
    return rates - bias
