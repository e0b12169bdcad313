"""The papers by name, each run by its own file."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import cast

from attlog.base.errors import UsageError, suggestion
from attlog.reproduce.paper import Paper, PaperOptions

PAPERS = ("lyu", "fan", "huang", "xu")
WITH_LOGS = {"xu"}
"""Those that look at real flights as well."""


def chosen(names: list[str]) -> list[str]:
    """The papers that are named, ``all`` for all of them, each once. UsageError with a suggestion for other names."""
    for name in names:
        if name != "all" and name not in PAPERS:
            raise UsageError(f"no paper {name}{suggestion(name, [*PAPERS, 'all'])}")
    return [name for name in PAPERS if name in names or "all" in names]


def reproduce(name: str, options: PaperOptions, command: str = "") -> Paper:
    """Run one paper's experiments."""
    from attlog.base.versions import versions

    found = cast(Paper, import_module(f"attlog.reproduce.{name}.claims").paper(options))
    return replace(found, attlog={k: str(v) for k, v in versions().items()}, command=command)
