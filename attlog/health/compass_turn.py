"""Offset and turn of the compass in use by the reference's heading.

Fallback where motion alone gives no heading. Model ``m = T R' h + o``: R attitude, h the earth's field by the world
magnetic model, o hard-iron offset in body axes, T rotation about the body's vertical (mounting or heading error). Turns
of the vehicle separate both; without turns, T keeps the horizontal field strength and o does not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from attlog.core import rotation
from attlog.core.sorting import median
from attlog.flight.model import Array, FlightLog
from attlog.health.check import Check, HealthCase, graded, unknown
from attlog.health.regression import robust_fit
from attlog.reference import alignment
from attlog.reference.model import Reference
from attlog.segments.model import Segments

# Minimum samples and time for a standard error: four blocks of 5 s at 2.5 Hz.
MIN_SAMPLES, MIN_FLIGHT_S = 50, 20.0
# Limits of the horizontal offset: 5 uT (50 mG) is a heading error of 14 deg in a horizontal field of 20 uT.
OFFSET_OFF_UT, OFFSET_FAR_UT = 5.0, 15.0
# Significance: 4 sigma, with sigma from 1.5 standard errors, 0.3 uT, and 0.8 deg of tilt in the vertical field.
SIGMAS, STANDARD_ERRORS, FLOOR_UT, TILT_RAD = 4.0, 1.5, 0.3, math.radians(0.8)
# Relative error of the model's field strength.
MODEL_SIZE_ERROR = 0.01
# Prior sigma of the turn without vehicle turns: onboard headings differ from truth by 0.3 to 3 deg.
HEADING_PRIOR_RAD = math.radians(3.0)
# Limits of the turn: twice a coarse mounting error, and half of the smallest orientation step (45 deg).
TURN_OFF_DEG, TURN_FAR_DEG = 10.0, 20.0
# Prior sigma of the horizontal field strength, and its maximum relative change by a pure turn.
SCALE_PRIOR, SIZE_KEPT = 0.02, 0.1
# Tolerance between both halves of the flight: 40 % of the error or 3 sigma.
HALVES_SHARE, HALVES_SIGMAS = 0.4, 3.0
# Maximum RMS residual of a single cause relative to that of both.
SIMPLER_RATIO = 1.5
NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])
OFFSET_LIMIT = f"ok up to {OFFSET_OFF_UT:.0f} uT or {SIGMAS:.0f} sigma, fault above {OFFSET_FAR_UT:.0f} uT"
TURN_LIMIT = f"ok up to {TURN_OFF_DEG:.0f} deg, fault above {TURN_FAR_DEG:.0f} deg"


class TurnFit(NamedTuple):
    """Offset (3,) uT and clockwise turn of a compass by the simplest model that fits.

    ``left_ut``: residual RMS. ``steady``: both halves of the flight agree, or the fit is small; ``one_fault``: an
    offset or a turn alone explains the field.
    """

    offset: Array
    offset_sigma: Array
    turn_deg: float
    turn_sigma: float
    left_ut: float
    samples: int
    seconds: float
    steady: bool = True
    one_fault: bool = True

    @property
    def is_large(self) -> bool:
        """Return whether offset or turn is above its limit and its error."""
        level, unsure = np.hypot(*self.offset[:2]), self.offset_sigma[:2].max()
        turned = abs(self.turn_deg) > max(TURN_OFF_DEG, SIGMAS * self.turn_sigma)
        return bool(turned or level > max(OFFSET_OFF_UT, SIGMAS * unsure))

    def reason_unsure(self, reference: Reference) -> str:
        """Return why the fit is not reliable; empty where it is."""
        if not self.one_fault and reference.kind != "truth":
            return "Neither an offset nor a turn alone explains the field: the attitude's heading may be in error."
        if not self.steady:
            return "The first half of the flight shows another error than the second: none is constant."
        return ""


def turn_checks(case: HealthCase) -> list[Check]:
    """Check offset and turn of the compass in use by the reference's heading, else the onboard one."""
    log = case.log
    if log.mag is None or not case.segments.of("airborne"):
        return []
    model, reference, source = alignment.earth_field(log), heading_reference(case), log.mags[log.mag].field.source
    found = None
    if reference is None or reference.kind == "none" or model is None:
        why = "No attitude in this log can turn the field." if model is not None else "No position, so no earth field."
    else:
        found = fit_turn(log, case.segments, reference)
        why = f"Fewer than {MIN_SAMPLES} samples or {MIN_FLIGHT_S:.0f} s of flight have an attitude."
    if reference is None or found is None:
        checks = [unknown("compass_offset", why, OFFSET_LIMIT), unknown("compass_turn", why, TURN_LIMIT)]
    else:
        checks = fit_checks(source, found, reference)
    for check in checks:
        check.sensor, check.about = source, "attitude"
    return checks


