"""Does the compass show the earth's field? Its three axes against what the attitude lets expect, before and after."""

from __future__ import annotations

import math

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Array, Mag
from attlog.health.assessments.model import Assessment, HealthCase
from attlog.health.figures.samples import broken, chosen, end_of
from attlog.metrics.figures.trace import Trace
from attlog.reference import declination
from attlog.segments.spans import inside

AXES = ("x", "y", "z")
SURE = math.radians(5.0)
"""The attitude by motion alone has a heading worth drawing up to this sigma."""
UNITS = {"uT": 1.0, "mG": 0.1}
"""Of an offset, in uT."""
MOVES_M_S2, MOVES_S = 0.25, 30
"""What carries that heading is GNSS acceleration: standing still it was 85 to 132 deg wrong at a claimed 1.8 to 5."""
FEWEST = 10


def field(case: HealthCase, found: list[Assessment]) -> list[Trace]:
    """The field of the compass in use over the flight; nothing without a place, an attitude or samples."""
    log = case.log
    model = declination.model(log)
    if log.mag is None or model is None:
        return []
    mag = log.mags[log.mag]
    t, measured = mag.field.t_best, 1e6 * mag.field.x
    turned, by_motion = _attitude(case, t)
    use = rotation.finite(turned) & rotation.finite(measured) & (t < end_of(case.segments))
    kept = chosen(t, use)
    if len(kept) < FEWEST:
        return []
    expected = rotation.rotate_inverse(turned[kept], 1e6 * np.array(model.ned_t))
    offset = offered(mag, found)
    corrected = None if offset is None else measured[kept] - offset
    return [of_arrays(mag.field.source, t[kept], measured[kept], expected, corrected, by_motion)]


def of_arrays(
    compass: str, t: Array, measured: Array, expected: Array, corrected: Array | None, by_motion: bool
) -> Trace:
    """The trace of fields (n, 3) uT in body axes at ``t`` (n,) s; ``corrected`` None where nothing is offered."""
    parts = {"": measured, "expected_": expected} | ({} if corrected is None else {"corrected_": corrected})
    columns = {
        f"{name}{axis}": column
        for name, part in parts.items()
        for axis, column in zip(AXES, broken(t, part).T, strict=True)
    }
    return Trace("compass", "", t, columns, compass, values={"by_motion": float(by_motion)})


def offered(mag: Mag, found: list[Assessment]) -> Array | None:
    """The offset (3,) uT of a compass for which there is something to set, None where there is nothing."""
    for one in found:
        own = one.question == "compass_offset" and one.sensor == mag.field.source
        if own and one.settings and len(one.vector) == 3 and one.unit in UNITS:
            return UNITS[one.unit] * np.array(one.vector)
    return None


def moves(case: HealthCase) -> bool:
    """Whether the vehicle accelerates enough in flight for a heading by motion: horizontally, in 1 s differences."""
    spans = [] if case.segments is None else case.segments.spans("airborne")
    for receiver in case.log.gnss:
        use = rotation.finite(receiver.vel_ned[:, :2]) & inside(receiver.t, spans)
        t, level = receiver.t[use], receiver.vel_ned[use, :2]
        first = np.unique(np.floor(t), return_index=True)[1]
        step, change = np.diff(t[first]), np.diff(level[first], axis=0)
        change = change[step < 1.5]  # not across a hole
        if len(change) >= MOVES_S:
            return float(np.sqrt(np.mean(np.sum(change**2, axis=1)))) >= MOVES_M_S2
    return False


def _attitude(case: HealthCase, t: Array) -> tuple[Array, bool]:
    """Attitudes (n, 4) at ``t`` (n,) s, NaN where there is none, and whether their heading is that of motion alone."""
    motion, reference = case.motion, case.reference
    if motion is not None and len(motion.t):
        aloft = inside(motion.t, [] if case.segments is None else case.segments.spans("airborne"))
        if aloft.any() and float(np.median(motion.sigma_heading[aloft])) <= SURE and moves(case):
            return rotation.interpolated(motion.t, motion.q, motion.segment, t)[0], True
    onboard = case.log.onboard_attitude
    if reference is None and onboard is not None:  # a log that is not replayed: nothing else was looked for
        return rotation.interpolated(onboard.t, onboard.q, None, t)[0], False
    if reference is None or reference.kind == "none" or reference.heading_by == "nobody" or len(reference.t) == 0:
        return np.full((len(t), 4), np.nan), False
    return rotation.interpolated(reference.t, reference.q, reference.gap_segment, t)[0], False
