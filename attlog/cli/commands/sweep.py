"""``attlog sweep``: a grid of settings of one filter on one log or on many."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog.cli.logs import PreparedLogs, end, file_stem, parse_all
from attlog.cli.options import CommonOptions, ComparisonOptions
from attlog.cli.printing import TextLine, console, json_to_stdout, say, table, table_to_stdout, to_stderr, wrapped
from attlog.cli.progress import progress

if TYPE_CHECKING:
    from attlog.compare.comparison import Question
    from attlog.compare.search import SettingsOnLog, Sweep
    from attlog.compare.setting import Configuration

EXAMPLE = "attlog sweep *.bin mahony kp=0.6,1.1,2 ki=0..0.05/6"
METRICS = ("tilt_rmse_deg", "heading_rmse_deg")
MAX_SETTINGS = 8  # listed; -v lists all, and each log's own optimum

SettingWords = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG... FILTER [NAME=VALUES...]",
        show_default=False,
        help="Vary these parameters of this filter on these logs: kp=0.6,1.1,2 (values), ki=0..0.05/6 (6 even steps), "
        "ki=1e-4..0.1/7log (equal factors), mag_form=heading,vector (a switch).",
    ),
]
MetricList = Annotated[
    list[str] | None,
    typer.Option(
        "--metric",
        metavar="METRIC[@WINDOW]",
        help="Compare by this metric, the first decides; repeat it for more. [default: " + ", ".join(METRICS) + "]",
    ),
]


def command(words: SettingWords, options: ComparisonOptions, common: CommonOptions, metric: MetricList = None) -> None:
    """Try a grid of settings of one filter on logs.

    The best one is printed, those that do not differ significantly from it, and one for all logs.

    Example: attlog sweep flight.ulg mahony kp=0.2..2/6log
    """
    from attlog.compare import sweep_report
    from attlog.compare.grid import decimal_comma_hints, parse_grid, search_request
    from attlog.compare.search import sweep, swept_questions
    from attlog.compare.setting import parse_configuration

    asked = search_request(words, EXAMPLE)
    base = parse_configuration(asked.filter)
    metrics = metric or METRICS
    grid, questions = parse_all(lambda: parse_grid(asked.axes, base.row.estimator), lambda: swept_questions(metrics))
    for sentence in decimal_comma_hints(asked.axes):
        to_stderr(f"attlog: {sentence}")
    with progress(common.quiet, common.verbose > 0):
        logs = PreparedLogs(asked.logs, options)
        found = sweep(asked.filter, grid, _on_logs(logs, base, questions))
        files = _written(found, options.output, logs.about())
    if options.json:
        json_to_stdout(files[1].read_text(encoding="utf-8"))
    if options.form is not None:
        table_to_stdout(options.form, *sweep_report.sweep_rows(found))
    if not common.quiet:
        say(_printed(found, files, logs.about(), common.verbose > 0), console(stderr=options.for_a_program))
    end(logs.errors)


def _on_logs(logs: PreparedLogs, base: Configuration, metrics: Sequence[Question]) -> Iterator[SettingsOnLog]:
    """Yield the logs with their questions; each is released before the next."""
    from attlog.compare.search import SettingsOnLog

    for case in logs:
        yield SettingsOnLog(case, base, metrics)
        del case


def _written(found: Sweep, folder: Path, about: dict[str, Any]) -> tuple[Path, Path, Path]:
    """Write page, JSON and CSV together."""
    import json

    from attlog.compare import sweep_report
    from attlog.core.files import write_all_atomic

    name = file_stem("sweep", found.filter)
    paths = folder / f"{name}.html", folder / f"{name}.json", folder / f"{name}.csv"
    write_all_atomic(
        {
            paths[0]: sweep_report.sweep_page(found, about),
            paths[1]: json.dumps(sweep_report.sweep_document(found, about), indent=1, allow_nan=False) + "\n",
            paths[2]: sweep_report.sweep_csv(found),
        }
    )
    return paths


def _printed(found: Sweep, files: Sequence[Path], about: dict[str, Any], everything: bool) -> Iterator[TextLine]:
    from attlog.compare import sweep_report

    for sentence in sweep_report.sweep_sentences(found, sweep_report.count_references(about)):
        yield from wrapped("", sentence, 100)
    yield TextLine("")
    head, rows = sweep_report.sweep_rows(found)
    shown = rows if everything or len(rows) <= MAX_SETTINGS + 1 else rows[:MAX_SETTINGS]
    yield from table(shown, head, left=(0, -1), indent="  ")
    if len(shown) < len(rows):
        yield TextLine(f"  and {len(rows) - len(shown)} more; -v lists all")
    if everything and len(found.logs) > 1 and found.columns[0].single is not None:
        yield TextLine("")
        head, rows = sweep_report.sweep_log_rows(found, found.columns[0])
        yield from table(rows, head, left=(0, -1), indent="  ")
    yield TextLine("")
    yield TextLine(f"page: {files[0]}   data: {files[1].name}, {files[2].name}")
