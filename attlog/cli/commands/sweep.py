"""``attlog sweep``: a grid of settings of one filter on one log or on many."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog import __version__
from attlog.base.errors import AttlogError, UsageError, exit_code, message, worst
from attlog.cli.shared.arguments import command_line
from attlog.cli.shared.options import FilterTimeout
from attlog.cli.shared.printing import Json, NoColor, Quiet, Verbose, console, json_to_stdout, say, to_stderr
from attlog.cli.shared.progress import progress

if TYPE_CHECKING:
    from attlog.cli.shared.printing import Line
    from attlog.compare.configurations.configuration import Configuration
    from attlog.compare.sweep.many import SettingsOnLog, SweptMetric
    from attlog.compare.sweep.sweep import Sweep
    from attlog.config import Config
    from attlog.metrics.base import Case

EXAMPLE = "attlog sweep *.bin mahony kp=0.6,1.1,2 ki=0..0.05/6"
METRICS = ("inclination_rmse_deg", "heading_rmse_deg")
SHOWN = 15

SettingWords = Annotated[
    list[str],
    typer.Argument(
        metavar="LOG... FILTER [NAME=VALUES...]",
        show_default=False,
        help="Logs, folders, quoted patterns; a filter as in analyze; what to vary: kp=0.6,1.1,2 (values), "
        "ki=0..0.05/6 (6 values, even steps), ki=1e-4..0.1/7log (equal factors), mag_form=heading,vector (a switch).",
    ),
]
MetricList = Annotated[
    list[str] | None,
    typer.Option(
        "--metric",
        metavar="METRIC[@WINDOW]",
        help="What is measured, the first decides; more by repeating it. [default: " + ", ".join(METRICS) + "]",
    ),
]
ReferenceName = Annotated[
    str | None,
    typer.Option("--reference", metavar="R", help="auto, truth, onboard, onboard:NAME or none. [default: auto]"),
]
ConfigFile = Annotated[
    Path | None,
    typer.Option(
        "--config", metavar="F.toml|F.json", help="Options of analyze from a file or an earlier result. [default: none]"
    ),
]


def command(
    words: SettingWords,
    metric: MetricList = None,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for page, JSON, CSV.")] = Path(
        "reports"
    ),
    table: Annotated[
        Path | None, typer.Option(metavar="F.csv|F.md|F.tex", help="Write the table of settings. [default: none]")
    ] = None,
    reference: ReferenceName = None,
    config: ConfigFile = None,
    json: Json = False,
    filter_timeout: FilterTimeout = None,
    no_color: NoColor = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Try all combinations of settings of a FILTER on each LOG: the best, what cannot be told from it, one for all."""
    from attlog.compare.configurations.configuration import parse
    from attlog.compare.sweep import many
    from attlog.compare.sweep import text as sweep_words
    from attlog.compare.sweep.arguments import told_apart
    from attlog.compare.sweep.grid import grid, like_decimal_commas
    from attlog.compare.sweep.sweep import sweep
    from attlog.compare.tables.files import check_suffix, text

    given = told_apart(words, EXAMPLE)
    if table is not None:
        check_suffix(table)
    wrong: list[str] = []
    base = parse(given.filter)
    for problem in (lambda: grid(given.axes, base.row.estimator), lambda: many.wanted(metric or METRICS)):
        try:
            problem()
        except UsageError as error:
            wrong.append(str(error))
    if wrong:
        raise UsageError("\n".join(wrong))
    for sentence in like_decimal_commas(given.axes):
        to_stderr(f"attlog: {sentence}")
    settings = analysis_settings(config, reference)
    with progress(quiet, verbose > 0):
        logs = Prepared(given.logs, settings)
        found = sweep(
            given.filter, grid(given.axes, base.row.estimator), _asked(logs, base, many.wanted(metric or METRICS))
        )
        told = logs.about()
        tables = {} if table is None else {table: text(table, *sweep_words.rows(found))}
        files = _written(found, output, told, tables)
    if json:
        json_to_stdout(files[1].read_text(encoding="utf-8"))
    if not quiet:
        say(_told(found, files, told, bool(verbose)), console(stderr=json))
    end(logs.errors)


def analysis_settings(config: Path | None, reference: str | None) -> Config:
    """The options of analyze that prepare a log."""
    from attlog.config import Config

    options: dict[str, Any] = {} if reference is None else {"reference": reference}
    found = Config.build(options) if config is None else Config.load(config, **{"estimators": ["default"]} | options)
    if found.imu == "all":
        raise UsageError("imu = all: settings are compared on one unit; name it or leave it to the log")
    return found


