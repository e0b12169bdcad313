"""``attlog schema``: the JSON schema of the result."""

from __future__ import annotations

import typer


def command() -> None:
    """Print the JSON schema of a result of analyze.

    Example: attlog schema > result.schema.json
    """
    import json

    from attlog.result.schema import schema

    typer.echo(json.dumps(schema(), indent=1))
