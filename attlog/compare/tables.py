"""A table for a paper or a spreadsheet: CSV, Markdown or LaTeX."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Literal

from attlog.compare.comparison import Comparison, LogDifference, LogLine, PooledDifference, Question
from attlog.compare.paired import Direction
from attlog.compare.wording import (
    DirectedDifference,
    direct_difference,
    favour_text,
    interval_text,
    own_value_text,
    signed_text,
)
from attlog.core import files
from attlog.result import Result
from attlog.words.findings import shown_assessments
from attlog.words.names import row_names
from attlog.words.numbers import counted, unit_sign
from attlog.words.table import ColumnHeading, main_table
from attlog.words.text import CONTROL, clean, escape_markdown

TableForm = Literal["md", "csv", "tex"]
LATEX_SIGNS = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "°": r"$^\circ$",
    "±": r"$\pm$",
    "−": r"$-$",
    "×": r"$\times$",
    "√": r"$\sqrt{}$",
    "µ": r"$\mu$",
    "²": r"$^2$",
    "<": r"$<$",
    ">": r"$>$",
    "–": "--",
    "∞": r"$\infty$",
}


def table_text(form: TableForm, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in this form."""
    return {"csv": table_csv, "md": table_markdown, "tex": table_latex}[form](head, rows)


def table_csv(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The table as CSV."""
    return files.csv_text([head, *rows])


def table_markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The table in Markdown."""
    rule = "|" + " --- |" * len(head) + "\n"
    first, *others = ("| " + " | ".join(map(escape_markdown, line)) + " |\n" for line in [head, *rows])
    return "".join([first, rule, *others])


def table_latex(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The table as a LaTeX tabular with the rules of booktabs."""

    def line(cells: Sequence[str]) -> str:
        return "  " + " & ".join(map(latex_escaped, cells)) + " \\\\\n"

    columns = "l" + "r" * (len(head) - 1)
    body = "".join(map(line, rows))
    whole = f"  \\toprule\n{line(head)}  \\midrule\n{body}  \\bottomrule\n"
    return f"\\begin{{tabular}}{{{columns}}}\n{whole}\\end{{tabular}}\n"


def latex_escaped(text: str) -> str:
    """A text with the signs that LaTeX reads otherwise, or not at all, as it writes them."""
    return "".join(LATEX_SIGNS.get(c, c) for c in CONTROL.sub(" ", " ".join(text.splitlines())))


# The table of ``attlog analyze`` for a paper: a row for each filter of each log, the columns of all logs together.

BEST_MARK, UNRANKED_MARK = "*", "~"


def analysis_rows(results: Sequence[Result], window: str = "all") -> tuple[list[str], list[list[str]]]:
    """Titles and rows: value, half of its 95 % interval where it has one, ``*`` best, ``~`` shown but not ranked.

    The column of the log is left out where there is one log only.
    """
    tables = [(result, main_table(result, window)) for result in results]
    titles = list(dict.fromkeys(_column_title(c) for _, table in tables for c in table.columns))
    rows = []
    for result, table in tables:
        names = row_names(result)
        for row, cells in table.rows:
            by = {
                _column_title(c): " ".join(p for p in (cell.text, "" if cell.missing else cell.half) if p)
                + (BEST_MARK if cell.best else UNRANKED_MARK if cell.unranked and not cell.missing else "")
                for c, cell in zip(table.columns, cells, strict=True)
            }
            log = [clean(str(result.log.get("name") or "log"))] if len(results) > 1 else []
            rows.append([*log, clean(names[row.name]), *(clean(by.get(title, "")) for title in titles)])
    return [*(["log"] if len(results) > 1 else []), "filter", *titles], rows


def _column_title(column: ColumnHeading) -> str:
    return f"{column.title}, {column.unit}" if column.unit else column.title


# The table of ``attlog health`` for a paper or a spreadsheet: a row for each assessment of each log, worst first.

SENSOR_COLUMNS = ["sensor", "question", "verdict", "value", "to set", "found"]


def sensor_rows(results: Sequence[Result]) -> tuple[list[str], list[list[str]]]:
    """Titles and rows; the column of the log is left out where there is one log only."""
    several = len(results) > 1
    rows = []
    for result in results:
        log = [clean(str(result.log.get("name") or "log"))] if several else []
        for a in shown_assessments(result.health):
            rows.append([*log, a.sensor, a.question, a.verdict, a.value, a.to_set, a.text])
    return [*(["log"] if several else []), *SENSOR_COLUMNS], rows


# A comparison as one table: a row for each question, a column for each configuration; of all logs, and of each.


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


def matrix_over_logs(found: Comparison) -> Matrix:
    """All logs together; the first configuration's value is its median over the logs."""
    rows = []
    for question in found.questions:
        overs = [c.over for c in question.contrasts]
        if any(over is not None for over in overs):
            cells = [MatrixCell("–") if over is None else _matrix_cell(question, over) for over in overs]
            rows.append((_question_title(question), first_median_text(found, question), cells))
    return Matrix(_matrix_head(found, ", median" if len(found.logs) > 1 else ""), rows)


def matrix_of_log(found: Comparison, line: LogLine) -> Matrix:
    """One log."""
    rows = []
    for question in found.questions:
        each = [next((b for b in c.logs if b.log == line.name), None) for c in question.contrasts]
        own = question.cells.get(line.name, {}).get(found.configurations[0].name)
        shown = own_value_text(None if own is None else own.value, question)
        if shown or any(b is not None and b.value is not None for b in each):
            cells = [MatrixCell("–") if b is None else _matrix_cell(question, b) for b in each]
            rows.append((_question_title(question), shown, cells))
    return Matrix(_matrix_head(found, ""), rows)


def first_median_text(found: Comparison, question: Question) -> str:
    """The median over the logs of the first configuration's own values, by their size."""
    first = found.configurations[0].name
    own = [cells[first].value for cells in question.cells.values() if first in cells]
    known = [abs(v) for v in own if v is not None]
    return own_value_text(median(known), question).removeprefix("+") if known else ""


def _matrix_head(found: Comparison, after: str) -> tuple[str, ...]:
    first, *others = (c.label for c in found.configurations)
    return ("question", first + after, *others)


def _question_title(question: Question) -> str:
    unit = unit_sign(question.unit)
    return f"{question.title}, {unit}" if unit else question.title


def _matrix_cell(question: Question, found: LogDifference | PooledDifference) -> MatrixCell:
    view = direct_difference(question, found)
    if view is None:
        return MatrixCell("–", reason=found.reason if isinstance(found, LogDifference) else "")
    if view.direction == "same":
        return MatrixCell("0", "equal", "same")
    count = (
        f"{view.better if view.value < _no_difference(question) else view.worse}/{view.logs}" if view.logs > 1 else ""
    )
    interval = f"[{interval_text(view).replace(' to ', ', ')}]" if view.ci95 else ""
    return MatrixCell(signed_text(view.value, question), f"{interval} {count}".strip(), view.direction)


def _no_difference(question: Question) -> float:
    return 1.0 if question.scale == "ratio" else 0.0


# The tables of a comparison: for each question a row per log and one for all of them, as plain cells.


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


def comparison_tables(found: Comparison) -> list[ComparisonTable]:
    """A table for each question and each configuration after the first."""
    return [_comparison_table(found, q, c.configuration) for q in found.questions for c in q.contrasts]


SIGNIFICANT_WORDS = {"better": "better", "worse": "worse", "same": "equal"}


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
            view = _pooled_view(question, name)
            if view is not None:
                change = (
                    ("0", "") if view.direction == "same" else (signed_text(view.value, question), interval_text(view))
                )
                better = f"{view.better} of {view.logs}"
                rows.append((question.title, *change, SIGNIFICANT_WORDS.get(view.direction, "no"), better))
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
        views = [_pooled_view(question, name) for question in found.questions]
        cells = [
            "" if v is None else f"{signed_text(v.value, v.question)}{_star_if_significant(v.direction)}" for v in views
        ]
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


def _pooled_view(question: Question, name: str) -> DirectedDifference | None:
    over = next((c.over for c in question.contrasts if c.configuration == name), None)
    return None if over is None else direct_difference(question, over)


def _star_if_significant(direction: str) -> str:
    return "*" if direction in ("better", "worse") else " "


def _comparison_table(found: Comparison, question: Question, name: str) -> ComparisonTable:
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
                *(own_value_text(v, question) for v in values),
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
    return ComparisonTable(question, name, question.title, _table_caption(question), head, rows, reasons)


def _difference_cells(
    question: Question, found: LogDifference | PooledDifference, first: str, second: str
) -> tuple[str, str, str]:
    """Change, interval, and who is significantly better by how much."""
    view = direct_difference(question, found)
    if view is None:
        return "", "", "–"
    if view.direction == "same":
        return "0", "", "equal"
    winner = {"better": second, "worse": first}.get(view.direction)
    text = (
        "not significant" if winner is None else f"{winner}: {favour_text(view if winner == second else view.turned)}"
    )
    if view.logs > 1 and winner is None:
        text += f" ({second} better on {view.better} of {view.logs} logs)"
    return signed_text(view.value, question), interval_text(view), text


def _table_caption(question: Question) -> str:
    where = " or ".join(question.windows[:2]) if len(question.windows) > 1 else question.windows[0]
    what = {"rmse": "RMS of the typical block", "noise": "typical window of 5 s"}
    kind = next((text for part, text in what.items() if part in question.metric), "")
    return f"{question.metric}, {where}" + (f", {kind}" if kind else "")


# The tables of a comparison as files for papers: CSV, LaTeX (booktabs) and Markdown, for ``--format``.


def comparison_text(found: Comparison, form: TableForm) -> str:
    """The tables of a comparison in this form."""
    return {"csv": comparison_csv, "md": comparison_markdown, "tex": comparison_latex}[form](found)


def comparison_csv(found: Comparison) -> str:
    """CSV: one line for each question, log and configuration, in full precision; the last of each are all logs."""
    lines: list[list[object]] = [
        [
            "metric",
            "window",
            "unit",
            "scale",
            "log",
            "configuration",
            "value",
            "low95",
            "high95",
            "n",
            "first",
            "first_value",
            "change",
            "change_low95",
            "change_high95",
            "p",
            "common_units",
            "direction",
            "reason",
        ]
    ]
    first = found.configurations[0].name
    for q in found.questions:
        for log, cells in q.cells.items():
            beside = {c.configuration: b for c in q.contrasts for b in c.logs if b.log == log}
            for name, cell in cells.items():
                b = beside.get(name)
                low, high = cell.ci95 or (None, None)
                row: list[object] = [q.metric, cell.window, q.unit, q.scale, log, name, cell.value, low, high, cell.n]
                if b is not None:
                    ends = b.ci95 or (None, None)
                    row += [first, b.first, b.value, *ends, b.p, b.n, b.direction, b.reason or cell.reason]
                else:
                    row += ["", "", "", "", "", "", "", "", cell.reason]
                lines.append(row)
        for c in q.contrasts:
            if c.over is not None:
                o, window = c.over, q.windows[0]
                ends = o.ci95 or (None, None)
                row = [q.metric, window, q.unit, q.scale, "(all)", c.configuration, "", "", "", o.logs, first, ""]
                lines.append([*row, o.value, *ends, o.p, o.logs, o.direction, o.method])
    for line in found.logs:
        if line.code:
            lines.append(["", "", "", "", line.name, *[""] * 13, line.reason])
    return files.csv_text(lines)


def comparison_markdown(found: Comparison) -> str:
    """Sentences and tables as Markdown."""
    parts = [said for verdict in found.verdicts for said in (verdict.lead, *verdict.more)]
    lines = [f"- {escape_markdown(said)}" for said in parts]
    for table in comparison_tables(found):
        lines += ["", f"**{escape_markdown(table.title)}** ({escape_markdown(table.caption)})", ""]
        lines.append(table_markdown(table.head, table.rows).rstrip())
    broken = [f"{line.name}: {line.reason}" for line in found.logs if line.code]
    if broken:
        lines += ["", "Not used:", "", *(f"- {escape_markdown(b)}" for b in broken)]
    return "\n".join(lines) + "\n"


def comparison_latex(found: Comparison) -> str:
    """Tables for LaTeX with the package booktabs, one table environment each."""
    parts = ["% Tables of attlog compare; needs \\usepackage{booktabs}"]
    for table in comparison_tables(found):
        caption = latex_escaped(f"{table.title} ({table.caption})")
        tabular = table_latex(table.head, table.rows)
        parts.append(f"\\begin{{table}}\n\\centering\n\\caption{{{caption}}}\n{tabular}\\end{{table}}\n")
    return "\n".join(parts)
