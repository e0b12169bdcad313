"""``attlog mcp``: tools for an assistant that speaks the Model Context Protocol."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from attlog.cli.options import CommonOptions


def mcp_command(
    folders: Annotated[
        list[Path], typer.Argument(metavar="FOLDER...", show_default=False, help="Read logs below these folders only.")
    ],
    common: CommonOptions,
) -> None:
    """Serve logs to an assistant, read-only (MCP).

    It speaks over standard input and output, writes no file and fetches nothing. Needs the extra mcp.

    Example: attlog mcp flights
    """
    from attlog.assistants.server import server

    server(folders).run("stdio")
