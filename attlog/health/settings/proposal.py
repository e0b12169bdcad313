"""What could be set against a sensor's error, or why nothing can."""

from __future__ import annotations

from dataclasses import dataclass, field

from attlog.health.assessments.model import Setting


@dataclass(frozen=True, slots=True)
class Proposal:
    """``settings`` to make, or, where there are none, why: ``refused`` is a sentence."""

    settings: list[Setting] = field(default_factory=list)
    refused: str = ""
