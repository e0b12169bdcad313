"""Commands that run no filter: ``info`` (contents), ``health`` (sensors), ``extract`` (data as tables)."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog.cli import options
from attlog.cli.arguments import command_line, refuse_file
from attlog.cli.logs import end_command, named_files, named_sources, one_log, run_and_report
from attlog.cli.options import (
    OUTPUT,
    Boot,
    CommonOptions,
    Form,
    Json,
    Log,
    Logs,
    Places,
    System,
    check_filter,
    one_form,
    require_finite,
)
from attlog.cli.printing import (
    GrowingText,
    TextLine,
    console,
    json_to_stdout,
    say,
    table,
    table_to_stdout,
    to_stderr,
    to_stdout,
    wrapped,
)
from attlog.core.errors import LogUnusable, UsageError

if TYPE_CHECKING:
    from attlog.flight.model import FlightLog
    from attlog.pipeline.extraction import Extract
    from attlog.result import Result


STYLES = {"ok": "", "warning": "yellow", "fault": "red", "unknown": "dim"}


def info_command(
    logs: Logs, common: CommonOptions, json: Json = False, boot: Boot = None, system: System = None
) -> None:
    """Say what is in a log and what it can answer.

    Each LOG is checked against physics. What is missing is listed with the setting that would log it.

    Example: attlog info flight.ulg
    """
    from attlog.cli.progress import progress
    from attlog.pipeline.inspection import inspect

    codes: set[int] = set()
    for number, log in enumerate(named_files(logs, codes)):
        with run_and_report(str(log), codes, common.verbose):
            with progress(common.quiet, common.verbose > 0):
                report = inspect(log, boot=boot, system=system)
            if json:
                json_to_stdout(report)
            elif not common.quiet:
                out = console()
                say([""] * (number > 0), out)
                say(info_lines(printable(report), out.width, common.verbose), out)
    end_command(codes)


def printable(report: dict[str, Any]) -> dict[str, Any]:
    """Return the report without control characters of the log; strange bytes of a file name as escapes."""
    from attlog.words.text import cleaned, encodable

    name = encodable(report["log"]["name"], "utf-8")
    safe: dict[str, Any] = cleaned(report | {"log": report["log"] | {"name": name}})
    return safe


def info_lines(report: dict[str, Any], width: int, verbose: int = 0) -> Iterator[TextLine]:
    """Lay out a report of ``inspect`` as text of at most ``width`` columns where words can be broken.

    What the log holds comes first, what is wrong with it last. Checks appear as in ``attlog health``.
    """
    from attlog.cli.tables import finding_lines, sensor_lines
    from attlog.health.check import Check, Setting
    from attlog.health.findings import Finding
    from attlog.metrics.gyro_bias import CommonBias
    from attlog.words.findings import shown_findings
    from attlog.words.flight import bias_sentence as said_bias

    yield from _head(report["log"], width)
    if report["headline"]:
        yield TextLine("")
        yield from wrapped("", report["headline"], width)
    yield from _messages(report["messages"], width, verbose)
    taken = [(f"gyro of {bias['imu']}", said_bias(CommonBias(**bias))) for bias in report["gyro_bias"] or []]
    yield from _part("What analyze does to every filter alike", taken, width, [""] * len(taken))
    if report["compared_with"]:
        yield from _part("Compared with", [("reference", "", report["compared_with"])], width, [""])
    yield TextLine("")
    yield TextLine("Physics", "bold")
    checks = [Check(**c | {"settings": [Setting(**s) for s in c["settings"]]}) for c in report["checks"]]
    yield from sensor_lines(checks, width, bool(verbose))
    questions = report["answerable"]
    answers = [
        (
            q["question"].replace("_", " "),
            "yes" if q["can"] else "no",
            " ".join(x for x in (q["reason"], q["setting"]) if x),
        )
        for q in questions
    ]
    yield from _part("What can be answered", answers, width, ["" if q["can"] else "red" for q in questions])
    yield TextLine("")
    yield TextLine("What is wrong with this log", "bold")
    found = [Finding(**f) for f in report["findings"]]
    yield from finding_lines(shown_findings(found), width, bool(verbose))


def _messages(messages: Sequence[dict[str, Any]], width: int, verbose: int) -> Iterator[TextLine]:
    """Yield the number of messages, with ``verbose`` each with its rate and numeric fields."""
    from attlog.words.numbers import counted

    rows = [
        (
            m["name"] + (f".{m['instance']}" if m["instance"] else ""),
            f"{m['records']:>7} record{'s' if m['records'] != 1 else ' '}",
            "" if m["rate_hz"] is None else f"{m['rate_hz']:>8.2f} Hz",
            f"{m['fields']:>3} field{'s' if m['fields'] != 1 else ''}"
            + (f": {', '.join(m['signals'])}" if m["signals"] else ""),
        )
        for m in messages
    ]
    if verbose:
        yield from _part("Messages", rows, width, [""] * len(rows))
    elif rows:
        records = counted(sum(m["records"] for m in messages), "record")
        yield TextLine("")
        yield TextLine(f"{counted(len(rows), 'message')}, {records} (-v lists them)")


def _head(log: dict[str, Any], width: int) -> Iterator[TextLine]:
    """Yield file, vehicle, firmware, date and length; the sensors and why they were chosen."""
    firmware = " ".join(x for x in (log["firmware"]["name"], log["firmware"]["version"]) if x) or "unknown firmware"
    yield TextLine(f"{log['name']}  {log['format']}, {log['size'] / 1e6:.1f} MB, sha256 {log['sha256'][:12]}", "bold")
    yield TextLine(f"{log['vehicle'] or 'unknown vehicle'}, {firmware}{', simulated' if log['simulated'] else ''}")
    boots = f", boot {log['boot']} of {log['boots']}" if log["boots"] > 1 else ""
    yield TextLine(f"{log['date_utc'] or 'date unknown'}, {log['duration_s']:.1f} s{boots}")
    sensors = []
    for what in ("imu", "mag", "attitude", "truth"):
        sensor = log[what]
        found = "none" if sensor is None else f"{sensor['source']} at {sensor['rate_hz']:.1f} Hz"
        if what == "truth" and log["poses"]:
            found += f"; --truth takes {', '.join(log['poses'])}"
        reason = log["choices"].get(what, "")
        sensors.append((what, found + (f". {reason.rstrip('.')}." if reason else "")))
    yield from table(sensors, left=(0, -1), width=width, indent="  ")
    if log["seconds"]:
        yield TextLine(
            "  " + ", ".join(f"{k} {'unknown' if s is None else f'{s:.1f} s'}" for k, s in log["seconds"].items())
        )


def _part(title: str, rows: Sequence[tuple[str, ...]], width: int, styles: list[str]) -> Iterator[TextLine]:
    """Yield a titled table; nothing without rows."""
    if rows:
        yield TextLine("")
        yield TextLine(title, "bold")
        yield from table(rows, left=range(len(rows[0])), width=width, indent="  ", styles=styles)


PARAM = ".param"


def health_command(
    logs: Places,
    common: CommonOptions,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            help="Write what to set as DIR/NAME.param. [default: print]",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    params: Annotated[
        str | None,
        typer.Option(
            metavar="F.param",
            help="Use the parameters of this file, as if the vehicle had flown with them. [default: those of the log]",
        ),
    ] = None,
    form: Form = None,
    json: Json = False,
    boot: Boot = None,
    system: System = None,
) -> None:
    """Say whether the sensors can be trusted, and what to set.

    No filter runs. Only what the log proves is offered, with what is missing for the rest.

    Example: attlog health flight.bin
    """
    from attlog.batch.log_file import require_unchanged
    from attlog.batch.report_files import report_names
    from attlog.cli.progress import first_lines_shown, progress
    from attlog.flight.parameters import read_parameter_file
    from attlog.pipeline.evaluation import health

    one_form(json, form)
    if params is not None:
        read_parameter_file(params)  # what is wrong with it is reported once, not for each log
    settings = {"params": params, "boot": boot, "system": system}
    config = {name: value for name, value in settings.items() if value is not None}
    codes: set[int] = set()
    found, _ = named_sources(logs, codes)
    assessed: list[Result] = []
    out = console(stderr=json or form is not None)
    for source, name in zip(found, report_names([source.file_name for source in found]), strict=True):
        with run_and_report(source.name, codes, common.verbose):
            text = GrowingText(out, [""] * (source is not found[0]))
            with (
                progress(common.quiet, common.verbose > 0) as shown,
                first_lines_shown(None if common.quiet or json or form is not None else text, shown.clear),
                source.local() as log,
                require_unchanged(log.path),
            ):
                result = health(log.path, config, command=command_line())
            if form is not None:
                assessed.append(result)
            if json:
                json_to_stdout(health_document(result))
            if not common.quiet:
                text.show(health_lines(result, text.width, common.verbose > 0))
            if (
                output is not None
                and (written := write_parameters(result, output / f"{name}{PARAM}", params)) is not None
            ):
                say([] if common.quiet else [written], out)
    if form is not None and assessed:
        from attlog.compare.tables import sensor_rows

        table_to_stdout(form, *sensor_rows(assessed))
    end_command(codes)


def health_document(result: Result) -> dict[str, Any]:
    """Return the document of ``--json``: parts of the JSON of ``analyze``, and each parameter to set once."""
    from attlog.core.plain import to_plain
    from attlog.result import agreed_settings

    whole = result.to_dict()
    parts = {key: whole.get(key, empty) for key, empty in (("log", {}), ("headline", ""), ("checks", []))}
    settings = [to_plain(setting, defaults=False) for setting in agreed_settings(result.checks)]
    return parts | {"settings": settings, "findings": whole.get("findings", [])}


def health_lines(result: Result, width: int, verbose: bool) -> Iterator[TextLine]:
    """Yield title, headline, the table of sensors and what should be set."""
    from attlog.cli.tables import first_lines, sensor_lines, setting_lines
    from attlog.result import agreed_settings

    yield from first_lines(result, width)
    yield from sensor_lines(result.checks, width, verbose)
    yield from setting_lines(agreed_settings(result.checks))


def write_parameters(result: Result, path: Path, params: str | None) -> str | None:
    """Write what should be set to a file (atomically), and say so; None where there is nothing to set or to say.

    UsageError where a flight log or the file of ``--params`` would be overwritten, OutputError if it cannot be written.
    """
    from attlog.core.files import write_atomic
    from attlog.core.own_files import PARAMETERS
    from attlog.health.settings import param_file
    from attlog.result import agreed_settings

    text = param_file(result.log, agreed_settings(result.checks))
    if not text:
        return f"nothing to set; {path} is of an earlier run" if PARAMETERS.includes(path) else None
    refuse_file("-o", str(path), [] if params is None else [params])
    write_atomic(path, text, PARAMETERS.of(str(result.log["sha256"])))
    return f"parameters: {path}"


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
            callback=require_finite,
            help="Begin at this time (s, 0 is the first IMU sample). [default: all]",
        ),
    ] = None
    end: Annotated[
        float | None,
        typer.Option("--to", metavar="T", callback=require_finite, help="End at this time (s). [default: all]"),
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


def extract_command(
    log: Log,
    own: ExtractOptions,
    common: CommonOptions,
    messages: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[MESSAGE[.N]]...",
            show_default=False,
            autocompletion=options.complete_messages,
            help="Write these messages, in any case; MAG.0 or MAG[0] is one instance, MAG[0].MagX a field. "
            "[default: all]",
        ),
    ] = None,
) -> None:
    """Write data of a log for pandas and PlotJuggler.

    The first column is time_s; units are in names or metadata.

    Example: attlog extract flight.ulg vehicle_attitude --from 10 --to 60
    """
    kind = _table_kind(own.kind, own.output)
    if messages and (own.streams or own.estimates):
        raise UsageError("name messages, or use --streams / --estimates, not both")
    if own.start is not None and own.end is not None and own.start > own.end:
        raise UsageError(f"--from {own.start:g} is after --to {own.end:g}")
    log = one_log(log)
    from attlog.cli.progress import progress
    from attlog.flight import read
    from attlog.pipeline import extraction

    with progress(common.quiet, common.verbose > 0):
        flight = read(log, boot=own.boot, system=own.system)
        whole = _extracts(flight, messages or [], own.streams, own.estimates, own.system)
    if not whole:
        raise LogUnusable(f"{log}: nothing to extract")
    tables = [extract.between(own.start, own.end) for extract in whole]
    empty = [
        f"{before.name}: no row {_reason_empty(before, own.start, own.end)}"
        for before, extract in zip(whole, tables, strict=True)
        if not len(extract)
    ]
    if len(empty) == len(tables):
        raise LogUnusable("\n".join([f"{log}: nothing to extract", *dict.fromkeys(empty)]))
    for sentence in [*extraction.other_senders(flight, messages or []), *empty] if not common.quiet else ():
        to_stderr(f"attlog: {sentence}")
    if str(own.output) == "-":
        extraction.write_stream(tables, flight, sys.stdout.buffer, kind)
        return
    from attlog.words.numbers import counted

    written = extraction.write(tables, flight, own.output, kind)
    if not common.quiet:
        for path, extract in zip(written, tables, strict=True):
            to_stdout(f"{path}: {counted(len(extract), 'row')}, {counted(len(extract.columns), 'column')}")


def _extracts(
    flight: FlightLog, messages: list[str], streams: bool, estimates: str | None, system: int | None
) -> list[Extract]:
    from attlog.pipeline import extraction

    if not estimates:
        return list(extraction.streams(flight) if streams else extraction.messages(flight, messages, system))
    from attlog.estimators import items

    for item in items(estimates):
        check_filter(item)
    tables = list(extraction.estimates(flight, items(estimates)))
    return tables + (list(extraction.streams(flight)) if streams else [])


def _table_kind(asked: str | None, output: Path) -> str:
    """Return the format of the option or of the file's name. UsageError if the two differ."""
    if asked is not None and asked not in KINDS:
        raise UsageError(f"--format {asked}: use csv or parquet")
    named = output.suffix.removeprefix(".").lower()
    if named in KINDS and asked is not None and asked != named:
        raise UsageError(f"-o {output} is the name of a {named} file and --format asks for {asked}")
    return asked or (named if named in KINDS else "csv")


def _reason_empty(extract: Extract, start: float | None, end: float | None) -> str:
    if not len(extract) or "time_s" not in extract.columns:
        return "in the log"
    t = extract.columns["time_s"]
    asked = " ".join(f"{word} {x:g} s" for word, x in (("from", start), ("to", end)) if x is not None)
    return f"{asked}: its times are {t.min():.1f} to {t.max():.1f} s"
