"""Tables of comparisons and results for terminal, page and paper (CSV, Markdown, LaTeX)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Literal

from attlog.compare.comparison import Comparison, LogLine, Question
from attlog.compare.paired import Difference, Direction
from attlog.compare.wording import direction_word, favour_text, interval_text, own_value_text, signed_text
from attlog.core import files
from attlog.result import Result
from attlog.words.findings import shown_checks
from attlog.words.names import row_names
from attlog.words.numbers import counted, unit_sign
from attlog.words.table import TableColumn, main_table
from attlog.words.text import clean, escape_markdown

WEB_FOLDER = Path(__file__).parent / "web"
TableForm = Literal["md", "csv", "tex"]
TableCells = tuple[Sequence[str], Sequence[Sequence[str]]]
# Characters missing in LaTeX's fonts, replaced after its special characters were escaped.
LATEX_SIGNS: dict[str, str | int | None] = {
    "°": r"$^\circ$",
    "±": r"$\pm$",
    "−": r"$-$",
    "×": r"$\times$",
    "÷": r"$\div$",
    "√": r"$\sqrt{}$",
    "µ": r"$\mu$",
    "²": r"$^2$",
    "<": r"$<$",
    ">": r"$>$",
    "–": "--",
    "∞": r"$\infty$",
}


def table_text(form: TableForm, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table as CSV, Markdown or LaTeX."""
    return {"csv": table_csv, "md": table_markdown, "tex": table_latex}[form](head, rows)


def table_csv(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table as CSV; cells that a spreadsheet would execute are escaped."""
    return files.csv_text([head, *rows])


def table_markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    rule = "|" + " --- |" * len(head) + "\n"
    first, *others = ("| " + " | ".join(map(escape_markdown, line)) + " |\n" for line in [head, *rows])
    return "".join([first, rule, *others])


def table_latex(head: Sequence[str], rows: Sequence[Sequence[str]], caption: str | None = None) -> str:
    """Format a LaTeX tabular with booktabs rules, in a table environment if captioned."""
    import pandas

    frame = pandas.DataFrame([list(map(clean, row)) for row in rows], columns=list(map(clean, head)))
    columns = "l" + "r" * (len(head) - 1)
    text: str = frame.to_latex(index=False, escape=True, column_format=columns, caption=caption, position=None)
    return text.translate(str.maketrans(LATEX_SIGNS))


BEST_MARK, UNRANKED_MARK = "*", "~"


def analysis_rows(results: Sequence[Result], window: str = "all") -> tuple[list[str], list[list[str]]]:
    """Return titles and rows of ``analyze``, one row per filter and log.

    The log column is omitted for one log. Cells: value, half of its 95 % interval, ``*`` best, ``~`` not ranked.
    """
    tables = [(result, main_table(result, window, many=True)) for result in results]
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


def _column_title(column: TableColumn) -> str:
    return f"{column.title}, {column.unit}" if column.unit else column.title


SENSOR_COLUMNS = ["sensor", "question", "verdict", "value", "to set", "found"]


def sensor_rows(results: Sequence[Result]) -> tuple[list[str], list[list[str]]]:
    """Return titles and rows of ``health``, one row per check, worst first.

    The log column is omitted for one log.
    """
    several = len(results) > 1
    rows = []
    for result in results:
        log = [clean(str(result.log.get("name") or "log"))] if several else []
        for a in shown_checks(result.checks):
            rows.append([*log, a.sensor, a.question, a.verdict, a.value, a.to_set, a.text])
    return [*(["log"] if several else []), *SENSOR_COLUMNS], rows


@dataclass(frozen=True, slots=True)
class MatrixCell:
    """Change of one configuration to the first in a question, on one log or over all; None if it is not asked."""

    question: Question
    difference: Difference | None

    @property
    def direction(self) -> Direction | None:
        """Return the direction, None where no change is known."""
        return None if self.difference is None or self.difference.value is None else self.difference.direction

    @property
    def colour(self) -> str:
        """Return the direction that the page colours, empty for shares of a gate."""
        word = direction_word(self.question, self.direction)
        return word if word in ("better", "worse") else ""

    @property
    def reason(self) -> str:
        """Return why no change is known."""
        return "" if self.difference is None else self.difference.reason

    @property
    def change(self) -> str:
        """Return the change with its sign."""
        if self.difference is None or self.difference.value is None:
            return "–"
        return "0" if self.direction == "same" else signed_text(self.difference.value, self.question)

    @property
    def interval(self) -> str:
        """Return the interval of the change."""
        if self.difference is None or self.direction is None:
            return ""
        return "equal" if self.direction == "same" else interval_text(self.question, self.difference)

    @property
    def better(self) -> str:
        """Return on how many logs the configuration is better."""
        d = self.difference
        return "" if d is None or self.direction is None else f"{d.better} of {d.logs}"

    @property
    def count(self) -> str:
        """Return on how many of several logs the change has this sign."""
        d = self.difference
        if d is None or d.value is None or self.direction == "same" or d.logs < 2:
            return ""
        return f"{d.better if d.value < d.even else d.worse}/{d.logs}"

    @property
    def starred(self) -> str:
        """Return the change with a star where it is significant."""
        return f"{self.change}{'*' if self.direction in ('better', 'worse') else ' '}" if self.direction else ""


@dataclass(frozen=True, slots=True)
class MatrixRow:
    """One question: the first configuration's value, and the change of each other one."""

    question: Question
    value: str
    cells: list[MatrixCell]


def matrix(found: Comparison, line: LogLine | None = None) -> list[MatrixRow]:
    """Return one row per answered question, for one log or over all logs.

    Over all logs the first configuration's value is the median size.
    """
    rows = []
    for question in found.questions:
        if line is None:
            value = _median_text(found, question)
            differences = [c.over for c in question.contrasts]
            shown = any(d is not None for d in differences)
        else:
            own = question.cells.get(line.name, {}).get(found.first.name)
            value = own_value_text(None if own is None else own.value, question)
            differences = [next((d for d in c.logs if d.log == line.name), None) for c in question.contrasts]
            shown = bool(value) or any(d is not None and d.value is not None for d in differences)
        if shown:
            rows.append(MatrixRow(question, value, [MatrixCell(question, d) for d in differences]))
    return rows


def _median_text(found: Comparison, question: Question) -> str:
    own = [cells[found.first.name].value for cells in question.cells.values() if found.first.name in cells]
    known = [abs(v) for v in own if v is not None]
    return own_value_text(median(known), question).removeprefix("+") if known else ""


@dataclass(frozen=True, slots=True)
class TextTable:
    """Changes as text cells; ``reasons``: why a row has no difference."""

    title: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]
    caption: str = ""
    reasons: Sequence[str] = ()


