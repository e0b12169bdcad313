"""The loop behind interpolated attitudes (:func:`attlog.base.rotation.slerp`, :mod:`attlog.reference.compare`)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.kernels.loops import kernel_of
from attlog.kernels.search import before

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SMALL = 0.0025
"""Squared sine of half an angle below which series hold to the last digit: 0.1 rad between neighbours, as of most."""
SIGNATURE = "void(f8[:, ::1], i8[::1], (f8[::1]), (f8[:, ::1]), (i8[::1]), (f8[::1]))"


def arc_of(s: float) -> float:
    """The angle in rad of a sine up to 0.05."""
    x = s * s
    return s * (1.0 + x * (1.0 / 6.0 + x * (3.0 / 40.0 + x * (5.0 / 112.0 + x * (35.0 / 1152.0 + x * 63.0 / 2816.0)))))


def sine_of(y: float) -> float:
    """The sine of an angle up to 0.11 rad."""
    x = y * y
    return y * (1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0))))


def interpolated(out: Array, where: Index, t: Array, q: Array, segment: Index, at: Array) -> None:
    """Fill ``out`` (m, 4) with attitudes at times ``at`` (m,) along the shortest arc, ``where`` (m,) with the sample
    before each; NaN and -1 where there is none, or where the next one is of another ``segment``.

    ``t`` (n,) ascending, ``q`` (n, 4), ``segment`` (n,). Times that ascend are found by walking on.
    """
    i, last = 0, len(t) - 1
    for k in range(len(at)):
        x = at[k]
        for c in range(4):
            out[k, c] = math.nan
        where[k] = -1
        if not (last >= 0 and t[0] <= x <= t[last]):
            continue
        i = before(t, x, i, last)
        if x == t[i]:
            where[k] = i
            for c in range(4):
                out[k, c] = q[i, c]
            continue
        if segment[i] != segment[i + 1]:
            continue
        where[k] = i
        share = (x - t[i]) / (t[i + 1] - t[i])
        dot = 0.0
        for c in range(4):
            dot += q[i, c] * q[i + 1, c]
        sign = -1.0 if dot < 0.0 else 1.0
        apart, along = 0.0, 0.0
        for c in range(4):
            minus, plus = sign * q[i + 1, c] - q[i, c], sign * q[i + 1, c] + q[i, c]
            apart, along = apart + minus * minus, along + plus * plus
        square = apart / (apart + along) if apart + along > 0.0 else math.nan
        first, second = 1.0 - share, share
        if square < SMALL:
            angle = 2.0 * arc_of(math.sqrt(square))
            if angle > 0.0:
                whole = sine_of(angle)
                first, second = sine_of(first * angle) / whole, sine_of(share * angle) / whole
        else:
            angle = 2.0 * math.atan2(math.sqrt(apart), math.sqrt(along))
            whole = math.sin(angle)
            first, second = math.sin(first * angle) / whole, math.sin(share * angle) / whole
        for c in range(4):
            out[k, c] = first * q[i, c] + second * sign * q[i + 1, c]


def interpolated_at_once(out: Array, where: Index, t: Array, q: Array, segment: Index, at: Array) -> None:
    """The same in numpy, which needs memory for all times at once."""
    out[:], where[:] = np.nan, -1
    if len(t) == 0:
        return
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 1)
    inside = (at >= t[0]) & (at <= t[-1])
    exact = inside & (t[i] == at)
    out[exact], where[exact] = q[i[exact]], i[exact]
    between = np.flatnonzero(inside & ~exact)
    between = between[segment[i[between]] == segment[i[between] + 1]]
    i = i[between]
    where[between] = i
    a, b, share = q[i], q[i + 1], ((at[between] - t[i]) / (t[i + 1] - t[i]))[:, None]
    b = np.where(_of_rows(a * b) < 0.0, -b, b)
    apart, along = (np.sqrt(_of_rows(x * x)) for x in (b - a, b + a))
    angle = 2.0 * np.arctan2(apart, along)
    whole = np.where(angle > 0.0, np.sin(angle), 1.0)
    first = np.where(angle > 0.0, np.sin((1.0 - share) * angle) / whole, 1.0 - share)
    second = np.where(angle > 0.0, np.sin(share * angle) / whole, share)
    out[between] = first * a + second * b


def _of_rows(x: Array) -> Array:
    """The sums (n, 1) of rows (n, 4), column by column: numpy adds up short rows several times slower."""
    return np.asarray(x[:, 0] + x[:, 1] + x[:, 2] + x[:, 3])[:, None]


INTERPOLATED = kernel_of(
    interpolated, SIGNATURE, "rotation", "the interpolation of attitudes", ("base/interpolation.py", "kernels")
)
