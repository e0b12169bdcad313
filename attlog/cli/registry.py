"""Which commands are there? Each is imported and built when it is asked for: what is not asked for costs nothing."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import typer

from attlog.cli.shared import process
from attlog.cli.shared.arguments import Group, Plain, WithGates, WithJson
from attlog.cli.shared.options import expanded

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
    "estimators": ("filters.estimators", Plain),
    "new": ("filters.new", Plain),
    "check-estimator": ("filters.check_estimator", Plain),
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
