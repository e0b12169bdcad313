"""``attlog extract``: messages, SI streams or estimates to CSV or Parquet."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from attlog.cli import options
from attlog.cli.logs import one_log
from attlog.cli.options import Boot, CommonOptions, Log, System, finite
from attlog.cli.printing import to_stderr, to_stdout
from attlog.core.errors import LogUnusable, UsageError

if TYPE_CHECKING:
    from attlog.flight.model import FlightLog
    from attlog.pipeline.extraction import Extract

KINDS = ("csv", "parquet")


@dataclass(frozen=True, slots=True)
class ExtractOptions:
    """What is written of a log, from when to when, and where."""

    streams: Annotated[
        bool, typer.Option("--streams", help="Write SI streams (imu0, mag0, attitude_...) instead of messages.")
    ] = False
    estimates: Annotated[
        str | None,
        typer.Option(
            "--estimates",
            metavar="LIST",
            autocompletion=options.complete_rows,
            help="Write attitudes of re-run filters: mahony@xu-0.6,gyro. [default: none]",
        ),
    ] = None
    start: Annotated[
        float | None,
        typer.Option(
            "--from",
            metavar="T",
            callback=finite,
            help="Begin at this time (s, 0 is the first IMU sample). [default: all]",
        ),
    ] = None
    end: Annotated[
        float | None, typer.Option("--to", metavar="T", callback=finite, help="End at this time (s). [default: all]")
    ] = None
    kind: Annotated[
        str | None,
        typer.Option(
            "--format",
            metavar="csv|parquet",
            help="Write the table as CSV or Parquet. [default: by the suffix of -o, or csv]",
        ),
    ] = None
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="PATH|-",
            help="Write to this folder, file (.csv, .parquet) for one table, or - for standard output.",
        ),
    ] = Path("extract")
    boot: Boot = None
    system: System = None


def command(
    log: Log,
    own: ExtractOptions,
    common: CommonOptions,
    messages: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[MESSAGE[.N]]...",
            show_default=False,
            autocompletion=options.complete_messages,
            help="Write these messages, in any case; MAG.0 or MAG[0] is one instance. [default: all]",
        ),
    ] = None,
) -> None:
    """Write data of a log for pandas and PlotJuggler.

    The first column is time_s; units stand in names or metadata.

    Example: attlog extract flight.ulg vehicle_attitude --from 10 --to 60
    """
    kind = _kind(own.kind, own.output)
    if messages and (own.streams or own.estimates):
        raise UsageError("name messages, or use --streams / --estimates, not both")
    if own.start is not None and own.end is not None and own.start > own.end:
        raise UsageError(f"--from {own.start:g} is after --to {own.end:g}")
    log = one_log(log)
    from attlog.flight import read
    from attlog.pipeline import extraction

    flight = read(log, boot=own.boot, system=own.system)
    whole = _tables(flight, messages or [], own.streams, own.estimates, own.system)
    if not whole:
        raise LogUnusable(f"{log}: nothing to extract")
    tables = [table.between(own.start, own.end) for table in whole]
    if not any(map(len, tables)):
        why = dict.fromkeys(f"{table.name}: no row {_why_empty(table, own.start, own.end)}" for table in whole)
        raise LogUnusable("\n".join([f"{log}: nothing to extract", *why]))
    for table, cut in zip(whole, tables, strict=True):
        if not len(cut) and not common.quiet:
            to_stderr(f"attlog: {table.name}: no row {_why_empty(table, own.start, own.end)}")
    if str(own.output) == "-":
        extraction.write_stream(tables, flight, sys.stdout.buffer, kind)
        return
    written = extraction.write(tables, flight, own.output, kind)
    if not common.quiet:
        for path, table in zip(written, tables, strict=True):
            to_stdout(f"{path}: {len(table)} rows, {len(table.columns)} columns")


def _tables(
    flight: FlightLog, messages: list[str], streams: bool, estimates: str | None, system: int | None
) -> list[Extract]:
    from attlog.pipeline import extraction

    if not estimates:
        return list(extraction.streams(flight) if streams else extraction.messages(flight, messages, system))
    from attlog.cli.options import check_filter
    from attlog.estimators import items

    for item in items(estimates):
        check_filter(item)
    tables = list(extraction.estimates(flight, items(estimates)))
    return tables + (list(extraction.streams(flight)) if streams else [])


def _kind(asked: str | None, output: Path) -> str:
    """The format that is asked for or that the file's name says. UsageError where the two differ."""
    if asked is not None and asked not in KINDS:
        raise UsageError(f"--format {asked}: use csv or parquet")
    named = output.suffix.removeprefix(".").lower()
    if named in KINDS and asked is not None and asked != named:
        raise UsageError(f"-o {output} is the name of a {named} file and --format asks for {asked}")
    return asked or (named if named in KINDS else "csv")


def _why_empty(table: Extract, start: float | None, end: float | None) -> str:
    """Why a table has no row: the log's, or the range's with the times that there are."""
    if not len(table) or "time_s" not in table.columns:
        return "in the log"
    t = table.columns["time_s"]
    asked = " ".join(f"{word} {x:g} s" for word, x in (("from", start), ("to", end)) if x is not None)
    return f"{asked}: its times are {t.min():.1f} to {t.max():.1f} s"
