"""A table for a paper or a spreadsheet: CSV, Markdown or LaTeX."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from attlog.base.files import spreadsheet
from attlog.present.table.markdown import escaped
from attlog.present.text import CONTROL

TableForm = Literal["md", "csv", "tex"]
LATEX = {
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


def text(form: TableForm, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in this form."""
    return {"csv": csv_text, "md": markdown, "tex": latex}[form](head, rows)


def csv_text(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The table as CSV."""
    return spreadsheet.csv_text([head, *rows])


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The table in Markdown."""
    rule = "|" + " --- |" * len(head) + "\n"
    first, *others = ("| " + " | ".join(map(escaped, line)) + " |\n" for line in [head, *rows])
    return "".join([first, rule, *others])


def latex(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The table as a LaTeX tabular with the rules of booktabs."""

    def line(cells: Sequence[str]) -> str:
        return "  " + " & ".join(map(in_latex, cells)) + " \\\\\n"

    columns = "l" + "r" * (len(head) - 1)
    body = "".join(map(line, rows))
    whole = f"  \\toprule\n{line(head)}  \\midrule\n{body}  \\bottomrule\n"
    return f"\\begin{{tabular}}{{{columns}}}\n{whole}\\end{{tabular}}\n"


def in_latex(text: str) -> str:
    """A text with the signs that LaTeX reads otherwise, or not at all, as it writes them."""
    return "".join(LATEX.get(c, c) for c in CONTROL.sub(" ", " ".join(text.splitlines())))
