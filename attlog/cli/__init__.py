"""The command line: one file per command; this one only gathers them and turns errors into exit codes.

Command modules import typer and nothing heavy, so that ``attlog --help`` answers at once.
"""

from __future__ import annotations

import sys
import traceback
from typing import Annotated, Any

import typer

from attlog import __version__
from attlog.cli import (
    across_logs,
    analyze,
    batch,
    check_estimator,
    compare,
    diff,
    estimators,
    extract,
    info,
    new,
    reproduce,
    schema,
    simulate,
    streams,
    sweep,
    tune,
)
from attlog.cli.arguments import Group, WithGates, WithJson
from attlog.cli.common import to_stderr
from attlog.errors import INTERRUPTED, AttlogError, exit_code, message


class Commands(Group):
    """The commands, with errors of standard output told apart from bugs."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except OSError as error:
            if streams.is_of_a_stream(error):  # typer would end with 1 where the reader went away
                raise typer.Exit(streams.lost(error)) from None
            raise


app = typer.Typer(
    name="attlog",
    cls=Commands,
    help="Re-run attitude filters on a flight log and say which is closest, quiet, late in a step, drifting in heading."
    " attlog LOG means attlog analyze LOG.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # it takes [default: x] and [@PRESET] for markup and drops them
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


app.command("analyze", cls=WithGates)(analyze.command)
app.command("batch", cls=WithGates)(batch.command)
app.command("info", cls=WithJson)(info.command)
app.command("extract")(extract.command)
app.command("compare", cls=WithJson)(compare.command)
app.command("diff")(diff.command)
app.command("sweep", cls=WithJson)(sweep.command)
app.command("tune", cls=WithJson)(tune.command)
app.command("table")(across_logs.command)
app.command("estimators")(estimators.command)
app.command("new")(new.command)
app.command("check-estimator")(check_estimator.command)
app.command("reproduce", cls=WithJson)(reproduce.command)
app.command("simulate")(simulate.command)
app.command("schema")(schema.command)


def main() -> None:
    """Entry point: run the command, print expected errors as one message, end with the documented exit code."""
    streams.show_everything()
    sys.exit(streams.flushed(_code()))


def _code() -> int:
    try:
        app()
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else 0
    except KeyboardInterrupt:
        return INTERRUPTED
    except Exception as error:
        if isinstance(error, OSError) and streams.is_of_a_stream(error):
            return streams.lost(error)
        if "-vv" in sys.argv and not isinstance(error, AttlogError):
            to_stderr(traceback.format_exc())
        to_stderr(message(error, __version__))
        return exit_code(error)
    return 0
