"""What is wrong with the compass: an offset (iron, current) or a turn (mounting), by attitude and earth's field.

The earth's field ``h`` is the world magnetic model's at the flight's place. Seen by an attitude R the compass shows
``m = T R' h + o``: o moves with the vehicle (hard iron), T turns about the vehicle's vertical (mounting, or an attitude
whose heading is off). Over a turn both are found; without one, a turn keeps the horizontal field's size and an offset
does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Array, FlightLog
from attlog.health.fits.regression import fit
from attlog.health.model import Check, not_judged
from attlog.reference import declination
from attlog.reference.model import Reference
from attlog.segments.model import Segments

OFFSET, TURN = "compass offset", "compass turn"
FEWEST, LEAST_S = 50, 20.0
OFF_UT, FAR_UT = 5.0, 15.0
"""50 and 150 mG, horizontally: by 5 uT the heading swings by 14 deg where the horizontal field is 20 uT."""
SIGMAS, FLOOR_UT, LEVEL = 4.0, 0.3, math.radians(0.8)
"""Told above four sigmas: 1.5 standard errors, 0.3 uT, and 0.8 deg of tilt of the attitude in the vertical field."""
HEADING = math.radians(3.0)
"""Onboard headings of flights with truth are off by 0.3 to 3 deg: the prior of the turn where nothing turns."""
TURNED_DEG, FAR_DEG = 10.0, 20.0
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
SIZE, KEEPS = 0.02, 0.1
"""The horizontal field's size is the model's to 2 % (prior); a turn keeps it to 10 %."""
SAME = 0.4
SIMPLER = 1.5
"""One fault alone explains the field where it leaves at most so many times what both leave (RMS)."""
LIMIT = f"ok up to {OFF_UT:.0f} uT or {SIGMAS:.0f} sigma, fault above {FAR_UT:.0f} uT"
TURN_LIMIT = f"ok up to {TURNED_DEG:.0f} deg, fault above {FAR_DEG:.0f} deg"


@dataclass(frozen=True, slots=True)
class CompassFit:
    """Offset (3,) uT with sigmas, and turn with sigma in deg, of the model that explains the field most simply."""

    offset: Array
    offset_sigma: Array
    turn_deg: float
    turn_sigma: float
    left_ut: float
    samples: int
    seconds: float
    steady: bool = True
    """Whether both halves of the flight tell the same."""
    one_fault: bool = True
    """Whether an offset alone or a turn alone explains the field."""

    def by(self, reference: Reference) -> str:
        """What it was found by, in words."""
        return f"{self.samples} samples in {self.seconds:.0f} s, turned by {reference.source}"

    def doubt(self, reference: Reference) -> str:
        """Why neither offset nor turn is told although the field is off; empty where they are."""
        if not self.one_fault and reference.kind != "truth":
            return "Neither an offset nor a turn alone explains the field: the attitude's heading may be in error."
        return (
            "" if self.steady else "The first half of the flight shows another error than the second: none is constant."
        )


def checks(log: FlightLog, segments: Segments, reference: Reference | None) -> list[Check]:
    """Offset and turn of the compass that is replayed; nothing without one, or where nothing flew."""
    if log.mag is None or not segments.of("airborne"):
        return []
    model = declination.model(log)
    if reference is None or reference.kind == "none" or model is None:
        why = "No attitude in this log can turn the field." if model is not None else "No position, so no earth field."
        return [not_judged(OFFSET, why, LIMIT), not_judged(TURN, why, TURN_LIMIT)]
    found = measured(log, segments, reference)
    if found is None:
        why = f"Fewer than {FEWEST} samples or {LEAST_S:.0f} s of flight have an attitude."
        return [not_judged(OFFSET, why, LIMIT), not_judged(TURN, why, TURN_LIMIT)]
    source = log.mags[log.mag].field.source
    return [_offset(source, found, reference), _turn(source, found, reference)]


def _offset(source: str, found: CompassFit, reference: Reference) -> Check:
    size = float(np.sqrt(np.sum(found.offset**2)))
    level, unsure = float(np.hypot(*found.offset[:2])), float(found.offset_sigma[:2].max())
    told = level > max(OFF_UT, SIGMAS * unsure)
    if not told and SIGMAS * unsure > FAR_UT:
        return not_judged(OFFSET, f"The flight turns too little: the offset is known to {unsure:.0f} uT only.", LIMIT)
    if told and (why := found.doubt(reference)):
        return not_judged(OFFSET, why, LIMIT)
    verdict = "ok" if not told else "warning" if level <= FAR_UT else "fault"
    sizes = ", ".join(f"{v:.0f} ± {1.96 * s:.0f}" for v, s in zip(found.offset, found.offset_sigma, strict=True))
    text = f"{source} is off by {sizes} uT in x, y, z (95 %), {found.by(reference)}."
    return Check(OFFSET, verdict, text, round(size, 1), "uT", LIMIT)


def _turn(source: str, found: CompassFit, reference: Reference) -> Check:
    size = abs(found.turn_deg)
    told = size > max(TURNED_DEG, SIGMAS * found.turn_sigma)
    if not told and SIGMAS * found.turn_sigma > FAR_DEG:
        why = f"The flight turns too little: the turn is known to {found.turn_sigma:.0f} deg only."
        return not_judged(TURN, why, TURN_LIMIT)
    if told and (why := found.doubt(reference)):
        return not_judged(TURN, why, TURN_LIMIT)
    verdict = "ok" if not told else "warning" if size <= FAR_DEG else "fault"
    way = "clockwise" if found.turn_deg > 0 else "anticlockwise"
    text = f"{source} points {size:.0f} ± {1.96 * found.turn_sigma:.0f} deg {way} of the attitude's heading (95 %), "
    text += f"{found.by(reference)}."
    return Check(TURN, verdict, text, round(found.turn_deg, 1), "deg", TURN_LIMIT)


def measured(log: FlightLog, segments: Segments, reference: Reference) -> CompassFit | None:
    """The simplest model that explains the field in flight; None where too little can be compared."""
    model = declination.model(log)
    if log.mag is None or model is None:
        return None
    field = log.mags[log.mag].field
    q, _ = rotation.interpolated(reference.t, reference.q, reference.gap_segment, field.t_best)
    use = rotation.finite(q) & rotation.finite(field.x) & segments.mask(field.t_best, "airborne")
    use &= (field.t_best >= reference.scoring_start) & (field.t_best < reference.end)
    t, m = field.t_best[use], 1e6 * field.x[use]
    seconds = len(t) / max(field.rate, 1e-9)
    if len(t) < FEWEST or seconds < LEAST_S:
        return None
    u = rotation.rotate_inverse(q[use], 1e6 * np.array(model.ned_t))
    found = simplest(t, u, m, seconds)
    middle = len(t) // 2
    halves = [simplest(t[k], u[k], m[k], seconds / 2) for k in (slice(None, middle), slice(middle, None))]
    return None if found is None else replace(found, steady=_agree(found, *halves))


def _agree(found: CompassFit, one: CompassFit | None, two: CompassFit | None) -> bool:
    """Whether the halves differ by at most 40 % or three sigmas of what the whole flight tells."""
    if one is None or two is None:
        return False
    size, apart = float(np.hypot(*found.offset[:2])), float(np.hypot(*(one.offset - two.offset)[:2]))
    unsure = float(np.hypot(one.offset_sigma[:2].max(), two.offset_sigma[:2].max()))
    turned = abs((one.turn_deg - two.turn_deg + 180.0) % 360.0 - 180.0)
    doubt = math.hypot(one.turn_sigma, two.turn_sigma)
    same_turn = turned <= max(SAME * abs(found.turn_deg), 3.0 * doubt)
    return same_turn and apart <= max(SAME * size, 3.0 * unsure)


def simplest(t: Array, u: Array, m: Array, seconds: float) -> CompassFit | None:
    """One fault where it explains the field, else both. ``u``, ``m`` (n, 3) uT: the earth's field and the compass's.

    ``m_x = a u_x + b u_y + o_x`` and ``m_y = a u_y - b u_x + o_y``: a turn by the angle of (a, b).
    """
    along, across = u[:, :2], np.column_stack([u[:, 1], -u[:, 0]])
    unit = np.broadcast_to(np.eye(2), (len(t), 2, 2))
    columns = np.concatenate([np.stack([along, across], axis=2), unit], axis=2)
    target = m[:, :2] - along
    both = fit(t, columns, target, np.array([SIZE, 10.0, np.inf, np.inf]))
    turned = fit(t, columns[:, :, :2], m[:, :2])
    moved = fit(t, columns, target, np.array([SIZE, HEADING, np.inf, np.inf]))
    if both is None or turned is None or moved is None:
        return None
    least = _left(columns, target, both.x)
    level, down = (float(np.median(rotation.length(u[:, :2]))), float(np.median(np.abs(u[:, 2]))))
    alone = _left(columns[:, :, :2], m[:, :2], turned.x)
    one_fault = True
    keeps = abs(math.hypot(*turned.x) - 1.0) < KEEPS
    if keeps and alone <= SIMPLER * least + FLOOR_UT:
        x = np.array([turned.x[0], turned.x[1], 0.0, 0.0])
        sigma = np.array([*turned.sigma, FLOOR_UT, FLOOR_UT])
    elif abs(moved.x[1]) <= 2.0 * HEADING and _left(columns, target, moved.x) <= SIMPLER * least + FLOOR_UT:
        x, sigma = moved.x + IDENTITY, moved.sigma
    else:
        x, sigma, one_fault = both.x + IDENTITY, both.sigma, False
    below = m[:, 2] - u[:, 2]
    offset = np.array([x[2], x[3], float(np.median(below))])
    tilted = np.array([LEVEL * down, LEVEL * down, math.hypot(LEVEL * level, 0.01 * math.hypot(level, down))])
    unsure = np.sqrt(np.array([1.5 * sigma[2], 1.5 * sigma[3], 0.0]) ** 2 + tilted**2 + FLOOR_UT**2)
    turn = math.degrees(math.atan2(x[1], x[0]))
    return CompassFit(
        offset,
        unsure,
        turn,
        math.degrees(math.hypot(1.5 * sigma[1], HEADING)),
        least,
        len(t),
        seconds,
        one_fault=one_fault,
    )


def _left(columns: Array, target: Array, x: Array) -> float:
    """RMS that a model leaves, uT, without its largest twentieth."""
    left = np.sort(np.sum((target - columns @ x) ** 2, axis=1))
    return float(np.sqrt(np.mean(left[: max(1, int(0.95 * len(left)))])))
