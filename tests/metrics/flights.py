"""Small made-up flights for the metric tests: attitudes whose errors are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Firmware, FlightLog
from attlog.metrics.base import Case
from attlog.reference.model import AttitudeErrors, Reference, Row
from attlog.segments.model import Segment, Segments

Array = NDArray[np.float64]


def row(t: Array, q: Array, name: str = "filter", **fields: object) -> Row:
    """A replayed row at ``t`` in one run."""
    return Row(name, "replay", t, q, np.zeros(len(t), np.int64), uses_mag=True, **fields)  # type: ignore[arg-type]


def case(
    rows: list[Row],
    segments: list[Segment],
    reference: tuple[Array, Array] | None = None,
    kind: str = "truth",
    scoring_start: float = 0.0,
) -> Case:
    """A case around rows; errors against the reference (t, q) at the reference's times, where there is one."""
    log = FlightLog(Path("made-up.ulg"), "ulog", 0, 0, Firmware("PX4"), "quad")
    t, q = reference if reference is not None else (np.zeros(0), np.zeros((0, 4)))
    zeros = np.zeros(len(t), np.int64)
    ref = Reference(
        kind if len(t) else "none",
        "made-up",
        t,
        q,
        zeros,
        zeros,  # type: ignore[arg-type]
        rate=(len(t) - 1) / (t[-1] - t[0]) if len(t) else 0.0,
        scoring_start=scoring_start,
    )
    if len(t):
        for r in rows:
            r.errors = errors(r, ref)
    return Case(log, Segments(segments), ref, rows)


def errors(r: Row, ref: Reference) -> AttitudeErrors:
    """Errors of a row at the reference's times."""
    inside = (ref.t >= r.t[0]) & (ref.t <= r.t[-1])
    t, q_ref = ref.t[inside], ref.q[inside]
    q_est = rotation.slerp(r.t, r.q, t)
    e = rotation.error(q_est, q_ref)
    return AttitudeErrors(
        t,
        np.degrees(rotation.total_angle(e)),
        np.degrees(rotation.heading_angle(e)),
        np.degrees(rotation.inclination_angle(e)),
        ref.gap_segment[inside],
        ref.segment[inside],
        t >= ref.scoring_start,
        q_est,
        q_ref,
    )


def first_order(x: Array, dt: float, time_constant: float) -> Array:
    """A signal (n,) through a first-order low-pass (exact for a held input)."""
    a = np.exp(-dt / time_constant)
    out = np.empty_like(x)
    state = x[0]
    for i, value in enumerate(x):
        state = a * state + (1 - a) * value
        out[i] = state
    return out


def coloured(rng: np.random.Generator, n: int, dt: float, sigma: float, time_constant: float) -> Array:
    """Stationary Gauss-Markov noise (n,) with standard deviation sigma; white for a time constant of 0."""
    white = rng.standard_normal(n) * sigma
    if time_constant == 0:
        return white
    a = np.exp(-dt / time_constant)
    out = np.empty(n)
    out[0] = white[0]
    drive = white * np.sqrt(1 - a * a)
    for i in range(1, n):
        out[i] = a * out[i - 1] + drive[i]
    return out
