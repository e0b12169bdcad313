"""Which commands are there? Each is imported and built when it is asked for: what is not asked for costs nothing."""

from __future__ import annotations

import gc
import os
import sys
import traceback
from importlib import import_module
from typing import Annotated, Any

import typer

from attlog import __version__
from attlog.cli import process
from attlog.cli.arguments import Group, Plain, WithGates, WithJson
from attlog.cli.options import CommonOptions, expanded
from attlog.cli.printing import to_stderr
from attlog.cli.process import ended_by_signals, guarded
from attlog.core.errors import EXIT_INTERRUPTED, AttlogError, UsageError, error_message, exit_code

COMMANDS: dict[str, tuple[str, type[Plain]]] = {
    "analyze": ("analyze", WithJson),
    "batch": ("batch", WithGates),
    "info": ("info", WithJson),
    "health": ("health", WithJson),
    "extract": ("extract", Plain),
    "compare": ("compare", WithJson),
    "diff": ("diff", WithJson),
    "sweep": ("sweep", WithJson),
    "tune": ("tune", WithJson),
    "table": ("table", Plain),
    "estimators": ("estimators", Plain),
    "new": ("new", Plain),
    "check-estimator": ("check_estimator", Plain),
    "reproduce": ("reproduce", WithJson),
    "simulate": ("simulate", Plain),
    "schema": ("schema", Plain),
}
"""In the order of the help: the file of each in this room, and how its arguments are read."""


class Commands(Group):
    """The group of them; one that is not asked for is only a name. An error of standard output is no bug."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands: dict[str, Any] = dict.fromkeys(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of a name, None where there is none."""
        if cmd_name in self.commands and self.commands[cmd_name] is None:
            file, kind = COMMANDS[cmd_name]
            alone = typer.Typer(add_completion=False, rich_markup_mode=None)
            alone.command(cmd_name, cls=kind)(expanded(import_module(f"attlog.cli.commands.{file}").command))
            self.commands[cmd_name] = typer.main.get_command(alone)
        return super().get_command(ctx, cmd_name)

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except OSError as error:
            if process.is_of_a_stream(error):  # typer would end with 1 where the reader went away
                raise typer.Exit(process.lost(error)) from None
            raise


# The command line: one file per command; this one only starts them and turns errors into exit codes.
#
# Command modules import typer and nothing heavy, so that ``attlog --help`` answers at once.

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
        return EXIT_INTERRUPTED
    except Exception as error:
        if isinstance(error, OSError) and process.is_of_a_stream(error):
            return process.lost(error)
        if "-vv" in sys.argv and not isinstance(error, AttlogError):
            to_stderr(traceback.format_exc())
        to_stderr(error_message(error, __version__))
        if isinstance(error, UsageError):
            _tell_ci(str(error))
        return exit_code(error)
    return 0


def _tell_ci(why: str) -> None:
    """Say there too why nothing was analysed."""
    from attlog.cli.gates import report_refusal

    report_refusal(why, sys.argv[1:])
