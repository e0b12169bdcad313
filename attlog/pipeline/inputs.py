"""Estimator inputs other than samples: logged parameters and aids, free of log formats."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.core import earth, spans
from attlog.core.sorting import median
from attlog.estimators import Aids, LogFacts, LogInfo, Measurements
from attlog.estimators.aids import MAX_LAG_S
from attlog.flight.model import FIX_3D, FlightLog, Gnss, Imu, Mag, Stream
from attlog.flight.vehicle import VehicleKind
from attlog.segments.model import Segments

Array = NDArray[np.float64]
# Shortest rest over which noise is estimated.
MIN_REST_S = 2.0


def facts_of(log: FlightLog, segments: Segments, imu: Imu, declination_deg: float | None = None) -> LogFacts:
    """Return parameters at the first IMU sample, rates, noise, declination for ``imu``."""
    values = {name: log.param(name) for name in log.parameters.lines if name not in log.parameters.filled}
    gyro, acc, seconds = noise_at_rest(imu, segments)
    info = LogInfo(
        declination_deg=declination_deg,
        imu_rate_hz=imu.gyro.rate or None,
        mag_rate_hz=None if log.mag is None else log.mags[log.mag].field.rate,
        gyro_noise=gyro,
        acc_noise=acc,
        rest_s=seconds,
        forward=forward_of(log.kind),
        since_boot_s=1e-6 * log.t0_us if log.t0_us >= 0 else None,
    )
    own = {name: float(v) for name, v in values.items() if isinstance(v, int | float)}
    return LogFacts(own, info, dict(log.parameters.given))


def forward_of(kind: VehicleKind) -> bool | None:
    """Return whether the course is the heading: planes, rovers, boats.

    None for an unknown vehicle.
    """
    return None if kind is VehicleKind.OTHER else kind.fixed_wing or kind in (VehicleKind.ROVER, VehicleKind.BOAT)


def noise_at_rest(imu: Imu, segments: Segments) -> tuple[float | None, float | None, float]:
    """Estimate white noise densities of gyro and accelerometer at rest.

    Units: rad/s/sqrt(Hz) and m/s^2/sqrt(Hz); then seconds of rest used. The variance of differences of neighbouring
    samples is 2 n^2 / dt, whatever the drift. Mean of the axes' variances over all rest; None with less than 2 s.
    """
    t = imu.gyro.t_best
    rest = spans.inside(t, segments.spans("rest"))
    step = np.diff(t)
    pair = rest[1:] & rest[:-1] & (step > 0.0)
    pair &= step < 2.0 * median(step) if len(step) else False
    seconds = float(step[pair].sum())
    if seconds < MIN_REST_S:
        return None, None, seconds
    density = []
    for x in (imu.gyro.x, imu.acc.x):
        squares = np.diff(x, axis=0)[pair] ** 2 * step[pair, None] / 2.0
        found = float(np.sqrt(np.nanmean(squares))) if np.isfinite(squares).any() else 0.0
        density.append(found or None)
    return density[0], density[1], seconds


def aids_of(
    log: FlightLog, segments: Segments, imu: Imu | None = None, field: earth.MagneticField | None = None
) -> Aids:
    """Return aids of a log: first GNSS receiver with a fix, barometer, airspeed, rest.

    ``imu``: the replayed unit; the lag of its low-pass filters is an aid. ``field``: the earth's field at the site.
    """
    receiver = receiver_of(log)
    height = next((_measured(b.t_best, b.x) for b in log.baro if b.unit == "m" and len(b.t) > 1), None)
    speed = log.airspeed
    rest = [(s.t0, s.t1) for s in segments.of("rest")]
    return Aids(
        position=None if receiver is None else _position(receiver),
        velocity=None if receiver is None else _velocity(receiver),
        baro=height,
        airspeed=None if speed is None else _measured(speed.t_best, speed.x),
        at_rest=np.array(rest, np.float64).reshape(-1, 2),
        field=None if field is None else np.array(field.ned_t),
        lag=(0.0, 0.0) if imu is None else (_lag(imu.gyro), _lag(imu.acc)),
        impact=min((s.t0 for s in segments.of("impact")), default=None),
    )


def receiver_of(log: FlightLog) -> Gnss | None:
    """Return the first receiver with a 3D fix, None without any."""
    return next((g for g in log.gnss if np.count_nonzero(g.fix >= FIX_3D) > 1), None)


def field_of(mag: Mag) -> Measurements | None:
    """Return a magnetometer at its own times, None without a finite sample."""
    whole = np.isfinite(mag.field.x).all(axis=1)
    return _measured(mag.field.t_best[whole], mag.field.x[whole])


def _lag(stream: Stream) -> float:
    """Return the known lag of a stream's low-pass filter in s.

    The lag is limited, because damaged parameters may give any value.
    """
    return float(np.clip(stream.delay, 0.0, 0.99 * MAX_LAG_S))


def _position(g: Gnss) -> Measurements | None:
    place = np.column_stack([g.lat, g.lon, g.alt])
    place[(g.fix < FIX_3D) | ~np.isfinite(g.lat + g.lon)] = np.nan
    return _measured(g.t, place, np.column_stack([g.h_acc, g.v_acc]))


def _velocity(g: Gnss) -> Measurements | None:
    velocity = np.array(g.vel_ned, np.float64)
    velocity[(g.fix < FIX_3D) | ~np.isfinite(velocity[:, 0] + velocity[:, 1])] = np.nan
    return _measured(g.t, velocity, np.asarray(g.s_acc, np.float64))


def _measured(t: Array, x: Array, sigma: Array | None = None) -> Measurements | None:
    """Return finite samples sorted by time, the first of equal times; None without any."""
    x = np.array(x, np.float64)
    x = x[:, 0] if x.ndim == 2 and x.shape[1] == 1 else x
    x[~np.isfinite(x)] = np.nan
    order = np.argsort(t, kind="stable")
    order = order[np.isfinite(t[order]) & np.isfinite(x[order]).reshape(len(t), -1).any(axis=1)]
    order = order[np.r_[True, np.diff(t[order]) > 0.0]] if len(order) else order
    if len(order) == 0:
        return None
    if sigma is not None:
        sigma = np.where(np.isfinite(sigma) & (sigma >= 0.0), sigma, np.nan)[order]
    return Measurements(t[order], x[order], sigma)
