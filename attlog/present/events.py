"""What happened in a flight, as it is listed: time, words, how bad, and the evidence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from attlog.result import Result

STYLE = {"serious": "bad", "warning": "warn"}
LABELS = {
    "armed": "armed",
    "disarmed": "disarmed",
    "liftoff": "lift-off",
    "landing": "landing",
    "hard_landing": "hard landing",
    "impact": "impact",
    "overturn": "overturned",
    "tumble": "tumbling",
    "wreck_moved": "carried",
    "ends_in_air": "log ends",
    "clipping": "clipping",
    "vibration": "vibration",
    "realigned": "EKF realigned",
    "reset": "attitude jump",
    "lane_switch": "EKF lane",
    "sensor_switch": "sensor switch",
    "compass_switch": "compass switch",
    "aid_rejected": "aid rejected",
    "gnss_lost": "GNSS lost",
    "gnss_jump": "GNSS jump",
    "failsafe": "failsafe",
    "battery": "battery",
    "message": "message",
}
"""An event in two words, by its kind."""
CUSTOMARY = ("power_up", "reset")
"""Kinds that are listed only where somebody asks for all."""


@dataclass(slots=True)
class ShownEvent:
    """An event as it is shown: ``t`` s, its sentence, its style, and the sources that tell it."""

    t: float
    text: str
    style: str
    evidence: str


def events(result: Result) -> tuple[list[ShownEvent], list[ShownEvent]]:
    """What happened, in time order, and what of it is custom or detail."""
    listed: list[ShownEvent] = []
    details: list[ShownEvent] = []
    for event in result.events:
        shown = ShownEvent(event.t, event.text, STYLE.get(event.severity, ""), "; ".join(event.evidence))
        minor = event.kind in CUSTOMARY or (event.kind == "message" and event.severity == "note")
        (details if minor else listed).append(shown)
    return listed, details
