"""Noise that corrections by accelerometer and magnetometer add to the gyro, without a reference.

The row is compared with the gyro alone, integrated over the same samples: true motion and the gyro's noise, scale and
misalignment are in both and cancel.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.core import jit, rotation
from attlog.core.jit import F1, F2, I1, Out1, Out2
from attlog.flight.model import Imu
from attlog.metrics.metric import Case, per_object
from attlog.metrics.windows import imu_of, logged_unit, sample_batches
from attlog.reference import alignment
from attlog.reference.model import Track

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Three = tuple[float, float, float]


# The vehicle stays within this of its mean attitude: beyond, the scatter of the comparison grows (onboard rows:
# another IMU path, another delay).
TURN_DEG, TURN_ONBOARD_DEG = 20.0, 10.0
DEG, TURN = math.degrees(1.0), 2.0 * math.pi


def relative(q: Array, i: int, c: Array, k: int) -> tuple[float, float, float, float]:
    """Return the rotation ``q_i c_k*`` of unit quaternions (n, 4), (m, 4)."""
    w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
    e, f, g, h = c[k, 0], -c[k, 1], -c[k, 2], -c[k, 3]
    return (
        w * e - x * f - y * g - z * h,
        w * f + x * e + y * h - z * g,
        w * g - x * h + y * e + z * f,
        w * h + x * g - y * f + z * e,
    )


def vector(w: float, x: float, y: float, z: float) -> Three:
    """Return the rotation vector in rad of a unit quaternion."""
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 * math.atan2(sine, abs(w)) / sine if sine > 1e-12 else 2.0
    if w < 0.0:
        factor = -factor
    return factor * x, factor * y, factor * z


def turned_to_earth(q: Array, i: int, m: Array) -> None:
    """Fill ``m`` (9,) with the rotation matrix of an attitude, row by row."""
    w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
    m[0], m[1], m[2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    m[3], m[4], m[5] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    m[6], m[7], m[8] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


def integrated(out: Array, t: Array, q: Array, a: int, b: int, now: Array, before: Array) -> None:
    """Fill rows a to b of ``out`` (n, 9) with the integral of R(q) over time, trapezoid, centred."""
    for c in range(9):
        out[a, c] = 0.0
    turned_to_earth(q, a, before)
    for i in range(a + 1, b):
        turned_to_earth(q, i, now)
        for c in range(9):
            out[i, c] = out[i - 1, c] + 0.5 * (t[i] - t[i - 1]) * (now[c] + before[c])
            before[c] = now[c]
    for c in range(9):
        mean = 0.0
        for i in range(a, b):
            mean += out[i, c] / (b - a)
        for i in range(a, b):
            out[i, c] -= mean


def fitted(x: Array, turned: Array, a: int, b: int, g: Array, h: Array) -> None:
    """Take the least-squares fit of ``turned`` (n, 9) times a constant vector from rows a to b of ``x`` (n, 3)."""
    for r in range(3):
        for c in range(3):
            g[3 * r + c], h[c] = 0.0, 0.0
    for i in range(a, b):
        for r in range(3):
            for c in range(3):
                h[c] += turned[i, 3 * r + c] * x[i, r]
                for d in range(c, 3):
                    g[3 * c + d] += turned[i, 3 * r + c] * turned[i, 3 * r + d]
    a00, a01, a02 = g[4] * g[8] - g[5] * g[5], g[2] * g[5] - g[1] * g[8], g[1] * g[5] - g[2] * g[4]
    a11, a12, a22 = g[0] * g[8] - g[2] * g[2], g[1] * g[2] - g[0] * g[5], g[0] * g[4] - g[1] * g[1]
    size = g[0] * a00 + g[1] * a01 + g[2] * a02
    if size > 0.0:
        sx = (a00 * h[0] + a01 * h[1] + a02 * h[2]) / size
        sy = (a01 * h[0] + a11 * h[1] + a12 * h[2]) / size
        sz = (a02 * h[0] + a12 * h[1] + a22 * h[2]) / size
        for i in range(a, b):
            for r in range(3):
                x[i, r] -= turned[i, 3 * r] * sx + turned[i, 3 * r + 1] * sy + turned[i, 3 * r + 2] * sz


@jit.loop("the noise in flight")
def correction_residual(
    out: Out2,
    t: F1,
    q: F2,
    correction: F2,
    centre: F2,
    yaw: F1,
    edges: I1,
    turned: Out2,
    now: Out1,
    before: Out1,
    g: Out1,
    h: Out1,
) -> None:
    """Fill ``out`` (n, 3) with the corrections in attitudes ``q`` (n, 4) at ``t`` (n,), in deg, without the fit.

    ``correction`` (n, 4) is the rotation relative to the gyro alone. Window k has samples ``edges[k]`` to ``edges[k +
    1]``, ``centre[k]`` is the mean of ``correction``, ``yaw[k]`` the heading of the mean attitude. Axes: level roll and
    pitch axis, vertical. The fit is an offset, and R(q) integrated times a constant. Scratch: ``turned`` (n, 9),
    ``now``, ``before``, ``g`` (9,), ``h`` (3,).
    """
    for k in range(len(yaw)):
        a, b = edges[k], edges[k + 1]
        integrated(turned, t, q, a, b, now, before)
        mx, my, mz = 0.0, 0.0, 0.0
        for i in range(a, b):
            w, x, y, z = relative(correction, i, centre, k)
            out[i, 0], out[i, 1], out[i, 2] = vector(w, x, y, z)
            mx, my, mz = mx + out[i, 0] / (b - a), my + out[i, 1] / (b - a), mz + out[i, 2] / (b - a)
        for i in range(a, b):
            out[i, 0], out[i, 1], out[i, 2] = out[i, 0] - mx, out[i, 1] - my, out[i, 2] - mz
        fitted(out, turned, a, b, g, h)
        cosine, sine = DEG * math.cos(yaw[k]), DEG * math.sin(yaw[k])
        for i in range(a, b):
            x, y = out[i, 0], out[i, 1]
            out[i, 0], out[i, 1], out[i, 2] = x * cosine + y * sine, y * cosine - x * sine, DEG * out[i, 2]


class Residuals(NamedTuple):
    """Residuals ``x`` (n, 3) in deg of consecutive windows; ``edges`` (windows + 1,) are their bounds in ``x``."""

    x: Array
    edges: Index


class GyroAttitude(NamedTuple):
    """The integrated gyro: ``t`` (n,) s, ``q`` (n, 4), ``segment`` (n,) counts restarts."""

    t: Array
    q: Array
    segment: NDArray[np.int64]


def gyro_alone(case: Case, row: Track) -> GyroAttitude | None:
    """Return the integrated gyro of the row's own unit; None without an IMU."""
    imu = imu_of(case, row)
    return None if imu is None else _integrated(case, imu)


