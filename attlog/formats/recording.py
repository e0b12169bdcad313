"""Content of a log to be written, for all formats, and merging of records by time.

Names and columns are those of the format's reader, so that a log can be read and written again. Writers raise
UsageError for content that their format cannot store.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import UsageError
from attlog.formats.table import ParamChange, Text

Columns = Mapping[str, NDArray[Any]]
Key = tuple[str, int]


@dataclass(frozen=True, slots=True)
class MessageLayout:
    """Storage details of a message beyond the types of its columns.

    DataFlash: ``letters``, ``units`` and ``multipliers`` have one character per column; columns of the letters c C e E
    L are the printed numbers and are rounded to the letter's step. ULog: ``nested`` names the type of each nested
    member (``esc`` of the columns ``esc[0].esc_rpm``).
    """

    letters: str = ""
    units: str = ""
    multipliers: str = ""
    nested: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Recording:
    """Columns, parameters and texts of a log to be written.

    ``messages``: (name, instance) to columns (n,) or (n, k), numbers or numpy bytes of one length; the instance is that
    of :class:`attlog.formats.Messages`. Every message has its format's clock column. ``params`` and ``texts`` without
    time belong to the start: ``start_us`` on the clock of the log, else the first time of the data. ``info``: the
    statements of a ULog, or ``system`` and ``component`` (default 1) that send a tlog's parameters and texts.
    ``layouts``: message name to layout.
    """

    messages: Mapping[Key, Columns]
    params: Sequence[ParamChange] = ()
    texts: Sequence[Text] = ()
    info: Mapping[str, str | int] = field(default_factory=dict)
    start_us: int | None = None
    layouts: Mapping[str, MessageLayout] = field(default_factory=dict)

    def checked(self, clock: str) -> int:
        """Return the log's start in us by its ``clock`` column. UsageError where the columns do not make records."""
        first = []
        for (name, _), columns in self.messages.items():
            if clock not in columns:
                raise UsageError(f"{name}: every message of this format needs a column {clock} (microseconds)")
            times = np.asarray(columns[clock])
            if times.ndim != 1 or times.dtype.kind not in "iu":
                raise UsageError(f"{name}.{clock}: times are whole microseconds, one per record")
            for column, values in columns.items():
                if np.ndim(values) == 0 or len(values) != len(times):
                    raise UsageError(f"{name}.{column}: not one value for each of the {len(times)} times")
            if len(times):
                if int(times.min()) < 0 or int(times.max()) >= 2**63:
                    raise UsageError(f"{name}.{clock}: a time is negative or beyond 63 bits")
                first.append(int(times.min()))
        for name in self.layouts:
            if all(name != known for known, _ in self.messages):
                raise UsageError(f"{name}: has a layout but is no message of this recording")
        if self.start_us is not None and not 0 <= self.start_us < 2**63:
            raise UsageError(f"the start {self.start_us} us is negative or beyond 63 bits")
        return self.start_us if self.start_us is not None else min(first, default=0)


def fit_to_type(values: NDArray[Any], kind: np.dtype[Any], what: str) -> NDArray[Any]:
    """Convert ``values`` to the stored type ``kind``, rounded for integers.

    UsageError where a value does not fit: too large, not a number in an integer, a text too long, another shape.
    """
    values = np.asarray(values)
    if values.shape[1:] != kind.shape or (values.dtype.kind == "S") != (kind.kind == "S"):
        raise UsageError(f"{what}: {values.dtype} of shape {values.shape} does not fit {kind}")
    base = kind.base
    if base.kind == "S":
        longest = int(np.char.str_len(values).max(initial=0))
        if longest > base.itemsize:
            raise UsageError(f"{what}: a text has {longest} bytes, the place for it {base.itemsize}")
        return values.astype(base)
    if values.dtype == base:
        return values
    if base.kind in "iu":
        limits = np.iinfo(base)
        least, most = limits.min, limits.max
        if values.dtype.kind == "f":
            values = np.rint(values)
            most = int(np.nextafter(float(most) + 1.0, 0.0))  # the largest float below
        if not bool(np.all((values >= least) & (values <= most))):
            raise UsageError(f"{what}: a value does not fit {base}, which holds {least} to {limits.max}")
        return values.astype(base)
    with np.errstate(over="ignore"):
        stored = values.astype(base)
    if base.itemsize < values.dtype.itemsize and bool(np.any(np.isinf(stored) & np.isfinite(values))):
        raise UsageError(f"{what}: a value is too large for {base}")
    return stored


def require_only(what: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Raise UsageError if ``given`` names anything but ``known``."""
    rest = sorted(set(given) - set(known))
    if rest:
        raise UsageError(f"this format has no place for the {what} {rest[0]!r}")


# Rows placed in one step, so that the indices of their bytes stay small.
MERGED_ROWS = 1 << 14


def time_order(times: Sequence[NDArray[np.integer]]) -> NDArray[np.int64]:
    """Return the order of all records by time, then by block."""
    if not times:
        return np.zeros(0, np.int64)
    return np.argsort(np.concatenate([t.astype(np.int64) for t in times]), kind="stable")


def merge_records(
    blocks: Sequence[NDArray[np.uint8]], times: Sequence[NDArray[np.integer]], lengths: Sequence[NDArray[np.int64]]
) -> bytes:
    """Return all records in the order of :func:`time_order`.

    A block is (n, width) bytes; the first ``lengths`` of each row count.
    """
    if not blocks:
        return b""
    order = time_order(times)
    size = np.concatenate(lengths)[order]
    begins = np.empty(len(order), np.int64)
    begins[order] = np.cumsum(size) - size
    out = np.zeros(int(size.sum()), np.uint8)
    first = 0
    for rows, length in zip(blocks, lengths, strict=True):
        column = np.arange(rows.shape[1])
        for start in range(0, len(rows), MERGED_ROWS):
            some = slice(start, min(start + MERGED_ROWS, len(rows)))
            there = column < length[some, np.newaxis]
            at = begins[first + some.start : first + some.stop, np.newaxis] + column
            out[at[there]] = rows[some][there]
        first += len(rows)
    return out.tobytes()
