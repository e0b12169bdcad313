"""Columns broken on purpose: an opened log and a seed give the same log with values that nobody expects.

Unlike :mod:`tests.fuzz.mutate` the file stays sound, so that every value reaches the
flight: each column of each message may hold NaN, infinities, extremes, zeros, a constant,
or another kind of thing; times jump, stand still or run backwards; parameters are anything.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats.table import Field, Messages, ParamChange, Table, Text

Column = NDArray[Any]
Way = Callable[[Column, random.Random], Column]

REALS = (np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-38, 1e-6, -1.0, 1.0, 1e3, -1e6, 1e9, 1e18, -1e30, 3.4e38, 1e300)
TIMES = ("TimeUS", "TimeMS", "timestamp", "timestamp_sample", "time_boot_ms", "time_usec", "T", "SampleUS", "TS")


def hostile(messages: Messages, seed: int | str) -> Messages:
    """The log with one to thirty broken columns, and sometimes broken parameters and texts."""
    rng = random.Random(f"{seed}")
    tables = dict(messages.tables)
    columns = [(key, name) for key, table in tables.items() for name in table.fields]
    layouts_are_known = messages.format in ("tlog", "mavlink")  # they come from the dialect, whatever the file holds
    for _ in range(min(len(columns), int(30 ** rng.random()))):
        key, name = _chosen(columns, rng)
        if name not in tables[key].fields:
            continue
        tables[key] = _broken(tables[key], name, rng, WAYS if rng.random() < 0.9 or layouts_are_known else ODD)
    params = messages.params
    if params and rng.random() < 0.4:
        params = list(params)
        for k in rng.sample(range(len(params)), min(len(params), rng.choice((1, 3, 50)))):
            own = params[k]
            value = rng.choice([x for x in REALS if np.isfinite(x)])
            params[k] = ParamChange(own.name, value, own.t_us, own.is_default, own.offset)
    params = [*params, *_own(rng)] if rng.random() < 0.4 else params
    texts = [*messages.texts, Text("\x1b]0;x\x07<b>" + "x" * 500, 9, 2**62)] if rng.random() < 0.1 else messages.texts
    return replace(messages, tables=tables, params=params, texts=texts)


def _chosen(columns: list[tuple[tuple[str, int], str]], rng: random.Random) -> tuple[tuple[str, int], str]:
    """A column of a message drawn by name first, so that messages with many fields do not take all of it."""
    key = rng.choice(list(dict.fromkeys(key for key, _ in columns)))
    own = [c for c in columns if c[0] == key]
    times = [c for c in own if c[1] in TIMES]
    return rng.choice(times if times and rng.random() < 0.2 else own)


def _own(rng: random.Random) -> list[ParamChange]:
    """Parameters that attlog computes with, as no vehicle has them."""
    names = (
        "INS_GYRO_FILTER",
        "INS_ACCEL_FILTER",
        "IMU_GYRO_CUTOFF",
        "COMPASS_DEC",
        "EKF2_MAG_DECL",
        "AHRS_TRIM_X",
        "AHRS_TRIM_Y",
        "SENS_BOARD_ROT",
        "SENS_BOARD_X_OFF",
        "CAL_GYRO0_XOFF",
        "CAL_MAG0_XSCALE",
        "AHRS_EKF_TYPE",
        "EK3_IMU_MASK",
        "INS_RAW_LOG_OPT",
        "FRAME_CLASS",
        "MAV_TYPE",
        "RCMAP_THROTTLE",
        "MOT_PWM_MIN",
        "AHRS_RP_P",
        "SCHED_LOOP_RATE",
        "LOG_BITMASK",
        "SDLOG_PROFILE",
        "COMPASS_AUTODEC",
        "COMPASS_PRIMARY",
        "SYSID_SW_TYPE",
        "CAL_MAG_COMP_TYP",
        "INS_HNTCH_ENABLE",
        "LOG_DISARMED",
        "ATT_MAG_DECL_A",
        "ATT_W_ACC",
    )
    return [
        ParamChange(
            rng.choice(names),
            float(rng.choice([x for x in REALS if np.isfinite(x)])),
            rng.choice((None, 0, -5, 2**62, 10**7)),
        )
        for _ in range(rng.choice((1, 2, 8)))
    ]


def _broken(table: Table, name: str, rng: random.Random, ways: tuple[Way, ...]) -> Table:
    """The table with one column changed, of the same length; its type may be another."""
    way, seed = rng.choice(ways), rng.random()
    decode, old = table._decode, table.fields[name]
    whole: dict[str, Column] = {}
    offsets = table.offsets

    def decoded(column: str, wanted: NDArray[np.int64]) -> Column:
        if column != name:
            return decode(column, offsets)[np.searchsorted(offsets, wanted)]
        if "x" not in whole:
            with np.errstate(all="ignore"):
                whole["x"] = way(np.array(decode(column, offsets)), random.Random(seed))
        return whole["x"][np.searchsorted(offsets, wanted)] if len(offsets) else whole["x"]

    sample = decoded(name, offsets)
    kind = np.dtype((sample.dtype, sample.shape[1:])) if sample.ndim > 1 else sample.dtype
    fields = dict(table.fields) | {name: Field(name, kind, old.unit, old.scale)}
    if way is gone:
        del fields[name]
    return Table(table.name, table.instance, fields, table.offsets, decoded)


def _some(x: Column, rng: random.Random) -> Any:
    """Which records: one, few, a block, half, all."""
    n = len(x)
    if n == 0:
        return slice(0, 0)
    begin = rng.randrange(n)
    return rng.choice(
        (
            slice(begin, begin + 1),
            slice(begin, begin + 5),
            slice(begin, n),
            slice(0, begin + 1),
            slice(None),
            slice(None, None, 2),
            slice(None, None, 97),
        )
    )


def _value(x: Column, rng: random.Random) -> Any:
    if x.dtype.kind == "f":
        return rng.choice(REALS)
    if x.dtype.kind in "iu":
        info = np.iinfo(x.dtype)
        wanted = rng.choice((info.min, info.max, 0, 1, info.max // 2, info.max - 1, 255, -1))
        return min(max(wanted, info.min), info.max)
    return x[0] if len(x) else 0


def one_value(x: Column, rng: random.Random) -> Column:
    """An extreme in some records."""
    x[_some(x, rng)] = _value(x, rng)
    return x


def constant(x: Column, rng: random.Random) -> Column:
    """The sensor hangs."""
    if len(x):
        x[rng.randrange(len(x)) :] = x[rng.randrange(len(x))]
    return x


def scaled(x: Column, rng: random.Random) -> Column:
    """Another unit."""
    if x.dtype.kind in "iuf":
        factor = rng.choice((1e-3, 1e3, 1e6, -1.0, 57.3, 1e-9))
        return np.asarray(x * factor).astype(x.dtype)
    return x


def jumping(x: Column, rng: random.Random) -> Column:
    """A step up or down from some record on, as of a clock that was set."""
    if x.dtype.kind in "iuf" and len(x):
        x[rng.randrange(len(x)) :] += np.asarray(rng.choice((-1e9, -1e6, 1.0, 1e6, 3.6e9, 1e12, 1e15))).astype(x.dtype)
    return x


def backwards(x: Column, rng: random.Random) -> Column:
    """Turned around, or shuffled."""
    if rng.random() < 0.5:
        return x[::-1].copy()
    order = list(range(len(x)))
    rng.shuffle(order)
    return x[order]


def noise(x: Column, rng: random.Random) -> Column:
    """Any bits at all."""
    if x.dtype.kind in "iuf" and len(x):
        return np.frombuffer(rng.randbytes(x.nbytes), x.dtype).reshape(x.shape).copy()
    return x


def text(x: Column, rng: random.Random) -> Column:
    """Text where a number stood, or the other way."""
    return np.array([rng.choice((b"", b"nan", b"x", b"1e999", b"\xff"))] * len(x), dtype="S8")


def wide(x: Column, rng: random.Random) -> Column:
    """Several numbers per record where one stood, or the other way."""
    if x.ndim > 1 and x.size:
        return x.reshape(len(x), -1)[:, 0]
    return np.repeat(x[:, None], rng.choice((0, 1, 3, 4)), axis=1)


def gone(x: Column, rng: random.Random) -> Column:
    """The message has no such field."""
    return x


WAYS: tuple[Way, ...] = (one_value, one_value, one_value, constant, scaled, jumping, backwards, noise)
ODD: tuple[Way, ...] = (text, wide, gone)


# Whole sensors broken as they break on vehicles: another unit, mirrored axes, a delay, a driver that stops.
#
# :mod:`tests.fuzz.values` breaks columns, whatever they mean. Here all axes of a sensor are broken
# alike, so that every single value is one that the sensor can give and only physics contradicts it.

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
            return decode(column, offsets)[np.searchsorted(offsets, wanted)]
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
