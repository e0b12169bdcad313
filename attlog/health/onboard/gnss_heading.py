"""Is the onboard heading wrong by GNSS acceleration, and when? It needs no compass, no truth and no smoother."""

from __future__ import annotations

from attlog.estimators.evidence.gnss_heading import WRONG_DEG, WRONG_SIGMAS
from attlog.flight.model import FlightLog
from attlog.health.model import Check, not_judged
from attlog.reference.physics.gnss_motion import motion_of
from attlog.reference.physics.onboard_heading import WrongHeading, onboard_offsets, wrong_heading
from attlog.segments.model import Segments
from attlog.segments.spans import Span, intersect
from attlog.story.rejections import tested

NAME = "heading by GNSS"
SERIOUS_DEG = 15.0
"""So far off, position hold circles instead of holding."""
LIMIT = f"ok up to {WRONG_DEG:.0f} deg or {WRONG_SIGMAS:.0f} sigma, fault above {SERIOUS_DEG:.0f} deg"


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


def _wrong(log: FlightLog, segments: Segments, wrong: WrongHeading) -> Check:
    size = round(abs(wrong.offset.offset_deg), 1)  # what is printed from the value says the same
    first, last = wrong.spans[0][0], wrong.spans[-1][1]
    seconds = sum(b - a for a, b in wrong.spans)
    when = f" from {first:.0f} s to {last:.0f} s" + (f", {seconds:.0f} s in all" if len(wrong.spans) > 1 else "")
    text = f"The onboard heading is {size:.0f} deg off by GNSS acceleration (± {wrong.offset.sigma_deg:.0f} deg){when}."
    evidence = ["At other times it is right."] if wrong.partly else []
    rejected = _rejected(log, segments, wrong.spans)
    if rejected:
        evidence.append(f"The EKF rejected {rejected} then: its heading is wrong, not GNSS.")
    verdict = "fault" if size > SERIOUS_DEG else "warning"
    return Check(NAME, verdict, text, size, "deg", LIMIT, t=first, t_end=last, evidence=evidence)


def _rejected(log: FlightLog, segments: Segments, spans: list[Span]) -> str:
    """What the onboard estimator rejected of GNSS while its heading was wrong: ``GNSS velocity for 12 s``."""
    found = []
    for one in tested(log, segments):
        seconds = sum(b - a for a, b in intersect(one.spans, spans))
        if one.aid in ("velocity", "position") and seconds >= 1.0:
            found.append(f"GNSS {one.aid} for {seconds:.0f} s")
    return " and ".join(found)
