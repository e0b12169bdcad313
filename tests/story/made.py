"""A log with nothing in it but what a test plants."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from attlog.flight.model import Firmware, FlightLog


def log(**more: Any) -> FlightLog:
    """A quadrotor's, with these fields."""
    made = FlightLog(Path("made"), "made", 0, 0, Firmware("made"), "quadrotor")
    for name, value in more.items():
        setattr(made, name, value)
    return made
