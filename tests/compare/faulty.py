"""Flights made worse on purpose: PX4 and ArduPilot logs whose sensors are changed, their truth left as it was."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pyulog import ULog

GYRO, ACCELEROMETER, FIELD = ("gyro", "accelerometer", "field")
Axes = list[np.ndarray]
Change = Callable[[np.ndarray, Axes], None]
"""Changes the axes (3 x (n,)) of a sensor in place, given its times in s since boot."""
IN_ULOG = {
    GYRO: ("sensor_combined", "gyro_rad[{}]"),
    ACCELEROMETER: ("sensor_combined", "accelerometer_m_s2[{}]"),
    FIELD: ("vehicle_magnetometer", "magnetometer_ga[{}]"),
}
IN_DATAFLASH = {GYRO: ("IMU", "Gyr"), ACCELEROMETER: ("IMU", "Acc"), FIELD: ("MAG", "Mag")}
LENGTHS = {"f": "f", "Q": "Q", "B": "B", "b": "b", "h": "h", "H": "H", "i": "i", "I": "I", "M": "B", "q": "q", "d": "d"}
"""Types of DataFlash fields by struct's letters, those of messages with sensors."""


def _late(t: np.ndarray, axes: Axes) -> None:
    for x in axes:
        x[:] = np.interp(t - 0.010, t, x)


def _large(t: np.ndarray, axes: Axes) -> None:
    for x in axes:
        x *= 1.03


def _off(start: float) -> Change:
    def change(t: np.ndarray, axes: Axes) -> None:
        axes[2][t > start] += np.radians(0.5)

    return change


def _crossed(t: np.ndarray, axes: Axes) -> None:
    axes[0][:], axes[1][:] = axes[1].copy(), axes[0].copy()


FAULTS: dict[str, dict[str, Callable[[float], Change]]] = {
    "as it was": {},
    "delay": {GYRO: lambda _: _late, ACCELEROMETER: lambda _: _late},  # by 10 ms
    "scale": {GYRO: lambda _: _large},  # 3 % too large
    "bias": {GYRO: _off},  # 0.5 deg/s about the vertical from some time on
    "swap": {FIELD: lambda _: _crossed},  # x and y exchanged
    "swapped gyro": {GYRO: lambda _: _crossed},
}


def write(source: Path, target: Path, fault: str, start: float) -> Path:
    """Write a log with a fault; a bias begins ``start`` s after boot."""
    changes = {sensor: make(start) for sensor, make in FAULTS[fault].items()}
    (_ulog if source.suffix == ".ulg" else _dataflash)(source, target, changes)
    return target


def _ulog(source: Path, target: Path, changes: dict[str, Change]) -> None:
    log = ULog(str(source))
    for sensor, change in changes.items():
        message, name = IN_ULOG[sensor]
        data = next(d.data for d in log.data_list if d.name == message and d.multi_id == 0)
        change(data["timestamp"] / 1e6, [data[name.format(k)] for k in range(3)])
    log.write_ulog(str(target))


def _dataflash(source: Path, target: Path, changes: dict[str, Change]) -> None:
    raw = bytearray(source.read_bytes())
    for sensor, change in changes.items():
        wanted, name = IN_DATAFLASH[sensor]
        places: dict[int, list[dict[str, tuple[str, int]]]] = {}
        for message, fields in _messages(bytes(raw)):
            if message == wanted:
                places.setdefault(struct.unpack_from(*_at(raw, fields["I"]))[0], []).append(fields)
        for entries in places.values():
            t = np.array([struct.unpack_from(*_at(raw, e["TimeUS"]))[0] for e in entries]) / 1e6
            keys = [f"{name}{axis}" for axis in "XYZ"]
            axes = [np.array([struct.unpack_from(*_at(raw, e[k]))[0] for e in entries], float) for k in keys]
            change(t, axes)
            for key, x in zip(keys, axes, strict=True):
                for entry, value in zip(entries, x.tolist(), strict=True):
                    kind, place = entry[key]
                    struct.pack_into(kind, raw, place, value if kind == "<f" else round(value))
    target.write_bytes(raw)


def _at(raw: bytearray, field: tuple[str, int]) -> tuple[str, Any, int]:
    return field[0], raw, field[1]


def _messages(raw: bytes) -> Iterator[tuple[str, dict[str, tuple[str, int]]]]:
    """Name and (type, place) of each field of the messages with sensors, by the log's own FMT messages."""
    kinds: dict[int, tuple[int, str, str, list[str]]] = {128: (89, "FMT", "", [])}
    at = 0
    while at + 3 <= len(raw):
        if raw[at : at + 2] != b"\xa3\x95" or raw[at + 2] not in kinds:
            at += 1
            continue
        length, name, types, labels = kinds[raw[at + 2]]
        if at + length > len(raw):
            return
        if name == "FMT":
            text = [raw[at + a : at + b].rstrip(b"\0").decode() for a, b in ((5, 9), (9, 25), (25, 89))]
            kinds[raw[at + 3]] = (raw[at + 4], text[0], text[1], text[2].split(","))
        elif name in ("IMU", "MAG"):
            offsets = [3]
            for letter in types:
                offsets.append(offsets[-1] + struct.calcsize("<" + LENGTHS[letter]))
            fields = zip(labels, types, offsets, strict=False)
            yield name, {label: ("<" + LENGTHS[letter], at + offset) for label, letter, offset in fields}
        at += length