def integrate_gyro(case: Case, imu: Imu) -> estimators.Estimate:
    """Run the filter ``gyro`` over a unit, with the common bias subtracted."""
    t = imu.gyro.t_best if case.reference.alignment.clock == "sample" else imu.gyro.t
    return estimators.estimate(
        "gyro", t, case.gyro_of(imu), imu.acc.x, sampling=imu.gyro.sampling, dt=imu.dt, check_units=False
    )


@per_object
def _integrated(case: Case, imu: Imu) -> GyroAttitude:
    found = integrate_gyro(case, imu)
    t = imu.gyro.t_best if case.reference.alignment.clock == "sample" else imu.gyro.t
    q = rotation.normalize(found.q)
    if case.reference.alignment.trim is not None:
        q = alignment.apply_trim(q, case.reference.alignment.trim)
    segment = found.segment
    if segment is None or not segment.any():
        segment = np.broadcast_to(np.int64(0), found.t.shape)  # it is kept: in long logs copies add up
    return GyroAttitude(t if np.array_equal(found.t, t) else found.t, q, segment)


def residual(t: Array, q: Array, gyro: GyroAttitude, turn_deg: float) -> Array | None:
    """Return the corrections of a row in one window (n, 3) in deg: about the level axes and the vertical.

    With ``q_g`` the gyro alone and ``e = q q_g*``: the rotation vector of ``e e_mean*`` (earth axes) without its
    least-squares fit ``a + M(t) b``, ``M`` the integral of R(q). ``a`` is an offset, ``b`` a constant gyro offset *in
    body axes*, which a turning vehicle would otherwise show as noise. None where the gyro restarts or turns more than
    ``turn_deg`` away from its mean.
    """
    whole = [slice(0, len(t))]
    return next(residuals(t, q, gyro, whole)).x if usable_windows(t, gyro, turn_deg, whole)[0] else None


