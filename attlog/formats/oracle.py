"""A log as the official library of its format reads it, asked in a process of its own.

Used to verify our own readers, by users (``attlog info --verify``) and by the
tests. The libraries print (pymavlink a line per damaged byte) and may end the
process; in a child neither reaches the caller. What is asked of which library
stands in each format's ``oracle.py``.
"""

from __future__ import annotations

import math
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from attlog.core.limits import VERIFY_S, VERIFY_S_PER_BYTE, VERIFY_WAITS
from attlog.core.workers import Child, Died, TooLong, write_output_to
from attlog.formats.table import Messages, Table

Key = tuple[str, int | None]
"""Message and instance; instance None where the library does not split by it."""
Columns = dict[Key, dict[str, Any]]


def _nothing(_: Any) -> Any:
    return None


@dataclass(frozen=True, slots=True)
class Oracle:
    """A format's official library, and our reading in its words.

    ``read(path)`` gives all columns as the library names and scales them, ``keys(log)`` our messages by its keys,
    ``ours(log, key)`` our columns of one of them (None if we have none). ``why_not_ours(column)`` says why attlog
    leaves out a column on purpose, ``why_not_comparable(log)`` why whole messages cannot be compared.
    """

    library: str
    read: Callable[[Path], Columns]
    keys: Callable[[Messages], list[Key]]
    ours: Callable[[Messages, Key], dict[str, Any] | None]
    why_not_ours: Callable[[str], str | None] = _nothing
    why_not_comparable: Callable[[Messages], dict[str, str] | None] = _nothing


class OracleFailed(Exception):
    """The library raised or ended the process; the message is its own."""


class OracleLate(OracleFailed):
    """The library took more time than it was given."""


def read_by_oracle(path: Path, log_format: str) -> Columns:
    """The log as the format's official library reads it. ``log_format`` as in ``Messages.format``.

    OracleFailed if the library gives up, with its words; OracleLate if it is not done in its time.
    """
    from attlog.formats.file_bytes import is_gzip, unpack_gzip

    try:
        scratch = tempfile.TemporaryDirectory(prefix="attlog-")
    except OSError as error:
        raise OracleFailed(f"no temporary folder for what it says ({error.strerror or error})") from error
    with scratch as folder:
        printed, log = Path(folder, "printed"), path.absolute()
        if is_gzip(path):
            log = Path(folder, "log")
            with log.open("w+b") as file:
                unpack_gzip(path, file)
        patience = max(math.ceil(VERIFY_S + VERIFY_S_PER_BYTE * log.stat().st_size), 1)
        with Child.started() as child:
            try:
                return child.call(_read, log_format, log, printed, patience, seconds=VERIFY_WAITS * patience)
            except TooLong:
                raise OracleLate(f"it is not done after {VERIFY_WAITS * patience:.0f} s") from None
            except Died as died:
                if died.exit.signal == "SIGXCPU":
                    raise OracleLate(f"it is not done after {patience} s of CPU time") from None
                raise OracleFailed(f"its process {_end(died)}: {_last_line(printed)}") from None


def _read(log_format: str, path: Path, printed: Path, cpu_s: int) -> Columns:
    """What the child does. OracleFailed where the library raises."""
    from attlog.formats import format_named

    write_output_to(printed)
    _limit_cpu(cpu_s)
    try:
        return format_named(log_format).load_oracle().read(path)
    except Exception as error:  # the library may fail in any way on a log that we can read
        raise OracleFailed(f"{type(error).__name__}: {error}") from None


def _end(died: Died) -> str:
    """How the child ended; a library that ends it by itself may have said why, which is quoted behind."""
    own = died.exit.status is not None and not died.exit.signal and not died.exit.crashed
    return f"ended with code {died.exit.status}" if own else str(died.exit)


def _last_line(printed: Path) -> str:
    text = printed.read_bytes().decode("utf-8", "replace").strip() if printed.exists() else ""
    return text.rpartition("\n")[2]


def _limit_cpu(seconds: int) -> None:
    """Have the system end this process after so much of its time; on Windows, which cannot, the parent's clock does."""
    with suppress(ImportError):
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))


def gathered(rows: Iterable[tuple[str, int | None, Any]]) -> Columns:
    """Columns from the messages (name, instance, message) that pymavlink gives one by one."""
    collected: dict[Key, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    for name, instance, message in rows:
        table = collected[name, instance]
        for field in message.get_fieldnames():
            table[field].append(getattr(message, field))
    return {key: {field: _array(values) for field, values in table.items()} for key, table in collected.items()}


def _array(values: list[Any]) -> Any:
    """Numbers as an array, texts and mixed values as an array of objects."""
    return np.array(values) if all(isinstance(v, int | float) for v in values) else _objects(values)


def _objects(values: list[Any]) -> Any:
    array = np.empty(len(values), object)
    for k, value in enumerate(values):
        array[k] = value
    return array


def as_printed(tables: list[Table], spell: Callable[[bytes], str]) -> dict[str, Any] | None:
    """The tables of one message put together in file order: integers as stored, other numbers scaled, texts spelled."""
    if not tables:
        return None
    order = np.argsort(np.concatenate([t.offsets for t in tables]), kind="stable")
    columns: dict[str, Any] = {}
    for name, described in tables[0].fields.items():
        plain = described.dtype.kind in "iub" and described.scale == 1.0
        stored = plain or described.dtype.shape or described.dtype.kind == "S"
        column = np.concatenate([t[name] if stored else t.value(name) for t in tables if name in t])[order]
        is_text = column.dtype.kind == "S"
        columns[name] = _objects([spell(raw) for raw in column.tolist()]) if is_text else column
    return columns
