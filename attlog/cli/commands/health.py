"""``attlog health``: can the sensors of a log be trusted, and what should be set?"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog.cli.arguments import command_line, refuse_file
from attlog.cli.logs import end, named_sources, reported
from attlog.cli.options import OUTPUT, Boot, CommonOptions, Form, Json, Places, System, one_form
from attlog.cli.printing import TextLine, console, json_to_stdout, say, table_to_stdout, wrapped

if TYPE_CHECKING:
    from attlog.result import Result

PARAM = ".param"


def command(
    logs: Places,
    common: CommonOptions,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR",
            help="Write what to set as DIR/NAME.param. [default: print]",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    params: Annotated[
        str | None,
        typer.Option(
            metavar="F.param",
            help="Use the parameters of this file, as if the vehicle had flown with them. [default: those of the log]",
        ),
    ] = None,
    form: Form = None,
    json: Json = False,
    boot: Boot = None,
    system: System = None,
) -> None:
    """Say whether the sensors can be trusted, and what to set.

    No filter runs. Nothing is offered that the log does not prove; what is missing for it is said.

    Example: attlog health flight.bin
    """
    from attlog.batch.log_file import unchanged
    from attlog.batch.report_files import report_names
    from attlog.cli.progress import progress
    from attlog.flight.parameters import read_parameter_file
    from attlog.pipeline.evaluation import health

    one_form(json, form)
    if params is not None:
        read_parameter_file(params)  # what is wrong with it is reported once, not for each log
    settings = {"params": params, "boot": boot, "system": system}
    config = {name: value for name, value in settings.items() if value is not None}
    codes: set[int] = set()
    found, _ = named_sources(logs, codes)
    assessed: list[Result] = []
    out = console(stderr=json or form is not None)
    for source, name in zip(found, report_names([source.file_name for source in found]), strict=True):
        with reported(source.name, codes, common.verbose):
            with progress(common.quiet, common.verbose > 0), source.local() as log, unchanged(log.path):
                result = health(log.path, config, command=command_line())
            if form is not None:
                assessed.append(result)
            if json:
                json_to_stdout(document(result))
            if not common.quiet:
                say([""] * (source is not found[0]), out)
                say(lines(result, out.width, common.verbose > 0), out)
            if output is not None and (written := write(result, output / f"{name}{PARAM}", params)) is not None:
                say([] if common.quiet else [written], out)
    if form is not None and assessed:
        from attlog.compare.tables import sensor_rows

        table_to_stdout(form, *sensor_rows(assessed))
    end(codes)


def document(result: Result) -> dict[str, Any]:
    """Return the document of ``--json``: parts of the JSON of ``analyze``, and each parameter to set once."""
    from attlog.core.plain import to_plain
    from attlog.result import agreed_settings

    whole = result.to_dict()
    told = {key: whole.get(key, empty) for key, empty in (("log", {}), ("headline", ""), ("health", []))}
    settings = [to_plain(setting, defaults=False) for setting in agreed_settings(result.health)]
    return told | {"settings": settings, "findings": whole.get("findings", [])}


def lines(result: Result, width: int, verbose: bool) -> Iterator[TextLine]:
    """Yield title, headline, the table of sensors and what should be set."""
    from attlog.cli.tables import sensor_lines, setting_lines, title
    from attlog.result import agreed_settings
    from attlog.words.text import clean

    yield from wrapped("", title(result), width, "bold")
    if result.headline:
        yield from wrapped("  ", clean(result.headline), width)
    yield from sensor_lines(result.health, width, verbose)
    yield from setting_lines(agreed_settings(result.health))


def write(result: Result, path: Path, params: str | None) -> str | None:
    """Write what should be set to a file (atomically), and say so; None where there is nothing to set or to say.

    UsageError where a flight log or the file of ``--params`` would be overwritten, OutputError if it cannot be written.
    """
    from attlog.core.files import write_atomic
    from attlog.words.findings import parameter_file

    text = parameter_file(result)
    if not text:
        return f"nothing to set; {path} is of an earlier run" if path.exists() else None
    refuse_file("-o", str(path), [] if params is None else [params])
    write_atomic(path, text)
    return f"parameters: {path}"
