"""One answer as a cell: its number and interval, or a word for what is missing; best, or shown but not ranked."""

from __future__ import annotations

from dataclasses import dataclass

from attlog.present.contest import RankedValue, why_unranked
from attlog.present.names import CODES
from attlog.present.numbers import SIGNED, bracketed, half_width, number
from attlog.present.table.columns import TableColumn
from attlog.present.table.rows import has_value, is_best, is_ranked, value_of
from attlog.present.text import typeset
from attlog.result import Answer, EstimatorRow, Result

FULL_COVERAGE = 95.0


@dataclass(slots=True)
class TableCell:
    """One value as it is shown.

    ``small`` stands below the number (interval, share of the time), ``half`` is half of
    the interval for one line, ``brief`` the text where there is little room. ``sort`` is
    None where there is nothing to sort by.
    """

    text: str
    small: tuple[str, ...] = ()
    half: str = ""
    brief: str = ""
    missing: bool = False
    best: bool = False
    unranked: bool = False
    reason: str = ""
    sort: float | None = None


def cell(result: Result, row: EstimatorRow, column: TableColumn, window: str) -> TableCell:
    """The cell of a row in a column, which has one window for all rows."""
    answer = row.metrics.get(window, {}).get(column.metric)
    if answer is None:
        word = "failed" if row.status == "failed" else "n/a"
        return TableCell(word, brief=word, missing=True, reason=row.reason)
    if not has_value(answer):
        return without_value(row, column.metric, answer)
    ranked = is_ranked(result, row, column.metric, window)
    return TableCell(
        number(answer.value, answer.unit),
        tuple(x for x in (bracketed(answer.ci95, answer.unit), share(answer)) if x),
        half=half_width(answer.ci95, answer.unit) if answer.unit in SIGNED else "",
        brief=number(answer.value, answer.unit),
        best=column.contest and is_best(result, row, column.metric, window),
        unranked=row.kind == "replay" and column.contest and not ranked,
        reason=typeset(why_unranked(RankedValue(row, answer, ranked)) if row.kind == "replay" and not ranked else ""),
        sort=distance(result, column.metric, answer),
    )


def without_value(row: EstimatorRow, metric: str, answer: Answer) -> TableCell:
    """The cell of an answer that is not there: a word, and the reason; a filter that lost its way says so first."""
    if row.kind == "replay" and row.status == "failed":
        return TableCell("failed", brief="failed", missing=True, reason=row.reason)
    itself = row.is_reference and answer.code == "not_applicable" and not metric.startswith("cost")
    word, brief = ("reference", "ref") if itself else CODES.get(answer.code or "", ("n/a", "n/a"))
    return TableCell(word, brief=brief, missing=True, reason=answer.reason or "")


def share(answer: Answer) -> str:
    """Which part of the time could be compared, ``of 62 %``; empty where (nearly) all of it."""
    coverage = answer.coverage_pct
    return f"of {coverage:.0f} %" if coverage is not None and coverage < FULL_COVERAGE else ""


def distance(result: Result, metric: str, answer: Answer) -> float:
    """What a column is sorted by: how far the value is from the best there is."""
    better = result.definitions.get(metric, {}).get("better") or ("zero" if answer.unit in SIGNED else "low")
    value = value_of(answer)
    return {"zero": abs(value), "one": abs(value - 1.0)}.get(better, value)
