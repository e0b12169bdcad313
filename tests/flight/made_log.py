"""Set fields of a made-up flight log, whichever group holds them."""

from __future__ import annotations

from typing import Any

from attlog.flight.model import FlightLog

GROUPS = ("state", "power", "estimator", "parameters", "vibration", "setpoints")


def with_fields(log: FlightLog, **fields: Any) -> FlightLog:
    """Return the log with these fields set: its own (``imus``), or those of a group (``armed``, ``throttle``)."""
    for name, value in fields.items():
        holders = [log, *(getattr(log, group) for group in GROUPS)]
        setattr(next(holder for holder in holders if hasattr(holder, name)), name, value)
    return log
