"""One log of a batch, as its index and its tables see it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Entry:
    """``log`` as it was given, ``name`` of its report without suffix, what became of it.

    ``code`` and ``message``: the exit code, and the sentence of a log that failed; ``row``: what
    :func:`attlog.fleet.records.row.index_row` made, None of a log that failed; ``gates``: a sentence for each gate that
    failed. ``known``: it failed like this in an earlier run.
    """

    log: str
    name: str
    code: int = 0
    message: str = ""
    row: dict[str, Any] | None = None
    gates: tuple[str, ...] = ()
    known: bool = False
