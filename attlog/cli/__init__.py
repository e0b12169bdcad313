"""Command line: options and output of the commands in ``commands``, errors as exit codes.

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
from attlog.cli import process
from attlog.cli.arguments import Group
from attlog.cli.options import CommonOptions, with_options
from attlog.cli.printing import to_stderr
from attlog.core.errors import EXIT_INTERRUPTED, AttlogError, UsageError, error_message, exit_code

# New objects between two collections: Python's 700 cost a short run 8 % of its time, for objects that nearly all stay.
COLLECTION_THRESHOLD = 200_000

app = typer.Typer(
    name="attlog",
    cls=Group,
    help="Run attitude filters on a flight log again: accuracy, noise, lag, yaw drift.\n\n"
    "Example: attlog flight.ulg. It means attlog analyze flight.ulg.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # it drops [default: x] and [@PRESET] as markup
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"attlog {__version__}")
        raise typer.Exit


@app.callback()
@with_options
def _root(
    context: typer.Context,
    common: CommonOptions,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    context.obj = common


def main() -> None:
    """Run the command line; print an expected error as one message, end with its documented exit code."""
    gc.set_threshold(COLLECTION_THRESHOLD)
    # Read by numpy. A log's arrays are too small for threads, whose waiting costs 0.2 s of CPU in a short ``analyze``.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    process.show_everything()
    sys.exit(process.run_guarded(_run, sys.argv[1:]))


def _run() -> int:
    with process.ended_by_signals():
        return process.flush_output(_code())


def _code() -> int:
    try:
        app(prog_name="attlog")
    except SystemExit as stop:
        why = getattr(stop.__context__, "format_message", None)  # of Typer's own errors, which it has printed
        if why is not None and sys.argv[1:]:
            _tell_ci(why())
        return stop.code if isinstance(stop.code, int) else 0
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except Exception as error:
        if isinstance(error, OSError) and process.is_of_a_stream(error):
            return process.report_lost_output(error)
        if "-vv" in sys.argv and not isinstance(error, AttlogError):
            to_stderr(traceback.format_exc())
        to_stderr(error_message(error, __version__))
        if isinstance(error, UsageError):
            _tell_ci(str(error))
        return exit_code(error)
    return 0


def _tell_ci(why: str) -> None:
    """Report to CI systems why nothing was analysed."""
    from attlog.cli.gates import report_refusal

    report_refusal(why, sys.argv[1:])
