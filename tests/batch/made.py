"""Records of a batch made by hand: flights, trouble, and flights by the thousand."""

from __future__ import annotations

import copy
import functools
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from typing import Any

from attlog.batch.ci import GatedLog, gated_log
from attlog.batch.index_row import REASON_POINTS, Reason, index_row, without_metrics
from attlog.batch.job import Record
from attlog.compare.gates import GateOutcome
from attlog.words.answers import verdicts
from tests.report.conftest import make_result

FIRMWARES = ("PX4 1.9.0", "PX4 1.13.2", "PX4 1.15.4", "ArduPilot Copter 4.5.7")


@functools.cache
def _sound() -> dict[str, Any]:
    made = make_result()
    assert made.reference is not None
    made.reference.choice = "smoother"
    made.findings, made.checks = [], []
    made.verdicts = verdicts(made)
    return without_metrics(index_row(made))


def reason(kind: str, severity: str = "serious", text: str = "", *, in_flight: bool = True) -> Reason:
    return Reason(kind, kind, REASON_POINTS[kind, severity], text or f"Something about the {kind}.", 12.0, in_flight)


def flown(name: str, *reasons: Reason, folder: str = "drive", **flight: Any) -> Record:
    """A log with its report. ``scale`` multiplies its numbers."""
    row = copy.deepcopy(_sound())
    scale = flight.pop("scale", 1.0)
    gates = flight.pop("gates", ())
    row["headline"] = flight.pop("headline", "")
    for column in row["columns"]:
        column["values"] = {k: v * scale if isinstance(v, float) else v for k, v in column["values"].items()}
    row["flight"] |= {"name": name} | flight
    row["reasons"] = list(map(asdict, reasons))
    return Record(f"{folder}/{name}", name, row=row, gates=gates)


def failed(name: str, why: str = "not a flight log", code: int = 65, folder: str = "drive") -> Record:
    """A log without a report."""
    return Record(f"{folder}/{name}", name, code=code, message=f"attlog: {folder}/{name}: {why}")


def many(count: int) -> list[Record]:
    """Flights over four years with different firmwares, numbers and troubles; every fiftieth could not be read."""
    found = []
    for i in range(count):
        if i % 50 == 49:
            found.append(failed(f"log_{i}.bin", folder=f"drive/{i // 100}"))
            continue
        reasons = [reason("attitude")] * (i % 29 == 0) + [reason("sensor", "warning")] * (i % 11 == 0)
        when = datetime(2022, 1, 1, tzinfo=UTC) + timedelta(hours=3.4 * i)
        found.append(
            flown(
                f"log_{i}.bin",
                *reasons,
                folder=f"drive/{i // 100}",
                date_utc=when.isoformat(),
                firmware=FIRMWARES[i % len(FIRMWARES)],
                airborne_s=10.0 + i % 600,
                scale=1.0 + (i % 97) / 50.0,
            )
        )
    return found


# Outcomes of gates made by hand.


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


def gated(log: str, *outcomes: GateOutcome, **more: Any) -> GatedLog:
    return gated_log(Record(log, "n", **more), outcomes)


def some() -> list[GatedLog]:
    """A log that passes, one that fails, one with a nasty name, one that cannot be read."""
    return [
        gated("good.ulg", outcome("a", "passed", 0.5), outcome("b", "skipped"), wall_s=12.3456),
        gated("bad.ulg", outcome("a", excess=3.0), outcome("b", "passed", 0.1), outcome("c", excess=9.0)),
        gated(NASTY, outcome(NASTY, sentence=f"{NASTY}: worse\nthan that")),
        gated("gone.ulg", code=66, message="attlog: gone.ulg: cannot be read\n(no such file)", wall_s=1234.0),
    ]
