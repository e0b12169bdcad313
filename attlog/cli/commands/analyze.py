"""``attlog analyze``: one report and one JSON per log, sentences and the table on the terminal."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from attlog import __version__
from attlog.base.errors import BUG, INTERRUPTED, PluginError, PluginTimeout, exit_code, message, worst
from attlog.cli.shared import gates as gated
from attlog.cli.shared import options
from attlog.cli.shared.arguments import command_line
from attlog.cli.shared.printing import (
    Boot,
    Json,
    NoColor,
    Places,
    Quiet,
    System,
    Verbose,
    console,
    json_line,
    json_to_stdout,
    say,
    to_stderr,
)
from attlog.cli.shared.process import is_of_a_stream
from attlog.cli.shared.progress import Bar, progress

if TYPE_CHECKING:
    from attlog.config import Config
    from attlog.fleet.records.entry import Entry
    from attlog.fleet.sources.source import Source
    from attlog.result import Result


def command(
    context: typer.Context,
    logs: Places,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for reports and JSON.")] = Path(
        "reports"
    ),
    jobs: Annotated[int, typer.Option("-j", "--jobs", metavar="N", min=1, help="Analyse so many logs at a time.")] = 1,
    estimators: options.Estimators = None,
    imu: options.ImuOption = None,
    mag: options.MagOption = None,
    reference: options.ReferenceOption = None,
    window: options.Window = None,
    score_from: options.ScoreFrom = None,
    clock: options.Clock = None,
    declination: options.Declination = None,
    trim: options.Trim = None,
    input_delay: options.InputDelay = None,
    gyro_bias: options.GyroBias = None,
    params: options.Params = None,
    config: options.ConfigFile = None,
    json: Json = False,
    plotly: options.Plotly = "inline",
    table: Annotated[
        list[Path] | None,
        typer.Option("--table", metavar="FILE.csv|tex|md", help="Write the table to a file too; may be repeated."),
    ] = None,
    open_report: Annotated[bool, typer.Option("--open", help="Open the report in a browser.")] = False,
    deterministic: options.Deterministic = False,
    gates: gated.GatesFile = None,
    strict: gated.Strict = None,
    junit: gated.Junit = None,
    summary: gated.Summary = None,
    boot: Boot = None,
    system: System = None,
    filter_timeout: options.FilterTimeout = None,
    no_color: NoColor = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Re-run attitude filters on each LOG and compare them with the onboard attitude: a report, a JSON, a table."""
    bundle = options.bundle(plotly)
    if table:
        from attlog.compare.tables.files import check_suffix

        for file in table:
            check_suffix(file)
    settings = options.settings(
        config,
        estimators=estimators,
        imu=imu,
        mag=mag,
        reference=reference,
        window=window,
        score_from=score_from,
        clock=clock,
        declination=declination,
        trim=trim,
        input_delay=input_delay,
        gyro_bias=gyro_bias,
        params=params,
        boot=boot,
        system=system,
    )
    held = gated.Gated(gates, strict, junit, summary, output)
    from attlog.fleet.processes.files import report_names
    from attlog.fleet.sources.find import sources

    found, wrong = sources(logs)
    for error in wrong:
        to_stderr(message(error, __version__))
    results: list[Result] = []
    late: set[int] = set()

    def show(log: str, result: Result, report: Path) -> None:
        from attlog.result import TIMED_OUT, nothing_ran

        results.append(result)
        late.update(PluginTimeout.exit_code for problem in result.problems if problem.code == TIMED_OUT)
        if not late and (failed := nothing_ran(result.estimators)):
            late.add(PluginError.exit_code)
            to_stderr(f"attlog: {log}: no filter ran: {failed}")
        if json:
            json_to_stdout(json_line(result.to_dict(deterministic)))
        if not quiet:
            _show(result, report, settings, on_stderr=json, verbose=verbose)
        held.shown(log, report, quiet, console(stderr=json))
        if open_report:
            typer.launch(str(report))

    task = _Task(settings, output, bundle, deterministic, quiet, verbose, show, held.broken)
    if len(found) > 1:
        codes = _several(found, options.commands(context, [source.name for source in found]), task, jobs, json)
    else:
        codes = {_one(source, task) for source in found}
    if table and results:
        _write_tables(table, results, settings)
    codes |= (
        late
        | {exit_code(error) for error in wrong}
        | held.finish(report_names([s.file_name for s in found]), wrong, interrupted=INTERRUPTED in codes)
    )
    if worst(codes):
        raise typer.Exit(worst(codes))


@dataclass(frozen=True, slots=True)
class _Task:
    """How every log is treated and shown."""

    config: Config
    folder: Path
    plotly: Literal["inline", "shared"]
    deterministic: bool
    quiet: bool
    verbose: int
    show: Callable[[str, Result, Path], None]
    broken: Callable[[str, str, int, str], None]
    """Hears of each log without a result: what it is, the name of its report, exit code, message."""


