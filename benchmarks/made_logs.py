"""Make long logs out of short ones: data records repeated with times advanced.

    python benchmarks/made_logs.py SOURCE TARGET --megabytes 60 [--mb-per-second 0.1] [--imu-hz 25]

The first pass holds every record of the source as it is; further passes hold its data
records alone, with their clocks (and in a tlog their checksums) made to fit. What
attlog, pyulog and pymavlink read in the result is whole: no byte is damaged and times
rise. ``--mb-per-second`` (ULog) thickens messages that no replay reads until a second of
flight fills so much, as the loggers of large vehicles do; ``--imu-hz`` thins what a replay
reads to about so many records in a second, the rest to a 25th of that.
"""

from __future__ import annotations

import argparse
import os
import struct
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog import formats
from attlog.formats import Messages, Table

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

ROOT = Path(__file__).resolve().parent.parent
SAMPLES = ROOT / "sample_logs"
MAKER = 2
"""Goes up when the same call makes other bytes: logs kept in the temporary folder are then made anew."""

ONCE = {"FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG", "VER", "FILE", "PARAM_VALUE", "STATUSTEXT", "SYSTEM_TIME"}
"""Definitions, parameters and texts stand once in a log however long it is; SYSTEM_TIME ends in a time that MAVLink
cuts to the bytes it needs, which leaves no room for a later one."""
FILLING = (
    "vehicle_attitude_setpoint",
    "trajectory_setpoint",
    "cpuload",
    "sensor_baro",
    "estimator_sensor_bias",
    "vehicle_angular_velocity_groundtruth",
    "actuator_outputs",
    "estimator_event_flags",
)
"""ULog topics of small records that no replay reads: a log is thickened with them."""
REPLAYED = {
    "sensor_combined",
    "vehicle_attitude",
    "vehicle_attitude_groundtruth",
    "vehicle_magnetometer",
    "vehicle_gps_position",
    "IMU",
    "ATT",
    "SIM",
    "MAG",
    "GPS",
    "RAW_IMU",
    "GPS_RAW_INT",
    "ATTITUDE",
    "ATTITUDE_QUATERNION",
    "SIM_STATE",
}


@dataclass(frozen=True)
class Records:
    """Records of one message: first bytes, lengths, times (us; later where a record stands in for several).

    ``clocks`` are the stored times: place counted from a record's first byte, and type (u64 us, u32 ms).
    """

    name: str
    starts: Integers
    lengths: Integers
    times_us: Integers
    clocks: tuple[tuple[int, str], ...]
    later_us: Integers

    def at(self, chosen: Any) -> Records:
        """Some of the records."""
        return replace(
            self,
            starts=self.starts[chosen],
            lengths=self.lengths[chosen],
            times_us=self.times_us[chosen],
            later_us=self.later_us[chosen],
        )


