"""Which parameters take a compass's offset and motor field away."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from attlog.flight.model import FlightLog, Mag
from attlog.health.assessments.model import Array, Setting


@dataclass(slots=True)
class Proposal:
    """Parameters to set; ``refused`` says why there are none."""

    settings: list[Setting] = field(default_factory=list)
    refused: str = ""


def proposal(
    log: FlightLog,
    mag: Mag,
    offset_t: Array,
    motor_t: Array | None = None,
    power: Literal["current", "throttle"] = "current",
) -> Proposal:
    """Settings by which ``mag`` reads ``offset_t`` (3,) T less, and ``motor_t`` (3,) T per ampere or full throttle."""
    return Proposal(refused="Parameters for this firmware are not known.")
