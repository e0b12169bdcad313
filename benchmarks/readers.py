"""Print how fast attlog reads logs against the official libraries, with the targets.

Large logs are made from ``sample_logs``: data records repeated with times advanced.
All times are CPU seconds of this process, file in the page cache, attlog the best of
five, the official library one run, both in the same run of this script:
``python benchmarks/readers.py [--megabytes 100] [--oracle-megabytes 20]``.
"""

from __future__ import annotations

import argparse
import struct
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from attlog import formats
from attlog.formats import Messages
from attlog.formats.ulog import index

SAMPLES = Path(__file__).resolve().parent.parent / "sample_logs"
PX4 = ["sensor_combined", "vehicle_magnetometer", "vehicle_attitude", "vehicle_gps_position"]
ARDUPILOT = ["IMU", "MAG", "ATT", "GPS"]
TELEMETRY = ["RAW_IMU", "ATTITUDE", "GPS_RAW_INT"]
"""The messages that an attitude replay wants: IMU, magnetometer, attitude, GNSS."""


@dataclass(frozen=True)
class Row:
    """One line of the table. ``ratio`` compares with ``target`` (at least, or at most for memory)."""

    what: str
    megabytes: float
    ours: str
    peer: str
    ratio: float
    target: float
    at_most: bool = False

    @property
    def met(self) -> bool:
        return self.ratio <= self.target if self.at_most else self.ratio >= self.target


