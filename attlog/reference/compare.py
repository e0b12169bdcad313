"""Errors of an attitude against the reference, at the times of the slower one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog import rotation
from attlog.reference import scoring
from attlog.reference.model import Errors, Reference
from attlog.segments import gaps

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CHUNK = 1 << 13
"""Attitudes per pass: temporaries stay in the processor's cache and cost long logs no memory."""

SAME_RATE = 1.05
"""Rates this close count as equal; then the row's own times are used."""


def interpolate(t: Array, q: Array, segment: Index, at: Array) -> tuple[Array, Index]:
    """Attitudes (m, 4) at times ``at`` and the segment each lies in; NaN and -1 where that would cross a segment's end.

    ``t`` (n,) ascending, ``q`` (n, 4), ``segment`` (n,). Along the shortest arc, so
    between two samples of one segment only: never across a gap or a reset.
    """
    out, where = np.full((len(at), 4), np.nan), np.full(len(at), -1, np.int64)
    if len(t) == 0:
        return out, where
    for a in range(0, len(at), CHUNK):
        block = slice(a, a + CHUNK)
        out[block], where[block] = _interpolated(t, q, segment, at[block])
    return out, where


def _interpolated(t: Array, q: Array, segment: Index, at: Array) -> tuple[Array, Index]:
    """``interpolate`` for one block of times."""
    i = np.searchsorted(t, at, side="right") - 1
    j = np.clip(i, 0, len(t) - 1)
    k = np.minimum(j + 1, len(t) - 1)
    on_sample = (i >= 0) & (at == t[j])
    between = (i >= 0) & (i < len(t) - 1) & (segment[j] == segment[k])
    valid = (on_sample | between) & np.isfinite(at)
    span = np.where(t[k] > t[j], t[k] - t[j], 1.0)
    share = np.where(between & ~on_sample, (at - t[j]) / span, 0.0)[:, None]
    step = rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[j]), q[k]))
    turned = rotation.multiply(q[j], rotation.from_rotvec(share * np.where(share > 0, step, 0.0)))
    return np.where(valid[:, None], turned, np.nan), np.where(valid, segment[j], -1)


def errors(t: Array, q: Array, gap_segment: Index, reference: Reference) -> Errors:
    """Errors of the attitudes (n, 4) at ``t`` against the reference.

    At the reference's times where the row is faster, at the row's where it is not:
    a slow reference is never drawn out to a fast row's times. Times at which either
    would have to be guessed across a gap, restart or reset are left out.
    """
    own = gaps.renumber(gaps.number(t), gap_segment)
    if gaps.rate(t) > SAME_RATE * reference.rate:
        at, q_ref = reference.t, reference.q
        q_est, mine = interpolate(t, q, own, at)
        where = np.arange(len(at))
    else:
        at, q_est, mine = t, q, own
        q_ref, _ = interpolate(reference.t, reference.q, reference.segment, at)
        where = np.clip(np.searchsorted(reference.t, at, side="right") - 1, 0, max(len(reference.t) - 1, 0))
    good = rotation.finite(q_est) & rotation.finite(q_ref)
    at, q_est, q_ref = gaps.only(good, at, q_est, q_ref)
    mine, where = gaps.only(good, mine, where)
    gap_segment, segment = (
        gaps.renumber(mine, reference.gap_segment[where]),
        gaps.renumber(mine, reference.segment[where]),
    )
    return measured(at, q_est, q_ref, gap_segment, segment, scoring.scored(reference, at))


def measured(
    t: Array, q_est: Array, q_ref: Array, gap_segment: Index, segment: Index, scored: NDArray[np.bool_]
) -> Errors:
    """The errors between attitudes at common times (docs/metrics.md)."""
    total, heading, inclination = angles = np.empty((3, len(t)))
    for a in range(0, len(t), CHUNK):
        e = rotation.error(q_est[a : a + CHUNK], q_ref[a : a + CHUNK])
        measures = (rotation.total_angle(e), rotation.heading_angle(e), rotation.inclination_angle(e))
        angles[:, a : a + CHUNK] = np.degrees(measures)
    return Errors(t, total, heading, inclination, gap_segment, segment, scored, q_est, q_ref)
