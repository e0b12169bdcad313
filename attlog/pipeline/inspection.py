"""Inspection of a log without filters, as plain values: ``attlog info``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from attlog import formats, reference
from attlog.core.log_cache import log_cache
from attlog.core.plain import to_plain
from attlog.flight import flight_in
from attlog.flight.model import guarded_part
from attlog.flight.signals import numeric_fields
from attlog.flight.timestamps import table_time_span
from attlog.formats import Messages
from attlog.health import answerable
from attlog.pipeline import evaluation
from attlog.pipeline.config import Config
from attlog.pipeline.preparation import Stages, prepared

# Shortest time span for which a message rate is computed.
MIN_S = 1.0


def inspect(path: Path, *, boot: int | None = None, system: int | None = None) -> dict[str, Any]:
    """Inspect a log: contents, physics checks, answerable questions and findings.

    Keys: ``log``; ``headline`` and ``events`` (what happened); ``messages`` of the boot (name, instance, records,
    rate_hz, fields, signals; the rate is None without times and for records within one second; signals are the
    numeric fields by name); ``compared_with`` (reference of an analysis); ``checks``; ``answerable``; ``findings``
    (every problem known before a filter runs, worst first, with cause and action); ``damage``; ``gyro_bias`` (bias
    that an analysis subtracts from the gyro; None without inertial data). Works on logs without inertial data too.
    LogUnreadable or LogUnusable as in ``attlog.read``.
    """
    messages = formats.open(path, system)
    log = flight_in(messages, boot=boot, system=system)
    listed = _listed(messages.boot(log.boot), system)
    damage = {"bytes": messages.damage_bytes, "count": messages.damage_places, "places": to_plain(messages.damage)}
    del messages  # frees the log's bytes and index: the next steps need as much memory
    log.messages = log.estimator.inputs = None  # not needed here
    config, stage = Config(), Stages()
    with log_cache():
        case = prepared(log, config, stage) if log.imu is not None else None
        answers = guarded_part(log, "What can be answered", lambda: answerable(log, case), list)
        result = evaluation.without_replay(log, config, stage, case=case)
    return {
        "log": result.log,
        "headline": result.headline,
        "events": to_plain(result.events),
        "messages": listed,
        "compared_with": "" if case is None else reference.meaning(case.reference),
        "checks": to_plain(result.checks),
        "answerable": to_plain(answers),
        "gyro_bias": None if case is None else to_plain(result.gyro_bias),
        "findings": to_plain(result.findings),
        "damage": damage,
    }


def _listed(messages: Messages, system: int | None) -> list[dict[str, Any]]:
    """List the messages of a log with their number of records and rate."""
    messages.forget()
    stamps = table_time_span(messages, system)
    return [
        {
            "name": table.name,
            "instance": table.instance,
            "records": len(table),
            "rate_hz": _rate(len(table), stamps(table)),
            "fields": len(table.fields),
            "signals": numeric_fields(table),
        }
        for table in messages.values()
    ]


def _rate(count: int, ends: tuple[int, int] | None) -> float | None:
    """Return the rate between two boot times in us; None for a burst."""
    if ends is None or count < 2:
        return None
    span = (float(ends[1]) - float(ends[0])) / 1e6
    return (count - 1) / span if span >= MIN_S else None
