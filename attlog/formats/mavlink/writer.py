"""Writes MAVLink 2 telemetry logs from columns, packets merged by their receiver time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.errors import UsageError
from attlog.formats.mavlink.crc import crc_of_rows
from attlog.formats.mavlink.detect import STAMP_LENGTH, V2
from attlog.formats.mavlink.dialect import STAMP, catalogue, dialect, layout
from attlog.formats.merge import merged
from attlog.output import write_atomic

_HEADER = 10


def write(path: Path | str, messages: Mapping[tuple[str, int], Mapping[str, NDArray[Any]]]) -> None:
    """Write the log; ``attlog.formats.mavlink.reader.read`` and pymavlink give the same columns back.

    ``messages``: (name, system * 256 + component) to columns, among them ``_t_us``, the
    receiver's clock (Unix us) in whose order the packets stand; fields that are not given
    are zero. UsageError for unknown messages or fields, OutputError if the file cannot be written.
    """
    numbers = {message.msgname: number for number, message in dialect().items()}
    blocks, times, lengths = [], [], []
    for (name, sender), columns in messages.items():
        if name not in numbers:
            raise UsageError(f"{name}: not a message of the ardupilotmega dialect")
        if STAMP not in columns:
            raise UsageError(f"{name}: a telemetry log needs the column {STAMP} (Unix time in us)")
        rows, length = _packets(numbers[name], sender, columns)
        blocks.append(rows)
        times.append(np.asarray(columns[STAMP]))
        lengths.append(length)
    write_atomic(Path(path), merged(blocks, times, lengths))


def _packets(
    number: int, sender: int, columns: Mapping[str, NDArray[Any]]
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Stamped packets as rows, and how many bytes of each count: trailing zeros of a payload are not sent."""
    name, fields, record = layout(number)
    unknown = set(columns) - set(fields) - {STAMP}
    if unknown:
        raise UsageError(f"{name} has no field {sorted(unknown)[0]}; it has {', '.join(fields)}")
    stamps = np.asarray(columns[STAMP])
    n, size = len(stamps), record.itemsize
    payload = np.zeros(n, record)
    for column, values in columns.items():
        if column != STAMP:
            payload[column] = values
    body = payload.view(np.uint8).reshape(n, size)
    used = np.where(body != 0, np.arange(1, size + 1), 1).max(axis=1, initial=1)
    rows = np.zeros((n, STAMP_LENGTH + _HEADER + size + 2), np.uint8)
    rows[:, :STAMP_LENGTH] = stamps.astype(">u8").view(np.uint8).reshape(n, STAMP_LENGTH)
    head = rows[:, STAMP_LENGTH:]
    head[:, 0] = V2
    head[:, 1] = used
    head[:, 4] = np.arange(n) & 0xFF
    head[:, 5:7] = sender >> 8, sender & 0xFF
    head[:, 7:10] = number & 0xFF, number >> 8 & 0xFF, number >> 16
    head[:, _HEADER : _HEADER + size] = body
    seed = int(catalogue().seeds[number])
    for length in np.unique(used).tolist():
        mine = np.flatnonzero(used == length)
        end = _HEADER + length
        covered = np.column_stack([head[mine, 1:end], np.full(len(mine), seed, np.uint8)])
        crc = crc_of_rows(covered)
        head[mine, end] = crc & 0xFF
        head[mine, end + 1] = crc >> 8
    return rows, STAMP_LENGTH + _HEADER + used + 2
