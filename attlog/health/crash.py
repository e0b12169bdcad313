"""Was there a loss of control or an impact? After it a log tells about a wreck."""

from __future__ import annotations

from attlog.health.model import Check
from attlog.segments.model import Segments


def checks(segments: Segments) -> list[Check]:
    """One check that tells the first impact, and how often control was lost."""
    lost, blows = segments.of("loss_of_control"), segments.of("impact")
    limit = "good: no tilt beyond 90 deg that ends on the ground, no blow above 4 g with a tumble"
    if not lost and not blows:
        return [Check("crash", "good", "No loss of control and no impact.", 0, "", limit)]
    if blows and not lost:
        first, what = blows[0], "An impact"
    else:
        first, what = lost[0], "Control was lost"
    times = f" {len(lost)} times" if len(lost) > 1 else ""
    text = f"{what}{times}{', first' if times else ''} at {first.t0:.1f} s: {first.why}."
    if blows and lost:
        text += f" Nothing is compared after {blows[0].t0:.1f} s."
    return [Check("crash", "bad", text, max(len(lost), 1), "", limit, t=first.t0, count=max(len(lost), 1))]