def usable_windows(t: Array, gyro: GyroAttitude, turn_deg: float, inside: Sequence[slice]) -> NDArray[np.bool_]:
    """Return in which windows (k,) the gyro does not restart and stays within ``turn_deg`` of its mean."""
    found = [np.zeros(0, bool)]
    for own, at, edges in sample_batches(inside):
        ends = np.array([(t[part.start], t[part.stop - 1]) for part in own])
        i, j = (np.searchsorted(gyro.t, ends, side="right") - 1).T
        q_g = rotation.slerp(gyro.t, gyro.q, t[at])
        relative = np.abs(
            np.einsum("ni,ni->n", q_g, rotation.group_means(q_g, edges)[np.repeat(np.arange(len(own)), np.diff(edges))])
        )
        near = np.minimum.reduceat(relative, edges[:-1]) >= np.cos(0.5 * np.radians(turn_deg))
        found.append((i >= 0) & (gyro.segment[i] == gyro.segment[j]) & near)
    return np.concatenate(found)


def residuals(t: Array, q: Array, gyro: GyroAttitude, inside: Sequence[slice]) -> Iterator[Residuals]:
    """Yield the corrections of a row in windows, a batch at a time; the windows must be :func:`usable_windows`."""
    for _, at, edges in sample_batches(inside):
        own = np.ascontiguousarray(q[at], np.float64)
        correction = rotation.earth_error(own, rotation.slerp(gyro.t, gyro.q, t[at]))
        yaw = np.ascontiguousarray(rotation.to_euler(rotation.group_means(own, edges))[:, 2])
        out = np.empty((len(at), 3))
        scratch = np.empty((len(at), 9)), np.zeros(9), np.zeros(9), np.zeros(9), np.zeros(3)
        correction_residual(out, t[at], own, correction, rotation.group_means(correction, edges), yaw, edges, *scratch)
        yield Residuals(out, edges)


def window_residuals(case: Case, row: Track, inside: list[slice]) -> tuple[NDArray[np.bool_], Iterator[Residuals]]:
    """Return which windows (k,) of a row's samples are usable, and the residuals in these."""
    gyro = gyro_alone(case, row)
    if gyro is None:
        return np.zeros(len(inside), bool), iter(())
    limit = TURN_ONBOARD_DEG if row.kind == "onboard" else TURN_DEG
    index = None if (imu := imu_of(case, row)) is None else logged_unit(case, imu)
    corrected = 1e-3 * float(row.quality.get("imu_lag_corrected_ms", 0.0))
    if estimators.is_recorded(row.estimator):
        corrected = case.reference.alignment.input_delay_s - 1e-3 * float(row.parameters.get("delay", 0.0))
    if corrected:
        # such a row shows the moment at which the sensor felt it: what it corrects it does not add
        gyro, index = GyroAttitude(gyro.t - corrected, gyro.q, gyro.segment), None
    use = (
        usable_windows(row.t, gyro, limit, inside)
        if index is None
        else _usable_windows(case, row.t, index, inside, limit)
    )
    return use, residuals(row.t, row.q, gyro, [part for part, good in zip(inside, use, strict=True) if good])


@per_object
def _usable_windows(case: Case, t: Array, index: int, inside: list[slice], turn_deg: float) -> NDArray[np.bool_]:
    """Return :func:`usable_windows` for the gyro of a unit, cached for rows with these times."""
    return usable_windows(t, _integrated(case, case.log.imus[index]), turn_deg, inside)