def heading_reference(case: HealthCase) -> Reference | None:
    """Return truth or smoother with its own heading, else a sound onboard attitude."""
    own = case.reference is not None and case.reference.heading.by == "own"
    found = case.reference if own else case.rates
    return found if found is None or found.heading.by == "own" else None


def fit_checks(source: str, found: TurnFit, reference: Reference) -> list[Check]:
    """Check the horizontal offset of a compass, and its turn about the vertical."""
    level, unsure = float(np.hypot(*found.offset[:2])), float(found.offset_sigma[:2].max())
    sizes = ", ".join(f"{v:.0f} ± {1.96 * s:.0f}" for v, s in zip(found.offset, found.offset_sigma, strict=True))
    text = f"{source} is off by {sizes} uT in x, y, z (95 %)"
    made = Check("compass_offset", "ok", text, round(float(np.linalg.norm(found.offset)), 1), "uT", OFFSET_LIMIT)
    offset = _graded_fit(made, "offset", level, unsure, (OFFSET_OFF_UT, OFFSET_FAR_UT), found, reference)
    size, way = abs(found.turn_deg), "clockwise" if found.turn_deg > 0 else "anticlockwise"
    text = f"{source} points {size:.0f} ± {1.96 * found.turn_sigma:.0f} deg {way} of the attitude's heading (95 %)"
    made = Check("compass_turn", "ok", text, round(found.turn_deg, 1), "deg", TURN_LIMIT)
    return [offset, _graded_fit(made, "turn", size, found.turn_sigma, (TURN_OFF_DEG, TURN_FAR_DEG), found, reference)]


def _graded_fit(
    made: Check, what: str, size: float, sigma: float, limits: tuple[float, float], found: TurnFit, reference: Reference
) -> Check:
    """Return a check with its verdict, ``unknown`` for a size that the flight does not show reliably."""
    made.verdict = graded(size, max(limits[0], SIGMAS * sigma), limits[1])
    made.text = f"{made.text}, {found.samples} samples in {found.seconds:.0f} s, turned by {reference.source}."
    why = found.reason_unsure(reference) if made.is_trouble else ""
    if not made.is_trouble and SIGMAS * sigma > limits[1]:
        why = f"The flight turns too little: the {what} is known to {sigma:.0f} {made.unit} only."
    return unknown(made.question, why, made.threshold) if why else made


def fit_turn(log: FlightLog, segments: Segments, reference: Reference) -> TurnFit | None:
    """Fit offset and turn to the field in flight; None with too few samples."""
    model = alignment.earth_field(log)
    if log.mag is None or model is None:
        return None
    field = log.mags[log.mag].field
    q, _ = rotation.slerp_in_segments(reference.t, reference.q, reference.gap_segment, field.t_best)
    use = rotation.finite_rows(q) & rotation.finite_rows(field.x) & segments.mask(field.t_best, "airborne")
    use &= (field.t_best >= reference.scoring.start) & (field.t_best < reference.scoring.end)
    t, m = field.t_best[use], 1e6 * field.x[use]
    seconds = len(t) / max(field.rate, 1e-9)
    if len(t) < MIN_SAMPLES or seconds < MIN_FLIGHT_S:
        return None
    u = rotation.rotate_inverse(q[use], 1e6 * np.array(model.ned_t))
    found = fit_simplest(t, u, m, seconds)
    if found is None or not found.is_large:
        return found
    middle = len(t) // 2
    halves = [fit_simplest(t[k], u[k], m[k], seconds / 2) for k in (slice(None, middle), slice(middle, None))]
    return found._replace(steady=_halves_agree(found, *halves))


