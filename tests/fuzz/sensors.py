"""Whole sensors broken as they break on vehicles: another unit, mirrored axes, a delay, a driver that stops.

:mod:`tests.fuzz.values` breaks columns, whatever they mean. Here all axes of a sensor are broken
alike, so that every single value is one that the sensor can give and only physics contradicts it.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats.base import Messages, Table

Array = NDArray[np.float64]
Fault = Callable[[Array], Array]

AXES: dict[str, dict[str, tuple[tuple[str, tuple[str, ...]], ...]]] = {
    "gyro": {
        "ulog": (("sensor_combined", ("gyro_rad",)), ("vehicle_imu", ("delta_angle",))),
        "dataflash": (("IMU", ("GyrX", "GyrY", "GyrZ")),),
        "tlog": (("RAW_IMU", ("xgyro", "ygyro", "zgyro")),),
    },
    "accelerometer": {
        "ulog": (("sensor_combined", ("accelerometer_m_s2",)), ("vehicle_imu", ("delta_velocity",))),
        "dataflash": (("IMU", ("AccX", "AccY", "AccZ")),),
        "tlog": (("RAW_IMU", ("xacc", "yacc", "zacc")),),
    },
    "compass": {
        "ulog": (("vehicle_magnetometer", ("magnetometer_ga",)),),
        "dataflash": (("MAG", ("MagX", "MagY", "MagZ")),),
        "tlog": (("RAW_IMU", ("xmag", "ymag", "zmag")),),
    },
    "attitude": {
        "ulog": (("vehicle_attitude", ("q",)),),
        "dataflash": (("ATT", ("Roll", "Pitch", "Yaw")),),
        "tlog": (("ATTITUDE", ("roll", "pitch", "yaw")), ("ATTITUDE_QUATERNION", ("q1", "q2", "q3", "q4"))),
    },
}
"""The columns of each sensor by format, one array or one column for each axis."""


def _from_half_on(x: Array, then: Array) -> Array:
    return np.where((np.arange(len(x)) < len(x) // 2)[:, None], x, then)


FAULTS: dict[str, Fault] = {
    "degrees": lambda x: x * 57.29578,
    "radians": lambda x: x / 57.29578,
    "in g": lambda x: x / 9.80665,
    "thousandth": lambda x: x * 1e-3,
    "half": lambda x: x * 0.5,
    "half as much again": lambda x: x * 1.5,
    "reversed": lambda x: -x,
    "one axis reversed": lambda x: x * np.where(np.arange(x.shape[1]) == x.shape[1] - 3, -1.0, 1.0),
    "swapped": lambda x: x[:, [*range(x.shape[1] - 3), x.shape[1] - 2, x.shape[1] - 3, x.shape[1] - 1]],
    "clipped": lambda x: np.clip(x, -np.abs(x).max() / 3, np.abs(x).max() / 3),
    "zero": np.zeros_like,
    "stopped": lambda x: _from_half_on(x, x[len(x) // 2 : len(x) // 2 + 1]),
    "late": lambda x: np.roll(x, max(1, len(x) // 20), axis=0),
    "backwards": lambda x: x[::-1],
    "noisy": lambda x: x + 2.0 * x.std() * np.random.default_rng(0).normal(size=x.shape),
    "spiked": lambda x: np.where((np.arange(len(x)) % 311 == 0)[:, None], 30.0 * x, x),
    "holes": lambda x: np.where(((np.arange(len(x)) % 100) < 30)[:, None], np.nan, x),
}
"""What happens to the axes (n, 3), of quaternions (n, 4)."""


def faulty(messages: Messages, sensor: str, fault: str) -> Messages:
    """The log with one fault of one sensor; the log itself where it has no such sensor."""
    tables = dict(messages.tables)
    for name, columns in AXES[sensor].get(messages.format, ()):
        for key in [key for key, table in tables.items() if key[0] == name and all(c in table.fields for c in columns)]:
            tables[key] = _with(tables[key], columns, FAULTS[fault])
    return replace(messages, tables=tables)


def any_fault(messages: Messages, seed: int | str) -> Messages:
    """One to three faults of any sensors."""
    rng = random.Random(f"{seed}")
    for _ in range(rng.choice((1, 1, 2, 3))):
        messages = faulty(messages, rng.choice(list(AXES)), rng.choice(list(FAULTS)))
    return messages


def without_truth(messages: Messages) -> Messages:
    """The log as a real vehicle would have written it."""
    tables = {k: t for k, t in messages.tables.items() if k[0] not in ("SIM", "SIM_STATE", "SIMSTATE")}
    return replace(messages, tables={k: t for k, t in tables.items() if not k[0].endswith("groundtruth")})


def _with(table: Table, columns: tuple[str, ...], fault: Fault) -> Table:
    decode, offsets = table._decode, table.offsets
    made: list[NDArray[Any]] = []

    def decoded(column: str, wanted: NDArray[np.int64]) -> NDArray[Any]:
        if column not in columns:
            return decode(column, wanted)
        if not made:
            stored = [np.asarray(decode(c, offsets)) for c in columns]
            whole = stored[0].astype(float) if stored[0].ndim == 2 else np.column_stack(stored).astype(float)
            with np.errstate(invalid="ignore", over="ignore"):
                broken = fault(whole) if len(whole) else whole
                made.extend(_stored(x, s.dtype) for x, s in zip(_split(broken, stored), stored, strict=True))
        return made[columns.index(column)][np.searchsorted(offsets, wanted)]

    return Table(table.name, table.instance, table.fields, offsets, decoded)


def _split(whole: Array, stored: list[NDArray[Any]]) -> list[Array]:
    return [whole] if stored[0].ndim == 2 else [whole[:, k] for k in range(len(stored))]


def _stored(x: Array, dtype: np.dtype[Any]) -> NDArray[Any]:
    if dtype.kind in "iu":
        x = np.clip(np.round(np.nan_to_num(x)), np.iinfo(dtype).min, np.iinfo(dtype).max)
    return x.astype(dtype)
