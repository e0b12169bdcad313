"""One log of a batch, as its index and its tables see it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from attlog.fleet.record import Record


@dataclass(frozen=True, slots=True)
class Entry:
    """``log`` as it was given, ``name`` of its report without suffix, what became of it.

    ``code`` and ``message``: the exit code, and the sentence of a log that failed; ``row``: what
    :func:`attlog.fleet.row.index_row` made, None of a log that failed; ``gates``: a sentence for each gate that
    failed.
    """

    log: str
    name: str
    code: int = 0
    message: str = ""
    row: dict[str, Any] | None = None
    gates: tuple[str, ...] = ()


def entry_of(record: Record, gates: Iterable[str] = ()) -> Entry:
    """What a record tells, with the sentences of the gates that its log failed."""
    return Entry(record.log, record.name, record.code, record.message, record.row or None, tuple(gates))