def repeated(source: Path, target: Path, size: int, *, mb_per_second: float = 0.0, imu_hz: float = 0.0) -> Path:
    """Write ``source`` with its data records repeated until about ``size`` bytes; returns ``target``."""
    log = formats.open(source)
    raw = np.fromfile(source, np.uint8)
    everything = list(_records(log, raw))
    end = len(raw) if log.format == "ulog" else max(int((r.starts + r.lengths)[-1]) for r in everything)
    data = [r for r in everything if r.name not in ONCE and r.clocks]
    first = next(r for r in data if r.name == IMU[log.format])
    later = [r.at((r.starts >= first.starts[0]) & (r.times_us >= first.times_us[0])) for r in data]
    span_us = max(int(r.times_us.max()) for r in later if len(r.starts)) - int(first.times_us[0])
    span_us = -(-span_us // 1000) * 1000 + 10_000
    if imu_hz:
        data, later = (
            [_thinned(r, imu_hz if r.name in REPLAYED else imu_hz / 25) for r in some] for some in (data, later)
        )
    bytes_of_pass = sum(int(r.lengths.sum()) for r in later)
    missing = mb_per_second * span_us - bytes_of_pass
    if missing > 0:
        copies = 1 + round(missing / sum(int(r.lengths.sum()) for r in later if r.name in FILLING))
        data, later = ([_thickened(r, copies) if r.name in FILLING else r for r in some] for some in (data, later))
    rest = _between(everything, data, end, thinned=bool(imu_hz))
    whole, again = Passage(raw, [*data, rest], log.format), Passage(raw, later, log.format)
    with target.open("wb") as file:
        file.write(whole.later(0))
        for i in range(1, max(1, 1 + round((size - len(whole)) / len(again)))):
            file.write(again.later(i * span_us))
    return target


IMU = {"ulog": "sensor_combined", "dataflash": "IMU", "tlog": "RAW_IMU"}
"""The message that paces a replay."""


class Passage:
    """The bytes of one pass through a log, for any time later than it was recorded."""

    def __init__(self, raw: Bytes, records: list[Records], log_format: str) -> None:
        starts, lengths, later = (
            np.concatenate([getattr(r, name) for r in records]) for name in ("starts", "lengths", "later_us")
        )
        order = np.lexsort([later, starts])
        ends = np.cumsum(lengths[order])
        place = np.empty(len(order), np.int64)
        place[order] = ends - lengths[order]
        at = np.repeat(starts[order] - place[order], lengths[order]) + np.arange(int(ends[-1]))
        self._bytes = raw[at]
        self._clocks: list[tuple[Integers, str, Integers]] = []
        self._seals: list[tuple[Integers, int, int]] = []
        begin = 0
        for r in records:
            own = place[begin : begin + len(r.starts)]
            begin += len(r.starts)
            for offset, dtype in r.clocks:
                self._clocks.append((own + offset, dtype, r.later_us))
            if log_format == "tlog" and r.clocks:
                self._seals += _seals(r, own + LEAD, self._bytes)

    def __len__(self) -> int:
        return len(self._bytes)

    def later(self, later_us: int) -> bytes:
        """The bytes as the logger would have written them ``later_us`` later."""
        raw: Bytes = self._bytes.copy()
        for places, dtype, own_us in self._clocks:
            _advance(raw, places, dtype, own_us + later_us)
        for places, covered, seed in self._seals:
            _seal(raw, places, covered, seed)
        return raw.tobytes()


LEAD = 8
"""Bytes of a tlog's time stamp, ahead of each packet."""


def _records(log: Messages, raw: Bytes) -> Iterator[Records]:
    """The records of every message that has any."""
    lead = LEAD if log.format == "tlog" else 0
    for (name, _), table in log.items():
        if len(table):
            clocks = tuple((lead + offset, dtype) for offset, dtype in _clocks(log.format, table))
            times = _times(log.format, table) if clocks else np.zeros(len(table), np.int64)
            lengths = _lengths(log, raw, table.offsets) + lead
            yield Records(name, table.offsets - lead, lengths, times, clocks, np.zeros(len(table), np.int64))


def _between(everything: list[Records], data: list[Records], end: int, *, thinned: bool) -> Records:
    """All bytes up to ``end`` that are no data record, as records without a clock.

    Where data was thinned, its left out records are no such bytes either.
    """
    free = np.ones(end, np.int8)
    for r in [r for r in everything if r.name not in ONCE and r.clocks] if thinned else data:
        inside = np.zeros(end + 1, np.int8)
        starts = np.unique(r.starts, return_index=True)[1]
        inside[r.starts[starts]] += 1
        inside[(r.starts + r.lengths)[starts]] -= 1
        free[np.cumsum(inside[:-1], dtype=np.int8) > 0] = 0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], free, [0]])))
    starts, ends = edges[::2], edges[1::2]
    zero = np.zeros(len(starts), np.int64)
    return Records("", starts, ends - starts, zero, (), zero)


def _thinned(r: Records, hz: float) -> Records:
    """One record in so many that about ``hz`` in a second are left."""
    if len(r.starts) < 2:
        return r
    rate = (len(r.starts) - 1) / max(float(r.times_us[-1] - r.times_us[0]) / 1e6, 1e-6)
    return r.at(slice(None, None, max(1, round(rate / hz))))


def _thickened(r: Records, copies: int) -> Records:
    """Each record ``copies`` times, spread over the time until the next one."""
    if len(r.starts) < 2:
        return r
    until_next = np.diff(r.times_us)
    step = np.append(until_next, 0) / copies
    wide = r.at(np.repeat(np.arange(len(r.starts)), copies))
    return replace(wide, later_us=(step[:, None] * np.arange(copies)).astype(np.int64).ravel())


def _lengths(log: Messages, raw: Bytes, starts: Integers) -> Integers:
    """Bytes of the records at these places."""
    if log.format == "ulog":
        return 3 + raw[starts].astype(np.int64) + 256 * raw[starts + 1].astype(np.int64)
    if log.format == "tlog":
        return raw[starts + 1].astype(np.int64) + np.where(raw[starts] == 0xFE, 8, 12)
    by_type = np.zeros(256, np.int64)
    by_type[log["FMT", 0]["Type"]] = log["FMT", 0]["Length"]
    return by_type[raw[starts + 2]]