def pooled_tables(found: Comparison, width: int) -> list[TextTable]:
    """Return the changes over all logs as tables.

    A single configuration has its interval; several are side by side, as many in a table as ``width`` columns hold. A
    star marks significance.
    """
    equal = (None, "same") if found.is_what_if else (None,)  # omits aids that rejected nothing
    main = any(q.main for q in found.questions)
    rows = [row for row in matrix(found) if any(c.direction not in equal for c in row.cells)]
    rows = [row for row in rows if row.question.main or not main]
    answering = len(found.used) - len(found.without_answer)
    where = f"{found.first.label}, {f'{answering} of ' if answering < len(found.logs) else ''}"
    where += counted(len(found.logs), "log")
    where += f" ({found.mode_text})" if found.mode_text else ""
    others = [c.label for c in found.configurations[1:]]
    lines: list[tuple[str, ...]]
    if not rows:
        return []
    if len(others) == 1:
        several = any(c.over is not None and c.over.logs > 1 for q in found.questions for c in q.contrasts)
        head = ("question", "change", "95 %", "significant", *["better"] * several)
        lines = [
            (row.question.title, c.change, c.interval, direction_word(row.question, c.direction) or "no")
            + (c.better,) * several
            for row, c in ((row, row.cells[0]) for row in rows)
        ]
        return [TextTable(f"{others[0]} beside {where}", head, lines)]
    columns = [(label, [row.cells[k].starred for row in rows]) for k, label in enumerate(others)]
    titles = [row.question.title for row in rows]
    made: list[TextTable] = []
    while columns:
        taken, used = 0, max(map(len, titles))
        for label, texts in columns:
            used += 2 + max(map(len, [label, *texts]))
            if taken and used > width:
                break
            taken += 1
        some, columns = columns[:taken], columns[taken:]
        lines = [(title, *(texts[i] for _, texts in some), "") for i, title in enumerate(titles)]
        titles_of = ("question", *(label for label, _ in some), "")
        made.append(TextTable(f"change beside {where}, * significant", titles_of, [r for r in lines if any(r[1:])]))
    return made


def comparison_tables(found: Comparison) -> list[TextTable]:
    """Return a table for each question and configuration after the first: a row per log, then all logs."""
    return [_comparison_table(found, q, c.configuration) for q in found.questions for c in q.contrasts]


