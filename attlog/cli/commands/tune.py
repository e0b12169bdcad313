"""``attlog tune``: gains from logs, judged on logs that were left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog.base.errors import UsageError
from attlog.cli.commands.sweep import ConfigFile, Prepared, ReferenceName, aligned, analysis_settings, end, stem
from attlog.cli.shared.options import FilterTimeout
from attlog.cli.shared.printing import Json, NoColor, Quiet, Verbose, console, json_to_stdout, say
from attlog.cli.shared.progress import progress

if TYPE_CHECKING:
    from attlog.cli.shared.printing import Line
    from attlog.compare.sweep.many import SettingsOnLog
    from attlog.compare.tune.search import FreeParameter
    from attlog.compare.tune.tune import Tuning

EXAMPLE = "attlog tune *.bin mahony kp=0.05..5log ki=0.001..0.1log"
ELSEWHERE = (
    "inclination_rmse_deg",
    "heading_rmse_deg",
    "noise_tilt_deg",
    "noise_tilt_deg@hover",
    "noise_tilt_deg@cruise",
    "step_error_deg.0.5s",
    "lag_ms",
)
"""What gains may cost beside what they were found for."""

TuneWords = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG... FILTER [NAME=LOW..HIGH[log]...]",
        show_default=False,
        help="Logs, folders, quoted patterns; a filter as in analyze; which gains between what. Without any: all that "
        "it has, a factor of 20 around their defaults.",
    ),
]


def command(
    words: TuneWords,
    objective: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=WEIGHT,...",
            help="What to make small: tilt, heading, total, noise (hover), rest_noise, step, lag, drift or "
            "METRIC[@WINDOW], with weights. [default: tilt=1, with a magnetometer heading=1 too]",
        ),
    ] = None,
    generations: Annotated[
        int, typer.Option(metavar="N", min=1, max=200, help="Generations of 32 settings in each search.")
    ] = 6,
    seed: Annotated[
        int, typer.Option(metavar="N", min=0, help="Another seed, another search; the same one repeats it.")
    ] = 0,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for page and JSON.")] = Path(
        "reports"
    ),
    table: Annotated[
        Path | None,
        typer.Option(metavar="F.csv|F.md|F.tex", help="Write the table of metrics left out. [default: none]"),
    ] = None,
    reference: ReferenceName = None,
    config: ConfigFile = None,
    json: Json = False,
    filter_timeout: FilterTimeout = None,
    no_color: NoColor = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Find gains of a FILTER that hold on logs they were not found on: what they gain there, and what they cost."""
    from attlog.compare.configurations.configuration import parse
    from attlog.compare.configurations.firmware_names import firmware_names
    from attlog.compare.sweep import many
    from attlog.compare.sweep.arguments import told_apart
    from attlog.compare.tables.files import check_suffix, text
    from attlog.compare.tune import text as tune_words
    from attlog.compare.tune.objective import objective as terms_of
    from attlog.compare.tune.search import free_parameters
    from attlog.compare.tune.tune import tune

    given = told_apart(words, EXAMPLE)
    if table is not None:
        check_suffix(table)
    base = parse(given.filter)
    uses_mag = "mag" in base.row.estimator.uses and base.before.get("mag") != "off"
    asked = objective or ["tilt=1,heading=1" if uses_mag else "tilt=1"]
    wrong: list[str] = []
    for check in (lambda: free_parameters(given.axes, base.row.estimator), lambda: terms_of(asked)):
        try:
            check()
        except UsageError as error:
            wrong.append(str(error))
    if wrong:
        raise UsageError("\n".join(wrong))
    free, terms = free_parameters(given.axes, base.row.estimator), terms_of(asked)
    settings = analysis_settings(config, reference)
    firmware = firmware_names(base.row.estimator)
    with progress(quiet, verbose > 0):
        prepared = Prepared(given.logs, settings)
        cases = list(prepared)
        logs = [many.SettingsOnLog(c, base, [t.metric for t in terms], guarded=True) for c in cases]
        others = [many.SettingsOnLog(c, base, many.wanted(ELSEWHERE)) for c in cases]
        found = tune(given.filter, free, terms, logs, others, _start(free, logs[0]), generations, seed)
        told = prepared.about()
        tables = {} if table is None else {table: text(table, *tune_words.judged_rows(found))}
        files = _written(found, output, told, firmware, tables)
    if json:
        json_to_stdout(files[1].read_text(encoding="utf-8"))
    if not quiet:
        say(_told(found, files, told, firmware), console(stderr=json))
    end(prepared.errors)


def _start(free: Sequence[FreeParameter], log: SettingsOnLog) -> dict[str, float | str]:
    """The gains as they are on the first log."""
    values = log.values
    return {f.name: values[f.name] for f in free}


def _written(
    found: Tuning, folder: Path, told: dict[str, Any], firmware: dict[str, str], tables: Mapping[Path, str]
) -> tuple[Path, Path]:
    """The page and the JSON, written together with other tables."""
    import json

    from attlog.base.output import write_together
    from attlog.compare.tune import text as tune_words
    from attlog.compare.tune.page import tune_page

    name = stem("tune", found.filter)
    paths = folder / f"{name}.html", folder / f"{name}.json"
    write_together(
        {
            paths[0]: tune_page(found, told, firmware),
            paths[1]: json.dumps(tune_words.document(found, told, firmware), indent=1, allow_nan=False) + "\n",
            **tables,
        }
    )
    return paths


def _told(found: Tuning, files: Sequence[Path], told: dict[str, Any], firmware: dict[str, str]) -> Iterator[Line]:
    from attlog.cli.shared.printing import Line, wrapped
    from attlog.compare.sweep.text import references_of
    from attlog.compare.tune import text as tune_words

    for sentence in tune_words.sentences(found, references_of(told)):
        yield from wrapped("", sentence, 100)
    yield Line("")
    for line in tune_words.paste(found, firmware):
        yield Line(f"  {line}", "bold")
    yield Line("")
    yield from aligned(*tune_words.judged_rows(found))
    yield Line("")
    yield from aligned(*tune_words.gain_rows(found))
    yield Line("")
    yield Line(f"page: {files[0]}   data: {files[1].name}")
