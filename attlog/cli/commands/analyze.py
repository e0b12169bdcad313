"""``attlog analyze``: one report and one JSON per log, sentences and the table on the terminal."""

from __future__ import annotations

import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from attlog import __version__
from attlog.cli.arguments import command_line
from attlog.cli.gates import GateOptions, GateReport, GatesFile
from attlog.cli.options import (
    CommonOptions,
    Figures,
    Folder,
    Form,
    Jobs,
    Json,
    LogOptions,
    Open,
    Places,
    TableForm,
    commands,
    configured,
    one_form,
)
from attlog.cli.printing import TextLine, console, json_line, json_to_stdout, say, table_to_stdout, to_stderr
from attlog.cli.process import is_of_a_stream
from attlog.cli.progress import Bar, compile_first, progress
from attlog.core.errors import (
    EXIT_BUG,
    EXIT_INTERRUPTED,
    PluginError,
    PluginTimeout,
    error_message,
    exit_code,
    worst_exit_code,
)

if TYPE_CHECKING:
    from attlog.batch.index_row import Entry
    from attlog.batch.sources import Source
    from attlog.pipeline.config import Config
    from attlog.result import Result


def command(
    logs: Places,
    options: LogOptions,
    common: CommonOptions,
    output: Folder = Path("reports"),
    jobs: Jobs = 1,
    form: Form = None,
    json: Json = False,
    gates: GatesFile = None,
    figures: Figures = None,
    open_report: Open = False,
) -> None:
    """Compare attitude filters with the onboard attitude.

    The filters run again on each LOG. A report and a JSON for each are written to a folder; sentences and a table are
    printed.

    Example: attlog analyze flight.ulg --estimators default,mahony:kp=0.3
    """
    one_form(json, form)
    settings = configured(options)
    if figures is not None:
        from attlog.report.figures.files import find_browser

        find_browser()  # none: said before the logs are read
    gate_report = GateReport(GateOptions(gates), output)
    run = AnalyzeRun(settings, options, common, output, gate_report, json, form, open_report, figures)
    from attlog.batch.report_files import report_names
    from attlog.batch.sources import sources

    found, wrong = sources(logs)
    for error in wrong:
        to_stderr(error_message(error, __version__))
    if len(found) > 1:
        run.several(found, jobs)
    else:
        for source in found:
            run.one(source)
    if form is not None and run.results:
        from attlog.compare.tables import analysis_rows

        table_to_stdout(form, *analysis_rows(run.results, settings.window or "all"))
    names = report_names([source.file_name for source in found])
    codes = run.codes | {exit_code(error) for error in wrong}
    codes |= run.gates.finish(names, wrong, interrupted=EXIT_INTERRUPTED in codes)
    if worst_exit_code(codes):
        raise typer.Exit(worst_exit_code(codes))


