"""The tables of a comparison as files for papers: CSV, LaTeX (booktabs) and Markdown, for ``--format``."""

from __future__ import annotations

from attlog.base.files import spreadsheet
from attlog.compare.differences.comparison import Comparison
from attlog.compare.tables import files as table_file
from attlog.compare.tables.files import TableForm, in_latex
from attlog.compare.tables.table import tables
from attlog.present.table.markdown import escaped


def text(found: Comparison, form: TableForm) -> str:
    """The tables of a comparison in this form."""
    return {"csv": numbers, "md": markdown, "tex": latex}[form](found)


def numbers(found: Comparison) -> str:
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
    return spreadsheet.csv_text(lines)


def markdown(found: Comparison) -> str:
    """Sentences and tables as Markdown."""
    parts = [said for verdict in found.verdicts for said in (verdict.lead, *verdict.more)]
    lines = [f"- {escaped(said)}" for said in parts]
    for table in tables(found):
        lines += ["", f"**{escaped(table.title)}** ({escaped(table.caption)})", ""]
        lines.append(table_file.markdown(table.head, table.rows).rstrip())
    broken = [f"{line.name}: {line.reason}" for line in found.logs if line.code]
    if broken:
        lines += ["", "Not used:", "", *(f"- {escaped(b)}" for b in broken)]
    return "\n".join(lines) + "\n"


def latex(found: Comparison) -> str:
    """Tables for LaTeX with the package booktabs, one table environment each."""
    parts = ["% Tables of attlog compare; needs \\usepackage{booktabs}"]
    for table in tables(found):
        caption = in_latex(f"{table.title} ({table.caption})")
        tabular = table_file.latex(table.head, table.rows)
        parts.append(f"\\begin{{table}}\n\\centering\n\\caption{{{caption}}}\n{tabular}\\end{{table}}\n")
    return "\n".join(parts)
