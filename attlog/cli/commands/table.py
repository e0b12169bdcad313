"""``attlog table``: numbers across the logs of a batch."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog import __version__
from attlog.cli.logs import end
from attlog.cli.options import OneFile
from attlog.cli.printing import TextLine, console, say, table, to_stderr
from attlog.core import files
from attlog.core.errors import LogUnusable, OutputError, UsageError, error_message

if TYPE_CHECKING:
    from attlog.batch.across import Across, Column

FORMATS = ("md", "csv", "tex", "parquet")
DEFAULT = "tilt_rmse_deg"


def command(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="DIR|RESULT.json...",
            show_default=False,
            help="Read these folders of batch or analyze, or single results; the newest result of a log counts.",
        ),
    ],
    metric: Annotated[
        list[str] | None,
        typer.Option(metavar="M[@WINDOW]", help=f"Show these metrics, with commas. [default: {DEFAULT}]"),
    ] = None,
    row: Annotated[
        list[str] | None,
        typer.Option(
            "--row",
            "--estimators",
            metavar="NAME|PATTERN",
            help="Show these filters and onboard sources, with commas. [default: all]",
        ),
    ] = None,
    window: Annotated[
        str | None, typer.Option(metavar="W", help="Show the numbers of this window. [default: as in the report]")
    ] = None,
    by: Annotated[
        str | None,
        typer.Option(
            metavar="GROUP",
            help="Show a line for each firmware, version, vehicle, board, reference, batch, month, year or attlog (its"
            " version), with median and quartiles. [default: a line for each log]",
        ),
    ] = None,
    form: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="|".join(FORMATS),
            help="Write the table in this format. [default: by -o, or for reading]",
        ),
    ] = None,
    output: OneFile = None,
) -> None:
    """Show one number of many logs.

    It stands in their results. Each log is a line, each filter a column; median and quartiles stand below.

    Example: attlog table reports --metric heading_rmse_deg --by firmware
    """
    from attlog.batch.across import BY, across
    from attlog.batch.results_file import EntryCollection

    kind = _format(form, output)
    if by is not None and by not in BY:
        raise UsageError(f"--by {by}: use {', '.join(BY[:-1])} or {BY[-1]}")
    asked = _listed(metric) or [DEFAULT]
    gathered = EntryCollection(results, [m.partition("@")[0] for m in asked])
    found = across(gathered, asked, _listed(row), window, by)
    for error in gathered.wrong:
        to_stderr(error_message(error, __version__))
    if not found.logs and not gathered.wrong:
        raise LogUnusable(f"{results[0]}: no log of it was analysed; {gathered.failed} failed")
    if found.logs:
        _notes(found, gathered.failed)
        _write(found, by, kind, output)
    end(gathered.wrong)


def _listed(options: list[str] | None) -> list[str]:
    return [word.strip() for option in options or () for word in option.split(",") if word.strip()]


def _format(form: str | None, output: Path | None) -> str:
    """How the table is written: as asked, else by the suffix of its file; empty for people to read."""
    suffix = output.suffix.lower().removeprefix(".") if output else ""
    kind = form or (suffix if suffix != "txt" else "")
    if kind not in FORMATS and (form or kind or (output and not suffix)):
        what = f"--format {kind}" if form else f"-o {output}"
        raise UsageError(f"{what}: use {', '.join(FORMATS[:-1])} or {FORMATS[-1]}")
    if kind == "parquet" and output is None:
        raise UsageError("--format parquet needs a file: -o table.parquet")
    return kind


def _notes(found: Across, failed: int) -> None:
    """What the table does not show, on standard error."""
    from attlog.batch.across import references
    from attlog.words.numbers import counted, listed

    if found.twice:
        to_stderr(
            f"attlog: {counted(found.twice, 'result')} left out: of a log that comes twice the newest one counts"
            " (--by batch lists each batch)"
        )
    against = references(found)
    if len(against) > 1:
        said = listed([f"{name} ({n})" for name, n in against.items()])
        to_stderr(f"attlog: the logs are compared with different things: {said}; --by reference separates them")
    if failed:
        to_stderr(f"attlog: {counted(failed, 'log')} could not be analysed, not in the table")


def _write(found: Across, by: str | None, kind: str, output: Path | None) -> None:
    from attlog.batch.across import values, words
    from attlog.compare.tables import table_latex, table_markdown
    from attlog.core.files import write_atomic

    if kind == "parquet":
        assert output is not None
        write_atomic(output, _parquet(found, by))
        return
    if not kind:
        out = console()
        if output is None:
            say(terminal(found, by, out.width), out)
            return
        text = "".join(line.text + "\n" for line in terminal(found, by, sys.maxsize))
    elif kind == "csv":
        head, body = values(found, by)
        text = files.csv_text([head, *body])
    else:
        shown = words(found, by, found.columns, units=True)
        text = (table_markdown if kind == "md" else table_latex)(shown.head, [*shown.body, *shown.foot])
    if output is None:
        say(text.splitlines(), console())
        return
    write_atomic(output, text.encode("utf-8", "backslashreplace"))


def terminal(found: Across, by: str | None, width: int) -> Iterator[TextLine]:
    """A block for each metric, with as many columns as fit."""
    from attlog.words.numbers import unit_sign

    questions = dict.fromkeys((c.metric, c.window) for c in found.columns)
    for k, (metric, where) in enumerate(questions):
        columns = [c for c in found.columns if (c.metric, c.window) == (metric, where)]
        unit = unit_sign(columns[0].unit)
        if k:
            yield TextLine("")
        yield TextLine(f"{metric}, {where}{f', in {unit}' if unit else ''}", "bold")
        yield from _block(found, by, columns, width)


def _block(found: Across, by: str | None, columns: Sequence[Column], width: int) -> Iterator[TextLine]:
    from attlog.batch.across import words
    from attlog.words.text import clean

    shown = words(found, by, columns)
    rows = [[clean(cell) for cell in line] for line in (*shown.body, *shown.foot)]
    styles = [""] * len(shown.body) + ["dim"] * len(shown.foot)
    fit = len(shown.head)
    while True:
        head = [clean(cell) for cell in shown.head[:fit]]
        lines = list(table([row[:fit] for row in rows], head, left=range(1 if by else 2), styles=styles))
        if fit <= 3 or max(len(line.text) for line in lines) <= width:
            break
        fit -= 1
    yield from lines
    if fit < len(shown.head):
        yield TextLine(f"No room for {', '.join(shown.head[fit:])}: --row NAME, or -o table.csv for all.", "dim")


def _parquet(found: Across, by: str | None) -> bytes:
    """The table as Parquet, metric, window and unit in the metadata of each column. OutputError without pyarrow."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise OutputError("Parquet needs pyarrow: pip install pyarrow, or use --format csv") from None
    from attlog.batch.across import LOGS, values

    head, body = values(found, by)
    first = len(head) - len(found.columns) * (4 if by else 1)
    fields, arrays = [], []
    for k, title in enumerate(head):
        column_values: list[Any] = [line[k] for line in body]
        kind = pyarrow.string() if k < first and title != LOGS else pyarrow.float64()
        about = {}
        if k >= first:
            column = found.columns[(k - first) // (4 if by else 1)]
            about = {"metric": column.metric, "window": column.window, "row": column.row, "unit": column.unit}
        fields.append(pyarrow.field(title, kind, metadata=about))
        arrays.append(pyarrow.array(column_values, kind))
    buffer = io.BytesIO()
    parquet.write_table(pyarrow.Table.from_arrays(arrays, schema=pyarrow.schema(fields)), buffer)
    return buffer.getvalue()
