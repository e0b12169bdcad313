"""``attlog batch``: many logs into one folder with an index; ``attlog table``: numbers across its logs."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog import __version__
from attlog.cli.gates import GateOptions, GateReport
from attlog.cli.logs import end_command, named_sources
from attlog.cli.options import (
    CommonOptions,
    JobsOfCores,
    LogOptions,
    OneFile,
    Places,
    build_configuration,
    commands,
    require_finite,
)
from attlog.cli.printing import TextLine, console, say, table, to_stderr
from attlog.cli.process import ended_by_signals
from attlog.cli.progress import Bar, compile_first
from attlog.core import files
from attlog.core.errors import EXIT_INTERRUPTED, LogUnusable, OutputError, UsageError, error_message

if TYPE_CHECKING:
    from attlog.batch.across import Column, LogTable
    from attlog.batch.job import Job, Record
    from attlog.batch.run import BatchOutcome, Runner


# Time limit of a log: a hundred times the slowest log in hand, and an hour of one worker for one that hangs.
TIMEOUT_S = 3600.0


@dataclass(frozen=True, slots=True)
class BatchOptions:
    """Processes and limits of a batch, and what happens to an earlier batch in the folder."""

    jobs: JobsOfCores = None
    timeout: Annotated[
        float,
        typer.Option(metavar="S", min=0.0, callback=require_finite, help="Give up on a log after so long; 0: never."),
    ] = TIMEOUT_S
    memory: Annotated[
        float | None,
        typer.Option(
            metavar="MB",
            min=1.0,
            callback=require_finite,
            help="Give up on a log that needs more memory. [default: no limit]",
        ),
    ] = None
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the batch in DIR: what is done and unchanged stays.")
    ] = False
    fresh: Annotated[bool, typer.Option("--fresh", help="Remove the reports of the batch in DIR and begin again.")] = (
        False
    )
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="tcp://HOST:PORT",
            help="Work on the Dask cluster of this scheduler; --jobs: tasks at a time. [default: on this machine]",
        ),
    ] = None

    def __post_init__(self) -> None:
        if self.resume and self.fresh:
            raise UsageError("--resume and --fresh: one or the other")

    def runner(self, progress: BatchProgress, bar: Bar) -> Runner:
        """Return what runs the jobs."""
        if self.scheduler is None:
            from attlog.batch.run import local_runner

            return local_runner(self.jobs, bar.stage)

        from attlog.batch.cluster import cluster_runner

        return cluster_runner(self.scheduler, self.jobs, progress.say)


def batch_command(
    logs: Places,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", show_default=False, help="Write the batch to this folder.")
    ],
    batch: BatchOptions,
    options: LogOptions,
    gate_options: GateOptions,
    common: CommonOptions,
) -> None:
    """Analyse many logs into one folder with an index.

    The folder gets a report for each log and a table of every number.
    Each log has a process of its own. An interrupted batch goes on with --resume.

    Example: attlog batch flights/ -o out --resume
    """
    gates = GateReport(gate_options, output)
    settings = build_configuration(options)
    from attlog.batch.run import run_batch

    codes, names = set[int](), list[str]()
    found, wrong = named_sources(logs, codes)
    if found:
        compile_first(settings.estimators, found, common.quiet)
        with ended_by_signals(), Bar(common.quiet, common.verbose > 0) as bar:
            progress = BatchProgress(bar, common.verbose)
            outcome = run_batch(
                found,
                output,
                settings,
                batch.runner(progress, bar),
                progress,
                lambda record: gates.judge(record, timed=not options.deterministic),
                commands=commands(options, [source.name for source in found]),
                fresh=batch.fresh,
                deterministic=options.deterministic,
                timeout=batch.timeout or None,
                memory=batch.memory,
                resume=batch.resume,
            )
        codes |= outcome.codes
        _say_outcome(outcome, output, common.quiet)
        names = [record.name for record in outcome.records]
        if not common.quiet and EXIT_INTERRUPTED not in codes:
            say(gates.total(names), console())
    end_command(codes | gates.finish(names, wrong, interrupted=EXIT_INTERRUPTED in codes))


class BatchProgress:
    """Progress of a batch: a bar, else a line for each log that fails; with ``verbose`` a line for each log."""

    def __init__(self, bar: Bar, verbose: int) -> None:
        self._bar, self._verbose = bar, verbose

    def planned(self, jobs: Sequence[Job]) -> None:
        """Start the bar."""
        self._bar.planned(jobs)

    def finished(self, record: Record) -> None:
        """Count a log and print what happened to it."""
        self._bar.advance(record)
        lines = [f"attlog: {record.log}: gate: {sentence}" for sentence in record.gates]
        if not record.done:
            if self._verbose or not (record.known or self._bar.is_shown):
                lines.append(record.trace * (self._verbose > 1) + record.message)
        elif self._verbose:
            how = "done before" if record.again else f"{record.wall_s:.1f} s, {record.peak_mb:.0f} MB"
            lines.append(f"{record.log}: {how}")
        if lines:
            self.say("\n".join(lines))

    def say(self, text: str) -> None:
        """Print a message above the bar."""
        with self._bar.aside():
            to_stderr(text)


def _say_outcome(outcome: BatchOutcome, folder: Path, quiet: bool) -> None:
    """Print the summary, and why not all logs were reached."""
    from attlog.batch.order import summary

    if not quiet:
        out = console()
        first, *others = summary(
            outcome.records, outcome.total, outcome.seconds, folder, outcome.again, width=out.width
        )
        say([TextLine(first, "bold"), *others], out)
        if outcome.records:
            say([f"index: {folder / 'index.html'}"], out)
    if outcome.ended:
        to_stderr(f"attlog: {outcome.ended}")


TABLE_FORMATS = ("md", "csv", "tex", "parquet")
DEFAULT_METRIC = "tilt_rmse_deg"


def table_command(
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
        typer.Option(metavar="M[@WINDOW]", help=f"Show these metrics, with commas. [default: {DEFAULT_METRIC}]"),
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
            metavar="|".join(TABLE_FORMATS),
            help="Write the table in this format. [default: by -o, or for reading]",
        ),
    ] = None,
    output: OneFile = None,
) -> None:
    """Show one number of many logs.

    Each log is a line, each filter a column; median and quartiles are below.

    Example: attlog table reports --metric heading_rmse_deg --by firmware
    """
    from attlog.batch.across import BY, across
    from attlog.batch.results_file import read_numbers

    kind = _format(form, output)
    if by is not None and by not in BY:
        raise UsageError(f"--by {by}: use {', '.join(BY[:-1])} or {BY[-1]}")
    asked = _listed(metric) or [DEFAULT_METRIC]
    numbers = read_numbers(results, [m.partition("@")[0] for m in asked])
    found = across(numbers, asked, _listed(row), window, by)
    for error in numbers.wrong:
        to_stderr(error_message(error, __version__))
    if found.logs.empty and not numbers.wrong:
        raise LogUnusable(f"{results[0]}: no log of it was analysed; {numbers.failed} failed")
    if not found.logs.empty:
        _notes(found, numbers.failed)
        _write_table(found, by, kind, output)
    end_command(numbers.wrong)


def _listed(options: list[str] | None) -> list[str]:
    return [word.strip() for option in options or () for word in option.split(",") if word.strip()]


def _format(form: str | None, output: Path | None) -> str:
    """Return the format asked for, else by the suffix of the file; empty for reading."""
    suffix = output.suffix.lower().removeprefix(".") if output else ""
    kind = form or (suffix if suffix != "txt" else "")
    if kind not in TABLE_FORMATS and (form or kind or (output and not suffix)):
        what = f"--format {kind}" if form else f"-o {output}"
        raise UsageError(f"{what}: use {', '.join(TABLE_FORMATS[:-1])} or {TABLE_FORMATS[-1]}")
    if kind == "parquet" and output is None:
        raise UsageError("--format parquet needs a file: -o table.parquet")
    return kind


def _notes(found: LogTable, failed: int) -> None:
    """Print what the table does not show, on standard error."""
    from attlog.batch.across import references
    from attlog.words.numbers import counted, listed

    if found.repeats:
        to_stderr(
            f"attlog: {counted(found.repeats, 'result')} left out: of a log that comes twice the newest one counts"
            " (--by batch lists each batch)"
        )
    against = references(found)
    if len(against) > 1:
        counts = listed([f"{name} ({n})" for name, n in against.items()])
        to_stderr(f"attlog: the logs are compared with different things: {counts}; --by reference separates them")
    if failed:
        to_stderr(f"attlog: {counted(failed, 'log')} could not be analysed, not in the table")


def _write_table(found: LogTable, by: str | None, kind: str, output: Path | None) -> None:
    from attlog.batch.across import table_text, table_values
    from attlog.compare.tables import table_latex, table_markdown
    from attlog.core.files import write_atomic
    from attlog.core.own_files import TABLE

    if kind == "parquet":
        assert output is not None
        write_atomic(output, _parquet(found, by), TABLE)
        return
    if not kind:
        out = console()
        if output is None:
            say(table_lines(found, by, out.width), out)
            return
        text = "".join(line.text + "\n" for line in table_lines(found, by, sys.maxsize))
    elif kind == "csv":
        head, body = table_values(found, by)
        text = files.csv_text([head, *body])
    else:
        shown = table_text(found, by, found.columns, units=True)
        text = (table_markdown if kind == "md" else table_latex)(shown.head, [*shown.body, *shown.foot])
    if output is None:
        say(text.splitlines(), console())
        return
    write_atomic(output, text.encode("utf-8", "backslashreplace"), TABLE)


def table_lines(found: LogTable, by: str | None, width: int) -> Iterator[TextLine]:
    """Yield a block for each metric, with as many columns as fit."""
    from attlog.words.numbers import unit_sign

    questions = dict.fromkeys((c.metric, c.window) for c in found.columns)
    for k, (metric, where) in enumerate(questions):
        columns = [c for c in found.columns if (c.metric, c.window) == (metric, where)]
        unit = unit_sign(columns[0].unit)
        if k:
            yield TextLine("")
        yield TextLine(f"{metric}, {where}{f', in {unit}' if unit else ''}", "bold")
        yield from _block(found, by, columns, width)


def _block(found: LogTable, by: str | None, columns: Sequence[Column], width: int) -> Iterator[TextLine]:
    from attlog.batch.across import table_text
    from attlog.words.text import clean

    shown = table_text(found, by, columns)
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


def _parquet(found: LogTable, by: str | None) -> bytes:
    """Return the table as Parquet, metric, window and unit in the metadata. OutputError without pyarrow."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise OutputError("Parquet needs pyarrow: pip install pyarrow, or use --format csv") from None
    from attlog.batch.across import LOGS, table_values

    head, body = table_values(found, by)
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
