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

from attlog.formats.base import Field, Messages, ParamChange, Table, Text

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
            return decode(column, wanted)
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
