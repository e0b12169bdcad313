"""``attlog compare``: configurations by paired differences; ``attlog diff``: what changed between two runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from attlog import __version__
from attlog.cli import options as completion
from attlog.cli.arguments import command_line
from attlog.cli.logs import end_command, named_files
from attlog.cli.options import (
    CommonOptions,
    ComparisonOptions,
    Jobs,
    Json,
    Open,
    check_window,
    for_comparison,
    one_form,
)
from attlog.cli.printing import TextLine, console, json_to_stdout, say, table, text_to_stdout, to_stderr, wrapped
from attlog.cli.progress import StageHandler, progress
from attlog.core.errors import PluginError, PluginTimeout, UsageError, error_message
from attlog.core.files import file_name, write_atomic
from attlog.core.own_files import COMPARISON, DIFFERENCE, require_replaceable

if TYPE_CHECKING:
    from attlog.compare.comparison import Comparison
    from attlog.compare.diff import RunDifference
    from attlog.compare.run import LogComparison


@dataclass(frozen=True, slots=True)
class CompareOptions:
    """What is compared, where, and what the files are called."""

    metric: Annotated[
        list[str] | None,
        typer.Option(metavar="ID|all", help="Compare by this metric; repeat it for more. [default: the main ones]"),
    ] = None
    window: Annotated[
        str | None,
        typer.Option(
            metavar="W",
            autocompletion=completion.complete_windows,
            help="Compare in this window: all, rest, airborne, hover, cruise, idle or T0:T1 (s). [default: by "
            "question]",
        ),
    ] = None
    params: Annotated[
        Path | None,
        typer.Option(
            metavar="NEW.param",
            help="Use the parameters of this file for the firmware's own filters, beside the log's. [default: none]",
        ),
    ] = None
    name: Annotated[str, typer.Option(metavar="NAME", help="Call the files this.")] = "compare"
    jobs: Jobs = 1
    open_page: Open = False


def compare_command(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG... CONFIGURATION...",
            show_default=False,
            help="Compare these filters on these logs: NAME[@PRESET][:key=value,...], FILE.py, filters.toml, "
            "estimate.csv.",
        ),
    ],
    options: ComparisonOptions,
    own: CompareOptions,
    common: CommonOptions,
) -> None:
    """Compare configurations of filters on logs.

    Each is compared with the first one.
    Differences of each log and of all logs together are printed and written: a page, a JSON, a CSV.

    Example: attlog compare a.bin b.bin mahony:kp=0.3 mahony:kp=0.6
    """
    if file_name(own.name) != own.name:
        raise UsageError(f"--name {own.name!r}: no name of a file in the folder of -o; such as {file_name(own.name)}")
    check_window(own.window)
    from attlog.compare.run import compare
    from attlog.compare.same_flight import repeat_warning
    from attlog.compare.setting_words import select_words, with_params_file

    found = select_words(words)
    configurations = with_params_file(found.configurations, own.params) if own.params else found.configurations
    if found.repeats and len(configurations) < 2:
        raise UsageError(f"{found.repeats[0]}; a comparison needs two that differ")
    for sentence in found.repeats:
        to_stderr(f"attlog: {sentence}; it is compared once")
    settings = for_comparison(options, found.options | ({} if own.window is None else {"window": own.window}))
    if not found.logs:
        raise UsageError("no log named: attlog compare LOG... mahony:kp=0.3 mahony:kp=0.6")
    for suffix in ("html", "json", "csv"):  # before hours of work
        require_replaceable(options.output / f"{own.name}.{suffix}", COMPARISON)
    codes: set[int] = set()
    logs = named_files(found.logs, codes)
    result = None
    with progress(common.quiet, common.verbose > 0) as stages:
        if logs:
            result = compare(
                logs,
                configurations,
                settings,
                metrics=own.metric or found.metrics,
                anyway=options.anyway,
                jobs=own.jobs,
                command=command_line(),
                progress=LogReport(stages, len(logs), common.verbose, codes).one,
            )
    for line in result.logs if result is not None else ():
        if line.same_as:
            to_stderr(f"attlog: {repeat_warning(line.name, line.same_as)}")
    if result is not None:
        codes |= {line.code for line in result.logs}
        page = _write_comparison(result, options.output, own.name)
        _print_comparison(result, page, options, common)
        if own.open_page and page is not None:
            typer.launch(str(page))
    end_command(codes)


class LogReport:
    """Print errors of each log as it comes, and add its exit code to ``codes``."""

    def __init__(self, stages: StageHandler, total: int, verbose: int, codes: set[int]) -> None:
        self._stages, self._total, self._verbose, self._codes = stages, total, verbose, codes
        self._done = 0
        stages.before = f"[1/{total}] "

    def one(self, log: LogComparison) -> None:
        """Print what went wrong with a log."""
        self._done += 1
        self._stages.clear()
        for sentence in log.overruns:
            self._codes.add(PluginTimeout.exit_code)
            to_stderr(f"attlog: {log.line.path}: {sentence}")
        for sentence in log.remarks:
            to_stderr(f"attlog: {log.line.path}: {sentence}")
        if log.nothing_ran and not log.overruns:
            self._codes.add(PluginError.exit_code)
            to_stderr(f"attlog: {log.line.path}: no configuration ran: {log.nothing_ran}")
        if log.line.code:
            to_stderr(log.trace * (self._verbose > 1) + f"attlog: {log.line.path}: {log.line.reason}")
        self._stages.before = f"[{min(self._done + 1, self._total)}/{self._total}] "


def _write_comparison(result: Comparison, folder: Path, name: str) -> Path | None:
    """Write the page, with JSON and CSV beside it.

    None where no log could be used, and where no log answers a question and an earlier page is there: it is kept.
    """
    from attlog.compare import comparison_page
    from attlog.compare import tables as export
    from attlog.core.files import write_all_atomic

    place = folder / f"{name}.html"
    if not result.used or (not result.answers and place.exists()):
        return None
    data = {folder / f"{name}.json": result.to_json(), folder / f"{name}.csv": export.comparison_text(result, "csv")}
    write_all_atomic({place: comparison_page.render_comparison(result)} | data, COMPARISON)
    return place


def _print_comparison(result: Comparison, page: Path | None, options: ComparisonOptions, common: CommonOptions) -> None:
    if options.json:
        json_to_stdout(result.to_json())
    if options.form is not None:
        from attlog.compare import tables as export

        text_to_stdout(export.comparison_text(result, options.form))
    if not common.quiet:
        out = console(stderr=options.for_a_program)
        if not result.used:  # the reasons were printed log by log
            return
        say(comparison_lines(result, out.width, common.verbose > 0), out)
        say(["no page: an earlier one is kept" if page is None else f"page: {page}"], out)


# Lines of a table behind which what is above it has scrolled away.
SCREEN_LINES = 24


def comparison_lines(result: Comparison, width: int, verbose: bool = False) -> Iterator[TextLine]:
    """Yield what is significant and the change over all logs, below a long table the first sentence again.

    ``verbose``: also a sentence for each significant question, and tables with a row for each log.
    """
    from attlog.words.text import clean, typeset

    leads = [line for v in result.verdicts for line in wrapped("", typeset(clean(v.lead)), width, "bold")]
    yield from leads
    for text in (text for v in result.verdicts for text in (v.more if verbose else ())):
        yield from wrapped("  ", typeset(clean(text)), width)
    yield TextLine("")
    tables = list(_each_log(result, width) if verbose else _over_all_logs(result, width))
    yield from tables
    for line in (line for line in result.logs if line.code):
        yield from wrapped("not used: ", clean(f"{line.name}: {line.reason}"), width)
    for log, reason in result.without_answer.items():
        yield from wrapped("no answer: ", clean(f"{log}: {reason}" if reason else log), width)
    if len(tables) > SCREEN_LINES:
        yield from leads


def _over_all_logs(result: Comparison, width: int) -> Iterator[TextLine]:
    """Yield a row for each question: all about one change, or the changes of several configurations."""
    from attlog.compare.tables import pooled_tables
    from attlog.words.text import clean

    for found in pooled_tables(result, width):
        yield TextLine(clean(found.title), "bold")
        yield from table(found.rows, [*map(clean, found.head)], left=(0, -1))
        yield TextLine("")


def _each_log(result: Comparison, width: int) -> Iterator[TextLine]:
    """Yield a table for each question and configuration, a row for each log with the reason of a missing value."""
    from attlog.compare.tables import comparison_tables
    from attlog.words.text import clean, typeset

    for found in comparison_tables(result):
        if not any(row[3] for row in found.rows):
            continue
        yield TextLine(f"{found.title} ({found.caption})", "bold")
        cells = [[clean(cell) for cell in row] for row in (found.head, *found.rows)]
        yield from table(cells[1:], cells[0], left=(0, -1), indent="  ")
        for reason in dict.fromkeys(filter(None, found.reasons)):
            yield from wrapped("  – ", typeset(clean(reason)), width)
        yield TextLine("")


def diff_command(
    old: Annotated[
        Path,
        typer.Argument(metavar="OLD", show_default=False, help="Compare this result of analyze, or folder of results."),
    ],
    new: Annotated[
        Path, typer.Argument(metavar="NEW", show_default=False, help="Compare it with these of a newer run.")
    ],
    common: CommonOptions,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            metavar="METRIC=VALUE|PCT%",
            help="Let a metric move so far: lag_ms=2, noise_*=5%. [default: 2 %, or a small step of its unit]",
        ),
    ] = None,
    window: Annotated[
        str | None, typer.Option(metavar="W", help="Compare the numbers of this window. [default: every window]")
    ] = None,
    form: Annotated[
        Literal["md"] | None,
        typer.Option("--format", metavar="md", help="Print the table as Markdown. [default: for reading]"),
    ] = None,
    json: Json = False,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FOLDER",
            help="Write a page and its JSON into this folder; with --format or --json this file. [default: print]",
        ),
    ] = None,
) -> None:
    """Compare two results, or two folders of them.

    Changed answers and numbers beyond their tolerance are printed, worst first, then parameters and gains.
    Exit code 1: something changed.

    Example: attlog diff reports-old reports-new --tolerance lag_ms=2
    """
    one_form(json, form)
    from json import dumps

    from attlog.compare import diff_report
    from attlog.compare.diff import compare_results, metric_units, pair_results, parse_tolerances

    found = pair_results(old, new)
    for error in found.wrong:
        to_stderr(error_message(error, __version__))
    results = [r for pair in found.pairs.values() for r in pair if r is not None]
    windows = {w for r in results for row in r.estimators for w in row.metrics}
    if window is not None and window not in windows and results:
        raise UsageError(f"--window {window}: no result has it; they have {', '.join(sorted(windows))}")
    limits = parse_tolerances(tolerance or [], metric_units(*results))
    differences = [
        compare_results(name, a, b, limits, window)
        for name, (a, b) in found.pairs.items()
        if a is not None and b is not None
    ]
    alone = found.alone
    changed = bool(alone) or any(d.count for d in differences)
    if json:
        lines = dumps(diff_report.diff_document(differences, alone), indent=1, allow_nan=False).split("\n")
    else:
        words = diff_report.diff_lines if form is None else diff_report.diff_markdown
        lines = list(words(differences, alone, common.verbose > 0))
    if not found.pairs and not alone and found.wrong:
        end_command(found.wrong)  # nothing was compared, and an earlier file is kept
    if output is not None and (json or form is not None):
        write_atomic(output, "\n".join(lines) + "\n", DIFFERENCE)
    else:
        if output is not None:
            lines += ["", f"page: {_write_diff_page(differences, alone, (old, new), output)}"]
        say(lines, console())
    end_command([*found.wrong, int(changed)])


def _write_diff_page(
    differences: list[RunDifference], alone: list[tuple[str, str]], sides: tuple[Path, Path], folder: Path
) -> Path:
    """Write the page and the JSON together."""
    from json import dumps

    from attlog.compare import diff_report
    from attlog.core.files import write_all_atomic

    whole = dumps(diff_report.diff_document(differences, alone), indent=1, allow_nan=False) + "\n"
    same = sides[0].name == sides[1].name
    names = [f"{side.parent.name}/{side.name}" if same else side.name for side in sides]
    page = diff_report.diff_page(differences, alone, names[0], names[1], __version__, command_line())
    write_all_atomic({folder / "diff.html": page, folder / "diff.json": whole}, DIFFERENCE)
    return folder / "diff.html"
