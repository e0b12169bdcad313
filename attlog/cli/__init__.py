"""The command line: one file per command; this one only gathers them and turns errors into exit codes.

Command modules import typer and nothing heavy, so that ``attlog --help`` answers at once.
"""

from __future__ import annotations

import io
import sys
from typing import Annotated

import typer

from attlog import __version__
from attlog.cli import analyze, check_estimator, estimators, extract, info, new, schema
from attlog.errors import INTERRUPTED, AttlogError, exit_code, message

app = typer.Typer(
    name="attlog",
    help="Re-run attitude filters on a flight log and say which is quiet at rest, late in a step, drifting in heading.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"attlog {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options of every command stand with the command."""


app.command("analyze")(analyze.command)
app.command("info")(info.command)
app.command("extract")(extract.command)
app.command("estimators")(estimators.command)
app.command("new")(new.command)
app.command("check-estimator")(check_estimator.command)
app.command("schema")(schema.command)


def _show_everything() -> None:
    """Signs that the terminal's encoding lacks get ASCII stand-ins, file names that are not UTF-8 escapes."""
    import codecs

    from attlog.present.stand_ins import on_encode_error

    codecs.register_error("attlog", on_encode_error)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="attlog")


def main() -> None:
    """Entry point: run the command, print expected errors as one message, end with the documented exit code."""
    _show_everything()
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except Exception as error:
        if "-vv" in sys.argv and not isinstance(error, AttlogError):
            raise
        print(message(error, __version__), file=sys.stderr)
        sys.exit(exit_code(error))
