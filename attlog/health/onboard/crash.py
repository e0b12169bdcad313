"""Was there a loss of control or an impact? After it a log tells about a wreck."""

from __future__ import annotations

from attlog.flight.model import FlightLog
from attlog.health.model import Check, not_judged
from attlog.segments.crash import fast_enough
from attlog.segments.model import Segments

LIMIT = "ok: no tilt beyond 90 deg that ends on the ground, no blow above 4 g after which it lies or tumbles"


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """One check that tells the first crash, and how often control was lost; ok only where samples could show one."""
    lost, blows = segments.of("loss_of_control"), segments.of("impact")
    if not lost and not blows:
        return [_none(log, segments)]
    before = [x for x in lost if not blows or x.t0 <= blows[0].t0]  # a wreck that rolls over loses no control
    first, what = (before[0], "Control was lost") if before else (blows[0], _what(segments, blows[0].t0))
    times = f" {len(before)} times" if len(before) > 1 else ""
    text = f"{what}{times}{', first' if times else ''} at {first.t0:.1f} s: {first.why}."
    if not blows:
        after = "It flew again: what follows is compared too."
    elif before and blows[0].t0 > before[-1].t1:
        after = f"It flew again until an impact at {blows[0].t0:.1f} s, after which nothing is compared."
    else:
        after = f"Nothing is compared after {blows[0].t0:.1f} s."
    count = max(len(before), 1)
    return [Check("crash", "fault", text, count, "", LIMIT, t=first.t0, count=count, evidence=[after])]


def _what(segments: Segments, t: float) -> str:
    """How the crash at a time began: the end of use is called an impact whatever it was."""
    first = next((e for e in segments.endings if e.is_crash and abs(e.t - t) < 1.0), None)
    kinds = {"impact": "An impact", "overturn": "It turned over", "tumble": "It tumbled"}
    return "An impact" if first is None else kinds.get(first.kind, "An impact")


def _none(log: FlightLog, segments: Segments) -> Check:
    """No crash, where raw samples would show one; else why that cannot be said."""
    driven = segments.of("airborne") or segments.of("armed")
    if not driven or fast_enough(log):
        return Check("crash", "ok", "No loss of control and no impact.", 0, "", LIMIT)
    rate = max(imu.acc.rate for imu in log.imus)
    blind = f"a blow shorter than {1000.0 / rate:.0f} ms would not show"
    return not_judged("crash", f"IMU at {rate:.0f} Hz: nothing turned it over; {blind}.", LIMIT)
