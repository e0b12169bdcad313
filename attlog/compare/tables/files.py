"""A table as a file for a paper or a spreadsheet: CSV, Markdown or LaTeX, by the file's suffix."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from attlog.base import spreadsheet
from attlog.base.errors import UsageError
from attlog.present.table.markdown import escaped
from attlog.present.text import CONTROL

SUFFIXES = (".csv", ".md", ".tex")
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


def check_suffix(path: Path) -> None:
    """UsageError for a file that is of no known kind."""
    if path.suffix.lower() not in SUFFIXES:
        raise UsageError(f"--table {path}: end its name with {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}")


def text(path: Path, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table as the file's name asks for it. UsageError for an unknown suffix."""
    check_suffix(path)
    return {".csv": csv_text, ".md": markdown, ".tex": latex}[path.suffix.lower()](head, rows)


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
