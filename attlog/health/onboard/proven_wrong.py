"""Which angle of the onboard attitude do the checks prove wrong in flight, by how much, and when?"""

from __future__ import annotations

from collections.abc import Iterable

from attlog.health.model import Check
from attlog.health.onboard import against_smoother, gnss_heading
from attlog.story.headline import WrongAngle

NAMES = (gnss_heading.NAME, against_smoother.TRUTH, against_smoother.NAME)
"""Checks that prove it, the one with the fewest assumptions first."""


def wrong_angle(checks: Iterable[Check]) -> WrongAngle | None:
    """The wrong angle with its size in deg and its time in s; None where no check proves one."""
    faults = {check.name: check for check in checks if check.name in NAMES and check.verdict == "fault"}
    for name in NAMES:
        check = faults.get(name)
        if check is not None and isinstance(check.value, float | int) and check.t is not None:
            angle = "heading" if name == gnss_heading.NAME else check.about
            return WrongAngle(angle, float(check.value), check.t, check.t if check.t_end is None else check.t_end)
    return None