def _clocks(log_format: str, table: Table) -> Iterator[tuple[int, str]]:
    """Places in a record and stored types of its times; the unit follows from the width (u64 us, u32 ms)."""
    if log_format == "tlog":
        yield -LEAD, ">u8"
        for field, place in _places(table.name):
            if field in ("time_boot_ms", "time_usec"):
                yield 10 + place, "<u4" if field == "time_boot_ms" else "<u8"
    elif log_format == "ulog":
        for i, field in enumerate(list(table.fields)[:2]):
            if field in ("timestamp", "timestamp_sample"):
                yield 5 + 8 * i, "<u8"
    elif "TimeUS" in table.fields:
        yield 3, "<u8"


def _times(log_format: str, table: Table) -> Integers:
    """When each record was logged, in microseconds."""
    return table[{"ulog": "timestamp", "dataflash": "TimeUS", "tlog": "_t_us"}[log_format]].astype(np.int64)


def _advance(raw: Bytes, places: Integers, dtype: str, by_us: Integers) -> None:
    width = int(dtype[2:])
    at = places[:, None] + np.arange(width)
    times = raw[at].view(dtype)[:, 0].astype(np.int64) + (by_us if width == 8 else by_us // 1000)
    raw[at] = times.astype(dtype)[:, None].view(np.uint8)


def _mavlink(name: str) -> Any:
    """The message's class in the official dialect."""
    from pymavlink.dialects.v20 import ardupilotmega

    return next(m for m in ardupilotmega.mavlink_map.values() if m.msgname == name)


def _places(name: str) -> Iterator[tuple[str, int]]:
    """Fields of a MAVLink message and their byte places in the payload."""
    message, place = _mavlink(name), 0
    for field, letter, count in zip(
        message.ordered_fieldnames, message.native_format.decode()[1:], message.lengths, strict=True
    ):
        yield field, place
        place += struct.calcsize(letter) * count


def _seals(r: Records, places: Integers, raw: Bytes) -> list[tuple[Integers, int, int]]:
    """Packets of MAVLink 2 of one message and length: places, covered bytes, checksum seed."""
    length = raw[places + 1]
    seed = _mavlink(r.name).crc_extra
    return [(places[length == payload], 9 + payload, seed) for payload in np.unique(length).tolist()]


def _seal(raw: Bytes, places: Integers, covered: int, seed: int) -> None:
    """Put the checksum on packets whose content was changed: CRC-16/MCRF4XX behind the marker, then the seed."""
    crc = np.full(len(places), 0xFFFF, np.uint16)
    rows = np.concatenate([raw[places[:, None] + 1 + np.arange(covered)], np.full((len(places), 1), seed, np.uint8)], 1)
    for column in rows.T:
        mixed = column ^ (crc & 0xFF).astype(np.uint8)
        mixed = (mixed ^ (mixed << 4)).astype(np.uint16)
        crc = (crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4)
    raw[places + 1 + covered], raw[places + 2 + covered] = crc & 0xFF, crc >> 8


def kept(source: str, megabytes: float, **how: float) -> Path:
    """The log made from a sample log, from the temporary folder where an earlier run left it."""
    folder = Path(tempfile.gettempdir()) / f"attlog-benchmarks-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    folder.mkdir(mode=0o700, exist_ok=True)
    stem, _, suffix = source.rpartition(".")
    told = "".join(f"-{name}-{value:g}" for name, value in how.items())
    target = folder / f"{stem}-{megabytes:g}MB{told}-{MAKER}.{suffix}"
    if not target.is_file():
        half = folder / f".{os.getpid()}-{target.name}"
        repeated(SAMPLES / source, half, int(megabytes * 1e6), **how)
        half.replace(target)
    return target


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--megabytes", type=float, default=60)
    parser.add_argument("--mb-per-second", type=float, default=0.0)
    parser.add_argument("--imu-hz", type=float, default=0.0)
    options = parser.parse_args(arguments)
    repeated(
        options.source,
        options.target,
        int(options.megabytes * 1e6),
        mb_per_second=options.mb_per_second,
        imu_hz=options.imu_hz,
    )


if __name__ == "__main__":
    main()
