"""What to set for an error of a sensor, or why nothing can be set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from attlog.flight.calibration import flown
from attlog.flight.model import FlightLog
from attlog.health.assessments.model import Setting
from attlog.health.settings import limits


@dataclass(frozen=True, slots=True)
class Proposal:
    """Settings that belong together, and where there are none the reason (``refused``, a sentence or empty)."""

    settings: list[Setting] = field(default_factory=list)
    refused: str = ""


def proposed(log: FlightLog, values: Mapping[str, float], units: Mapping[str, str], digits: int) -> Proposal:
    """The proposal to set ``values`` (by name, in ``units``): all that are new, or none and the reason.

    One that differs from what flew in decimals beyond ``digits`` alone stays: a rounded value is no correction.
    """
    old = flown.values(log)
    new = {name: old[name] if name in old and round(old[name], digits) == v else v for name, v in values.items()}
    wanted = [Setting(name, old.get(name), value, units.get(name, "")) for name, value in new.items()]
    why = limits.refusal(log, wanted)
    return Proposal(refused=why) if why else Proposal(limits.keep(log, wanted))