def _halves_agree(found: TurnFit, one: TurnFit | None, two: TurnFit | None) -> bool:
    if one is None or two is None:
        return False
    apart = float(np.hypot(*(one.offset - two.offset)[:2]))
    unsure = math.hypot(one.offset_sigma[:2].max(), two.offset_sigma[:2].max())
    turned = abs((one.turn_deg - two.turn_deg + 180.0) % 360.0 - 180.0)
    turn_unsure = math.hypot(one.turn_sigma, two.turn_sigma)
    same_turn = turned <= max(HALVES_SHARE * abs(found.turn_deg), HALVES_SIGMAS * turn_unsure)
    level = float(np.hypot(*found.offset[:2]))
    return same_turn and apart <= max(HALVES_SHARE * level, HALVES_SIGMAS * unsure)


def fit_simplest(t: Array, u: Array, m: Array, seconds: float) -> TurnFit | None:
    """Fit a turn or an offset alone where it explains the field, else both.

    ``u``, ``m`` (n, 3) uT: the earth's field in body axes and the compass's. ``m_x = a u_x + b u_y + o_x`` and
    ``m_y = a u_y - b u_x + o_y``; the angle of (a, b) is the turn.
    """
    along, across = u[:, :2], np.column_stack([u[:, 1], -u[:, 0]])
    columns = np.concatenate([np.stack([along, across], axis=2), np.broadcast_to(np.eye(2), (len(t), 2, 2))], axis=2)
    target = m[:, :2] - along
    both = robust_fit(t, columns, target, np.array([SCALE_PRIOR, 10.0, np.inf, np.inf]))
    turned = robust_fit(t, columns[:, :, :2], m[:, :2])
    moved = robust_fit(t, columns, target, np.array([SCALE_PRIOR, HEADING_PRIOR_RAD, np.inf, np.inf]))
    if both is None or turned is None or moved is None:
        return None
    least = _rms_left(columns, target, both.x)
    enough = SIMPLER_RATIO * least + FLOOR_UT
    keeps_size = abs(math.hypot(*turned.x) - 1.0) < SIZE_KEPT
    one_fault = True
    if keeps_size and _rms_left(columns[:, :, :2], m[:, :2], turned.x) <= enough:
        x = np.array([turned.x[0], turned.x[1], 0.0, 0.0])
        sigma = np.array([*turned.sigma, FLOOR_UT, FLOOR_UT])
    elif abs(moved.x[1]) <= 2.0 * HEADING_PRIOR_RAD and _rms_left(columns, target, moved.x) <= enough:
        x, sigma = moved.x + NO_TURN, moved.sigma
    else:
        x, sigma, one_fault = both.x + NO_TURN, both.sigma, False
    level, down = float(median(rotation.length(along))), float(median(np.abs(u[:, 2])))
    offset = np.array([x[2], x[3], float(median(m[:, 2] - u[:, 2]))])
    tilted = TILT_RAD * down
    vertical = math.hypot(TILT_RAD * level, MODEL_SIZE_ERROR * math.hypot(level, down))
    fitted = STANDARD_ERRORS * np.array([sigma[2], sigma[3], 0.0])
    unsure = np.sqrt(fitted**2 + np.array([tilted, tilted, vertical]) ** 2 + FLOOR_UT**2)
    turn, turn_sigma = math.atan2(x[1], x[0]), math.hypot(STANDARD_ERRORS * sigma[1], HEADING_PRIOR_RAD)
    degrees = math.degrees(turn), math.degrees(turn_sigma)
    return TurnFit(offset, unsure, *degrees, least, len(t), seconds, one_fault=one_fault)


def _rms_left(columns: Array, target: Array, x: Array) -> float:
    """Return the RMS residual in uT of a model without the largest 5 %."""
    left = np.sort(np.sum((target - columns @ x) ** 2, axis=1))
    return float(np.sqrt(np.mean(left[: max(1, int(0.95 * len(left)))])))
