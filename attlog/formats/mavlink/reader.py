"""Read MAVLink telemetry logs (``.tlog``) and raw MAVLink captures (``.mavlink``, ``.rlog``).

MAVLink 1 and 2 may be mixed in one file. Deliberate differences from pymavlink's reader: every packet with a valid
checksum is found, also behind damage; bytes between packets are not returned as messages; numbers stay as sent.
"""

from __future__ import annotations

from contextlib import suppress
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import LogUnusable
from attlog.core.limits import MAX_PARAM_CHANGES, MAX_TEXT_LENGTH, MAX_TEXTS
from attlog.core.timestamps import Offsets, Timeline, merge_timelines, times_before
from attlog.formats.file_bytes import RecordColumns, decode_text, decode_texts, gather, offsets_by_kind, read_file_bytes
from attlog.formats.mavlink.layout import MAVLINK_2, STAMP_BYTES, STAMP_COLUMN, message_catalogue, message_layout
from attlog.formats.mavlink.walk import Packets, index_packets
from attlog.formats.table import Boot, Field, Messages, ParamChange, Table, Text, boots_of_timeline

__all__ = ["CLOCK_MESSAGES", "STAMP_COLUMN", "decode_parameter_values", "list_systems", "main_vehicle", "read_mavlink"]


# Messages whose ``time_boot_ms`` is the autopilot's clock at the moment of sending.
CLOCK_MESSAGES = ("ATTITUDE", "ATTITUDE_QUATERNION", "GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "SYSTEM_TIME")
PX4_AUTOPILOT = 12
NO_AUTOPILOT = 8
_GROUND_STATION = 6
_MAX_TEXT_BYTES = 50  # a STATUSTEXT that fills its field goes on in the next chunk


def system_tables(messages: Messages, name: str, system: int) -> list[Table]:
    """Return a message's tables from all components of one system."""
    return [messages[name, i] for i in messages.instances(name) if i >> 8 == system]


def boot_timeline(messages: Messages, system: int) -> Timeline:
    """Return offset and boot time (us) of an autopilot's clock messages."""
    component = messages.info["systems"].get(system, {}).get("component")
    found = []
    for table in (t for name in CLOCK_MESSAGES for t in system_tables(messages, name, system)):
        if component is None or table.instance & 0xFF == component:
            with suppress(KeyError):  # reported among the remarks
                found.append((table.offsets, table["time_boot_ms"].astype(np.int64) * 1000))
    at, time = merge_timelines(found)
    known = time > 0  # SYSTEM_TIME of a ground station under the vehicle's id is zero
    return at[known], time[known]


def read_mavlink(path: str | Path, system: int | None = None, *, data: NDArray[np.uint8] | None = None) -> Messages:
    """Return a tlog or raw MAVLink file; ``data`` are its bytes if mapped.

    The instance of a table is ``system * 256 + component``. ``params``, ``texts`` and ``boots`` are those of one
    vehicle: ``system``, or :func:`main_vehicle`. ``info["systems"]`` lists all, ``info["unknown"]`` counts messages
    outside the dialect. A tlog has the extra column STAMP_COLUMN. LogUnusable if no packet has a right checksum.
    """
    path = Path(path)
    data = read_file_bytes(path) if data is None else data
    packets = index_packets(data, message_catalogue())
    if len(packets.offsets) == 0:
        raise LogUnusable(f"{path}: no MAVLink packet with a right checksum, so there is nothing to decode.")
    losses = packets.losses
    log_format = "tlog" if packets.stamped else "mavlink"
    messages = Messages(path, log_format, len(data), _build_tables(data, packets), losses=losses)
    messages.info["systems"] = list_systems(messages)
    messages.info["unknown"] = dict(sorted(packets.unknown.items()))
    chosen = main_vehicle(messages) if system is None else system
    messages.info["system"] = chosen
    messages.boots = [Boot(0, len(data))]
    if chosen is not None:
        clock = boot_timeline(messages, chosen)

        messages.params = lambda log: losses.list_or_empty(
            "PARAM_VALUE", "parameters", lambda: _read_params(log, chosen, clock)
        )
        messages.texts = lambda log: losses.list_or_empty(
            "STATUSTEXT", "texts", lambda: _read_texts(log, chosen, clock)
        )
        messages.boots = boots_of_timeline(clock, len(data))
    return messages


def _build_tables(data: NDArray[np.uint8], packets: Packets) -> dict[tuple[str, int], Table]:
    """Return the tables by message name and sender, in file order."""
    tables: dict[tuple[str, int], Table] = {}
    keys = packets.ids.astype(np.uint64) << np.uint64(16) | packets.senders
    for key, offsets in offsets_by_kind([(packets.offsets, keys)]):
        instance = key & 0xFFFF
        name, fields, record = message_layout(key >> 16)
        if packets.stamped:
            fields = {STAMP_COLUMN: Field(STAMP_COLUMN, np.dtype(np.int64), "us"), **fields}
        tables[name, instance] = Table(name, instance, fields, offsets, _PayloadDecoder(data, record), packets.losses)
    return dict(sorted(tables.items(), key=lambda item: int(item[1].offsets[0])))


class _PayloadDecoder:
    """Decoder of one message: stamps, and fields of the payload."""

    def __init__(self, data: NDArray[np.uint8], record: np.dtype[Any]) -> None:
        self._data = data
        self._fields = RecordColumns(lambda offsets: read_payloads(data, offsets, record))

    def __call__(self, column: str, offsets: Offsets) -> NDArray[Any]:
        if column == STAMP_COLUMN:
            return gather(self._data, offsets - STAMP_BYTES, np.dtype(">u8")).astype(np.int64)
        return self._fields(column, offsets)

    def forget(self) -> None:
        self._fields.forget()


def read_payloads(data: NDArray[np.uint8], offsets: Offsets, record: np.dtype[Any]) -> NDArray[Any]:
    """Return the payloads of packets; bytes that were not sent are zero."""
    size = record.itemsize
    begin = offsets + np.where(data.take(offsets) == MAVLINK_2, np.uint8(10), np.uint8(6))
    length = data[1:].take(offsets)
    fits = begin <= len(data) - size
    if fits.all():
        raw = gather(data, begin, np.dtype((np.uint8, (size,))))
    else:  # the last packets of a file may be shorter than the message
        raw = np.zeros((len(offsets), size), np.uint8)
        raw[fits] = gather(data, begin[fits], np.dtype((np.uint8, (size,))))
        for k in (~fits).nonzero()[0].tolist():
            rest = data[begin[k] : begin[k] + min(int(length[k]), size)]
            raw[k, : len(rest)] = rest
    if length.min(initial=size) < size:
        shortest = int(length.min())
        raw[:, shortest:] *= np.arange(shortest, size, dtype=np.uint8) < length[:, np.newaxis]
    return raw.view(record).reshape(len(offsets))


def list_systems(messages: Messages) -> dict[int, dict[str, Any]]:
    """Return each system: its components, packets, and its autopilot by heartbeat (None without)."""
    systems: dict[int, dict[str, Any]] = {}
    for (name, instance), table in messages.tables.items():
        system = systems.setdefault(
            instance >> 8, {"components": [], "packets": 0, "autopilot": None, "type": None, "component": None}
        )
        if instance & 0xFF not in system["components"]:
            system["components"].append(instance & 0xFF)
        system["packets"] += len(table)
        if name == "HEARTBEAT":
            flies = (table["autopilot"] != NO_AUTOPILOT) & (table["type"] != _GROUND_STATION)
            # a companion may send heartbeats of an autopilot too; the autopilot is the lowest such component
            if flies.any() and (system["component"] is None or instance & 0xFF < system["component"]):
                k = int(np.argmax(flies))
                system["component"] = instance & 0xFF
                system["autopilot"] = int(table["autopilot"][k])
                system["type"] = int(table["type"][k])
    return dict(sorted(systems.items()))


def main_vehicle(messages: Messages) -> int | None:
    """Return the system with an autopilot and most packets, or None."""
    systems = messages.info.get("systems") or list_systems(messages)
    flying = {s: d for s, d in systems.items() if d["autopilot"] is not None}
    if not flying:
        # without heartbeats the sender of an attitude is the vehicle
        senders = {i >> 8 for n, i in messages.tables if n in CLOCK_MESSAGES}
        flying = {s: systems[s] for s in senders}
    return max(flying, key=lambda s: (flying[s]["packets"], -s), default=None)


def _read_params(messages: Messages, system: int, clock: Timeline) -> list[ParamChange]:
    """Return PARAM_VALUE of a system with times."""
    bitwise = messages.info["systems"].get(system, {}).get("autopilot") == PX4_AUTOPILOT
    result: list[ParamChange] = []
    for table in system_tables(messages, "PARAM_VALUE", system):
        names = decode_texts(table["param_id"])
        values = decode_parameter_values(table["param_value"], table["param_type"], bitwise)
        times = times_before(table.offsets, clock)
        rows = zip(names, values, times, repeat(False), table.offsets.tolist(), repeat(False), strict=False)
        result += map(ParamChange._make, rows)
    result.sort(key=lambda p: p.offset)
    return result[:MAX_PARAM_CHANGES]


_INTEGER_PARAMETERS = {1: "<u1", 2: "<i1", 3: "<u2", 4: "<i2", 5: "<u4", 6: "<i4"}  # MAV_PARAM_TYPE


def decode_parameter_values(values: NDArray[np.float32], types: NDArray[np.uint8], bitwise: bool) -> list[float | int]:
    """Return parameter values: ints for integer types, else floats.

    ArduPilot sends integers as float values, PX4 sends their bits in the float (``bitwise``).
    """
    result: list[float | int] = values.tolist()
    raw = np.ascontiguousarray(values, "<f4").view(np.uint8).reshape(len(values), 4)
    for kind, name in _INTEGER_PARAMETERS.items():
        mine = np.flatnonzero(types == kind)
        width = np.dtype(name).itemsize
        bits = np.ascontiguousarray(raw[mine, :width]).view(name).ravel().tolist()
        for k, integer in zip(mine.tolist(), bits, strict=True):
            if bitwise:
                result[k] = integer
            elif float(result[k]).is_integer():
                result[k] = int(result[k])
    return result


def _read_texts(messages: Messages, system: int, clock: Timeline) -> list[Text]:
    """Return STATUSTEXT of a system; chunks of long texts are joined."""
    result: list[Text] = []
    for table in system_tables(messages, "STATUSTEXT", system):
        open_id, open_sequence = 0, -1
        rows = zip(
            table["severity"].tolist(),
            table["text"].tolist(),
            table["id"].tolist(),
            table["chunk_seq"].tolist(),
            table.offsets.tolist(),
            times_before(table.offsets, clock),
            strict=True,
        )
        for severity, raw, number, sequence, offset, t_us in rows:
            text = decode_text(raw)
            if number != 0 and number == open_id and sequence == open_sequence + 1 and result:
                before = result.pop()
                text, offset, t_us = (before.text + text)[:MAX_TEXT_LENGTH], before.offset, before.t_us
            result.append(Text(text, min(severity, 7), t_us, offset))
            # a chunk that does not fill the field is the last one
            open_id, open_sequence = (number, sequence) if len(raw) == _MAX_TEXT_BYTES else (0, -1)
    result.sort(key=lambda x: x.offset)
    return result[:MAX_TEXTS]