def _one(source: Source, task: _Task) -> int:
    """Analyse one log here and show it; the exit code."""
    from attlog.fleet.processes.files import analyze_to_files, report_names

    try:
        with progress(task.quiet, task.verbose > 0), source.local() as log:
            written = analyze_to_files(
                log.path,
                task.config,
                task.folder,
                report_names([source.file_name])[0],
                command=command_line(),
                plotly=task.plotly,
                deterministic=task.deterministic,
            )
        task.show(source.name, written.result, written.report)
    except KeyboardInterrupt:
        to_stderr(_kept([], 1, task.folder))
        return INTERRUPTED
    except Exception as error:
        code = _failed(error, source.name, task.verbose)
        task.broken(source.name, report_names([source.file_name])[0], code, message(error, __version__, source.name))
        return code
    return 0


def _failed(error: Exception, log: str, verbose: int) -> int:
    """Say what went wrong with a log; the exit code. An error of standard output is none of the log."""
    if is_of_a_stream(error):
        raise error
    if verbose > 1 and exit_code(error) == BUG:
        to_stderr("".join(traceback.format_exception(error)))
    to_stderr(message(error, __version__, log))
    return exit_code(error)


def _several(logs: Sequence[Source], commands: Sequence[str], task: _Task, jobs: int, on_stderr: bool) -> set[int]:
    """Analyse each log in a process of its own and show it as it comes; the exit codes."""
    from attlog.fleet.processes.files import report_names
    from attlog.fleet.processes.run import tidied
    from attlog.fleet.records.work import Work, settings_key
    from attlog.fleet.schedulers.batch import entry_of
    from attlog.fleet.schedulers.local import here
    from attlog.result import Result

    key = settings_key(task.config, task.plotly, task.deterministic)
    names = report_names([source.file_name for source in logs])
    works = [
        Work(source, name, task.folder, task.config, key, command, task.plotly, task.deterministic, keep=False)
        for source, name, command in zip(logs, names, commands, strict=True)
    ]
    found: dict[str, Entry] = {}
    codes: set[int] = set()
    started = time.monotonic()
    with tidied(task.folder), Bar(task.quiet, task.verbose > 0) as bar:
        coming = here(jobs, bar.heard)(works)
        try:
            bar.planned(works)
            for record in coming:
                found[record.name] = entry_of(record)
                codes |= {record.code}
                bar.advance(record)
                with bar.aside():
                    if not record.done:
                        task.broken(record.log, record.name, record.code, record.message)
                        to_stderr(record.trace * (task.verbose > 1) + record.message)
                        continue
                    try:
                        task.show(
                            record.log,
                            Result.load(task.folder / f"{record.name}.json"),
                            task.folder / f"{record.name}.html",
                        )
                    except Exception as error:
                        codes |= {_failed(error, record.log, task.verbose)}
        except KeyboardInterrupt:
            codes |= {INTERRUPTED}
        finally:
            coming.close()
    if not task.quiet:
        entries = [found[name] for name in names if name in found]
        _say_summary(entries, len(logs), time.monotonic() - started, task.folder, on_stderr)
    if INTERRUPTED in codes:
        to_stderr(_kept([e.name for e in found.values() if e.row is not None], len(logs), task.folder))
    return codes


def _say_summary(entries: Sequence[Entry], total: int, seconds: float, folder: Path, on_stderr: bool) -> None:
    from attlog.cli.shared.printing import Line
    from attlog.fleet.pages.summary import summary

    out = console(stderr=on_stderr)
    first, *others = summary(entries, total, seconds, folder, width=out.width)
    say([Line(""), Line(first, "bold"), *map(Line, others)], out)


def _write_tables(files: Sequence[Path], results: Sequence[Result], settings: Config) -> None:
    """The table of all logs as files for papers."""
    from attlog.base.output import write_together
    from attlog.compare.tables.analysis_table import head_and_rows
    from attlog.compare.tables.files import text

    content = head_and_rows(results, settings.window or "all")
    write_together({file: text(file, *content) for file in files})


def _kept(reports: Sequence[str], total: int, folder: Path) -> str:
    """What stands in the folder after an interrupt."""
    if not reports:
        return f"attlog: interrupted; nothing was written, reports of earlier runs in {folder} are untouched"
    names = ", ".join(f"{name}.html" for name in reports)
    return f"attlog: interrupted; kept {len(reports)} of {total} reports in {folder}: {names}"


def _show(result: Result, report: Path, settings: Config, on_stderr: bool, verbose: int) -> None:
    from attlog.cli.shared.printing import Line
    from attlog.cli.shared.terminal import printed
    from attlog.report import bundle_notice

    out = console(stderr=on_stderr)
    say(printed(result, settings.window or "all", out.width, out.encoding, bool(verbose)), out)
    say([Line(f"report: {report}")], out)
    notice = bundle_notice()
    if notice:
        to_stderr(f"attlog: {notice}")
