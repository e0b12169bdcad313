"""The loops behind :mod:`attlog.metrics.steps.turning`: summed turning of an attitude, and about the axes of events."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.kernels.loops import kernel_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]

DEG = math.degrees(1.0)
SMALL = 0.0025
"""Squared tangent of half an angle below which a series holds to the last digit: 0.1 rad, as between most samples."""
SOURCES = ("metrics/steps/turning_loop.py", "kernels")
SUMMED_SIGNATURE = "void(f8[:, ::1], (f8[:, ::1]))"
ABOUT_SIGNATURE = (
    "void(f8[:, ::1], f8[::1], (f8[:, ::1]), (f8[::1]), (i8[::1]), (i8[::1]), (f8[::1]), (f8[:, ::1]), i8)"
)


def summed_turning(out: Array, q: Array) -> None:
    """Fill ``out`` (n, 3) with the summed rotation vectors in deg of ``q_i^* q_(i+1)`` of attitudes ``q`` (n, 4)."""
    sx, sy, sz = 0.0, 0.0, 0.0
    for i in range(len(q)):
        if i > 0:
            w, x, y, z = q[i - 1, 0], q[i - 1, 1], q[i - 1, 2], q[i - 1, 3]
            e, f, g, h = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
            tx, ty, tz = w * f - x * e - y * h + z * g, w * g + x * h - y * e - z * f, w * h - x * g + y * f - z * e
            cosine, square = w * e + x * f + y * g + z * h, tx * tx + ty * ty + tz * tz
            size, factor = abs(cosine), 2.0
            if square < SMALL * size * size:
                s = square / (size * size)
                factor = 1.0 - s * (
                    1.0 / 3.0 - s * (0.2 - s * (1.0 / 7.0 - s * (1.0 / 9.0 - s * (1.0 / 11.0 - s / 13.0))))
                )
                factor *= 2.0 / size
            elif square > 1e-24:
                sine = math.sqrt(square)
                factor = 2.0 * math.atan2(sine, size) / sine
            factor *= -DEG if cosine < 0.0 else DEG
            sx, sy, sz = sx + factor * tx, sy + factor * ty, sz + factor * tz
        out[i, 0], out[i, 1], out[i, 2] = sx, sy, sz


def summed_at_once(out: Array, q: Array) -> None:
    """The same in numpy."""
    turn = rotation.increments(q)
    out[:1] = 0.0
    np.cumsum(np.degrees(turn, out=turn), axis=0, out=out[1:])


def about_axes(
    out: Array, at: Array, axes: Array, start: Array, begin: Index, first: Index, t: Array, turned: Array, cross: int
) -> None:
    """Fill ``out[:, 0]`` with what is turned (n,) in deg about each event's axis since its first sample.

    Event e has ``axes[e]`` and the samples ``first[e]`` to ``first[e + 1]`` of ``out`` and ``at``, which are those from
    ``begin[e]`` on of ``t`` and ``turned`` (m, 3). ``at`` becomes their time after ``-start[e]``; with ``cross`` the
    next three columns what is turned, times the axis.
    """
    for e in range(len(begin)):
        ux, uy, uz = axes[e, 0], axes[e, 1], axes[e, 2]
        k0 = begin[e]
        for i in range(first[e], first[e + 1]):
            k = k0 + i - first[e]
            x, y, z = turned[k, 0] - turned[k0, 0], turned[k, 1] - turned[k0, 1], turned[k, 2] - turned[k0, 2]
            at[i] = t[k] + start[e]
            out[i, 0] = x * ux + y * uy + z * uz
            if cross == 1:
                out[i, 1], out[i, 2], out[i, 3] = y * uz - z * uy, z * ux - x * uz, x * uy - y * ux


SUMMED = kernel_of(summed_turning, SUMMED_SIGNATURE, "metrics", "the turning of an attitude", SOURCES)
ABOUT = kernel_of(about_axes, ABOUT_SIGNATURE, "metrics", "the turning in quick movements", SOURCES)
