"""``attlog extract``: messages, SI streams or estimates to CSV or Parquet."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from attlog.cli.common import Boot, Log, NoColor, Quiet, System, existing
from attlog.errors import LogUnusable, UsageError


def command(
    log: Log,
    messages: Annotated[
        list[str] | None, typer.Argument(metavar="[MESSAGE]...", help="Messages by name; none: all.")
    ] = None,
    streams: Annotated[
        bool, typer.Option("--streams", help="SI streams (imu0, mag0, attitude_...) instead of messages.")
    ] = False,
    estimates: Annotated[
        str | None,
        typer.Option("--estimates", metavar="LIST", help="Attitudes of re-run estimators: mahony@xu-0.6,gyro"),
    ] = None,
    start: Annotated[
        float | None, typer.Option("--from", metavar="T", help="From this time on (s, 0 = first IMU sample).")
    ] = None,
    end: Annotated[float | None, typer.Option("--to", metavar="T", help="Up to this time (s).")] = None,
    kind: Annotated[str, typer.Option("--format", metavar="csv|parquet", help="File format.")] = "csv",
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="PATH", help="Folder, or a file for one table.")
    ] = Path("extract"),
    boot: Boot = None,
    system: System = None,
    no_color: NoColor = False,
    quiet: Quiet = False,
) -> None:
    """Write data of LOG to files for pandas and PlotJuggler: first column time_s, units in names or metadata."""
    if kind not in ("csv", "parquet"):
        raise UsageError(f"--format {kind}: use csv or parquet")
    if messages and (streams or estimates):
        raise UsageError("name messages, or use --streams / --estimates, not both")
    if start is not None and end is not None and start > end:
        raise UsageError(f"--from {start} is after --to {end}")
    existing(log)
    from attlog import extraction
    from attlog.flight import read

    flight = read(log, boot=boot, system=system)
    if estimates:
        from attlog.estimators import items

        tables = list(extraction.estimates(flight, items(estimates)))
        if streams:
            tables += extraction.streams(flight)
    else:
        tables = list(extraction.streams(flight) if streams else extraction.messages(flight, messages or [], system))
    tables = [table.between(start, end) for table in tables]
    if not tables:
        raise LogUnusable(f"{log}: nothing to extract")
    written = extraction.write(tables, flight, output, kind)
    if not quiet:
        for path, table in zip(written, tables, strict=True):
            typer.echo(f"{path}: {len(next(iter(table.columns.values())))} rows, {len(table.columns)} columns")