def _asked(logs: Prepared, base: Configuration, metrics: Sequence[SweptMetric]) -> Iterator[SettingsOnLog]:
    """The logs with what is asked of them; each is let go of with the one who takes it."""
    from attlog.compare.sweep.many import SettingsOnLog

    for case in logs:
        yield SettingsOnLog(case, base, metrics)
        del case


class Prepared:
    """Logs made ready one after the other; what is wrong with one is told as it comes and kept in ``errors``."""

    def __init__(self, paths: Sequence[Path], settings: Config) -> None:
        from attlog.fleet.sources.find import find

        self._settings = settings
        self._logs, self.errors = find(paths)
        self._told: list[dict[str, Any]] = []

    def __iter__(self) -> Iterator[Case]:
        """The cases; the first error is raised after the last log if there was none."""
        from attlog.analysis import prepare

        late = list(self.errors)
        for log in self._logs:
            try:
                case = prepare(log, self._settings)
            except AttlogError as error:
                self.errors.append(error)
                late.append(error)
                continue
            for wrong in late:
                to_stderr(message(wrong, __version__))
            late.clear()
            self._told.append(_about_log(case))
            yield case
            del case
        for wrong in late if self._told else late[1:]:
            to_stderr(message(wrong, __version__))
        if not self._told:
            raise self.errors[0]

    def about(self) -> dict[str, Any]:
        """What a JSON says of the version, the command and the logs."""
        from attlog.analysis import versions

        settings = self._settings.resolved()
        return {"attlog": versions(), "command": command_line(), "config": settings, "logs": self._told}


def _about_log(case: Case) -> dict[str, Any]:
    from attlog.analysis import summarize
    from attlog.summary import sha256

    log = case.log
    return {
        "name": log.path.name,
        "sha256": sha256(log.path),
        "vehicle": log.vehicle,
        "firmware": log.firmware.version,
        "reference": case.reference.kind,
        "reference_text": summarize(case.reference).text,
    }


def end(errors: Sequence[AttlogError]) -> None:
    """End with the exit code of what went wrong with some logs, if anything did."""
    code = worst(exit_code(error) for error in errors)
    if code:
        raise typer.Exit(code)


def stem(command: str, filter_name: str) -> str:
    """The name of the files of a command: its own and the filter's."""
    import re

    return f"{command}-{re.sub(r'[^A-Za-z0-9._-]+', '-', Path(filter_name).name)}"


def _written(found: Sweep, folder: Path, told: dict[str, Any], tables: Mapping[Path, str]) -> tuple[Path, Path, Path]:
    """The page, the JSON and the CSV, written together with other tables."""
    import json

    from attlog.base.output import write_together
    from attlog.compare.sweep import text as sweep_words
    from attlog.compare.sweep.page import sweep_page

    name = stem("sweep", found.filter)
    paths = folder / f"{name}.html", folder / f"{name}.json", folder / f"{name}.csv"
    write_together(
        {
            paths[0]: sweep_page(found, told),
            paths[1]: json.dumps(sweep_words.document(found, told), indent=1, allow_nan=False) + "\n",
            paths[2]: sweep_words.csv_text(found),
            **tables,
        }
    )
    return paths


def _told(found: Sweep, files: Sequence[Path], told: dict[str, Any], everything: bool) -> Iterator[Line]:
    from attlog.cli.shared.printing import Line, wrapped
    from attlog.compare.sweep import text as sweep_words

    for sentence in sweep_words.sentences(found, sweep_words.references_of(told)):
        yield from wrapped("", sentence, 100)
    yield Line("")
    head, rows = sweep_words.rows(found)
    shown = rows if everything or len(rows) <= SHOWN + 2 else rows[:SHOWN]
    yield from aligned(head, shown)
    if len(shown) < len(rows):
        yield Line(f"  and {len(rows) - len(shown)} more; -v lists all")
    if len(found.logs) > 1 and found.columns[0].single is not None:
        yield Line("")
        yield from aligned(*sweep_words.log_rows(found, found.columns[0]))
    yield Line("")
    yield Line(f"page: {files[0]}   data: {files[1].name}, {files[2].name}")


def aligned(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[Line]:
    """A table: words of the last and first column to the left, all between to the right."""
    from attlog.cli.shared.printing import Line

    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    for number, row in enumerate([head, *rows]):
        cells = [
            c.ljust(w) if i in (0, len(head) - 1) else c.rjust(w)
            for i, (c, w) in enumerate(zip(row, widths, strict=True))
        ]
        yield Line("  " + "  ".join(cells).rstrip(), "bold" if number == 0 else "")
