"""What ArduPilot logs of vibration: VIBE at the sensor's full rate (levels, clipped samples), and bursts (ISBH, ISBD).

``Clip0`` to ``Clip2`` (3.4 to 4.0) count by unit in one record, ``Clip`` (4.1 on) in one record for each unit. Before
3.4 nothing tells, and the logged IMU at 25 Hz never reaches the limit. Bursts: ``BatchSampler.cpp`` of
AP_InertialSensor; a header tells the sensor and the factor, up to 32 data records of 32 samples follow.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.flight import physics
from attlog.flight.ardupilot.clock import Clock
from attlog.flight.ardupilot.imus import units
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.model import Clipping, Imu, Stream
from attlog.flight.vibration.model import Burst, OnboardVibration
from attlog.formats.base import Table

AXES = ("VibeX", "VibeY", "VibeZ")
MOST_BURSTS = 200
"""So many of each sensor are kept, evenly spread, so that the memory they take has a limit (5 MB)."""
LEAST_SAMPLES = 256
"""A shorter rest of a burst of which records were lost resolves no peak."""
LATE_US = 10_000_000
"""A burst is written within a second or two; a header that says otherwise has no time of measurement."""
POST_FILTER, PRE_AND_POST = 2, 4
"""Bits of INS_LOG_BAT_OPT: behind the filters; both, those behind them numbered after the last IMU."""
SENSORS: dict[int, Literal["gyro", "accelerometer"]] = {0: "accelerometer", 1: "gyro"}
"""ISBH.type."""


def level(builder: LogBuilder, clock: Clock, imu: Imu | None) -> Stream | None:
    """VIBE (n, 3) in m/s^2 of the replayed unit; before 4.1 there is one record for all."""
    tables = units(builder.messages, "VIBE")
    table = tables.get(imu.index if imu is not None else 0, tables.get(0))
    if table is None or not all(c in table for c in AXES):
        return None
    x = columns(table, *AXES)
    return builder.stream(clock.of(table), x, "m/s^2", "VIBE", frame="FRD", within=physics.VIBRATION)


def levels(builder: LogBuilder, clock: Clock) -> list[OnboardVibration]:
    """The level of the worst axis of every unit that VIBE tells of; before 4.1 that is the primary one, here 0."""
    found = []
    own = LogBuilder(builder.messages, t0_us=builder.t0_us)  # what is left out is told where the replayed unit is read
    for unit, table in units(builder.messages, "VIBE").items():
        if all(c in table for c in AXES):
            source = f"VIBE:{unit}" if "IMU" in table else "VIBE"
            stream = own.stream(clock.of(table), columns(table, *AXES), "m/s^2", source, within=physics.VIBRATION)
            if stream is not None:
                found.append(OnboardVibration(unit, "rest", source, stream.t, stream.x.max(axis=1)))
    return found


def clippings(builder: LogBuilder, clock: Clock) -> list[Clipping]:
    """New clipped samples of every unit over time."""
    found = []
    have = {imu for imu in units(builder.messages, "IMU")}
    for instance, table in units(builder.messages, "VIBE").items():
        if len(table) < 2:
            continue
        named = [(instance, "Clip")] if "Clip" in table else [(k, f"Clip{k}") for k in range(3)]
        for unit, column in named:
            if column in table and (column == "Clip" or unit in have):
                counter = table[column].astype(np.int64)
                new = np.maximum(np.diff(counter, prepend=counter[:1]), 0)
                source = f"VIBE:{unit}.Clip" if column == "Clip" else f"VIBE.{column}"
                found.append(Clipping("accelerometer", unit, source, builder.seconds(clock.of(table)), new, True))
    return found


def bursts(builder: LogBuilder, values: dict[str, float]) -> list[Burst]:
    """The batches of the sensors' raw samples, at most 200 of each sensor, in time order."""
    heads, data = builder.messages.first("ISBH"), builder.messages.first("ISBD")
    needed = ("N", "type", "instance", "mul", "SampleUS", "smp_rate")
    if heads is None or data is None or not all(c in heads for c in needed) or not all(c in data for c in "xyz"):
        return []
    number = heads["N"].astype(np.int64)
    of_head = np.searchsorted(heads.offsets, data.offsets) - 1
    mine = (of_head >= 0) & (data["N"].astype(np.int64) == number[np.maximum(of_head, 0)])
    rows = np.flatnonzero(mine)
    begin = np.searchsorted(of_head[rows], np.arange(len(heads)))
    end = np.searchsorted(of_head[rows], np.arange(len(heads)), side="right")
    imus = max(len(units(builder.messages, "IMU")), 1)
    options = int(values.get("INS_LOG_BAT_OPT", 0.0))
    found = []
    for k in _spread(heads):
        unit, filtered = int(heads["instance"][k]), bool(options & POST_FILTER)
        if options & PRE_AND_POST and unit >= imus:
            unit, filtered = unit - imus, True
        one = _burst(builder, heads, int(k), data.rows(rows[begin[k] : end[k]]), unit, filtered)
        found += [] if one is None else [one]
    return found


def _spread(heads: Table) -> NDArray[np.int64]:
    """Which headers to read, in file order: of each sensor as many as are kept, evenly spread."""
    kind = heads["type"].astype(np.int64) * 256 + heads["instance"].astype(np.int64)
    kept = []
    for one in np.unique(kind):
        k = np.flatnonzero(kind == one)
        kept.append(k[np.unique(np.linspace(0, len(k) - 1, MOST_BURSTS).round().astype(np.int64))])
    return np.sort(np.concatenate(kept)) if kept else np.zeros(0, np.int64)


def _burst(builder: LogBuilder, heads: Table, k: int, data: Table, unit: int, filtered: bool) -> Burst | None:
    """One burst up to the first record that is missing; None where that is too short or its header makes no sense."""
    sensor = SENSORS.get(int(heads["type"][k]))
    factor, rate = float(heads["mul"][k]), float(heads["smp_rate"][k])
    if sensor is None or factor <= 0 or not 100.0 <= rate <= physics.RAW_HZ:
        return None
    whole = data["seqno"].astype(np.int64) == np.arange(len(data)) if "seqno" in data else np.ones(len(data), bool)
    count = int(np.argmin(whole)) if not whole.all() else len(data)
    x = np.stack([data[axis][:count].reshape(-1) for axis in "xyz"], axis=-1).astype(np.float32) / np.float32(factor)
    at, sampled = int(heads["TimeUS"][k]) if "TimeUS" in heads else 0, int(heads["SampleUS"][k])
    stamp = sampled if abs(at - sampled) < LATE_US or not at else at
    if len(x) < LEAST_SAMPLES or not builder.is_near(stamp):
        return None
    t = float(builder.seconds(np.array(stamp)))
    return Burst(sensor, unit, t, rate, x, filtered, f"ISBD:{int(heads['instance'][k])}")
