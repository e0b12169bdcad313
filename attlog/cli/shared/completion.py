"""What the shell offers after TAB. Nothing is imported before somebody presses it."""

from __future__ import annotations

from typing import Any

import typer


def rows(incomplete: str) -> list[str]:
    """The last item of a list of row specifications: sets, filters, and their presets behind @."""
    from attlog.base.errors import AttlogError
    from attlog.estimators import get, names

    done, comma, last = incomplete.rpartition(",")
    name, at, _ = last.partition("@")
    if at:
        try:
            offered = [f"{name}@{preset}" for preset in get(name).presets]
        except AttlogError:
            offered = []
    else:
        offered = ["default", "all", *names()]
    return [f"{done}{comma}{item}" for item in offered if item.startswith(last)]


def filters(incomplete: str) -> list[str]:
    """Names of filters."""
    from attlog.estimators import names

    return [name for name in names() if name.startswith(incomplete)]


def scenarios(incomplete: str) -> list[str]:
    """Names of the scenarios that can be simulated."""
    from attlog.simulate.scenario.scenario import names

    return [name for name in names() if name.startswith(incomplete)]


def windows(incomplete: str) -> list[str]:
    """Names of windows."""
    from attlog.segments.model import WINDOWS

    return [name for name in WINDOWS if name.startswith(incomplete)]


def references(incomplete: str) -> list[str]:
    """What ``--reference`` takes."""
    return [
        name for name in ("auto", "truth", "smoother", "onboard", "onboard:", "none") if name.startswith(incomplete)
    ]


def messages(ctx: typer.Context, incomplete: str) -> list[str]:
    """Names of the messages in the log that stands before on the line."""
    from attlog import formats
    from attlog.base.errors import AttlogError

    log: Any = ctx.params.get("log")
    try:
        names = formats.open(log).names() if log else []
    except AttlogError:
        return []  # no log, nothing to offer; the command itself will say why
    return [name for name in names if name.startswith(incomplete)]
