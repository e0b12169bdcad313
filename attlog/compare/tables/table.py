"""The tables of a comparison: for each question a row per log and one for all of them, as plain cells."""

from __future__ import annotations

from dataclasses import dataclass

from attlog.compare.differences.comparison import Comparison, LogDifference, PooledDifference, Question
from attlog.compare.differences.wording import DirectedDifference, directed, favour, signed, span, value
from attlog.present.numbers import counted, unit_sign


@dataclass(frozen=True, slots=True)
class ComparisonTable:
    """One question against one configuration. ``head`` and ``rows`` have as many cells; the last row is all logs."""

    question: Question
    configuration: str
    title: str
    caption: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]
    reasons: list[str]
    """Beside each row why it has no difference, or empty."""


def tables(found: Comparison) -> list[ComparisonTable]:
    """A table for each question and each configuration after the first."""
    return [_table(found, q, c.configuration) for q in found.questions for c in q.contrasts]


SIGNIFICANT = {"better": "better", "worse": "worse", "same": "equal"}


@dataclass(frozen=True, slots=True)
class PooledTable:
    """All questions against one configuration over all logs, in few words; ``rows`` have as many cells as ``head``.

    The last cell says on how many logs, significant or not, the second is better.
    """

    title: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]


def pooled_tables(found: Comparison) -> list[PooledTable]:
    """A table for each configuration after the first: the change in each question that has a difference."""
    called = {c.name: c.label for c in found.configurations}
    made = []
    for name in list(called)[1:]:
        rows: list[tuple[str, ...]] = []
        for question in found.questions:
            view = _view(question, name)
            if view is not None:
                change = ("0", "") if view.direction == "same" else (signed(view.value, question), span(view))
                better = f"{view.better} of {view.logs}"
                rows.append((question.title, *change, SIGNIFICANT.get(view.direction, "no"), better))
        head = ("question", "change", "95 %", "significant", "better")
        title = f"{called[name]} beside {called[found.configurations[0].name]}, {counted(len(found.logs), 'log')}"
        made += [PooledTable(title, head, rows)] if rows else []
    return made


def side_by_side(found: Comparison, width: int) -> list[PooledTable]:
    """The changes of all configurations after the first beside each other, as many a table as ``width`` columns hold.

    A star marks what is significant.
    """
    called = {c.name: c.label for c in found.configurations}
    titles = [question.title for question in found.questions]
    columns: list[tuple[str, list[str]]] = []
    for name in list(called)[1:]:
        views = [_view(question, name) for question in found.questions]
        cells = ["" if v is None else f"{signed(v.value, v.question)}{_star(v.direction)}" for v in views]
        columns.append((called[name], cells))
    first, end = max(map(len, titles), default=0), f"beside {called[found.configurations[0].name]}"
    made: list[PooledTable] = []
    while columns:
        taken, used = 0, first
        while taken < len(columns) and used + 2 + max(map(len, [columns[taken][0], *columns[taken][1]])) <= width:
            used += 2 + max(map(len, [columns[taken][0], *columns[taken][1]]))
            taken += 1
        some, columns = columns[: max(taken, 1)], columns[max(taken, 1) :]
        rows = [(title, *(cells[i] for _, cells in some), "") for i, title in enumerate(titles)]
        title = f"change {end}, {counted(len(found.logs), 'log')}, * significant"
        made.append(
            PooledTable(title, ("question", *(label for label, _ in some), ""), [r for r in rows if any(r[1:])])
        )
    return made


def _view(question: Question, name: str) -> DirectedDifference | None:
    over = next((c.over for c in question.contrasts if c.configuration == name), None)
    return None if over is None else directed(question, over)


def _star(direction: str) -> str:
    return "*" if direction in ("better", "worse") else " "


def _table(found: Comparison, question: Question, name: str) -> ComparisonTable:
    called = {c.name: c.label for c in found.configurations}
    first = found.configurations[0].name
    contrast = next(c for c in question.contrasts if c.configuration == name)
    unit = unit_sign(question.unit)
    change = f"{called[name]} to {called[first]}"
    head = ("log", *(f"{called[n]}{f', {unit}' if unit else ''}" for n in (first, name)), change, "95 %", "significant")
    rows, reasons = [], []
    for beside in contrast.logs:
        cells = question.cells.get(beside.log, {})
        values = (beside.first, beside.second)
        if beside.value is None:
            values = tuple(cells[n].value if n in cells else None for n in (first, name))  # type: ignore[assignment]
        rows.append(
            (
                beside.log,
                *(value(v, question) for v in values),
                *_difference_cells(question, beside, called[first], called[name]),
            )
        )
        reasons.append(beside.reason)
    if contrast.over is not None and contrast.over.logs > 1:
        over = contrast.over
        label = (
            f"{counted(over.logs, 'log')} of {len(found.logs)}"
            if over.logs < len(found.logs)
            else f"all {over.logs} logs"
        )
        rows.append((label, "", "", *_difference_cells(question, over, called[first], called[name])))
        reasons.append("")
    return ComparisonTable(question, name, question.title, _caption(question), head, rows, reasons)


def _difference_cells(
    question: Question, found: LogDifference | PooledDifference, first: str, second: str
) -> tuple[str, str, str]:
    """Change, interval, and who is significantly better by how much."""
    view = directed(question, found)
    if view is None:
        return "", "", "–"
    if view.direction == "same":
        return "0", "", "equal"
    winner = {"better": second, "worse": first}.get(view.direction)
    text = "not significant" if winner is None else f"{winner}: {favour(view if winner == second else view.turned)}"
    if view.logs > 1 and winner is None:
        text += f" ({second} better on {view.better} of {view.logs} logs)"
    return signed(view.value, question), span(view), text


def _caption(question: Question) -> str:
    where = " or ".join(question.windows[:2]) if len(question.windows) > 1 else question.windows[0]
    what = {"rmse": "RMS of the typical block", "noise": "typical window of 5 s"}
    kind = next((text for part, text in what.items() if part in question.metric), "")
    return f"{question.metric}, {where}" + (f", {kind}" if kind else "")
