"""What a metric is, and what it may look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

from attlog.flight.model import FlightLog
from attlog.reference.model import HeadingReference, Reference, Row
from attlog.segments.model import Segments

__all__ = ["Case", "HeadingReference", "Metric", "applies_to", "paragraph"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Metric:
    """A column of the table. ``definition`` is the paragraph that the report shows.

    ``name`` carries the unit (``noise_roll_deg``); ``better`` says which value is best;
    ``needs`` names what must be in the log (rest, reference, events, mag, gnss, setpoint).
    """

    name: str
    title: str
    unit: str
    better: Literal["low", "zero", "one", "high"]
    needs: tuple[str, ...]
    definition: str


@dataclass(slots=True)
class Case:
    """All that metrics see of one log. ``heading_references``: headings by name for drift in the air."""

    log: FlightLog
    segments: Segments
    reference: Reference
    rows: list[Row]
    heading_references: dict[str, HeadingReference] = field(default_factory=dict)
    cache: dict[str, Any] = field(default_factory=dict)
    """What :meth:`cached` has computed."""

    def cached(self, key: str, compute: Callable[[], T]) -> T:
        """What ``compute`` returns, computed at the first call only: for what rows, windows or metrics share.

        ``key`` begins with the name of the metric's file and names all that the value depends on.
        """
        if key not in self.cache:
            self.cache[key] = compute()
        return self.cache[key]


def applies_to(window: str, *names: str) -> bool:
    """Whether a metric that belongs to the named windows says something about this one (``T0:T1`` always)."""
    return ":" in window or window in names


def paragraph(text: str) -> str:
    """The text with its line breaks and indents as single spaces, for definitions written over several lines."""
    return " ".join(text.split())
