"""Write MAVLink 2 telemetry logs from columns, packets merged by their receiver time."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import UsageError
from attlog.core.files import write_atomic
from attlog.core.own_files import SIMULATED_LOG, FileKind
from attlog.core.sorting import unique
from attlog.formats.mavlink.layout import (
    MAVLINK_2,
    STAMP_BYTES,
    STAMP_COLUMN,
    crc_of_rows,
    dialect,
    message_catalogue,
    message_layout,
)
from attlog.formats.recording import Columns, Key, Recording, fit_to_type, merge_records, require_only, time_order
from attlog.formats.table import Text

_HEADER_BYTES = 10
_MAX_TEXT_BYTES = 50
_MAV_PARAM_TYPE_INT32, _MAV_PARAM_TYPE_REAL32 = 6, 9
_PX4_AUTOPILOT = 12


def write_tlog(path: Path | str, recording: Recording, kind: FileKind = SIMULATED_LOG) -> None:
    """Write a tlog, which attlog and pymavlink read back with equal columns.

    The instance is system * 256 + component. The clock column is ``_t_us``, the receiver's clock (Unix us), which
    orders the packets; fields that are not given are zero. Parameters become PARAM_VALUE packets, whole numbers as the
    autopilot in the heartbeats sends them, texts STATUSTEXT packets, in chunks where they are long. Both come from
    ``info["system"]`` and ``info["component"]``. Defaults and layouts are refused. UsageError for unknown messages or
    fields, OutputError if the file cannot be written.
    """
    start = recording.checked(STAMP_COLUMN)
    require_only("info", recording.info, ("system", "component"))
    require_only("layout of", recording.layouts, ())
    system, component = (_byte(recording.info.get(k, 1), k) for k in ("system", "component"))
    pilot = system * 256 + component
    numbers = {message.msgname: number for number, message in dialect().items()}
    messages = [
        *_parameters(recording, start, pilot),
        *_texts(recording.texts, start, pilot),
        *recording.messages.items(),
    ]
    for (name, sender), _ in messages:
        if name not in numbers:
            raise UsageError(f"{name}: not a message of the ardupilotmega dialect")
        if not 0 <= sender <= 0xFFFF:
            raise UsageError(f"{name}: the sender {sender} is not system * 256 + component")
    times = [np.asarray(columns[STAMP_COLUMN]) for _, columns in messages]
    counts = _sequences(times, [sender for (_, sender), _ in messages])
    blocks, lengths = [], []
    for ((name, sender), columns), count in zip(messages, counts, strict=True):
        rows, length = _packets(numbers[name], sender, columns, count)
        blocks.append(rows)
        lengths.append(length)
    write_atomic(Path(path), merge_records(blocks, times, lengths), kind)


def _byte(value: str | int, name: str) -> int:
    if not isinstance(value, int) or not 0 <= value <= 255:
        raise UsageError(f"the {name} {value!r} of a MAVLink sender is a number from 0 to 255")
    return value


def _sequences(times: list[NDArray[Any]], senders: list[int]) -> list[NDArray[np.uint8]]:
    """Return each packet's count (0 to 255) among its sender's."""
    order = time_order(times)
    sender = np.repeat(np.array(senders, np.int64), [len(t) for t in times])
    count = np.zeros(len(order), np.int64)
    for one in unique(sender):
        mine = order[sender[order] == one]
        count[mine] = np.arange(len(mine))
    ends = np.cumsum([len(t) for t in times], dtype=np.int64)
    return [part.astype(np.uint8) for part in np.split(count & 0xFF, ends[:-1])] if times else []


def _parameters(recording: Recording, start: int, pilot: int) -> Iterable[tuple[Key, Columns]]:
    """Yield PARAM_VALUE. ArduPilot sends a whole number as float value, PX4 its bits in the float."""
    params = recording.params
    require_only("default of", [p.name for p in params if p.is_default], ())
    if not params:
        return
    names = [p.name.encode() for p in params]
    if any(len(name) > 16 for name in names):
        raise UsageError(f"{max(names, key=len).decode()}: a MAVLink parameter name holds 16 characters")
    beats = recording.messages.get(("HEARTBEAT", pilot), {}).get("autopilot", np.zeros(0))
    bitwise = bool(np.any(np.asarray(beats) == _PX4_AUTOPILOT))
    whole = np.array([isinstance(p.value, int) for p in params])
    values = np.zeros(len(params), np.float32)
    for k, p in enumerate(params):
        if isinstance(p.value, int) and not -(2**31) <= p.value < 2**31:
            raise UsageError(f"{p.name}: {p.value} does not fit 32 bits")
        if isinstance(p.value, int) and bitwise:
            values[k : k + 1].view(np.int32)[0] = p.value
        else:
            values[k] = p.value
            if isinstance(p.value, int) and int(values[k]) != p.value:
                raise UsageError(f"{p.name}: ArduPilot sends {p.value} as a float, which does not hold it")
    different = list(dict.fromkeys(names))
    index = {name: k for k, name in enumerate(different)}
    yield (
        ("PARAM_VALUE", pilot),
        {
            STAMP_COLUMN: np.array([start if p.t_us is None else p.t_us for p in params], np.int64),
            "param_id": np.array(names, "S16"),
            "param_value": values,
            "param_type": np.where(whole, _MAV_PARAM_TYPE_INT32, _MAV_PARAM_TYPE_REAL32),
            "param_index": np.array([index[name] for name in names]),
            "param_count": np.full(len(names), len(different)),
        },
    )


def _texts(texts: Iterable[Text], start: int, pilot: int) -> Iterable[tuple[Key, Columns]]:
    """Yield STATUSTEXT, long texts in chunks. The last chunk is not full."""
    rows: list[tuple[int, int, bytes, int, int]] = []
    number = 0
    for text in texts:
        raw = text.text.encode()
        pieces = [raw[k : k + _MAX_TEXT_BYTES] for k in range(0, len(raw), _MAX_TEXT_BYTES)] or [b""]
        if len(pieces) > 1:
            number = number % 0xFFFF + 1
            if len(pieces[-1]) == _MAX_TEXT_BYTES:
                pieces.append(b"")
        if len(pieces) > 256:
            raise UsageError(f"{text.text[:40]!r}: a MAVLink text has at most 256 chunks of {_MAX_TEXT_BYTES} bytes")
        when = start if text.t_us is None else text.t_us
        rows += [(when, text.level, piece, number if len(pieces) > 1 else 0, k) for k, piece in enumerate(pieces)]
    if rows:
        stamps, levels, parts, numbers, sequence = zip(*rows, strict=True)
        yield (
            ("STATUSTEXT", pilot),
            {
                STAMP_COLUMN: np.array(stamps, np.int64),
                "severity": np.array(levels),
                "text": np.array(parts, f"S{_MAX_TEXT_BYTES}"),
                "id": np.array(numbers),
                "chunk_seq": np.array(sequence),
            },
        )


def _packets(
    number: int, sender: int, columns: Columns, count: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return stamped packets as rows, and the length of each. Trailing zeros of a payload are not sent."""
    name, fields, record = message_layout(number)
    unknown = set(columns) - set(fields) - {STAMP_COLUMN}
    if unknown:
        raise UsageError(f"{name} has no field {sorted(unknown)[0]}; it has {', '.join(fields)}")
    stamps = np.asarray(columns[STAMP_COLUMN])
    n, size = len(stamps), record.itemsize
    payload = np.zeros(n, record)
    for column, values in columns.items():
        if column != STAMP_COLUMN:
            payload[column] = fit_to_type(values, record[column], f"{name}.{column}")
    body = payload.view(np.uint8).reshape(n, size)
    used = np.where(body != 0, np.arange(1, size + 1), 1).max(axis=1, initial=1)
    rows = np.zeros((n, STAMP_BYTES + _HEADER_BYTES + size + 2), np.uint8)
    rows[:, :STAMP_BYTES] = stamps.astype(">u8").view(np.uint8).reshape(n, STAMP_BYTES)
    head = rows[:, STAMP_BYTES:]
    head[:, 0] = MAVLINK_2
    head[:, 1] = used
    head[:, 4] = count
    head[:, 5:7] = sender >> 8, sender & 0xFF
    head[:, 7:10] = number & 0xFF, number >> 8 & 0xFF, number >> 16
    head[:, _HEADER_BYTES : _HEADER_BYTES + size] = body
    seed = int(message_catalogue().seeds[number])
    for length in unique(used).tolist():
        mine = np.flatnonzero(used == length)
        end = _HEADER_BYTES + length
        covered = np.column_stack([head[mine, 1:end], np.full(len(mine), seed, np.uint8)])
        crc = crc_of_rows(covered)
        head[mine, end] = crc & 0xFF
        head[mine, end + 1] = crc >> 8
    return rows, STAMP_BYTES + _HEADER_BYTES + used + 2
