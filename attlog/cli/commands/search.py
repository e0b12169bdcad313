"""``attlog sweep``: a grid of settings of one filter; ``attlog tune``: gains judged on logs left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog.cli.logs import PreparedLogs, end_command, file_stem, parse_all
from attlog.cli.options import CommonOptions, ComparisonOptions
from attlog.cli.printing import TextLine, console, json_to_stdout, say, table, table_to_stdout, to_stderr, wrapped
from attlog.cli.progress import progress
from attlog.core.own_files import SWEEP, TUNING, FileKind, require_replaceable

if TYPE_CHECKING:
    from attlog.compare.search import SettingsOnLog, Sweep
    from attlog.compare.setting import Configuration
    from attlog.compare.tune import Tuning
    from attlog.metrics.metric import Case


SWEEP_EXAMPLE = "attlog sweep *.bin mahony kp=0.6,1.1,2 ki=0..0.05/6"
SWEEP_METRICS = ("tilt_rmse_deg", "heading_rmse_deg")
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
        help="Compare by this metric, the first decides; repeat it for more. [default: "
        + ", ".join(SWEEP_METRICS)
        + "]",
    ),
]


def sweep_command(
    words: SettingWords, options: ComparisonOptions, common: CommonOptions, metric: MetricList = None
) -> None:
    """Try a grid of settings of one filter on logs.

    The best one is printed, those that do not differ significantly from it, and one for all logs.

    Example: attlog sweep flight.ulg mahony kp=0.2..2/6log
    """
    from attlog.compare import sweep_report
    from attlog.compare.grid import decimal_comma_hints, parse_grid, search_request
    from attlog.compare.search import sweep, swept_questions
    from attlog.compare.setting import parse_configuration

    asked = search_request(words, SWEEP_EXAMPLE)
    base = parse_configuration(asked.filter)
    metrics = metric or SWEEP_METRICS
    grid, _ = parse_all(lambda: parse_grid(asked.axes, base.row.estimator), lambda: swept_questions(metrics))
    for sentence in () if base.is_flown else decimal_comma_hints(asked.axes):
        to_stderr(f"attlog: {sentence}")
    stem = options.output / file_stem("sweep", asked.filter)
    _require_replaceable(SWEEP, stem, "html", "json", "csv")
    with progress(common.quiet, common.verbose > 0):
        logs = PreparedLogs(asked.logs, options, _reproduction_check(base, options))
        found = sweep(asked.filter, grid, _on_logs(logs, base, metric, [axis.name for axis in grid.axes]))
        about = logs.about()
        document = _json_text(sweep_report.sweep_document(found, about))
        files = []
        if any(c.single is not None for c in found.columns) or not stem.with_name(f"{stem.name}.html").exists():
            page, csv = sweep_report.sweep_page(found, about), sweep_report.sweep_csv(found)
            files = _write(SWEEP, stem, html=page, json=document, csv=csv)
    if options.json:
        json_to_stdout(document)
    if options.form is not None:
        table_to_stdout(options.form, *sweep_report.sweep_rows(found))
    if not common.quiet:
        lines = _sweep_lines(found, files, about, common.verbose > 0)
        say(lines, console(stderr=options.for_a_program))
    end_command(logs.errors)


def _reproduction_check(base: Configuration, options: ComparisonOptions) -> Callable[[Case], object] | None:
    """Return the check that a filter that flew, run again, follows its own attitude; None where it is not wanted."""
    from attlog.compare.filter_input import require_reproduction

    return partial(require_reproduction, name=base.row.estimator.name) if base.is_flown and not options.anyway else None


def _on_logs(
    logs: PreparedLogs, base: Configuration, metrics: Sequence[str] | None, axes: Sequence[str]
) -> Iterator[SettingsOnLog]:
    """Yield the logs with the questions of ``metrics``, by default those that the first log answers."""
    from attlog.compare.search import SettingsOnLog, flown_questions, swept_questions

    questions = swept_questions(metrics or SWEEP_METRICS)
    for number, case in enumerate(logs):
        if number == 0 and base.is_flown and not metrics:
            judged, innovations = flown_questions([case], base, axes, SWEEP_METRICS)
            questions = judged + innovations
        yield SettingsOnLog(case, base, questions)
        del case


def _json_text(document: dict[str, Any]) -> str:
    import json

    return json.dumps(document, indent=1, allow_nan=False) + "\n"


def _require_replaceable(kind: FileKind, stem: Path, *suffixes: str) -> None:
    """Raise OutputError before any log is read if a file of this name is not of this kind."""
    for suffix in suffixes:
        require_replaceable(stem.with_name(f"{stem.name}.{suffix}"), kind)


def _write(kind: FileKind, stem: Path, **texts: str) -> list[Path]:
    """Write files of one kind and name together, ``texts`` by suffix."""
    from attlog.core.files import write_all_atomic

    files: dict[Path, str | bytes] = {stem.with_name(f"{stem.name}.{suffix}"): text for suffix, text in texts.items()}
    write_all_atomic(files, kind)
    return list(files)


def _sweep_lines(found: Sweep, files: Sequence[Path], about: dict[str, Any], everything: bool) -> Iterator[TextLine]:
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
    if files:
        yield TextLine(f"page: {files[0]}   data: {files[1].name}, {files[2].name}")
    else:
        yield TextLine("no page: an earlier one is kept")


TUNE_EXAMPLE = "attlog tune *.bin mahony kp=0.05..5log ki=0.001..0.1log"
# Metrics that gains may worsen beside the objective.
SIDE_EFFECT_METRICS = (
    "tilt_rmse_deg",
    "heading_rmse_deg",
    "noise_tilt_deg",
    "noise_tilt_deg@hover",
    "noise_tilt_deg@cruise",
    "step_error_deg.0.5s",
    "lag_ms",
)

TuneWords = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG... FILTER [NAME=LOW..HIGH[log]...]",
        show_default=False,
        help="Tune this filter on these logs between these gains. Without any: all that it has, a factor of 20 "
        "around the defaults.",
    ),
]


def tune_command(
    words: TuneWords,
    options: ComparisonOptions,
    common: CommonOptions,
    objective: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=WEIGHT,...",
            help="Make this small: tilt, heading, total, noise (hover), rest_noise, step, lag, drift or "
            "METRIC[@WINDOW], with weights. [default: tilt=1, with a magnetometer heading=1 too]",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Seed the search; the same seed repeats it.")] = 0,
) -> None:
    """Find gains that hold on logs they were not found on.

    What the gains of a FILTER improve and cost on logs that were left out is printed.

    Example: attlog tune *.bin mahony kp=0.05..5log --objective tilt=1,noise=0.5
    """
    from attlog.compare import tune_report
    from attlog.compare.grid import parse_free_parameters, search_request
    from attlog.compare.search import SettingsOnLog, flown_questions, swept_questions
    from attlog.compare.setting import parse_configuration
    from attlog.compare.tune import GENERATIONS, ObjectiveTerm, parse_objective, tune

    asked = search_request(words, TUNE_EXAMPLE)
    base = parse_configuration(asked.filter)
    uses_mag = "mag" in base.row.estimator.uses and base.before.get("mag") != "off"
    goals = objective or (["tilt"] if not uses_mag else ["tilt", "heading"])
    free, terms = parse_all(
        lambda: parse_free_parameters(asked.axes, base.row.estimator), lambda: parse_objective(goals)
    )
    stem = options.output / file_stem("tune", asked.filter)
    _require_replaceable(TUNING, stem, "html", "json")
    with progress(common.quiet, common.verbose > 0):
        prepared = PreparedLogs(asked.logs, options, _reproduction_check(base, options))
        cases = list(prepared)
        beside = swept_questions(SIDE_EFFECT_METRICS)
        if base.is_flown:
            judged, innovations = flown_questions(cases, base, [f.name for f in free], SWEEP_METRICS)
            beside += innovations
            terms = terms if objective else [ObjectiveTerm.of(q) for q in judged or innovations]
        logs = [SettingsOnLog(c, base, [t.question for t in terms], guarded=True) for c in cases]
        others = [SettingsOnLog(c, base, beside) for c in cases]
        first = {f.name: logs[0].values[f.name] for f in free}
        found = tune(asked.filter, free, terms, logs, others, first, GENERATIONS, seed)
        about = prepared.about()
        files = _write(
            TUNING,
            stem,
            html=tune_report.tune_page(found, about),
            json=_json_text(tune_report.tune_document(found, about)),
        )
    if options.json:
        json_to_stdout(files[1].read_text(encoding="utf-8"))
    if options.form is not None:
        table_to_stdout(options.form, *tune_report.held_out_rows(found))
    if not common.quiet:
        lines = _tuning_lines(found, files, about, common.verbose > 0)
        say(lines, console(stderr=options.for_a_program))
    end_command(prepared.errors)


def _tuning_lines(found: Tuning, files: Sequence[Path], about: dict[str, Any], everything: bool) -> Iterator[TextLine]:
    """Yield the recommendation, gains to paste and their effect; ``everything``: also the gains of each fold."""
    from attlog.compare import tune_report
    from attlog.compare.sweep_report import count_references

    for sentence in tune_report.tune_sentences(found, count_references(about)):
        yield from wrapped("", sentence, 100)
    yield TextLine("")
    for line in tune_report.paste_lines(found):
        yield TextLine(f"  {line}", "bold")
    yield TextLine("")
    tables = [tune_report.held_out_rows(found), *([tune_report.gain_rows(found)] if everything else [])]
    for head, rows in tables:
        yield from table(rows, head, left=(0, -1), indent="  ")
        yield TextLine("")
    yield TextLine(f"page: {files[0]}   data: {files[1].name}")
