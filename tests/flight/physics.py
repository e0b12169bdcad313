"""Plain physics on a FlightLog, independent of the code that made it: gravity, turn rates, magnetic field.

Short on purpose: every number here can be checked by hand against the manifests.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.flight.model import Attitude, FlightLog, Imu

Array = NDArray[np.float64]


def integral(imu: Imu) -> tuple[Array, Array]:
    """Times and the integrated gyro (n, 3) in rad, by the stream's own sampling rule."""
    t, x = imu.gyro.t, imu.gyro.x
    mean = x[1:] if imu.gyro.sampling == "interval" else 0.5 * (x[1:] + x[:-1])
    return t, np.vstack([np.zeros(3), np.cumsum(mean * np.diff(t)[:, None], axis=0)])


def rates(imu: Imu, attitude: Attitude, longest: float = 0.3) -> tuple[Array, Array]:
    """Mean gyro and mean turn rate of the attitude (m, 3) in rad/s between attitude samples, resets left out."""
    t = attitude.t if attitude.t_sample is None else attitude.t_sample
    step = rotation.to_rotvec(rotation.multiply(rotation.conjugate(attitude.q[:-1]), attitude.q[1:]))
    dt = np.diff(t)
    at, angle = integral(imu)
    whole = np.column_stack([np.interp(t, at, angle[:, k]) for k in range(3)])
    imu_gap = np.interp(t, at[1:], np.maximum.accumulate(np.where(np.diff(at) > 0.3, at[1:], -1e9)))
    good = (dt > 0) & (dt < longest) & (t[:-1] >= at[0]) & (t[1:] <= at[-1]) & (np.diff(imu_gap) == 0)
    resets = [int(k) - 1 + d for k in attitude.resets for d in (-1, 0, 1)]
    good[[k for k in resets if 0 <= k < len(good)]] = False
    return np.diff(whole, axis=0)[good] / dt[good, None], step[good] / dt[good, None]


def slopes(imu: Imu, attitude: Attitude, least_dps: float = 3.0) -> Array:
    """Slope (3,) of attitude rate on gyro per axis; NaN where the vehicle turns too little."""
    gyro, turned = rates(imu, attitude)
    out = np.full(3, np.nan)
    if len(gyro) < 20:
        return out
    g, a = gyro - np.median(gyro, axis=0), turned - np.median(turned, axis=0)
    for k in range(3):
        if np.degrees(g[:, k].std()) >= least_dps:
            out[k] = float(np.dot(g[:, k], a[:, k]) / np.dot(g[:, k], g[:, k]))
    return out


def correlation(imu: Imu, attitude: Attitude) -> float:
    """Correlation of gyro and attitude rate, three axes pooled about their medians."""
    gyro, turned = rates(imu, attitude)
    g, a = gyro - np.median(gyro, axis=0), turned - np.median(turned, axis=0)
    return float(np.sum(g * a) / np.sqrt(np.sum(g * g) * np.sum(a * a)))


def still(imu: Imu, width: float = 0.5) -> NDArray[np.bool_]:
    """Which samples lie in half-second windows without motion."""
    t = imu.gyro.t
    window = np.floor((t - t[0]) / width).astype(np.int64)
    mask = np.zeros(len(t), bool)
    starts = np.flatnonzero(np.diff(window, prepend=-1))
    norm = np.linalg.norm(imu.acc.x, axis=1)
    means = []
    for a, b in zip(starts, np.append(starts[1:], len(t)), strict=True):
        if b - a < 4:
            continue
        quiet = np.degrees(imu.gyro.x[a:b].std(axis=0)).max() < 0.5 and norm[a:b].std() < 0.15
        if quiet:
            mask[a:b] = True
            means.append(imu.gyro.x[a:b].mean(axis=0))
    if means:
        centre = np.median(means, axis=0)
        mask &= np.degrees(np.abs(imu.gyro.x - centre)).max(axis=1) < 3.0
    return mask


def tilt_error(log: FlightLog, mask: NDArray[np.bool_], attitude: Attitude) -> float:
    """Median angle in deg between measured gravity at rest and the attitude's down direction."""
    imu = log.imus[log.imu]
    q = rotation.slerp(attitude.t, attitude.q, imu.acc.t[mask])
    known = np.isfinite(q).all(axis=1)
    if known.sum() < 5:
        return float("nan")
    down = rotation.rotate_inverse(q[known], np.array([0.0, 0.0, -1.0]))
    measured = np.median(imu.acc.x[mask][known], axis=0)
    measured /= np.linalg.norm(measured)
    expected = down.mean(axis=0) / np.linalg.norm(down.mean(axis=0))
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(measured, expected)), measured @ expected)))


def azimuths(log: FlightLog, attitude: Attitude) -> Array:
    """Direction of the horizontal field (n,) in deg after rotation by an attitude: the declination if all is right."""
    mag = log.mags[log.mag].field
    t = mag.t if mag.t_sample is None else mag.t_sample
    q = rotation.slerp(attitude.t, attitude.q, t)
    good = np.isfinite(q).all(axis=1) & np.isfinite(mag.x).all(axis=1)
    earth = rotation.rotate(q[good], mag.x[good])
    return np.degrees(np.arctan2(earth[:, 1], earth[:, 0]))


def scores(onboard: Attitude, truth: Attitude, start: float) -> dict[str, float]:
    """RMS in deg of an onboard attitude against truth from ``start`` on, truth interpolated to its times."""
    use = onboard.t >= start
    q_true = rotation.slerp(truth.t, truth.q, onboard.t[use])
    known = np.isfinite(q_true).all(axis=1)
    e = rotation.earth_error(onboard.q[use][known], q_true[known])
    rms = {
        "rms_tilt": rotation.tilt_angle(e),
        "rms_heading": rotation.heading_angle(e),
        "rms_total": rotation.total_angle(e),
    }
    return {name: float(np.degrees(np.sqrt(np.mean(angle**2)))) for name, angle in rms.items()}
