"""Was there a loss of control or an impact? After it a log tells about a wreck."""

from __future__ import annotations

from attlog.flight.model import FlightLog
from attlog.health.model import Check, not_judged
from attlog.segments.crash import fast_enough
from attlog.segments.model import Segments


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """One check that tells the first crash, and how often control was lost; ok only where samples could show one."""
    lost, blows = segments.of("loss_of_control"), segments.of("impact")
    limit = "ok: no tilt beyond 90 deg that ends on the ground, no blow above 4 g after which it lies or tumbles"
    if not lost and not blows:
        if segments.of("airborne") and not fast_enough(log):
            rate = max(imu.acc.rate for imu in log.imus)
            blind = f"a blow shorter than {1000.0 / rate:.0f} ms would not show"
            return [not_judged("crash", f"IMU at {rate:.0f} Hz: nothing turned it over; {blind}.", limit)]
        return [Check("crash", "ok", "No loss of control and no impact.", 0, "", limit)]
    before = [x for x in lost if not blows or x.t0 <= blows[0].t0]  # a wreck that rolls over loses no control
    first, what = (before[0], "Control was lost") if before else (blows[0], "An impact")
    times = f" {len(before)} times" if len(before) > 1 else ""
    text = f"{what}{times}{', first' if times else ''} at {first.t0:.1f} s: {first.why}. "
    if not blows:
        text += "It flew again: what follows is compared too."
    elif before and blows[0].t0 > before[-1].t1:
        text += f"It flew again until an impact at {blows[0].t0:.1f} s, after which nothing is compared."
    else:
        text += f"Nothing is compared after {blows[0].t0:.1f} s."
    return [Check("crash", "fault", text, max(len(before), 1), "", limit, t=first.t0, count=max(len(before), 1))]
