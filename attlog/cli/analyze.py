"""``attlog analyze``: one report and one JSON per log, three sentences and the table on the terminal."""

from __future__ import annotations

import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from attlog import __version__
from attlog.cli.common import Boot, NoColor, Quiet, System, Verbose, console, existing, number_or
from attlog.errors import AttlogError, UsageError, exit_code, message, worst
from attlog.fleet.one import analyze_to_files, report_names

if TYPE_CHECKING:
    from attlog.config import Config
    from attlog.fleet.one import Written
    from attlog.result import Result

BUNDLES: dict[str, Literal["inline", "shared"]] = {"inline": "inline", "shared": "shared"}
"""Where reports have plotly from."""


def command(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", readable=False, help="Flight logs: .ulg, .bin, .log, .tlog.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for reports and JSON.")] = Path(
        "reports"
    ),
    estimators: Annotated[
        str | None,
        typer.Option(
            metavar="LIST", help="default, all, NAME[@PRESET][:k=v,...] and FILE.py, with commas. [default: default]"
        ),
    ] = None,
    imu: Annotated[
        str | None, typer.Option(metavar="N|all", help="IMU to replay. [default: the one that flew]")
    ] = None,
    mag: Annotated[
        str | None, typer.Option(metavar="N|none", help="Magnetometer to use. [default: the log's choice]")
    ] = None,
    reference: Annotated[
        str | None, typer.Option(metavar="R", help="auto, truth, onboard, onboard:NAME or none. [default: auto]")
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(
            metavar="W", help="all, rest, rest.long, idle, armed, airborne, hover, cruise or T0:T1 (s). [default: all]"
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
    params: Annotated[
        str | None, typer.Option(metavar="F.param", help="Parameters for what the log does not tell.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(metavar="F.toml", help="Options from a file; options given here win.")
    ] = None,
    json: Annotated[
        str | None, typer.Option("--json", metavar="-", help="- prints the JSON on standard output.")
    ] = None,
    plotly: Annotated[
        str, typer.Option(metavar="inline|shared", help="shared: one plotly bundle beside many reports.")
    ] = "inline",
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
    if json not in (None, "-"):
        raise UsageError(f"--json {json}: only - (standard output); files are written to the folder of -o")
    if plotly not in BUNDLES:
        raise UsageError(f"--plotly {plotly}: use inline or shared")
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
        "boot": boot,
        "system": system,
        "params": params,
        "input_delay": None if input_delay is None else number_or(input_delay, ("auto", "off"), "--input-delay"),
    }
    settings = _settings(config, {k: v for k, v in options.items() if v is not None})
    codes: set[int] = set()
    for number, (log, name) in enumerate(zip(logs, report_names(logs), strict=True), 1):
        if len(logs) > 1 and not quiet and sys.stderr.isatty():
            print(f"[{number}/{len(logs)}] {log}", file=sys.stderr)
        try:
            existing(log)
            done = analyze_to_files(
                log, settings, output, name,
                command=" ".join(["attlog", *sys.argv[1:]]), plotly=BUNDLES[plotly], deterministic=deterministic,
            )  # fmt: skip
            if json == "-":
                print(_json_text(done.result, deterministic, one_line=len(logs) > 1))
            if not quiet:
                _show(done, settings, on_stderr=json == "-", verbose=verbose)
            if open_report:
                typer.launch(str(done.report))
        except BrokenPipeError:
            raise  # nobody reads on: no fault of this log
        except Exception as error:
            if len(logs) == 1:
                raise
            if verbose > 1 and not isinstance(error, AttlogError):
                traceback.print_exception(error)
            print(message(error, __version__, str(log)), file=sys.stderr)
            codes.add(exit_code(error))
    if codes:
        raise typer.Exit(worst(codes))


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
    from rich.text import Text

    from attlog.cli.terminal import printed
    from attlog.present.stand_ins import stand_in
    from attlog.report import bundle_notice

    out = console(stderr=on_stderr)
    for line in printed(done.result, settings.window or "all", out.width, out.encoding, bool(verbose)):
        out.print(Text(line.text, line.style), soft_wrap=True)
    out.print(Text(stand_in(f"report: {done.report}", out.encoding)), soft_wrap=True)
    notice = bundle_notice()
    if notice:
        print(f"attlog: {notice}", file=sys.stderr)
