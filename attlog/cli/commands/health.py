"""``attlog health``: can the sensors of a log be trusted, and what should be set?"""

from __future__ import annotations

import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog import __version__
from attlog.cli.options import Boot, CommonOptions, Form, Json, Places, System, one_form
from attlog.cli.printing import TextLine, console, json_line, json_to_stdout, say, table_to_stdout, to_stderr, wrapped
from attlog.core.errors import EXIT_BUG, error_message, exit_code, worst_exit_code

if TYPE_CHECKING:
    from attlog.result import Result

PARAM = ".param"
"""How a file of parameters is called after its log."""


def command(
    logs: Places,
    common: CommonOptions,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Write what to set as DIR/NAME.param. [default: print]"),
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
    from attlog.batch.sources import sources
    from attlog.cli.arguments import command_line
    from attlog.cli.process import is_of_a_stream
    from attlog.cli.progress import progress
    from attlog.pipeline.evaluation import health

    one_form(json, form)
    settings = {"params": params, "boot": boot, "system": system}
    config = {name: value for name, value in settings.items() if value is not None}
    _check_params(params)
    found, wrong = sources(logs)
    codes = {exit_code(error) for error in wrong}
    for error in wrong:
        to_stderr(error_message(error, __version__))
    assessed: list[Result] = []
    out = console(stderr=json or form is not None)
    for source, name in zip(found, report_names([source.file_name for source in found]), strict=True):
        try:
            with progress(common.quiet, common.verbose > 0), source.local() as log, unchanged(log.path):
                result = health(log.path, config, command=command_line())
            if form is not None:
                assessed.append(result)
            if json:
                json_to_stdout(json_line(document(result)))
            if not common.quiet:
                say([TextLine("")] * (source is not found[0]), out)
                say(lines(result, source.name, out.width, out.encoding, common.verbose > 0), out)
            if output is not None and (written := write(result, output / f"{name}{PARAM}", params)) is not None:
                say([] if common.quiet else [TextLine(written)], out)
        except Exception as error:
            if is_of_a_stream(error):
                raise
            if common.verbose > 1 and exit_code(error) == EXIT_BUG:
                to_stderr("".join(traceback.format_exception(error)))
            to_stderr(error_message(error, __version__, source.name))
            codes.add(exit_code(error))
    if form is not None and assessed:
        from attlog.compare.tables import sensor_rows

        table_to_stdout(form, *sensor_rows(assessed))
    if worst_exit_code(codes):
        raise typer.Exit(worst_exit_code(codes))


def document(result: Result) -> dict[str, Any]:
    """What ``--json`` tells of a log: as in the JSON of ``analyze``, and all that should be set, each once."""
    from attlog.core.plain import to_plain
    from attlog.result import agreed_settings

    whole = result.to_dict()
    told = {key: whole.get(key, empty) for key, empty in (("log", {}), ("headline", ""), ("health", []))}
    settings = [to_plain(setting, defaults=False) for setting in agreed_settings(result.health)]
    return told | {"settings": settings, "findings": whole.get("findings", [])}


def lines(result: Result, log: str, width: int, encoding: str, verbose: bool) -> Iterator[TextLine]:
    """Title, headline, the table, what should be set; of a log called ``log`` on the command line."""
    from attlog.cli.tables import sensor_lines, setting_lines, title
    from attlog.result import agreed_settings
    from attlog.words.text import clean, encodable

    def shown(text: str) -> str:
        return encodable(text, encoding)

    yield from (TextLine(line.text, "bold") for line in wrapped("", shown(title(result)), width))
    if result.headline:
        yield from wrapped("  ", shown(clean(result.headline)), width)
    yield from sensor_lines(result.health, shown, width, verbose)
    yield from setting_lines(agreed_settings(result.health))


def write(result: Result, path: Path, params: str | None) -> str | None:
    """Write what should be set to a file (atomically), and say so; None where there is nothing to set or to say.

    UsageError where a flight log or the file of ``--params`` would be overwritten, OutputError if it cannot be written.
    """
    from attlog.cli.arguments import refuse
    from attlog.core.files import write_atomic
    from attlog.words.findings import parameter_file

    text = parameter_file(result)
    if not text:
        return f"nothing to set; {path} is of an earlier run" if path.exists() else None
    refuse("-o", str(path), [] if params is None else [params])
    write_atomic(path, text)
    return f"parameters: {path}"


def _check_params(params: str | None) -> None:
    """What is wrong with a file of parameters is said once, not for each log. UsageError, LogUnreadable."""
    if params is not None:
        from attlog.flight.parameters import read_parameter_file

        read_parameter_file(params)
