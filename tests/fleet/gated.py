"""Outcomes of gates made by hand."""

from __future__ import annotations

from typing import Any

from attlog.compare.gates.outcome import GateOutcome
from attlog.fleet.ci.gating import GatedLog, gated


def outcome(row: str, status: str = "failed", excess: float = 2.0, **changes: Any) -> GateOutcome:
    """A gate on the lag of a row."""
    cause = {"failed": "limit", "skipped": "unanswered", "passed": None}[status]
    values: dict[str, Any] = {
        "row": row,
        "check": "lag_ms@airborne max=5",
        "metric": "lag_ms",
        "window": "airborne",
        "status": status,
        "cause": cause,
        "value": 5.0 * excess,
        "unit": "ms",
        "allowed": 5.0,
        "excess": excess,
        "sentence": f"{row}: lag_ms {5.0 * excess:g} ms (airborne), at most 5 ms",
    }
    return GateOutcome(**(values | changes))


NASTY = "a|b<i>&\"'`*_[x](y)\x00\x1b[31m\ud800\ufffe%0A,:é.ulg"
"""A log name that is markup, escapes and bytes that are no text."""


def some() -> list[GatedLog]:
    """A log that passes, one that fails, one with a nasty name, one that cannot be read."""
    return [
        gated("good.ulg", "good.ulg", [outcome("a", "passed", 0.5), outcome("b", "skipped")], seconds=12.3456),
        gated("bad.ulg", "bad.ulg", [outcome("a", excess=3.0), outcome("b", "passed", 0.1), outcome("c", excess=9.0)]),
        gated(NASTY, "nasty", [outcome(NASTY, sentence=f"{NASTY}: worse\nthan that")]),
        gated("gone.ulg", "gone.ulg", code=66, message="gone.ulg: cannot be read\n(no such file)", seconds=1234.0),
    ]