class AnalyzeRun:
    """The logs of one command: how each is treated, and what came of those that are done."""

    def __init__(
        self,
        config: Config,
        options: LogOptions,
        common: CommonOptions,
        folder: Path,
        gates: GateReport,
        json: bool,
        form: TableForm | None,
        open_report: bool,
        figures: Path | None,
    ) -> None:
        self.config, self.options, self.folder, self.gates = config, options, folder, gates
        self.quiet, self.verbose = common.quiet, common.verbose
        self.json, self.form, self.open_report, self.figures = json, form, open_report, figures
        self.results: list[Result] = []
        self.codes: set[int] = set()

    def one(self, source: Source) -> None:
        """Analyse one log in this process and show it."""
        from attlog.batch.report_files import analyze_to_files, figure_starts, report_names

        name = report_names([source.file_name])[0]
        try:
            compile_first(self.config.estimators, self.quiet)
            with progress(self.quiet, self.verbose > 0), source.local() as log:
                written = analyze_to_files(
                    log.path,
                    self.config,
                    self.folder,
                    name,
                    command=command_line(),
                    deterministic=self.options.deterministic,
                    figures=None if self.figures is None else figure_starts(self.figures, [source.file_name])[0],
                )
            self._show(source.name, written.result, written.report)
        except KeyboardInterrupt:
            to_stderr(_kept([], 1, self.folder))
            self.codes.add(EXIT_INTERRUPTED)
        except Exception as error:
            self._failed(error, source.name)
            self.gates.broken(source.name, name, exit_code(error), error_message(error, __version__, source.name))

    def several(self, logs: Sequence[Source], jobs: int) -> None:
        """Analyse each log in a process of its own and show it as it comes."""
        from attlog.batch.job import Work, settings_key
        from attlog.batch.process import tidied
        from attlog.batch.report_files import figure_starts, report_names
        from attlog.batch.run import entry_of, local_runner

        deterministic = self.options.deterministic
        key = settings_key(self.config, deterministic)
        names = report_names([source.file_name for source in logs])
        starts: Sequence[Path | None] = [None] * len(logs)
        if self.figures is not None:
            starts = figure_starts(self.figures, [source.file_name for source in logs])
        typed = commands(self.options, [source.name for source in logs])
        works = [
            Work(source, name, self.folder, self.config, key, words, deterministic, figures=start, keep=False)
            for source, name, words, start in zip(logs, names, typed, starts, strict=True)
        ]
        done: dict[str, Entry] = {}
        compile_first(self.config.estimators, self.quiet)
        started = time.monotonic()
        with tidied(self.folder), Bar(self.quiet, self.verbose > 0) as bar:
            coming = local_runner(jobs, bar.stage)(works)
            try:
                bar.planned(works)
                for record in coming:
                    done[record.name] = entry_of(record)
                    self.codes.add(record.code)
                    bar.advance(record)
                    with bar.aside():
                        if record.done:
                            self._load_and_show(record.log, record.name)
                        else:
                            self.gates.broken(record.log, record.name, record.code, record.message)
                            to_stderr(record.trace * (self.verbose > 1) + record.message)
            except KeyboardInterrupt:
                self.codes.add(EXIT_INTERRUPTED)
            finally:
                coming.close()
        if not self.quiet:
            self._say_summary([done[name] for name in names if name in done], len(logs), time.monotonic() - started)
        if EXIT_INTERRUPTED in self.codes:
            to_stderr(_kept([e.name for e in done.values() if e.row is not None], len(logs), self.folder))

    def _load_and_show(self, log: str, name: str) -> None:
        from attlog.result import Result

        try:
            self._show(log, Result.load(self.folder / f"{name}.json"), self.folder / f"{name}.html")
        except Exception as error:
            self._failed(error, log)

    def _show(self, log: str, result: Result, report: Path) -> None:
        """Print a result, and what gates say of it."""
        from attlog.result import TIMED_OUT, nothing_ran

        self.results.append(result)
        if any(finding.kind == TIMED_OUT for finding in result.findings):
            self.codes.add(PluginTimeout.exit_code)
        elif failed := nothing_ran(result.estimators):
            self.codes.add(PluginError.exit_code)
            to_stderr(f"attlog: {log}: no filter ran: {failed}")
        if self.json:
            json_to_stdout(json_line(result.to_dict(self.options.deterministic)))
        out = console(stderr=self._on_stderr)
        if not self.quiet:
            from attlog.cli.tables import printed
            from attlog.report import bundle_notice

            say(printed(result, self.config.window or "all", out.width, out.encoding, self.verbose > 0), out)
            say([TextLine(f"report: {report}")], out)
            if self.figures is not None:
                say([TextLine(f"figures: {self.figures}")], out)
            if notice := bundle_notice():
                to_stderr(f"attlog: {notice}")
        self.gates.shown(log, report, self.quiet, out)
        if self.open_report:
            typer.launch(str(report))

    @property
    def _on_stderr(self) -> bool:
        """Whether standard output is for a program."""
        return self.json or self.form is not None

    def _failed(self, error: Exception, log: str) -> None:
        """Say what went wrong with a log. An error of standard output is none of the log."""
        if is_of_a_stream(error):
            raise error
        if self.verbose > 1 and exit_code(error) == EXIT_BUG:
            to_stderr("".join(traceback.format_exception(error)))
        to_stderr(error_message(error, __version__, log))
        self.codes.add(exit_code(error))

    def _say_summary(self, entries: Sequence[Entry], total: int, seconds: float) -> None:
        from attlog.batch.order import summary

        out = console(stderr=self._on_stderr)
        first, *others = summary(entries, total, seconds, self.folder, width=out.width)
        say([TextLine(""), TextLine(first, "bold"), *map(TextLine, others)], out)


def _kept(reports: Sequence[str], total: int, folder: Path) -> str:
    """What stands in the folder after an interrupt."""
    if not reports:
        return f"attlog: interrupted; nothing was written, reports of earlier runs in {folder} are untouched"
    names = ", ".join(f"{name}.html" for name in reports)
    return f"attlog: interrupted; kept {len(reports)} of {total} reports in {folder}: {names}"
