"""Errors of an attitude against the reference, at the times of the slower one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.reference import scoring
from attlog.reference.model import AttitudeErrors, Reference, ReferenceSamples
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
    out, before = rotation.interpolated(t, q, segment, at)
    return out, np.where(before >= 0, segment[before], -1) if len(t) else before


def errors(t: Array, q: Array, gap_segment: Index, reference: Reference) -> AttitudeErrors:
    """Errors of the attitudes (n, 4) at ``t`` against the reference.

    At the reference's times where the row is faster, at the row's where it is not:
    a slow reference is never drawn out to a fast row's times. Times at which either
    would have to be guessed across a gap, restart or reset are left out.
    """
    before = reference.met
    if before is not None and before.of is t and before.own is reference.q:
        number, faster = before.number, before.faster
    else:
        before, number, faster = None, gaps.number(t), gaps.rate(t) > SAME_RATE * reference.rate
    own = gaps.renumber(number, gap_segment)
    q_est, mine = interpolate(t, q, own, reference.t) if faster else (q, own)
    has = rotation.finite(q_est)
    if before is not None and np.array_equal(before.good, before.known & has):
        met = before
    else:
        met = reference.met = _met(reference, t, number, faster, has)
    (q_est,), (mine,) = gaps.only(met.good, q_est), gaps.only(met.good, mine)
    gap_segment, segment = (gaps.renumber(mine, x[met.where]) for x in (reference.gap_segment, reference.segment))
    return measured(met.t, q_est, met.q, gap_segment, segment, scoring.scored(reference, met.t))


def _met(reference: Reference, t: Array, number: Index, faster: bool, has: NDArray[np.bool_]) -> ReferenceSamples:
    """The reference at the times (k,) of the slower one, where a row at ``t`` (n,) ``has`` (k,) an attitude."""
    if faster:
        at, q, where = reference.t, reference.q, np.arange(len(reference.t))
    else:
        at, (q, _) = t, interpolate(reference.t, reference.q, reference.segment, t)
        where = np.clip(np.searchsorted(reference.t, at, side="right") - 1, 0, max(len(reference.t) - 1, 0))
    known = rotation.finite(q)
    good = known & has
    (at, q), (where,) = gaps.only(good, at, q), gaps.only(good, where)
    return ReferenceSamples(reference.q, t, number, faster, known, good, at, q, where)


def measured(
    t: Array, q_est: Array, q_ref: Array, gap_segment: Index, segment: Index, scored: NDArray[np.bool_]
) -> AttitudeErrors:
    """The errors between attitudes (n, 4), body to earth, at common times ``t`` (n,) s (docs/metrics.md).

    ``gap_segment``, ``segment`` and ``scored`` (n,) are kept beside them; errors are angles (n,) in deg.
    """
    total, heading, inclination = angles = np.empty((3, len(t)))
    for a in range(0, len(t), CHUNK):
        e = rotation.error(q_est[a : a + CHUNK], q_ref[a : a + CHUNK])
        measures = (rotation.total_angle(e), rotation.heading_angle(e), rotation.inclination_angle(e))
        angles[:, a : a + CHUNK] = np.degrees(measures)
    return AttitudeErrors(t, total, heading, inclination, gap_segment, segment, scored, q_est, q_ref)
