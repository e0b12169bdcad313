"""Did the onboard estimator reject what aids it? Its own test ratios above 1 in flight, by aid."""

from __future__ import annotations

from attlog.flight.model import FlightLog
from attlog.health.model import Check
from attlog.segments.model import Segments
from attlog.story.rejections import LEAST_S, Rejection, tested

LONG_S = 10.0
"""ArduPilot's EKF3 resets to GNSS that it rejected for so long (AP_NavEKF3.h, posRetryTimeUseVel_ms)."""
LIMIT = f"ok: never above 1, the firmware's own gate, for {LEAST_S:.0f} s in flight; fault: for {LONG_S:.0f} s on end"


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """One check for each aid whose test ratio was logged in flight."""
    return [_check(one) for one in tested(log, segments)]


def _check(one: Rejection) -> Check:
    name = f"rejected {one.aid}"
    if not one.spans:
        text = f"The EKF never rejected its {one.aid} for {LEAST_S:.0f} s in {one.seconds_flown:.0f} s of flight."
        return Check(name, "ok", text, 0.0, "s", LIMIT)
    verdict = "fault" if one.longest >= LONG_S else "warning"
    first, last = one.spans[0][0], one.spans[-1][1]
    seconds = round(one.seconds, 1)
    return Check(name, verdict, one.text, seconds, "s", LIMIT, first, len(one.spans), last)
