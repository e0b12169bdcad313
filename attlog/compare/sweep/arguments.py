"""The words of ``sweep`` and ``tune``: logs, then a filter, then axes, recognised without an option."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from attlog.base.errors import UsageError
from attlog.compare.sweep.grid import is_axis


@dataclass(frozen=True, slots=True)
class SearchRequest:
    """Logs (files, folders, patterns), the filter's text and the axes' texts."""

    logs: list[Path]
    filter: str
    axes: list[str]


def search_request(words: Sequence[str], example: str) -> SearchRequest:
    """``LOG... FILTER NAME=VALUES...``: an axis is NAME=... that is no file, the filter is the last of the others.

    UsageError with the ``example`` where logs or filter are missing.
    """
    axes = [w for w in words if is_axis(w) and not os.path.exists(w)]
    others = [w for w in words if w not in axes]
    if len(others) < 2:
        missing = "a log and a filter are" if not others else "a log or the filter is"
        raise UsageError(f"{missing} missing; give logs, then a filter, then what to vary: {example}")
    if os.path.isdir(others[-1]) or (os.path.isfile(others[-1]) and not others[-1].endswith(".py")):
        raise UsageError(f"{others[-1]} is a file or folder; the filter comes after the logs: {example}")
    return SearchRequest([Path(w) for w in others[:-1]], others[-1], axes)
