"""A log with nothing in it but what a test plants."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from attlog.flight.model import Firmware, FlightLog
from tests.flight.made_log import with_fields


def log(**more: Any) -> FlightLog:
    """A quadrotor's, with these fields."""
    made = FlightLog(Path("made"), "made", 0, 0, Firmware("made"), "quadrotor")
    return with_fields(made, **more)
