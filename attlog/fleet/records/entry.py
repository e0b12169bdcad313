"""What a batch knows of one log: enough for its index and its tables, so that no result is read again."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from attlog.base.plain import plain
from attlog.fleet.records import answers
from attlog.fleet.records.thumbnail import thumbnail
from attlog.fleet.records.trouble import reasons, trouble
from attlog.present.flight import firmware
from attlog.present.health import change
from attlog.present.names import row_names
from attlog.present.table.table import main_table
from attlog.result import MEASURED_TIMES, Answer, Result, Verdict, offered

FORM = 2
"""Grows when what stands in a row changes its meaning."""
HEAVY = "answers"
"""The one part that only tables need: most of a row's size."""


@dataclass(frozen=True, slots=True)
class Entry:
    """``log`` as it was given, ``name`` of its report without suffix, what became of it.

    ``code`` and ``message``: the exit code, and the sentence of a log that failed; ``row``: what
    :func:`index_row` made, None of a log that failed; ``gates``: a sentence for each gate that
    failed. ``known``: it failed like this in an earlier run.
    """

    log: str
    name: str
    code: int = 0
    message: str = ""
    row: dict[str, Any] | None = None
    gates: tuple[str, ...] = ()
    known: bool = False


def index_row(result: Result) -> dict[str, Any]:
    """Everything that the index and the tables of a batch tell of one log, as plain JSON values.

    The same log, version and configuration give the same row: measured times stay out. ``headline``: what happened;
    ``flight``: what flew, when, how long (s); ``rows``: every row of the comparison by id; ``verdicts``: the four
    sentences with their numbers; ``trouble``: see :func:`attlog.fleet.records.trouble.trouble`; ``columns``: the
    columns of the comparison with their values by row; ``thumbnail``: the flight at a glance, None where the result
    holds no traces; ``sensors``: how many assessments are faults and warnings, and what to set; ``answers``: every
    metric, see :func:`attlog.fleet.records.answers.packed`.
    """
    row: dict[str, Any] = plain(
        {
            "form": FORM,
            "headline": result.headline,
            "flight": _flight(result),
            "rows": _rows(result),
            "verdicts": [_verdict(v) for v in result.verdicts],
            "trouble": trouble(reasons(result)),
            "columns": _columns(result),
            "thumbnail": thumbnail(result),
            "sensors": _sensors(result),
            HEAVY: answers.packed(result),
        }
    )
    return row


def light(row: dict[str, Any]) -> dict[str, Any]:
    """A row without the part that only tables need: a tenth of its size, for those who hold many in memory."""
    return {key: value for key, value in row.items() if key != HEAVY}


def sensors_of(row: dict[str, Any]) -> dict[str, Any]:
    """What a row tells of sensors: ``faults``, ``warnings``, ``to_set``; nothing is off in one of an older version."""
    found: dict[str, Any] = {"faults": 0, "warnings": 0, "to_set": []} | (row.get("sensors") or {})
    return found


def _flight(result: Result) -> dict[str, Any]:
    log = result.log
    seconds = log.get("seconds") or {}
    said = log.get("firmware") or {}
    return {
        "name": log.get("name"),
        "sha256": log.get("sha256"),
        "date_utc": log.get("date_utc"),
        "firmware": firmware(result).partition(" on ")[0],
        "autopilot": said.get("name"),
        "version": said.get("version"),
        "board": said.get("board"),
        "vehicle": log.get("vehicle"),
        "simulated": bool(log.get("simulated")),
        "format": log.get("format"),
        "duration_s": log.get("duration_s"),
        "airborne_s": seconds.get("airborne"),
        "rest_s": seconds.get("rest"),
        "reference": result.reference.choice if result.reference else None,
        "attlog": result.attlog.get("version"),
        "schema": result.schema,
    }


def _sensors(result: Result) -> dict[str, Any]:
    verdicts = Counter(assessment.verdict for assessment in result.health)
    settings = [str(change(setting)) for setting in offered(result.health)]
    return {"faults": verdicts["fault"], "warnings": verdicts["warning"], "to_set": settings}


def _rows(result: Result) -> dict[str, dict[str, Any]]:
    names = row_names(result)
    return {
        r.name: {
            "name": names[r.name],
            "kind": r.kind,
            "estimator": r.estimator,
            "status": r.status,
            "reason": r.reason,
            "is_reference": r.is_reference,
        }
        for r in result.estimators
    }


def _verdict(verdict: Verdict) -> dict[str, Any]:
    """The sentence and the numbers that its card shows; ``bars``: [row, value, unit]."""
    return {
        "question": verdict.question,
        "sentence": verdict.sentence,
        "metric": verdict.metric,
        "window": verdict.window,
        "bars": [list(bar) for bar in verdict.bars],
    }


def _columns(result: Result) -> list[dict[str, Any]]:
    """The comparison's columns: title, metric, window, unit, and row -> value, or the code why there is none."""
    found = []
    for heading in main_table(result).columns:
        if heading.metric in MEASURED_TIMES:
            continue
        cells = {r.name: r.metrics.get(heading.window, {}).get(heading.metric) for r in result.estimators}
        values = {name: _short(answer) for name, answer in cells.items() if answer is not None}
        unit = next(a.unit for a in cells.values() if a is not None and a.value is not None)
        found.append(
            {"title": heading.title, "metric": heading.metric, "window": heading.window, "unit": unit, "values": values}
        )
    return found


def _short(answer: Answer) -> float | str | None:
    return answer.code if answer.value is None else float(f"{answer.value:.6g}")
