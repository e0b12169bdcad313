"""Onboard heading against GNSS acceleration, and whether its own compass or the estimator is wrong.

The field, levelled by the onboard tilt, shows the heading of the compass beside that of the estimator. Where the
estimator is further off than its compass, no calibration of the compass mends it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import median
from attlog.core.spans import Span, inside, intersect
from attlog.estimators.evidence import WRONG_DEG, WRONG_SIGMAS
from attlog.flight.model import Array, FlightLog
from attlog.health.check import Check, HealthCase, Verdict, unknown
from attlog.reference import alignment
from attlog.reference.heading_sources import WrongHeading, find_wrong_heading, onboard_offsets
from attlog.segments import model
from attlog.segments.model import Segments
from attlog.story.estimator_events import aid_rejections

HEADING_BY_GNSS = "heading_by_gnss"
# Heading error from which position hold flies circles.
SERIOUS_HEADING_DEG = 15.0
GNSS_HEADING_LIMIT = (
    f"ok up to {WRONG_DEG:.0f} deg or {WRONG_SIGMAS:.0f} sigma, fault above {SERIOUS_HEADING_DEG:.0f} deg"
)
# Minimum duration of a rejection; shorter ones are one or two late fixes.
MIN_REJECTED_S = 1.0


def gnss_heading_checks(case: HealthCase) -> list[Check]:
    """Check the onboard heading against GNSS acceleration in flight; nothing without either."""
    log, segments = case.log, case.segments
    offsets = onboard_offsets(log, segments)
    if offsets is None:
        return []
    whole, parts = offsets
    wrong = find_wrong_heading(whole, parts)
    if wrong is not None:
        return [_wrong_heading_check(case, wrong)]
    if not whole.known:
        return [unknown(HEADING_BY_GNSS, f"{whole.why[0].upper()}{whole.why[1:]}.", GNSS_HEADING_LIMIT)]
    size = abs(whole.offset_deg)
    text = f"{log.onboard}'s heading fits the motion by GNSS to {size:.1f} deg (± {whole.sigma_deg:.1f} deg)."
    return [Check(HEADING_BY_GNSS, "ok", text, round(size, 1), "deg", GNSS_HEADING_LIMIT)]


def _wrong_heading_check(case: HealthCase, wrong: WrongHeading) -> Check:
    log, segments = case.log, case.segments
    size = round(abs(wrong.offset.offset_deg), 1)  # rounded as in texts made from the value
    first, last = wrong.spans[0][0], wrong.spans[-1][1]
    seconds = sum(b - a for a, b in wrong.spans)
    when = f" from {first:.0f} s to {last:.0f} s" + (f", {seconds:.0f} s in all" if len(wrong.spans) > 1 else "")
    sigma = f"± {wrong.offset.sigma_deg:.0f} deg"
    text = f"The onboard heading is {size:.0f} deg wrong ({sigma}){when}, by the motion that GNSS shows."
    evidence = ["At other times it is correct."] if wrong.partly else []
    rejected = _rejected_gnss(log, segments, wrong.spans)
    if rejected:
        evidence.append(f"The EKF rejected {rejected} meanwhile: its heading is wrong, not GNSS.")
    verdict: Verdict = "fault" if size > SERIOUS_HEADING_DEG else "warning"
    check = Check(
        HEADING_BY_GNSS, verdict, text, size, "deg", GNSS_HEADING_LIMIT, t=first, t_end=last, evidence=evidence
    )
    # A compass that is set wrongly, or corrected by a file, is not the one that flew.
    other = case.trouble("compass_orientation") or any(p.code == "calibration_applied" for p in log.problems)
    left = None if other else compass_left(log, segments, wrong)
    if left is not None:
        _blame_estimator(log, segments, check, left)
    return check


def _rejected_gnss(log: FlightLog, segments: Segments, spans: list[Span]) -> str:
    """Return GNSS rejections of the onboard estimator in spans: ``GNSS velocity for 12 s``."""
    found = []
    for one in aid_rejections(log, segments):
        seconds = sum(b - a for a, b in intersect(one.spans, spans))
        if one.aid in ("velocity", "position") and seconds >= MIN_REJECTED_S:
            found.append(f"GNSS {one.aid} for {seconds:.0f} s")
    return " and ".join(found)


# The compass beside the estimator.

# Least difference of both heading errors: that of a sound compass with the usual declination and iron.
LEFT_DEG, LEFT_SIGMAS = 15.0, 3.0
# Searched time before the first part of 30 s with a wrong heading.
BEFORE_S = 30.0
# Time compared on both sides of the onset, and the share of the error that a jump makes within it.
AROUND_S, JUMP_SHARE = 2.0, 0.5
# Change of the estimator's gyro bias about the vertical that turns a heading away against its compass.
BIAS_DPS = 0.3
MIN_FIELD_SAMPLES = 20


class CompassLeft(NamedTuple):
    """An estimator whose heading left its compass at ``t`` s, by a ``jump_deg`` (0: gradually).

    ``compass_deg``: heading error of the compass by the same GNSS acceleration.
    """

    t: float
    jump_deg: float
    compass_deg: float


def compass_left(log: FlightLog, segments: Segments, wrong: WrongHeading) -> CompassLeft | None:
    """Return when the estimator's heading left a better compass; None where the compass is as wrong."""
    lead = compass_lead(log)
    error = wrong.offset.offset_deg
    if lead is None:
        return None
    t, lead_deg = lead
    own = inside(t, wrong.spans) & inside(t, [(wrong.offset.t0, wrong.offset.t1)])
    if np.count_nonzero(own) < MIN_FIELD_SAMPLES:
        return None
    by_compass = float(_wrapped(_middle(lead_deg[own]) - error))
    if abs(error) - abs(by_compass) < max(LEFT_DEG, LEFT_SIGMAS * wrong.offset.sigma_deg):
        return None
    first, last = wrong.spans[0][0], wrong.spans[-1][1]
    near = inside(t, intersect([(first - BEFORE_S, last)], segments.spans("airborne") or [(-math.inf, math.inf)]))
    if not near.any():
        return None
    t, away = t[near], np.abs(_wrapped(lead_deg[near] - by_compass))
    onset = float(t[_change_point(away > LEFT_DEG)])
    before, after = (inside(t, [span]) for span in ((onset - AROUND_S, onset - 1e-6), (onset, onset + AROUND_S)))
    jump = 0.0
    if before.any() and after.any():
        step = float(median(away[after]) - median(away[before]))
        jump = step if step > max(LEFT_DEG, JUMP_SHARE * abs(error)) else 0.0
    return CompassLeft(onset, jump, abs(by_compass))