def main(arguments: list[str] | None = None) -> list[Row]:
    """Build the logs, measure, print the table; returns its rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--megabytes", type=float, default=100, help="size of the ULog and of the memory test")
    parser.add_argument("--oracle-megabytes", type=float, default=20, help="size where the official library is slow")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        rows = list(_rows(Path(folder), int(options.megabytes * 1e6), int(options.oracle_megabytes * 1e6)))
    _print(rows)
    return rows


def _rows(folder: Path, size: int, oracle_size: int) -> Iterator[Row]:
    large = repeated(SAMPLES / "px4_steps.ulg", folder / "large.ulg", size)
    binary = repeated(SAMPLES / "copter_steps_stabilize.bin", folder / "large.bin", min(size, oracle_size))
    telemetry = repeated(SAMPLES / "copter_steps_stabilize.tlog", folder / "large.tlog", min(size, oracle_size))
    without_numba = _best(lambda: _columns(formats.open(large), PX4))
    memory = _peak(lambda: _columns(formats.open(large), PX4)) / large.stat().st_size
    wanted = _once(lambda: _pyulog(large, PX4))
    everything = _once(lambda: _pyulog(large, None))
    binary_ours = _best(lambda: _columns(formats.open(binary), ARDUPILOT))
    binary_memory = _peak(lambda: _columns(formats.open(binary), ARDUPILOT)) / binary.stat().st_size
    telemetry_memory = _peak(lambda: _columns(formats.open(telemetry), TELEMETRY)) / telemetry.stat().st_size
    yield _speed("ULog wanted, no numba", large, without_numba, "pyulog, filter", wanted, 12)
    import numba  # noqa: F401  (readers use compiled loops where it is loaded)

    _columns(formats.open(large), PX4)
    yield _speed("ULog wanted, numba loaded", large, _best(lambda: _columns(formats.open(large), PX4)),
                 "pyulog, filter", wanted, 50)  # fmt: skip
    yield _speed("ULog all topics", large, _best(lambda: _columns(formats.open(large), None)), "pyulog", everything, 25)
    yield _index_row(large)
    _columns(formats.open(telemetry), TELEMETRY)
    telemetry_ours = _best(lambda: _columns(formats.open(telemetry), TELEMETRY))
    with _quiet():
        binary_peer = _once(lambda: _dfreader(binary, ARDUPILOT))
        telemetry_peer = _once(lambda: _mavlogfile(telemetry, TELEMETRY))
    yield _speed("DataFlash wanted", binary, binary_ours, "DFReader recv_match + to_dict", binary_peer, 120)
    yield _speed("tlog wanted, numba loaded", telemetry, telemetry_ours, "mavlogfile recv_match + to_dict",
                 telemetry_peer, 100)  # fmt: skip
    for path, share in [(large, memory), (binary, binary_memory), (telemetry, telemetry_memory)]:
        megabytes = path.stat().st_size / 1e6
        yield Row(f"{path.suffix} wanted, peak memory", megabytes, f"{share * megabytes:.1f} MB", "file size",
                  share, 1.0, at_most=True)  # fmt: skip


def _index_row(path: Path) -> Row:
    """The bare index pass of a ULog (where is every data record) against a plain copy of the mapped file."""
    mapped = np.memmap(path, np.uint8, "r")
    data, log = np.asarray(mapped), formats.open(path)
    sizes = index.Sizes()
    for table in log.values():
        at = int(table.offsets[0])
        size = int(data[at]) + 256 * int(data[at + 1])
        sizes.set(int(data[at + 3]) + 256 * int(data[at + 4]), size, size)
    begin = min(int(table.offsets[0]) for table in log.values())
    copy = _best(lambda: mapped.copy())
    indexed = _best(lambda: _index(data, sizes, begin))
    return Row("ULog index, numba loaded", len(data) / 1e6, f"{indexed:.3f} s", f"numpy copy {copy:.3f} s",
               copy / indexed, 0.7)  # fmt: skip


def _index(data: np.ndarray, sizes: index.Sizes, position: int) -> int:
    """Follow the chain of data records from the first on; returns their number."""
    chain, count = index.chain(data, sizes), 0
    while position < len(data):
        starts, _ = chain.follow(position, len(data))
        if len(starts):
            count += len(starts)
            position = int(starts[-1])
        position += 3 + int(data[position]) + 256 * int(data[position + 1])  # also over a record of another type
    return count


def _speed(what: str, path: Path, ours: float, peer_name: str, peer: float, target: float) -> Row:
    return Row(what, path.stat().st_size / 1e6, f"{ours:.3f} s", f"{peer_name} {peer:.2f} s", peer / ours, target)


def _print(rows: list[Row]) -> None:
    print(f"{'what':28} {'MB':>6} {'attlog':>10}  {'against':42} {'ratio':>8} {'target':>8}")
    for row in rows:
        sign = "<=" if row.at_most else ">="
        verdict = "" if row.met else "  missed"
        figures = f"{row.ratio:8.2f} {sign} {row.target:g}{verdict}"
        print(f"{row.what:28} {row.megabytes:6.1f} {row.ours:>10}  {row.peer:42} {figures}")


# What is measured.


def _columns(log: Messages, names: list[str] | None) -> None:
    """Decode every column of the wanted messages."""
    for (name, _), table in log.items():
        if names is None or name in names:
            for column in table.fields:
                table[column]


def _pyulog(path: Path, names: list[str] | None) -> None:
    from pyulog import ULog

    ULog(str(path), names)


def _dfreader(path: Path, names: list[str]) -> None:
    from pymavlink.DFReader import DFReader_binary

    log = DFReader_binary(str(path))
    while (message := log.recv_match(type=names)) is not None:
        message.to_dict()


def _mavlogfile(path: Path, names: list[str]) -> None:
    from pymavlink import mavutil

    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    while (message := log.recv_match(type=names)) is not None:
        message.to_dict()


def _once(work: Callable[[], object]) -> float:
    begin = time.process_time()
    work()
    return time.process_time() - begin


def _best(work: Callable[[], object], runs: int = 5) -> float:
    return max(min(_once(work) for _ in range(runs)), 1e-6)


def _peak(work: Callable[[], object]) -> int:
    """Most bytes allocated at a time; pages of the mapped file do not count, the system may drop them."""
    tracemalloc.start()
    work()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


@contextmanager
def _quiet() -> Iterator[None]:
    """The official library prints about what it does not like."""
    import io
    from contextlib import redirect_stderr, redirect_stdout

    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        yield


# How large logs are made.


def repeated(source: Path, target: Path, size: int) -> Path:
    """Write the log with its data records repeated until ``size`` bytes, times advanced; returns ``target``."""
    log = formats.open(source)
    raw = np.fromfile(source, np.uint8)
    begin, repeats = _repeating(log, raw)
    place = np.cumsum(repeats) - 1
    clocks = [(place[at[repeats[at]]], dtype) for at, dtype in _clocks(log)]
    seals = [(place[at[repeats[at]]], n, seed) for at, n, seed in _seals(log, raw)] if log.format == "tlog" else []
    body = raw[repeats]
    with target.open("wb") as file:
        file.write(raw[:begin].tobytes())
        file.write(raw[_late_definitions(log, raw, begin) & ~repeats].tobytes())
        for i in range(max(1, round((size - begin) / len(body)))):
            copy = body.copy()
            for at, dtype in clocks:
                _advance(copy, at, dtype, i * _span(log))
            for at, covered, seed in seals:
                _seal(copy, at, covered, seed)
            file.write(copy.tobytes())
    return target


ONCE = {"FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG", "VER", "FILE", "PARAM_VALUE", "STATUSTEXT", "SYSTEM_TIME"}
"""Definitions, parameters and texts stand once in a log however long it is; SYSTEM_TIME ends in a time that MAVLink
cuts to the bytes it needs, which leaves no room for a later one."""


def _repeating(log: Messages, raw: np.ndarray) -> tuple[int, np.ndarray]:
    """Where data begins, and which bytes belong to records that are repeated."""
    first = {"ulog": "sensor_combined", "dataflash": "IMU", "tlog": "RAW_IMU"}[log.format]
    lead = 8 if log.format == "tlog" else 0
    begin = int(log.first(first).offsets[0]) - lead
    repeats = np.zeros(len(raw), bool)
    for (name, _), table in log.items():
        if name in ONCE:
            continue
        starts = table.offsets[table.offsets - lead >= begin]
        for start, length in zip(starts.tolist(), _lengths(log, raw, starts).tolist(), strict=True):
            repeats[start - lead : start + length] = True
    return begin, repeats


def _late_definitions(log: Messages, raw: np.ndarray, begin: int) -> np.ndarray:
    """Bytes behind the beginning of the data without which it cannot be decoded."""
    late = np.zeros(len(raw), bool)
    if log.format == "ulog":
        late[begin:] = True
    for name in ("FMT", "FMTU", "UNIT", "MULT"):
        table = log.first(name)
        starts = table.offsets[table.offsets >= begin] if table is not None else np.zeros(0, np.int64)
        for start, length in zip(starts.tolist(), _lengths(log, raw, starts).tolist(), strict=True):
            late[start : start + length] = True
    return late


def _lengths(log: Messages, raw: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Bytes of the records at these places."""
    if log.format == "ulog":
        return 3 + raw[starts].astype(int) + 256 * raw[starts + 1].astype(int)
    if log.format == "tlog":
        return raw[starts + 1].astype(int) + np.where(raw[starts] == 0xFE, 8, 12)
    by_type = np.zeros(256, int)
    by_type[log["FMT", 0]["Type"]] = log["FMT", 0]["Length"]
    return by_type[raw[starts + 2]]


