"""Heading offset: what a heading without a north of its own is allowed before it is compared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.reference import scoring
from attlog.reference.compare import measured
from attlog.reference.model import AlignmentStep, Reference, Row
from attlog.segments import Segments, gaps, spans

Array = NDArray[np.float64]

FIRST_S = 10.0
LEAST_REST_S = 5.0


def remove(row: Row, segments: Segments, reference: Reference) -> None:
    """Turn a row so that its heading starts with the reference's, and tell it in its steps.

    The mean difference over the scored part of the first long rest of each segment (else
    its first 10 s of scoring) is taken out of ``q`` and the errors. Where the reference itself
    jumps, the errors go on as if it had not: its reset is no drift of this row.
    """
    errors = row.errors
    assert errors is not None
    along = rotation.unwrap(np.radians(errors.heading))
    jumps = scoring.reset_steps(errors, along)
    smooth = along - np.cumsum(jumps)
    numbers, place = np.unique(row.segment, return_inverse=True)
    own = place[np.clip(np.searchsorted(row.t, errors.t, side="right") - 1, 0, len(row.t) - 1)]
    offset, sources = np.zeros(len(numbers)), []
    for part in gaps.slices(np.ones(len(own), bool), own):
        offset[own[part.start]], source = _first_mean(errors.t[part], smooth[part], errors.scored[part], segments)
        sources.append(source)
    turned = rotation.turn_about_down(errors.q_est, -(offset[own] + np.cumsum(jumps)))
    row.errors = measured(errors.t, turned, errors.q_ref, errors.gap_segment, errors.segment, errors.scored)
    row.q = rotation.turn_about_down(row.q, -offset[place])
    row.heading_offset_deg = float(np.degrees(rotation.wrap(offset[own[0]])))
    text = f"mean heading difference over {sources[0]}, removed"
    text += "; the reference has no north of its own" if reference.heading_by == "nobody" else ""
    text += f" in each of {len(sources)} segments" if len(sources) > 1 else ""
    resets = int(np.count_nonzero(jumps))
    text += f"; {resets} resets of the reference not counted" if resets else ""
    row.steps.append(AlignmentStep("heading_offset", text, row.heading_offset_deg, "deg", reference.source))


def _first_mean(t: Array, along: Array, scored: NDArray[np.bool_], segments: Segments) -> tuple[float, str]:
    """Mean of the unwrapped heading error (n,) rad over a segment's first long rest, else its first 10 s of scoring."""
    counted = scored if scored.any() else np.ones(len(t), bool)
    for rest in segments.of("rest.long"):
        inside = spans.between(t, rest.t0, rest.t1)
        during = inside.start + np.flatnonzero(counted[inside])
        if len(during) and np.ptp(t[during]) >= LEAST_REST_S:
            return float(np.mean(along[during])), f"the rest from {t[during][0]:.0f} s"
    start = t[counted][0]
    return float(np.mean(along[counted & (t <= start + FIRST_S)])), f"{FIRST_S:.0f} s from {start:.0f} s"
