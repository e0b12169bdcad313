"""``attlog sweep``: a grid of settings of one filter on one log or on many."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog.cli.shared.options import CommonOptions
from attlog.cli.shared.prepared_logs import PreparedLogs, all_problems, end, one_unit, stem
from attlog.cli.shared.printing import (
    TextLine,
    aligned,
    console,
    json_to_stdout,
    say,
    table_to_stdout,
    to_stderr,
    wrapped,
)
from attlog.cli.shared.progress import progress
from attlog.cli.shared.settings import ComparisonOptions

if TYPE_CHECKING:
    from attlog.compare.configurations.configuration import Configuration
    from attlog.compare.sweep.many import SettingsOnLog, SweptMetric
    from attlog.compare.sweep.sweep import Sweep

EXAMPLE = "attlog sweep *.bin mahony kp=0.6,1.1,2 ki=0..0.05/6"
METRICS = ("inclination_rmse_deg", "heading_rmse_deg")
SHOWN = 8
"""So many settings are listed; -v lists all, and each log's own optimum."""

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
    from attlog.compare.configurations.configuration import parse
    from attlog.compare.sweep import many
    from attlog.compare.sweep import text as sweep_words
    from attlog.compare.sweep.grid import grid, like_decimal_commas, search_request
    from attlog.compare.sweep.sweep import sweep

    asked = search_request(words, EXAMPLE)
    base = parse(asked.filter)
    metrics = metric or METRICS
    all_problems(lambda: grid(asked.axes, base.row.estimator), lambda: many.wanted(metrics))
    for sentence in like_decimal_commas(asked.axes):
        to_stderr(f"attlog: {sentence}")
    settings = one_unit(options)
    with progress(common.quiet, common.verbose > 0):
        logs = PreparedLogs(asked.logs, settings)
        found = sweep(asked.filter, grid(asked.axes, base.row.estimator), _on_logs(logs, base, many.wanted(metrics)))
        files = _written(found, options.output, logs.about())
    if options.json:
        json_to_stdout(files[1].read_text(encoding="utf-8"))
    if options.form is not None:
        table_to_stdout(options.form, *sweep_words.rows(found))
    if not common.quiet:
        say(_printed(found, files, logs.about(), common.verbose > 0), console(stderr=options.for_a_program))
    end(logs.errors)


def _on_logs(logs: PreparedLogs, base: Configuration, metrics: Sequence[SweptMetric]) -> Iterator[SettingsOnLog]:
    """The logs with what is asked of them; each is released when the next is asked for."""
    from attlog.compare.sweep.many import SettingsOnLog

    for case in logs:
        yield SettingsOnLog(case, base, metrics)
        del case


def _written(found: Sweep, folder: Path, about: dict[str, Any]) -> tuple[Path, Path, Path]:
    """The page, the JSON and the CSV, written together."""
    import json

    from attlog.base.files.output import write_together
    from attlog.compare.sweep import text as sweep_words
    from attlog.compare.sweep.page import sweep_page

    name = stem("sweep", found.filter)
    paths = folder / f"{name}.html", folder / f"{name}.json", folder / f"{name}.csv"
    write_together(
        {
            paths[0]: sweep_page(found, about),
            paths[1]: json.dumps(sweep_words.document(found, about), indent=1, allow_nan=False) + "\n",
            paths[2]: sweep_words.csv_text(found),
        }
    )
    return paths


def _printed(found: Sweep, files: Sequence[Path], about: dict[str, Any], everything: bool) -> Iterator[TextLine]:
    from attlog.compare.sweep import text as sweep_words

    for sentence in sweep_words.sentences(found, sweep_words.references_of(about)):
        yield from wrapped("", sentence, 100)
    yield TextLine("")
    head, rows = sweep_words.rows(found)
    shown = rows if everything or len(rows) <= SHOWN + 1 else rows[:SHOWN]
    yield from aligned(head, shown)
    if len(shown) < len(rows):
        yield TextLine(f"  and {len(rows) - len(shown)} more; -v lists all")
    if everything and len(found.logs) > 1 and found.columns[0].single is not None:
        yield TextLine("")
        yield from aligned(*sweep_words.log_rows(found, found.columns[0]))
    yield TextLine("")
    yield TextLine(f"page: {files[0]}   data: {files[1].name}, {files[2].name}")