def _comparison_table(found: Comparison, question: Question, name: str) -> TextTable:
    first, second = found.first.label, found.labels[name]
    contrast, unit = question.contrast(name), unit_sign(question.unit)
    own = (f"{label}{f', {unit}' if unit else ''}" for label in (first, second))
    head = ("log", *own, f"{second} to {first}", "95 %", "significant")
    rows, reasons = [], []
    for d in contrast.logs:
        cells = question.cells.get(d.log, {})
        values = [d.first, d.second]
        if d.value is None:
            values = [cells[n].value if n in cells else None for n in (found.first.name, name)]
        shown = [own_value_text(v, question) for v in values]
        rows.append((d.log, *shown, *_difference_cells(question, d, first, second)))
        reasons.append(d.reason)
    over = contrast.over
    if over is not None and over.logs > 1:
        part = over.logs < len(found.logs)
        label = f"{counted(over.logs, 'log')} of {len(found.logs)}" if part else f"all {over.logs} logs"
        rows.append((label, "", "", *_difference_cells(question, over, first, second)))
        reasons.append("")
    return TextTable(question.title, head, rows, _table_caption(question), reasons)


def _difference_cells(question: Question, found: Difference, first: str, second: str) -> tuple[str, str, str]:
    """Return change, interval, and the significantly better configuration with its margin."""
    if found.value is None:
        return "", "", "–"
    if found.direction == "same":
        return "0", "", "equal"
    if found.direction == "better":
        text = f"{second}: {favour_text(question, found)}"
    elif found.direction == "worse":
        text = f"{first}: {favour_text(question, found.inverse())}"
    else:
        on = f" ({second} better on {found.better} of {found.logs} logs)" if found.logs > 1 else ""
        text = f"not significant{on}"
    return signed_text(found.value, question), interval_text(question, found), text


def _table_caption(question: Question) -> str:
    where = " or ".join(question.windows[:2])
    what = {"rmse": "RMS of the typical block", "noise": "typical window of 5 s"}
    kind = next((text for part, text in what.items() if part in question.metric), "")
    return f"{question.metric}, {where}" + (f", {kind}" if kind else "")


COMPARISON_COLUMNS = (
    "metric window unit scale log configuration value low95 high95 n "
    "first first_value change change_low95 change_high95 p common_units direction reason"
).split()


def comparison_text(found: Comparison, form: TableForm) -> str:
    """Return the tables of a comparison in a form."""
    return {"csv": comparison_csv, "md": comparison_markdown, "tex": comparison_latex}[form](found)


def comparison_csv(found: Comparison) -> str:
    """Return one line per question, log and configuration, in full precision.

    ``(all)``: pooled over the logs.
    """
    lines: list[Sequence[object]] = [COMPARISON_COLUMNS]
    for q in found.questions:
        for log, cells in q.cells.items():
            by_name = {c.configuration: d for c in q.contrasts for d in c.logs if d.log == log}
            for name, a in cells.items():
                d = by_name.get(name)
                own = [q.metric, a.window, q.unit, q.scale, log, name, a.value, *(a.ci95 or (None, None)), a.n]
                lines.append([*own, *_change_columns(found, d, a.reason)])
        for c in q.contrasts:
            if c.over is not None:
                own = [q.metric, q.window, q.unit, q.scale, "(all)", c.configuration, "", "", "", c.over.logs]
                lines.append([*own, *_change_columns(found, c.over, c.over.method)])
    lines += [["", "", "", "", line.name, *[""] * 13, line.reason] for line in found.logs if line.code]
    return files.csv_text(lines)


def _change_columns(found: Comparison, d: Difference | None, reason: str) -> list[object]:
    if d is None:
        return [*[""] * 8, reason]
    ends = d.ci95 or (None, None)
    return [found.first.name, d.first, d.value, *ends, d.p, d.n, d.direction, d.reason or reason]


def comparison_markdown(found: Comparison) -> str:
    """Return sentences and tables as Markdown."""
    lines = [f"- {escape_markdown(said)}" for verdict in found.verdicts for said in (verdict.lead, *verdict.more)]
    for table in comparison_tables(found):
        lines += ["", f"**{escape_markdown(table.title)}** ({escape_markdown(table.caption)})", ""]
        lines.append(table_markdown(table.head, table.rows).rstrip())
    broken = [f"- {escape_markdown(f'{line.name}: {line.reason}')}" for line in found.logs if line.code]
    return "\n".join([*lines, *(["", "Not used:", "", *broken] if broken else [])]) + "\n"


def comparison_latex(found: Comparison) -> str:
    """Return tables for LaTeX with the package booktabs, one table environment each."""
    parts = ["% Tables of attlog compare; needs \\usepackage{booktabs}"]
    for table in comparison_tables(found):
        caption = f"{table.title} ({table.caption})".replace("_", r"\_").replace("%", r"\%")
        parts.append(table_latex(table.head, table.rows, caption))
    return "\n".join(parts)
