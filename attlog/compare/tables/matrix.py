"""A comparison as one table: a row for each question, a column for each configuration; of all logs, and of each."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median

from attlog.compare.differences.comparison import Comparison, LogDifference, LogLine, PooledDifference, Question
from attlog.compare.differences.paired import Direction
from attlog.compare.differences.wording import directed, signed, span, value
from attlog.present.numbers import unit_sign


@dataclass(frozen=True, slots=True)
class MatrixCell:
    """A change to the first configuration: ``note`` holds its interval and on how many logs it has that sign.

    ``direction`` is None where there is no change; ``reason`` says why.
    """

    change: str
    note: str = ""
    direction: Direction | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Matrix:
    """``head``: the question, the first configuration's value, the change to it of every other one.

    ``rows``: title, value, changes.
    """

    head: tuple[str, ...]
    rows: list[tuple[str, str, list[MatrixCell]]]

    @property
    def reasons(self) -> list[str]:
        """Why cells are empty, each reason once."""
        return list(dict.fromkeys(cell.reason for _, _, cells in self.rows for cell in cells if cell.reason))


def over_all(found: Comparison) -> Matrix:
    """All logs together; the first configuration's value is its median over the logs."""
    rows = []
    for question in found.questions:
        overs = [c.over for c in question.contrasts]
        if any(over is not None for over in overs):
            cells = [MatrixCell("–") if over is None else _cell(question, over) for over in overs]
            rows.append((_titled(question), first_value(found, question), cells))
    return Matrix(_head(found, ", median" if len(found.logs) > 1 else ""), rows)


def of_log(found: Comparison, line: LogLine) -> Matrix:
    """One log."""
    rows = []
    for question in found.questions:
        each = [next((b for b in c.logs if b.log == line.name), None) for c in question.contrasts]
        own = question.cells.get(line.name, {}).get(found.configurations[0].name)
        shown = value(None if own is None else own.value, question)
        if shown or any(b is not None and b.value is not None for b in each):
            cells = [MatrixCell("–") if b is None else _cell(question, b) for b in each]
            rows.append((_titled(question), shown, cells))
    return Matrix(_head(found, ""), rows)


def first_value(found: Comparison, question: Question) -> str:
    """The median over the logs of the first configuration's own values, by their size."""
    first = found.configurations[0].name
    own = [cells[first].value for cells in question.cells.values() if first in cells]
    known = [abs(v) for v in own if v is not None]
    return value(median(known), question).removeprefix("+") if known else ""


def _head(found: Comparison, after: str) -> tuple[str, ...]:
    first, *others = (c.label for c in found.configurations)
    return ("question", first + after, *others)


def _titled(question: Question) -> str:
    unit = unit_sign(question.unit)
    return f"{question.title}, {unit}" if unit else question.title


def _cell(question: Question, found: LogDifference | PooledDifference) -> MatrixCell:
    view = directed(question, found)
    if view is None:
        return MatrixCell("–", reason=found.reason if isinstance(found, LogDifference) else "")
    if view.direction == "same":
        return MatrixCell("0", "equal", "same")
    count = f"{view.better if view.value < _even(question) else view.worse}/{view.logs}" if view.logs > 1 else ""
    interval = f"[{span(view).replace(' to ', ', ')}]" if view.ci95 else ""
    return MatrixCell(signed(view.value, question), f"{interval} {count}".strip(), view.direction)


def _even(question: Question) -> float:
    return 1.0 if question.scale == "ratio" else 0.0
