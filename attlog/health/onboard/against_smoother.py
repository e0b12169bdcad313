"""Is the onboard attitude the wrong one? Its difference from the truth, or from the smoother in degrees and sigmas.

Where it differs, and what gravity and GNSS acceleration say of it, stands in ``reference.physics.accusing``. A smoother
whose own sensors failed a check accuses nobody, unless that evidence speaks against the onboard attitude too.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Array, FlightLog
from attlog.health.model import Check, not_judged
from attlog.reference.compare import interpolate
from attlog.reference.model import Reference
from attlog.reference.physics import accusing
from attlog.reference.physics.accusing import OnboardComparison, OnboardError
from attlog.segments.model import Segments

NAME, TRUTH = "onboard against smoother", "onboard against truth"
NAMES = {"smoother": NAME, "truth": TRUTH}
"""By what the reference is."""
MOUNTED = 0.3
"""What is left of a tilt error that a turn of the sensor explains, at most."""
LIMIT = "ok up to 3 deg of tilt and 8 deg of heading"
LIMITS = {"smoother": f"{LIMIT}, or 3 joint sigmas", "truth": LIMIT}
FORCE = ("accelerometer axes", "accelerometer delay", "force axes", "frozen sensors")
"""Checks of the accelerometer, which the evidence of gravity and of GNSS acceleration needs."""
INERTIAL = (
    *FORCE,
    *("gyro", "gyro range", "gyro bias", "frozen gyro", "gyro spikes", "gyro bias step", "gyro scale"),
    *("gravity", "force offset", "vibration", "vertical force"),
)
"""Checks of the sensors that every smoother is made of."""
COMPASS = ("compass axes", "compass offset", "compass turn", "field", "field against motors")
"""Checks of the sensor that a heading may rest on."""


def checks(
    log: FlightLog, segments: Segments, reference: Reference | None, others: Iterable[Check] = ()
) -> list[Check]:
    """Tilt and heading of the attitude that flew against truth or smoother; nothing where neither is the reference.

    ``others``: the checks of the sensors that a smoother is made of.
    """
    found = None if reference is None else accusing.compared(log, segments, reference)
    if reference is None or found is None:
        return []
    name, limit = NAMES[reference.kind], LIMITS[reference.kind]
    whom = "the truth" if reference.kind == "truth" else "the smoother"
    if not found.errors:
        return [Check(name, "ok", _agreement(log, found, whom), threshold=limit)]
    failed = {check.name for check in others if _misleads(check)}
    doubts = {error.angle: _doubt(error, reference, failed) for error in found.errors}
    errors = [error for error in found.errors if not doubts[error.angle]]
    if not errors:
        error = found.errors[0]
        why = f"{log.onboard} differs from {whom}: {error.text}. Who is wrong is open: {doubts[error.angle]} failed."
        return [not_judged(name, why, limit)]
    shown = [error for error in errors if error.wrong] or errors
    lead, *rest = shown
    wrong = lead.wrong
    text = "The onboard attitude was wrong" if wrong else "The onboard attitude errs"
    own, _ = interpolate(reference.t, reference.q, reference.gap_segment, found.t[found.counted])
    if lead.angle == "tilt" and mounted(found.q[found.counted], own):
        wrong, text = False, "The sensor is mounted otherwise than set, or the onboard attitude is wrong throughout"
    text += f": {lead.text}."
    if lead.evidence:
        text += f" It is {lead.evidence.replace('the judge', whom)}."
    first, last = lead.longest
    return [
        Check(
            name,
            "fault" if wrong else "warning",
            text,
            round(lead.size, 1),
            "deg",
            limit,
            t=first,
            t_end=last,
            about=lead.angle,
            evidence=[f"Its {error.text}." for error in rest],
        )
    ]


def _agreement(log: FlightLog, found: OnboardComparison, whom: str) -> str:
    """That the onboard attitude is not in error, and by what."""
    if found.acquitted == ["tilt"]:
        return f"{log.onboard} agrees with gravity where it stands, better than {whom}."
    if found.acquitted:
        return f"{log.onboard} agrees with gravity and GNSS acceleration, better than {whom}."
    usual = ", ".join(
        _usual(angle, size[found.counted], found.sigmas[angle][found.counted]) for angle, size in found.sizes.items()
    )
    return f"{log.onboard} differs from {whom} by {usual}."


def _misleads(check: Check) -> bool:
    """Whether a check failed in a way that a smoother does not find out and correct, as it does a constant bias."""
    constant = check.name == "gyro bias" and check.t is None
    return check.verdict == "fault" or (check.verdict == "warning" and not constant)


def _doubt(error: OnboardError, reference: Reference, failed: set[str]) -> str:
    """Which failed checks (names) of the judge's own sensors leave open who is wrong; empty for none."""
    if reference.kind == "truth":
        return ""
    relevant: tuple[str, ...] = FORCE if error.confirmed else INERTIAL
    by_compass = reference.quality.get("heading_from") not in ("motion", "brought")
    if not error.confirmed and error.angle == "heading" and by_compass:
        relevant = (*relevant, *COMPASS)
    found = [f"`{name}`" for name in relevant if name in failed]
    if not error.confirmed and reference.gyro_jumps:
        found.append("the gyro's bias, which jumps,")
    return " and ".join(found)


def mounted(onboard: Array, own: Array) -> bool:
    """Whether one turn of the sensor in the body explains the tilt (n, 4) of the onboard attitude against ``own``."""
    down = np.array([0.0, 0.0, 1.0])
    a, b = (rotation.rotate_inverse(q, down) for q in (own, onboard))
    turn = rotation.nearest(b.T @ a)
    left, whole = (float(np.median(np.sum((b - x) ** 2, axis=1))) for x in (a @ turn.T, a))
    return left < MOUNTED**2 * whole


def _usual(angle: str, size: Array, sigma: Array) -> str:
    """``tilt 0.6 deg (2.1 sigma)``: RMS of the difference, and of its ratio to the reference's own sigma."""
    text = f"{angle} {float(np.sqrt(np.mean(size**2))):.1f} deg"
    return f"{text} ({float(np.sqrt(np.mean((size / sigma) ** 2))):.1f} sigma)" if sigma.all() else text
