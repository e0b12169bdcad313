"""The windows of 5 s of a row in one phase of the flight, and the variances in them: at rest, and in motion."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.kernels.loops import function_of, kernel_of
from attlog.metrics.base import Case, per_row
from attlog.metrics.evidence.phases import phase_spans
from attlog.metrics.noise import injection, windows
from attlog.metrics.noise.injection import DEG, relative, vector
from attlog.reference.model import Row
from attlog.segments.spans import Span

Array = NDArray[np.float64]
Index = NDArray[np.int64]


AXES = ("roll", "pitch", "heading", "tilt")
UNSETTLED, MIN_LATER = 4.0, 3
"""Leading windows of a rest with more than this times the median variance of all later ones (at least 3) settle."""


TURN = 2.0 * math.pi
SOURCES = ("metrics/noise/variances.py", "metrics/noise/injection.py", "kernels")


AT_REST_SIGNATURE = "void(f8[:, ::1], (f8[::1]), (f8[:, ::1]), (f8[:, ::1]), (f8[::1]), (i8[::1]))"


def left_at_rest(out: Array, t: Array, q: Array, centre: Array, yaw: Array, edges: Index) -> None:
    """Fill ``out`` (n, 3) with what attitudes ``q`` (n, 4) at ``t`` (n,) turn in deg away from their window's line.

    Window k has the samples ``edges[k]`` to ``edges[k + 1]``, ``centre[k]`` is their mean attitude, ``yaw[k]`` its
    heading. The rotation from the mean: about the level roll and pitch axis and the vertical, unwrapped.
    """
    for k in range(len(yaw)):
        a, b = edges[k], edges[k + 1]
        cosine, sine = DEG * math.cos(yaw[k]), DEG * math.sin(yaw[k])
        before, middle = 0.0, 0.0
        for i in range(a, b):
            w, x, y, z = relative(q, i, centre, k)
            heading = 2.0 * math.atan2(z, w)
            heading += TURN * np.floor((before - heading) / TURN + 0.5)  # the whole turns of the sample before
            before = heading
            x, y, _ = vector(w, x, y, z)
            out[i, 0], out[i, 1], out[i, 2] = x * cosine + y * sine, y * cosine - x * sine, DEG * heading
            middle += (t[i] - t[a]) / (b - a)
        for c in range(3):
            mean = 0.0
            for i in range(a, b):
                mean += out[i, c] / (b - a)
            along, size = 0.0, 0.0
            for i in range(a, b):
                u = t[i] - t[a] - middle
                along, size = along + u * (out[i, c] - mean), size + u * u
            for i in range(a, b):
                out[i, c] -= mean + along / size * (t[i] - t[a] - middle)


AT_REST = kernel_of(left_at_rest, AT_REST_SIGNATURE, "metrics", "the noise at rest", SOURCES)


@dataclass(frozen=True, slots=True)
class PhaseVariances:
    """The windows of a row in one phase: they begin at ``t0`` (k,) s.

    ``variances`` (k, 4) deg^2 about AXES, ``seconds`` together, ``p2p`` (3,) deg the middle
    99.8 % of the residuals, ``settled_s`` how long after its start a row still settled at rest, if it did.
    """

    t0: Array
    variances: Array
    seconds: float
    p2p: Array
    settled_s: float | None


@dataclass(frozen=True, slots=True)
class SpanVariances:
    """What :class:`Measured` has of one span: the residuals (n, 3) in deg of its windows, their lengths (k) in s."""

    t0: Array
    variances: Array
    residuals: Array
    lengths: list[float]
    settled_s: float | None


def variance(residual: Array) -> Array:
    """Variances (4,) about roll, pitch, heading and (the mean of the first two) tilt of residuals (n, 3)."""
    v = np.sum(residual**2, axis=0) / (len(residual) - 2)
    return np.array([v[0], v[1], v[2], 0.5 * (v[0] + v[1])])


def unsettled(variances: Array) -> int:
    """How many leading windows of a rest settle: variances (k, 4), tilt or heading above 4 x the later median."""
    for k in range(len(variances) - MIN_LATER):
        later = np.median(variances[k + 1 :, 2:], axis=0)
        if not (variances[k, 2:] > UNSETTLED * later).any():
            return k
    return max(0, len(variances) - MIN_LATER)


def measured(case: Case, row: Row, phase: str, window: str) -> PhaseVariances | None:
    """The windows of a row in a phase and their variances; None without a usable window."""
    return _in_spans(case, row, phase, phase_spans(case, phase, window))


@per_row
def _in_spans(case: Case, row: Row, phase: str, spans: list[Span]) -> PhaseVariances | None:
    known = _known(case, row, phase)
    new = [span for span in spans if span not in known]
    known |= zip(new, _of_spans(case, row, phase, new), strict=True)
    parts = [part for span in spans if (part := known[span]) is not None]
    if not parts:
        return None
    columns = np.concatenate([part.residuals for part in parts]).T
    reach = np.array([np.quantile(x, 0.999) - np.quantile(x, 0.001) for x in columns])
    t0, variances = (np.concatenate([getattr(part, name) for part in parts]) for name in ("t0", "variances"))
    settled = [part.settled_s for part in parts if part.settled_s is not None]
    seconds = sum((length for part in parts for length in part.lengths), 0.0)
    return PhaseVariances(t0, variances, seconds, reach, settled[-1] if settled else None)


@per_row
def _known(case: Case, row: Row, phase: str) -> dict[Span, SpanVariances | None]:
    """What was found in spans of a phase: the same wherever they are asked for."""
    return {}


def _of_spans(case: Case, row: Row, phase: str, spans: list[Span]) -> list[SpanVariances | None]:
    """What is in each of some spans: the windows of all of them are looked at together."""
    laid = [windows.of_span(case, row, phase, span) for span in spans]
    inside = [samples for own in laid for _, samples in own]
    left = iter(residuals_at_rest(row, inside) if phase == "rest" else injection.of_windows(case, row, inside))
    return [_part(row, phase, [(w, r) for w, _ in own if (r := next(left)) is not None]) for own in laid]


def residuals_at_rest(row: Row, inside: list[slice]) -> Iterator[Array]:
    """The residuals (n, 3) in deg of windows at rest: away from their mean attitude, without the straight line."""
    for _, at, edges in windows.together(inside):
        q, out = np.ascontiguousarray(row.q[at], np.float64), np.empty((len(at), 3))
        centre = rotation.means(q, edges)
        yaw = np.ascontiguousarray(rotation.to_euler(centre)[:, 2])
        function_of(AT_REST, left_at_rest)(out, row.t[at], q, centre, yaw, edges)
        yield from np.split(out, edges[1:-1])


def _part(row: Row, phase: str, windows: list[tuple[Span, Array]]) -> SpanVariances | None:
    """The windows of a span, with their residuals, without those in which the row settles."""
    found = [(window, variance(residual), residual) for window, residual in windows]
    skip = unsettled(np.array([v for _, v, _ in found])) if phase == "rest" and len(found) > MIN_LATER else 0
    kept = found[skip:]
    if not kept:
        return None
    return SpanVariances(
        np.array([w[0] for w, _, _ in kept]),
        np.array([v for _, v, _ in kept]),
        np.concatenate([r for _, _, r in kept]),
        [w[1] - w[0] for w, _, _ in kept],
        kept[0][0][0] - row.start if skip else None,
    )
