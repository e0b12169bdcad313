"""``attlog analyze``: a report and a JSON for each log; ``attlog schema``: the schema of the JSON."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from attlog import __version__
from attlog.cli.arguments import command_line
from attlog.cli.gates import GateOptions, GateReport, GatesFile
from attlog.cli.logs import end_command, named_sources, report_error
from attlog.cli.options import (
    OUTPUT,
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
    build_configuration,
    commands,
    one_form,
)
from attlog.cli.printing import (
    GrowingText,
    TextLine,
    console,
    json_to_stdout,
    say,
    table_to_stdout,
    text_to_stdout,
    to_stderr,
)
from attlog.cli.progress import Bar, compile_first, first_lines_shown, progress
from attlog.core.errors import EXIT_INTERRUPTED, PluginError, PluginTimeout, UsageError, error_message, exit_code

if TYPE_CHECKING:
    from attlog.batch.job import Record
    from attlog.batch.sources import Source
    from attlog.pipeline.config import Config
    from attlog.result import Result


def analyze_command(
    logs: Places,
    options: LogOptions,
    common: CommonOptions,
    output: Folder = Path("reports"),
    jobs: Jobs = 1,
    form: Form = None,
    json: Json = False,
    gates: GatesFile = None,
    figures: Figures = None,
    forum: Annotated[
        bool,
        typer.Option(
            "--forum",
            help="Print what happened as Markdown for a forum or an issue, without place, date, names, serial numbers.",
            rich_help_panel=OUTPUT,
        ),
    ] = False,
    open_report: Open = False,
) -> None:
    """Compare attitude filters with the onboard attitude.

    The filters run again on each LOG. A report and a JSON for each are written to a folder; sentences and a table are
    printed.

    Example: attlog analyze flight.ulg --estimators default,mahony:kp=0.3
    """
    one_form(json, form)
    if forum and (json or form is not None):
        raise UsageError("--forum and --json or --format both go to standard output; use one")
    settings = build_configuration(options)
    if figures is not None:
        from attlog.report.figures.files import find_browser

        find_browser()  # missing: reported before any log is read
    gate_report = GateReport(GateOptions(gates), output)
    run = AnalyzeRun(settings, options, common, output, gate_report, json, form, open_report, figures, forum)
    from attlog.batch.report_files import report_names

    found, wrong = named_sources(logs, run.codes)
    if len(found) > 1:
        run.several(found, jobs)
    else:
        for source in found:
            run.one(source)
    if form is not None and run.results:
        from attlog.compare.tables import analysis_rows

        table_to_stdout(form, *analysis_rows(run.results, settings.window or "all"))
    names = report_names([source.file_name for source in found])
    end_command(run.codes | run.gates.finish(names, wrong, interrupted=EXIT_INTERRUPTED in run.codes))


@dataclass
class AnalyzeRun:
    """Logs of one command: settings, and results of those that are done."""

    config: Config
    options: LogOptions
    common: CommonOptions
    folder: Path
    gates: GateReport
    json: bool
    form: TableForm | None
    open_report: bool
    figures: Path | None
    forum: bool = False
    results: list[Result] = field(default_factory=list)
    codes: set[int] = field(default_factory=set)

    def one(self, source: Source) -> None:
        """Analyse one log in this process and show it."""
        from attlog.batch.job import Record
        from attlog.batch.report_files import analyze_to_files, figure_starts, report_names

        name = report_names([source.file_name])[0]
        start = None if self.figures is None else figure_starts(self.figures, [source.file_name])[0]
        text = GrowingText(console(stderr=self._for_a_program))
        try:
            compile_first(self.config.estimators, [source], self.common.quiet)
            with (
                progress(self.common.quiet, self.common.verbose > 0) as shown,
                first_lines_shown(None if self.common.quiet or self._for_a_program else text, shown.clear),
                source.local() as log,
            ):
                written = analyze_to_files(
                    log.path,
                    self.config,
                    self.folder,
                    name,
                    command=command_line(),
                    deterministic=self.options.deterministic,
                    figures=start,
                )
            self._show(Record(source.name, name), written.result, text)
        except KeyboardInterrupt:
            to_stderr(_kept([], 1, self.folder))
            self.codes.add(EXIT_INTERRUPTED)
        except Exception as error:
            self.codes.add(report_error(error, source.name, self.common.verbose))
            message = error_message(error, __version__, source.name)
            self.gates.judge(Record(source.name, name, code=exit_code(error), message=message))

    def several(self, logs: Sequence[Source], jobs: int) -> None:
        """Analyse each log in a process of its own and show it as it comes."""
        from attlog.batch.job import Job, settings_key
        from attlog.batch.process import clean_up
        from attlog.batch.report_files import figure_starts, report_names
        from attlog.batch.run import in_memory, local_runner

        deterministic = self.options.deterministic
        key = settings_key(self.config, deterministic)
        names = report_names([source.file_name for source in logs])
        starts: Sequence[Path | None] = [None] * len(logs)
        if self.figures is not None:
            starts = figure_starts(self.figures, [source.file_name for source in logs])
        typed = commands(self.options, [source.name for source in logs])
        todo = [
            Job(source, name, self.folder, self.config, key, words, deterministic, figures=start, keep=False)
            for source, name, words, start in zip(logs, names, typed, starts, strict=True)
        ]
        done: dict[str, Record] = {}
        compile_first(self.config.estimators, logs, self.common.quiet)
        started = time.monotonic()
        with clean_up(self.folder), Bar(self.common.quiet, self.common.verbose > 0) as bar:
            coming = local_runner(jobs, bar.stage)(todo)
            try:
                bar.planned(todo)
                for record in coming:
                    done[record.name] = in_memory(record)
                    self.codes.add(record.code)
                    bar.advance(record)
                    with bar.aside():
                        if record.done:
                            self._load_and_show(record)
                        else:
                            self.gates.judge(record, timed=False)
                            to_stderr(record.trace * (self.common.verbose > 1) + record.message)
            except KeyboardInterrupt:
                self.codes.add(EXIT_INTERRUPTED)
            finally:
                coming.close()
        if not self.common.quiet:
            self._say_summary([done[name] for name in names if name in done], len(logs), time.monotonic() - started)
        if EXIT_INTERRUPTED in self.codes:
            to_stderr(_kept([r.name for r in done.values() if r.done], len(logs), self.folder))

    def _load_and_show(self, record: Record) -> None:
        from attlog.result import Result

        try:
            result = Result.load(self.folder / f"{record.name}.json")
            self._show(record, result, GrowingText(console(stderr=self._for_a_program)))
        except Exception as error:
            self.codes.add(report_error(error, record.log, self.common.verbose))

    def _show(self, record: Record, result: Result, text: GrowingText) -> None:
        """Print a result, whose first lines may be shown, and the outcome of gates."""
        from attlog.result import TIMED_OUT, nothing_ran

        page = self.folder / f"{record.name}.html"
        self.results.append(result)
        if any(finding.kind == TIMED_OUT for finding in result.findings):
            self.codes.add(PluginTimeout.exit_code)
        elif failed := nothing_ran(result.estimators):
            self.codes.add(PluginError.exit_code)
            to_stderr(f"attlog: {record.log}: no filter ran: {failed}")
        if self.json:
            json_to_stdout(result.to_dict(self.options.deterministic))
        if self.forum:
            from attlog.words.forum import forum_text

            text_to_stdout(("---\n\n" if len(self.results) > 1 else "") + forum_text(result))
        out = text.out
        if not self.common.quiet:
            from attlog.cli.tables import result_lines
            from attlog.report import bundle_notice

            text.show(result_lines(result, self.config.window or "all", text.width, self.common.verbose > 0))
            say([f"report: {page}"], out)
            if self.figures is not None:
                say([f"figures: {self.figures}"], out)
            if notice := bundle_notice():
                to_stderr(f"attlog: {notice}")
        self.gates.judge_and_print(record, self.common.quiet, out)
        if self.open_report:
            typer.launch(str(page))

    @property
    def _for_a_program(self) -> bool:
        """True if standard output is for a program."""
        return self.json or self.forum or self.form is not None

    def _say_summary(self, found: Sequence[Record], total: int, seconds: float) -> None:
        from attlog.batch.order import summary

        out = console(stderr=self._for_a_program)
        first, *others = summary(found, total, seconds, self.folder, width=out.width)
        say(["", TextLine(first, "bold"), *others], out)


def _kept(reports: Sequence[str], total: int, folder: Path) -> str:
    """Say what is in the folder after an interrupt."""
    if not reports:
        return f"attlog: interrupted; nothing was written, reports of earlier runs in {folder} are untouched"
    names = ", ".join(f"{name}.html" for name in reports)
    return f"attlog: interrupted; kept {len(reports)} of {total} reports in {folder}: {names}"


def schema_command() -> None:
    """Print the JSON schema of a result of analyze.

    Example: attlog schema > result.schema.json
    """
    import json

    from attlog.result.schema import schema

    typer.echo(json.dumps(schema(), indent=1))
