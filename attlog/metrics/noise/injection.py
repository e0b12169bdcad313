"""What does a filter push into its attitude, beyond what the gyro tells? Measurable in flight, without a reference.

The row is compared with the gyro alone, integrated over the same samples: true motion, the
gyro's noise, scale error and misalignment are in both and cancel. What is left is what
accelerometer and magnetometer push in, and the filter's own gyro offset.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.base import rotation
from attlog.flight.model import Imu
from attlog.kernels.loops import function_of
from attlog.metrics.base import Case, per_case, per_row, per_times
from attlog.metrics.evidence.samples import imu_of, logged_unit
from attlog.metrics.noise.loops import PUSHED, left_of_pushed
from attlog.metrics.noise.windows import together
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
    segment = found.segment
    if segment is None or not segment.any():
        segment = np.broadcast_to(np.int64(0), found.t.shape)  # it is kept: in long logs copies add up
    return Integrated(t if np.array_equal(found.t, t) else found.t, q, segment)


def residual(t: Array, q: Array, gyro: Integrated, turn_deg: float) -> Array | None:
    """What a row pushes in during one window (n, 3) in deg: about the vehicle's roll and pitch axis and the vertical.

    ``t`` (n,) s, ``q`` (n, 4) of the row. With ``q_g`` the gyro alone at the same times and
    ``e = q q_g*``: the rotation vector of ``e e_mean*`` (earth axes) without its least-squares fit
    ``a + M(t) b``, ``M`` the integral of R(q). ``a`` is an offset, ``b`` a constant difference of
    gyro offsets *in body axes*, which a turning vehicle would otherwise show as noise. None where the
    gyro restarts or turns more than ``turn_deg`` away from its mean.
    """
    whole = [slice(0, len(t))]
    return next(residuals(t, q, gyro, whole)) if of_use(t, gyro, turn_deg, whole)[0] else None


def of_use(t: Array, gyro: Integrated, turn_deg: float, inside: Sequence[slice]) -> NDArray[np.bool_]:
    """In which windows of times (n,) the gyro does not restart and turns at most ``turn_deg`` from its mean (k,)."""
    found = [np.zeros(0, bool)]
    for own, at, edges in together(inside):
        ends = np.array([(t[part.start], t[part.stop - 1]) for part in own])
        i, j = (np.searchsorted(gyro.t, ends, side="right") - 1).T
        q_g = rotation.slerp(gyro.t, gyro.q, t[at])
        apart = np.abs(
            np.einsum("ni,ni->n", q_g, rotation.means(q_g, edges)[np.repeat(np.arange(len(own)), np.diff(edges))])
        )
        near = np.minimum.reduceat(apart, edges[:-1]) >= np.cos(0.5 * np.radians(turn_deg))
        found.append((i >= 0) & (gyro.segment[i] == gyro.segment[j]) & near)
    return np.concatenate(found)


def residuals(t: Array, q: Array, gyro: Integrated, inside: Sequence[slice]) -> Iterator[Array]:
    """:func:`residual` (n, 3) of several windows of a row, in which the gyro is :func:`of_use`."""
    for _, at, edges in together(inside):
        own = np.ascontiguousarray(q[at], np.float64)
        pushed = rotation.error(own, rotation.slerp(gyro.t, gyro.q, t[at]))
        yaw = np.ascontiguousarray(rotation.to_euler(rotation.means(own, edges))[:, 2])
        out = np.empty((len(at), 3))
        function_of(PUSHED, left_of_pushed)(
            out, t[at], own, pushed, rotation.means(pushed, edges), yaw, edges, np.empty((len(at), 9))
        )
        yield from np.split(out, edges[1:-1])


def of_windows(case: Case, row: Row, inside: list[slice]) -> list[Array | None]:
    """The residuals (n, 3) of a row in windows of its samples; None where the gyro is of no use."""
    gyro = gyro_alone(case, row)
    if gyro is None:
        return [None] * len(inside)
    limit = TURN_ONBOARD_DEG if row.kind == "onboard" else TURN_DEG
    index = None if (imu := imu_of(case, row)) is None else logged_unit(case, imu)
    use = of_use(row.t, gyro, limit, inside) if index is None else _of_use(case, row.t, index, inside, limit)
    left = residuals(row.t, row.q, gyro, [part for part, good in zip(inside, use, strict=True) if good])
    return [next(left) if good else None for good in use]


@per_times
def _of_use(case: Case, t: Array, index: int, inside: list[slice], turn_deg: float) -> NDArray[np.bool_]:
    """That of the gyro of a unit, for all rows that have these times (n,)."""
    return of_use(t, _of_unit(case, index), turn_deg, inside)
