"""What does a filter push into its attitude, beyond what the gyro tells? Measurable in flight, without a reference.

The row is compared with the gyro alone, integrated over the same samples: true motion, the
gyro's noise, scale error and misalignment are in both and cancel. What is left is what
accelerometer and magnetometer push in, and the filter's own gyro offset.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog import estimators, rotation
from attlog.flight.model import Imu
from attlog.metrics.base import Case, per_case, per_row, per_times
from attlog.metrics.evidence import imu_of, logged_unit
from attlog.reference import trim
from attlog.reference.model import Row

Array = NDArray[np.float64]

TURN_DEG, TURN_ONBOARD_DEG = 20.0, 10.0
"""The vehicle stays within this of its mean attitude: beyond, the scatter of the comparison grows (onboard rows:
another IMU path, another delay)."""


@dataclass(frozen=True, slots=True)
class Integrated:
    """The gyro alone: ``t`` (n,) s, ``q`` (n, 4), ``segment`` (n,) counts restarts."""

    t: Array
    q: Array
    segment: NDArray[np.int64]


def gyro_alone(case: Case, row: Row) -> Integrated | None:
    """The row ``gyro`` over the row's own unit, whether it was asked for or not; None without an IMU."""
    imu = imu_of(case, row)
    if imu is None:
        return None
    index = logged_unit(case, imu)
    return _of_own_samples(case, row) if index is None else _of_unit(case, index)


@per_case
def _of_unit(case: Case, index: int) -> Integrated:
    return _integrated(case, case.log.imus[index])


@per_row
def _of_own_samples(case: Case, row: Row) -> Integrated | None:
    return None if row.imu is None else _integrated(case, row.imu)


def _integrated(case: Case, imu: Imu) -> Integrated:
    t = imu.gyro.t_best if case.reference.clock == "sample" else imu.gyro.t
    found = estimators.estimate("gyro", t, case.gyro_of(imu), imu.acc.x, sampling=imu.gyro.sampling, dt=imu.dt)
    q = rotation.normalize(found.q)
    if case.reference.trim is not None:
        q = trim.apply(q, case.reference.trim)
    segment = np.zeros(len(found.t), np.int64) if found.segment is None else found.segment
    return Integrated(found.t, q, segment)


def residual(t: Array, q: Array, gyro: Integrated, turn_deg: float) -> Array | None:
    """What a row pushes in during one window (n, 3) in deg: about the vehicle's roll and pitch axis and the vertical.

    ``t`` (n,) s, ``q`` (n, 4) of the row. With ``q_g`` the gyro alone at the same times and
    ``e = q q_g*``: the rotation vector of ``e e_mean*`` (earth axes) without its least-squares fit
    ``a + M(t) b``, ``M`` the integral of R(q). ``a`` is an offset, ``b`` a constant difference of
    gyro offsets *in body axes*, which a turning vehicle would otherwise show as noise. None where the
    gyro restarts or turns more than ``turn_deg`` away from its mean.
    """
    q_g = turned_little(t, gyro, turn_deg)
    return None if q_g is None else pushed_in(t, q, q_g)


def turned_little(t: Array, gyro: Integrated, turn_deg: float) -> Array | None:
    """The gyro alone (n, 4) at times (n,); None where it restarts or turns more than ``turn_deg`` from its mean."""
    i, j = np.searchsorted(gyro.t, [t[0], t[-1]], side="right") - 1
    if i < 0 or j >= len(gyro.t) or gyro.segment[i] != gyro.segment[j]:
        return None
    q_g = gyro.q[i : j + 1]
    if not np.array_equal(gyro.t[i : j + 1], t):  # a row of other times than the filters'
        q_g = rotation.slerp(gyro.t[i : j + 2], gyro.q[i : j + 2], t)
    if not np.isfinite(q_g).all() or np.min(np.abs(q_g @ rotation.mean(q_g))) < np.cos(0.5 * np.radians(turn_deg)):
        return None
    return q_g


def pushed_in(t: Array, q: Array, q_g: Array) -> Array:
    """:func:`residual` with the gyro alone ``q_g`` (n, 4) at the same times."""
    e = rotation.error(q, q_g)
    x = rotation.to_rotvec(rotation.error(e, rotation.mean(e)))
    left = np.degrees(x - _fit(x, _turned(t, q)))
    yaw = rotation.to_euler(rotation.mean(q))[2]
    return np.asarray(
        left @ np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    )


def of_window(case: Case, row: Row, inside: slice) -> Array | None:
    """The residual (n, 3) of a row in one window of its samples."""
    gyro = gyro_alone(case, row)
    limit = TURN_ONBOARD_DEG if row.kind == "onboard" else TURN_DEG
    index = None if (imu := imu_of(case, row)) is None else logged_unit(case, imu)
    if gyro is None or (index is not None and not _is_of_use(case, row.t, index, inside, limit)):
        return None
    return residual(row.t[inside], row.q[inside], gyro, limit)


@per_times
def _is_of_use(case: Case, t: Array, index: int, inside: slice, turn_deg: float) -> bool:
    """Whether the gyro of a unit turns little in a window of times (n,); for all rows that have these times."""
    return turned_little(t[inside], _of_unit(case, index), turn_deg) is not None


def _turned(t: Array, q: Array) -> Array:
    """The integral of R(q) over time (n, 3, 3), trapezoid, centred."""
    matrices = rotation.to_matrix(q).reshape(-1, 9)
    found = np.zeros_like(matrices)
    np.cumsum(0.5 * np.diff(t)[:, None] * (matrices[1:] + matrices[:-1]), axis=0, out=found[1:])
    return np.asarray(found - np.mean(found, axis=0)).reshape(-1, 3, 3)


def _fit(x: Array, turned: Array) -> Array:
    """The least-squares fit (n, 3) of an offset and of ``turned`` (n, 3, 3, centred) times a constant vector."""
    mean, columns = np.mean(x, axis=0), turned.reshape(-1, 3)
    slope = np.linalg.lstsq(columns.T @ columns, columns.T @ (x - mean).ravel(), rcond=None)[0]
    return np.asarray(mean + (columns @ slope).reshape(-1, 3))