def _clocks(log: Messages) -> Iterator[tuple[np.ndarray, str]]:
    """Byte places and stored types of every time in the log; the unit follows from the width (u64 us, u32 ms)."""
    for (name, _), table in log.items():
        if log.format == "tlog":
            yield table.offsets - 8, ">u8"
            for field, place in _places(name):
                if field in ("time_boot_ms", "time_usec"):
                    yield table.offsets + 10 + place, "<u4" if field == "time_boot_ms" else "<u8"
        elif log.format == "ulog":
            yield from ((table.offsets + 5 + 8 * i, "<u8") for i, f in enumerate(list(table.fields)[:2])
                        if f in ("timestamp", "timestamp_sample"))  # fmt: skip
        elif "TimeUS" in table.fields:
            yield table.offsets + 3, "<u8"


def _span(log: Messages) -> int:
    """Length of the flight in microseconds, whole milliseconds."""
    table, clock = {
        "ulog": ("sensor_combined", "timestamp"), "dataflash": ("IMU", "TimeUS"), "tlog": ("RAW_IMU", "time_usec")
    }[log.format]  # fmt: skip
    times = log.first(table)[clock].astype(np.int64)
    return int(times[-1] - times[0]) // 1000 * 1000 + 10_000


def _advance(raw: np.ndarray, places: np.ndarray, dtype: str, by_us: int) -> None:
    width = int(dtype[2:])
    at = places[:, None] + np.arange(width)
    times = raw[at].view(dtype)[:, 0].astype(np.uint64) + np.uint64(by_us if width == 8 else by_us // 1000)
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


def _seals(log: Messages, raw: np.ndarray) -> list[tuple[np.ndarray, int, int]]:
    """Packets of MAVLink 2 that share a length and a message: places, covered bytes, checksum seed."""
    found = []
    for (name, _), table in log.items():
        length = raw[table.offsets + 1]
        for payload in np.unique(length).tolist():
            found.append((table.offsets[length == payload], 9 + payload, _mavlink(name).crc_extra))
    return found


def _seal(raw: np.ndarray, places: np.ndarray, covered: int, seed: int) -> None:
    """Put the checksum on packets whose content was changed: CRC-16/MCRF4XX behind the marker, then the seed."""
    crc = np.full(len(places), 0xFFFF, np.uint16)
    rows = np.concatenate([raw[places[:, None] + 1 + np.arange(covered)], np.full((len(places), 1), seed, np.uint8)], 1)
    for column in rows.T:
        mixed = column ^ (crc & 0xFF).astype(np.uint8)
        mixed = (mixed ^ (mixed << 4)).astype(np.uint16)
        crc = (crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4)
    raw[places + 1 + covered], raw[places + 2 + covered] = crc & 0xFF, crc >> 8


if __name__ == "__main__":
    sys.exit(0 if all(row.met for row in main()) else 1)