def left_by_estimator(checks: Iterable[Check]) -> bool:
    """Return whether the estimator, not its compass, made the heading wrong."""
    return any(check.question == HEADING_BY_GNSS and check.kind == "attitude" for check in checks)


def compass_lead(log: FlightLog) -> tuple[Array, Array] | None:
    """Return times (n,) s and by how many deg (n,) the estimator's heading exceeds that of the compass in use."""
    attitude, earth = log.onboard_attitude, alignment.earth_field(log)
    if attitude is None or earth is None or log.mag is None:
        return None
    t, x = model.select_rising(log.mags[log.mag].field.t_best, log.mags[log.mag].field.x)
    own = attitude.t if attitude.t_sample is None else attitude.t_sample
    q, _ = rotation.slerp_in_segments(own, attitude.q, model.number_segments(own), t)
    good = rotation.finite_rows(q) & np.any(x != 0.0, axis=1)
    seen = rotation.rotate(q[good], x[good])
    azimuth = np.degrees(np.arctan2(seen[:, 1], seen[:, 0]))
    return (t[good], _wrapped(azimuth - earth.declination_deg)) if len(seen) else None


def _change_point(on: NDArray[np.bool_]) -> int:
    """Return the sample from which ``on`` (n,) holds, with the fewest exceptions on both sides."""
    wrong = np.cumsum(on) - on + np.count_nonzero(~on) - np.cumsum(~on) + ~on
    return min(int(np.argmin(wrong)), len(on) - 1)


def _middle(angle: Array) -> float:
    """Return the circular median of angles in deg."""
    mean = float(np.degrees(np.angle(np.mean(np.exp(1j * np.radians(angle))))))
    return mean + float(median(_wrapped(angle - mean)))


def _wrapped(angle: Array | float) -> Array:
    return np.asarray(np.degrees(rotation.wrap(np.radians(angle))))


def _blame_estimator(log: FlightLog, segments: Segments, check: Check, left: CompassLeft) -> None:
    """Turn a wrong heading into a finding about the estimator, with its onset and remedy."""
    assert check.t is not None
    assert check.t_end is not None
    check.kind, check.about = "attitude", "heading"
    check.text = check.text.replace(f"from {check.t:.0f} s", f"from {left.t:.0f} s", 1)
    check.t = round(left.t, 1)
    check.evidence.append(f"The compass itself is {left.compass_deg:.0f} deg off by the same acceleration.")
    check.cause = f"The estimator's heading diverged from its own compass, which is {left.compass_deg:.0f} deg off."
    bias = log.estimator.gyro_bias
    ran = 0.0
    if bias is not None:
        during = inside(bias.t_best, [(left.t - BEFORE_S, check.t_end)])
        ran = float(np.ptp(np.degrees(bias.x[during, 2]))) if np.count_nonzero(during) > 1 else 0.0
    rejected = [one for one in aid_rejections(log, segments) if one.aid == "compass"]
    seconds = sum(b - a for one in rejected for a, b in intersect(one.spans, [(left.t - BEFORE_S, check.t_end)]))
    if left.jump_deg:
        check.evidence.append(f"The onboard heading jumped by {left.jump_deg:.0f} deg at {left.t:.1f} s.")
        sound = "; the compass needs no calibration" if left.compass_deg < LEFT_DEG else ""
        check.action = f"Find what reset the onboard heading at {left.t:.1f} s{sound}."
    elif ran > BIAS_DPS:
        check.cause = f"The estimator's gyro bias about the vertical drifted by {ran:.1f} deg/s, against the compass."
        check.action = "Reboot before the next flight, and land if the EKF reports a variance."
    elif seconds >= MIN_REJECTED_S:
        check.evidence.append(f"The EKF rejected its compass for {seconds:.0f} s meanwhile.")
        check.action = "Find why the EKF rejected its compass: check gates, innovations and other yaw sources."
    else:
        check.action = "Check the estimator's yaw source, and its heading before take-off against the compass."
