"""What ``attlog info`` tells of a log, as plain values."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from attlog import flight as room
from attlog import formats, reference, segments, story
from attlog.core.log_cache import log_cache
from attlog.core.plain import to_plain
from attlog.flight import flight_in
from attlog.flight.model import FlightLog, guarded_part
from attlog.flight.timestamps import table_time_span
from attlog.formats import Messages
from attlog.health import answerable, audit
from attlog.health.attitude import wrong_angle
from attlog.health.findings import contradiction, findings, nothing_wrong
from attlog.metrics import Case
from attlog.metrics.gyro_bias import common_bias
from attlog.pipeline.summary import describe
from attlog.reference.model import Reference
from attlog.segments import Segments

SHORTEST_S = 1.0
"""Records that span less have no rate."""


def inspect(path: Path, *, boot: int | None = None, system: int | None = None) -> dict[str, Any]:
    """Contents, physics checks, answerable questions and findings of a log.

    Keys: ``log``, ``headline`` and ``events`` (what happened), ``messages`` of the boot (name,
    instance, records, rate_hz, fields; the rate is None without times and for records within one second),
    ``compared_with`` (what an
    analysis would compare with), ``audit``, ``answerable``,
    ``findings`` (all that is wrong, worst first, with cause and action, before any filter runs), ``damage``,
    ``gyro_bias`` (what an analysis takes off the gyro; None without inertial data). Works on logs without inertial data too. LogUnreadable
    or LogUnusable as in ``attlog.read``.
    """
    messages = formats.open(path, system)
    log = flight_in(messages, boot=boot, system=system)
    listed, damage = _listed(messages.boot(log.boot), system), _damage(messages)
    del messages  # the log's bytes and its index go with it: what follows takes as much
    room.check_analysis_memory(log, room.INFO_BYTES)
    with log_cache():
        phases = segments.build(log) if log.imu is not None else None
        chosen, case = (
            (None, None)
            if phases is None
            else guarded_part(log, "The reference", partial(_compared, log, phases), partial(_alone, log, phases))
        )
        checks = audit(log, phases, chosen)
    answers = guarded_part(log, "What can be answered", lambda: answerable(log, case), list)
    compared = ""
    if phases is not None and chosen is not None:
        compared = guarded_part(log, "The reference", partial(reference.expected_reference, log, phases, chosen), str)
    flown = segments.build(log) if phases is None else phases
    happened = story.events(log, flown)
    described = to_plain(describe(log, phases))  # before the findings: what breaks in it is one
    wrong = findings(log, checks, [] if chosen is None else contradiction(chosen), events=happened)
    headline = story.headline(log, flown, happened, nothing_wrong(wrong), wrong_angle(checks))
    return {
        "log": described,
        "headline": headline,
        "events": to_plain(happened),
        "messages": listed,
        "compared_with": compared,
        "audit": to_plain(checks),
        "answerable": to_plain(answers),
        "gyro_bias": None if case is None else to_plain(list(case.gyro_bias.values())),
        "findings": to_plain(wrong),
        "damage": damage,
    }


def _listed(messages: Messages, system: int | None) -> list[dict[str, Any]]:
    """The messages of the log that is looked at, how many records they have and how many a second."""
    messages.forget()
    stamps = table_time_span(messages, system)
    return [
        {
            "name": table.name,
            "instance": table.instance,
            "records": len(table),
            "rate_hz": _rate(len(table), stamps(table)),
            "fields": len(table.fields),
        }
        for table in messages.values()
    ]


def _damage(messages: Messages) -> dict[str, Any]:
    """How much of the file is not usable, and where."""
    return {"bytes": messages.damage_bytes, "count": messages.damage_places, "places": to_plain(messages.damage)}


def _compared(log: FlightLog, phases: Segments) -> tuple[Reference | None, Case | None]:
    """What an analysis would compare with, and the log as the metrics see it."""
    chosen = reference.choose(log, phases)
    return chosen, _case(log, phases, chosen)


def _alone(log: FlightLog, phases: Segments) -> tuple[Reference | None, Case | None]:
    """The same where nothing can be compared with."""
    chosen = reference.choose(log, phases, reference.ReferenceOptions(reference="none"))
    return chosen, Case(log, phases, chosen)


def _case(log: FlightLog, phases: Segments, chosen: Reference) -> Case:
    """The log as the metrics see it; headings to compare with are only built where there is flight."""
    flown = bool(phases.spans("airborne"))
    imu = log.replay_imu
    return Case(
        log,
        phases,
        chosen,
        heading_references=reference.heading_references(log, phases, chosen) if flown else {},
        gyro_bias={} if imu is None else {imu.index: common_bias(log, phases, imu, "rest")},
    )


def _rate(count: int, ends: tuple[int, int] | None) -> float | None:
    """Intervals per second of ``count`` records from the first to the last boot time in us; None for a burst, such as
    definitions."""
    if ends is None or count < 2:
        return None
    span = (float(ends[1]) - float(ends[0])) / 1e6
    return (count - 1) / span if span >= SHORTEST_S else None
