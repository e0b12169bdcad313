"""``attlog analyze``: one report and one JSON per log, sentences and the table on the terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from attlog import __version__
from attlog.cli import completion
from attlog.cli.arguments import command_line
from attlog.cli.common import Boot, Json, Logs, NoColor, Quiet, System, Verbose, console, number_or, say
from attlog.cli.progress import Shown, progress
from attlog.cli.streams import is_of_a_stream
from attlog.errors import INTERRUPTED, UsageError, exit_code, message, worst

if TYPE_CHECKING:
    from attlog.cli.layout import Line
    from attlog.config import Config
    from attlog.fleet.one import Written
    from attlog.fleet.several import Outcome, Task
    from attlog.result import Result

BUNDLES: dict[str, Literal["inline", "shared"]] = {"inline": "inline", "shared": "shared"}
"""Where reports have plotly from."""


def command(
    logs: Logs,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for reports and JSON.")] = Path(
        "reports"
    ),
    jobs: Annotated[int, typer.Option("-j", "--jobs", metavar="N", min=1, help="Analyse so many logs at a time.")] = 1,
    estimators: Annotated[
        str | None,
        typer.Option(
            metavar="LIST",
            autocompletion=completion.rows,
            help="default, all, NAME[@PRESET][:k=v,...] and FILE.py, with commas. [default: default]",
        ),
    ] = None,
    imu: Annotated[
        str | None, typer.Option(metavar="N|all", help="IMU to replay. [default: the one that flew]")
    ] = None,
    mag: Annotated[
        str | None, typer.Option(metavar="N|none", help="Magnetometer to use. [default: the log's choice]")
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(
            metavar="R",
            autocompletion=completion.references,
            help="auto, truth, smoother, onboard, onboard:NAME or none. [default: auto]",
        ),
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(
            metavar="W",
            autocompletion=completion.windows,
            help="all, rest, rest.long, idle, armed, airborne, hover, cruise or T0:T1 (s). [default: all]",
        ),
    ] = None,
    score_from: Annotated[
        float | None, typer.Option(metavar="S", help="Compare from this time on. [default: 15 s]")
    ] = None,
    clock: Annotated[
        str | None, typer.Option(metavar="sample|publication", help="Which time stamps count. [default: sample]")
    ] = None,
    declination: Annotated[
        str | None,
        typer.Option(metavar="DEG|model|param", help="Magnetic declination. [default: model, else parameter]"),
    ] = None,
    trim: Annotated[
        str | None, typer.Option(metavar="on|off", help="Apply the autopilot's trim to the replay. [default: on]")
    ] = None,
    input_delay: Annotated[
        str | None, typer.Option(metavar="MS|off", help="Known delay of the logged IMU. [default: from the log]")
    ] = None,
    gyro_bias: Annotated[
        str | None,
        typer.Option(
            metavar="rest|none|onboard",
            help="Gyro bias to take off for every filter: its mean at rest before take-off, none, or the onboard "
            "estimator's. [default: rest]",
        ),
    ] = None,
    params: Annotated[
        str | None,
        typer.Option(
            metavar="F.param",
            help="What if: parameters for the autopilots' filters, and where the log has none. [default: none]",
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            metavar="F.toml|F.json",
            help="Options from a file or from an earlier result; options here win. [default: none]",
        ),
    ] = None,
    json: Json = False,
    plotly: Annotated[
        str, typer.Option(metavar="inline|shared", help="shared: one plotly bundle beside many reports.")
    ] = "inline",
    table: Annotated[
        list[Path] | None,
        typer.Option("--table", metavar="FILE.csv|tex|md", help="Write the table to a file too; may be repeated."),
    ] = None,
    open_report: Annotated[bool, typer.Option("--open", help="Open the report in a browser.")] = False,
    deterministic: Annotated[
        bool, typer.Option("--deterministic", help="Leave measured times out of JSON and report: same log, same bytes.")
    ] = False,
    boot: Boot = None,
    system: System = None,
    no_color: NoColor = False,
    quiet: Quiet = False,
    verbose: Verbose = 0,
) -> None:
    """Re-run attitude filters on each LOG and compare them with the onboard attitude: a report, a JSON, a table."""
    if plotly not in BUNDLES:
        raise UsageError(f"--plotly {plotly}: use inline or shared")
    if table:
        from attlog.compare.table_file import check_suffix

        for file in table:
            check_suffix(file)
    options = {
        "estimators": estimators,
        "imu": _int_or(imu, "all", "--imu"),
        "mag": _int_or(mag, "none", "--mag"),
        "reference": reference,
        "window": window,
        "score_from": score_from,
        "clock": clock,
        "declination": None
        if declination is None
        else number_or(declination, ("auto", "model", "param"), "--declination"),
        "trim": _on_off(trim),
        "gyro_bias": gyro_bias,
        "boot": boot,
        "system": system,
        "params": params,
        "input_delay": None if input_delay is None else number_or(input_delay, ("auto", "off"), "--input-delay"),
    }
    settings = _settings(config, {k: v for k, v in options.items() if v is not None})
    if settings.params is not None:
        from attlog.flight.parameter_file import read_file

        read_file(settings.params)  # what is wrong with it is said once, not for each log
    from attlog.fleet.find import find
    from attlog.fleet.several import Task

    found, wrong = find(logs)
    for error in wrong:
        print(message(error, __version__), file=sys.stderr)
    task = Task(settings, output, command_line(), BUNDLES[plotly], deterministic)

    def tell(outcome: Outcome) -> None:
        if outcome.written is None:
            print(outcome.trace * (verbose > 1) + outcome.message, file=sys.stderr)
            return
        if json:
            print(_json_text(outcome.written.result, deterministic, one_line=max(len(logs), len(found)) > 1))
        if not quiet:
            _show(outcome.written, settings, on_stderr=json, verbose=verbose)
        if open_report:
            typer.launch(str(outcome.written.report))

    with progress(quiet, verbose > 0) as shown:
        outcomes, interrupted = _outcomes(found, task, jobs, shown, tell)
    _write_tables(table or [], [o.written.result for o in outcomes if o.written is not None], settings)
    if len(found) > 1 and not quiet:
        say(_summary(found, outcomes, output), console(stderr=json))
    if interrupted:
        print(_kept(found, outcomes, output), file=sys.stderr)
        raise typer.Exit(INTERRUPTED)
    codes = {exit_code(error) for error in wrong} | {outcome.code for outcome in outcomes}
    if worst(codes):
        raise typer.Exit(worst(codes))


def _outcomes(
    logs: Sequence[Path], task: Task, jobs: int, shown: Shown, tell: Callable[[Outcome], None]
) -> tuple[list[Outcome], bool]:
    """What became of each log, told as it comes, and whether the user stopped the run."""
    from attlog.fleet.one import report_names
    from attlog.fleet.several import failed, outcomes

    done: list[Outcome] = []

    def next_one() -> None:
        if len(logs) > 1 and len(done) < len(logs):
            shown.before = f"[{len(done) + 1}/{len(logs)}] " + (f"{logs[len(done)].name}: " if jobs == 1 else "")
            if jobs > 1 and shown.stages:
                shown.show(f"{shown.before}{jobs} at a time ...")

    try:
        next_one()
        for outcome in outcomes(logs, report_names(logs), task, jobs):
            shown.clear()
            try:
                tell(outcome)
            except Exception as error:
                if is_of_a_stream(error):
                    raise
                outcome = failed(outcome.log, error)
                tell(outcome)
            done.append(outcome)
            next_one()
    except KeyboardInterrupt:
        return done, True
    return done, False


def _write_tables(files: Sequence[Path], results: Sequence[Result], settings: Config) -> None:
    """The table of all logs as files for papers."""
    if not files or not results:
        return
    from attlog.compare.analysis_table import head_and_rows
    from attlog.compare.table_file import write_table

    content = head_and_rows(results, settings.window or "all")
    for file in files:
        write_table(file, *content)


def _summary(logs: Sequence[Path], outcomes: Sequence[Outcome], folder: Path) -> Iterator[Line]:
    """How many reports there are, and which logs have none."""
    from attlog.cli.layout import Line
    from attlog.present.numbers import counted

    without = [outcome for outcome in outcomes if outcome.written is None]
    yield Line("")
    written = counted(len(outcomes) - len(without), "report")
    yield Line(f"{counted(len(logs), 'log')}: {written} in {folder}", "bold")
    for outcome in without:
        yield Line(f"  no report: {outcome.log} (exit code {outcome.code})")


def _kept(logs: Sequence[Path], outcomes: Sequence[Outcome], folder: Path) -> str:
    """What stands in the folder after an interrupt."""
    kept = [outcome.written.report.name for outcome in outcomes if outcome.written is not None]
    if not kept:
        return f"attlog: interrupted; nothing was written, reports of earlier runs in {folder} are untouched"
    return f"attlog: interrupted; kept {len(kept)} of {len(logs)} reports in {folder}: {', '.join(kept)}"


def _settings(path: Path | None, options: dict[str, Any]) -> Config:
    from attlog.config import Config

    return Config.build(options) if path is None else Config.load(path, **options)


def _json_text(result: Result, deterministic: bool, one_line: bool) -> str:
    import json

    text = result.to_json(deterministic=deterministic).rstrip("\n")
    try:
        text.encode(sys.stdout.encoding or "utf-8")
        plain = False
    except UnicodeEncodeError:
        plain = True  # JSON has its own escapes for what the output cannot show
    if not one_line and not plain:
        return text
    layout: dict[str, Any] = {"separators": (",", ":")} if one_line else {"indent": 1}
    return json.dumps(json.loads(text), ensure_ascii=plain, **layout)


def _int_or(text: str | None, word: str, option: str) -> int | str | None:
    if text is None or text == word:
        return text
    if not text.isdecimal():
        raise UsageError(f"{option} {text!r}: use a number from 0 or {word}")
    return int(text)


def _on_off(text: str | None) -> bool | None:
    if text in (None, "on", "off"):
        return None if text is None else text == "on"
    raise UsageError(f"--trim {text!r}: use on or off")


def _show(done: Written, settings: Config, on_stderr: bool, verbose: int) -> None:
    from attlog.cli.layout import Line
    from attlog.cli.terminal import printed
    from attlog.report import bundle_notice

    out = console(stderr=on_stderr)
    say(printed(done.result, settings.window or "all", out.width, out.encoding, bool(verbose)), out)
    say([Line(f"report: {done.report}")], out)
    notice = bundle_notice()
    if notice:
        print(f"attlog: {notice}", file=sys.stderr)
