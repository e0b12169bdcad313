"""Is the onboard heading wrong by GNSS acceleration, and when? It needs no compass, no truth and no smoother."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.estimators.evidence.gnss_heading import WRONG_DEG, WRONG_SIGMAS, HeadingOffset
from attlog.flight.model import FlightLog
from attlog.health.model import Check, not_judged
from attlog.reference import clock, scoring
from attlog.reference.physics.gnss_motion import GnssMotion, motion_of
from attlog.segments import gaps, resets
from attlog.segments.model import Segments
from attlog.segments.spans import Span, intersect, merge
from attlog.story.rejections import tested

NAME = "heading by GNSS"
SERIOUS_DEG = 15.0
"""So far off, position hold circles instead of holding."""
LIMIT = f"ok up to {WRONG_DEG:.0f} deg or {WRONG_SIGMAS:.0f} sigma, fault above {SERIOUS_DEG:.0f} deg"


@dataclass(frozen=True, slots=True)
class WrongHeading:
    """When the heading is wrong, the best known of these offsets, and whether it is right at other times."""

    spans: list[Span]
    offset: HeadingOffset
    partly: bool = False


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """The onboard heading against GNSS acceleration in flight; nothing without GNSS or attitude."""
    motion = motion_of(log, segments)
    if motion is None or log.onboard_attitude is None:
        return []
    whole, parts = onboard_offsets(log, segments, motion)
    wrong = wrong_heading(whole, parts)
    if wrong is not None:
        return [_wrong(log, segments, wrong)]
    if not whole.told:
        return [not_judged(NAME, f"{whole.why[0].upper()}{whole.why[1:]}.", LIMIT)]
    size = abs(whole.offset_deg)
    text = f"{log.onboard}'s heading is {size:.1f} deg off by GNSS acceleration (± {whole.sigma_deg:.1f} deg)."
    return [Check(NAME, "ok", text, round(size, 1), "deg", LIMIT)]


def onboard_offsets(
    log: FlightLog, segments: Segments, motion: GnssMotion
) -> tuple[HeadingOffset, list[HeadingOffset]]:
    """The heading error of the attitude that flew, over the flight and in each 30 s, from its own alignment on."""
    attitude = log.onboard_attitude
    assert attitude is not None
    t, q, _ = clock.usable(attitude, "sample")
    aligned = scoring.aligned_at(attitude, resets.known(log, log.onboard or "", segments)[0], segments)
    return motion.offsets(t, q, gaps.number(t), -np.inf if aligned is None else aligned)


def wrong_heading(whole: HeadingOffset, parts: list[HeadingOffset]) -> WrongHeading | None:
    """When the heading is wrong: all the time, or in some of the 30 s; None where it nowhere is."""
    off = [part for part in parts if part.wrong]
    if whole.wrong and not any(part.told and not part.wrong for part in parts):
        return WrongHeading([(whole.t0, whole.t1)], whole)
    if off:
        spans = list(merge((part.t0, part.t1) for part in off))
        return WrongHeading(spans, min(off, key=lambda part: part.sigma_deg), partly=any(part.sound for part in parts))
    return WrongHeading([(whole.t0, whole.t1)], whole) if whole.wrong else None


def _wrong(log: FlightLog, segments: Segments, wrong: WrongHeading) -> Check:
    size = abs(wrong.offset.offset_deg)
    first, last = wrong.spans[0][0], wrong.spans[-1][1]
    seconds = sum(b - a for a, b in wrong.spans)
    when = f" from {first:.0f} s to {last:.0f} s" + (f", {seconds:.0f} s in all" if len(wrong.spans) > 1 else "")
    text = f"The onboard heading is {size:.0f} deg off by GNSS acceleration (± {wrong.offset.sigma_deg:.0f} deg){when}."
    evidence = ["At other times it is right."] if wrong.partly else []
    rejected = _rejected(log, segments, wrong.spans)
    if rejected:
        evidence.append(f"The EKF rejected {rejected} then: its heading is wrong, not GNSS.")
    verdict = "fault" if size > SERIOUS_DEG else "warning"
    return Check(NAME, verdict, text, round(size, 1), "deg", LIMIT, t=first, t_end=last, evidence=evidence)


def _rejected(log: FlightLog, segments: Segments, spans: list[Span]) -> str:
    """What the onboard estimator rejected of GNSS while its heading was wrong: ``GNSS velocity for 12 s``."""
    found = []
    for one in tested(log, segments):
        seconds = sum(b - a for a, b in intersect(one.spans, spans))
        if one.aid in ("velocity", "position") and seconds >= 1.0:
            found.append(f"GNSS {one.aid} for {seconds:.0f} s")
    return " and ".join(found)
