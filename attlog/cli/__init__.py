"""The command line: one file per command; this one only starts them and turns errors into exit codes.

Command modules import typer and nothing heavy, so that ``attlog --help`` answers at once.
"""

from __future__ import annotations

import gc
import os
import sys
import traceback
from typing import Annotated

import typer

from attlog import __version__
from attlog.base.errors import INTERRUPTED, AttlogError, UsageError, exit_code, message
from attlog.cli.registry import Commands
from attlog.cli.shared import process
from attlog.cli.shared.options import CommonOptions, expanded
from attlog.cli.shared.printing import to_stderr
from attlog.cli.shared.process import ended_by_signals, guarded

app = typer.Typer(
    name="attlog",
    cls=Commands,
    help="Run attitude filters on a flight log again: accuracy, noise, lag, yaw drift.\n\n"
    "Example: attlog flight.ulg. It means attlog analyze flight.ulg.",
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
@expanded
def _root(
    context: typer.Context,
    common: CommonOptions,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    context.obj = common


COLLECTED_AFTER = 200_000
"""New objects; Python's 700 cost a short run 8 % of its time, 20,000 still 2 %: nearly all that it makes is kept."""

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "1")
"""numpy reads it when it is imported. Products of a log's arrays are too small for threads: those that wait for more to
do cost 0.2 s of CPU in a short ``analyze``, and more on a busy machine. Whoever sets the variable has his way."""


def main() -> None:
    """Entry point: run the command, print expected errors as one message, end with the documented exit code."""
    gc.set_threshold(COLLECTED_AFTER)
    os.environ.setdefault(*ONE_THREAD)
    process.show_everything()
    code = guarded(_ended, sys.argv[1:])
    gc.freeze()  # all ends with the process: Python's last look for circles among it is a tenth of ``attlog info``
    sys.exit(code)


def _ended() -> int:
    """The exit code; a signal that ends the program does so in order, temporary files removed."""
    with ended_by_signals():
        return process.flushed(_code())


def _code() -> int:
    try:
        app()
    except SystemExit as stop:
        why = getattr(stop.__context__, "format_message", None)  # of Typer's own errors, which it has printed
        if why is not None and sys.argv[1:]:
            _tell_ci(why())
        return stop.code if isinstance(stop.code, int) else 0
    except KeyboardInterrupt:
        return INTERRUPTED
    except Exception as error:
        if isinstance(error, OSError) and process.is_of_a_stream(error):
            return process.lost(error)
        if "-vv" in sys.argv and not isinstance(error, AttlogError):
            to_stderr(traceback.format_exc())
        to_stderr(message(error, __version__))
        if isinstance(error, UsageError):
            _tell_ci(str(error))
        return exit_code(error)
    return 0


def _tell_ci(why: str) -> None:
    """Say there too why nothing was analysed."""
    from attlog.cli.shared.gates import report_refusal

    report_refusal(why, sys.argv[1:])
