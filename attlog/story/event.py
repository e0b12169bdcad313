"""An event of a flight: what happened, when, how large, and who says so."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

Weight = Literal["info", "note", "warning", "serious"]
KINDS = (
    "power_up",
    "armed",
    "disarmed",
    "liftoff",
    "landing",
    "hard_landing",
    "impact",
    "overturn",
    "tumble",
    "wreck_moved",
    "ends_in_air",
    "clipping",
    "vibration",
    "realigned",
    "reset",
    "lane_switch",
    "sensor_switch",
    "compass_switch",
    "aid_rejected",
    "gnss_lost",
    "gnss_jump",
    "failsafe",
    "battery",
    "message",
)
CRASHES = ("impact", "overturn", "tumble")
"""A crash is one of these with severity ``serious``."""


@dataclass(frozen=True, slots=True)
class Event:
    """What happened at ``t`` s, until ``t_end`` s where it lasted: one of KINDS, a sentence, its size and the evidence.

    ``evidence`` are the sources that tell it: sensors with what they show, flags, and the autopilot's own words.
    """

    kind: str
    t: float
    severity: Weight
    text: str
    t_end: float | None = None
    value: float | None = None
    unit: str = ""
    evidence: list[str] = field(default_factory=list)

    @property
    def is_crash(self) -> bool:
        """Whether control or the vehicle was lost."""
        return self.kind in CRASHES and self.severity == "serious"


def figures(x: float, count: int = 2) -> str:
    """A size with so many significant figures at least, without an exponent: 4.6, 13, 250."""
    if x == 0.0:
        return "0"
    digits = count - len(str(int(abs(x)))) if abs(x) >= 1.0 else count
    return f"{x:.{max(digits, 0)}f}"


def moment(t: float) -> str:
    """When something was, in words; a clock that begins a little late tells no "-0.0 s"."""
    return f"at {max(t, 0.0) if t > -0.05 else t:.1f} s"
