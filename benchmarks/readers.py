"""How fast attlog reads logs, against the official libraries.

    python benchmarks/readers.py [--megabytes 60] [--slow-megabytes 10] [--runs 5] [--corpus DIR]

Both readers run by turns in one process that reads nothing else, as often as each other, imports outside, file in the
page cache; CPU seconds, medians. *first* is the first log of a fresh process, which loads the machine code of attlog's
loops from where it is kept where the log is large enough, *later* are further ones, machine code loaded: of a process
that runs filters as well (``batch``, ``compare``), or has read some 30 MB. "Wanted" are IMU, magnetometer, attitude and
GNSS, every column of them. Logs of ``sample_logs`` and of ``--corpus`` (default $ATTLOG_CORPUS) as they are, and sample
logs repeated to ``--megabytes``, ``--slow-megabytes`` where the official library is slow.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import median

import numpy as np
from made_logs import SAMPLES, kept
from measured import Pair, anonymous_mb, apart, by_turns, cpu, environment, quiet
from table import Measured, Target, Task, of_pair, seconds

from attlog import formats
from attlog.core.machine import release_memory
from attlog.formats import Messages

WANTED = {
    ".ulg": ["sensor_combined", "vehicle_magnetometer", "vehicle_attitude", "vehicle_gps_position"],
    ".bin": ["IMU", "MAG", "ATT", "GPS"],
    ".tlog": ["RAW_IMU", "ATTITUDE", "GPS_RAW_INT"],
}
PEERS = {
    ".ulg": "pyulog",
    ".bin": "pymavlink DFReader, recv_match + to_dict",
    ".tlog": "pymavlink mavlogfile, recv_match + to_dict",
}
REAL = {
    ".ulg": ["logs/ulg_px4_1.15dev_cubeorange_quad_cut.ulg", "logs/ulg_px4_1.16_cuav7nano_quad_cut.ulg"],
    ".bin": ["logs/bin_copter_3.6.4_781s.bin", "logs/bin_copter_4.7dev_crash_isb_cut.bin"],
    ".tlog": ["logs/tlog_mav1_copter_3.5.7_radio_cut.tlog", "logs/tlog_mav2_sub_10hz_cut.tlog"],
}
"""Logs of a corpus that somebody flew, cut at record boundaries."""


@dataclass(frozen=True)
class Reading:
    """How long both readers took for one log: the first time in a process, and later."""

    path: Path
    everything: bool
    first: Pair
    later: Pair

    @property
    def times_faster(self) -> float:
        """The peer's time over ours, machine code loaded."""
        return 1.0 / self.later.ratio

    @property
    def first_times_faster(self) -> float:
        """The same for the first log of a process."""
        return 1.0 / self.first.ratio


def compared(
    path: Path, everything: bool = False, runs: int = 5, seconds: float = 60.0, *, compiled: bool = True
) -> Reading:
    """Read a log with both readers, each time in fresh processes for the first log.

    ``compiled`` False: attlog reads by numpy alone, as it does where no machine code is at hand.
    """
    with environment(ATTLOG_NO_JIT="" if compiled else "1"):
        if compiled:
            apart(_kept, path)
        first, later = Pair(), Pair()
        for turn in range(min(runs, 3)):
            cold, warm = apart(_by_turns, path, everything, turn, runs if turn == 0 else 0, seconds / 2)
            first.ours += cold.ours
            first.peer += cold.peer
            if turn == 0:
                later = warm
            if sum(first.ours + first.peer) * (turn + 2) / (turn + 1) > seconds / 2:
                break
    return Reading(path, everything, first, later)


def _kept(path: Path) -> None:
    """Have the loops of this log's reader compiled and kept, as the first analysis of a user does."""
    import numba  # noqa: F401  (readers have their loops compiled only where the compiler is loaded)

    with quiet():
        columns(formats.open(path), WANTED[path.suffix.lower()])


def _by_turns(path: Path, everything: bool, turn: int, runs: int, seconds: float) -> tuple[Pair, Pair]:
    """One reading each in a process that has read nothing, then ``runs`` by turns."""
    names = None if everything else WANTED[path.suffix.lower()]
    read = _peer(path.suffix.lower())
    with quiet():
        works: tuple[Callable[[], float], Callable[[], float]] = (
            lambda: cpu(lambda: columns(formats.open(path), names)),
            lambda: cpu(lambda: read(path, names)),
        )
        path.read_bytes()  # the page cache
        times = [work() for work in (works if turn % 2 == 0 else works[::-1])]
        first = Pair([times[turn % 2]], [times[1 - turn % 2]])
        load_machine_code(path)
        return first, by_turns(*works, runs, seconds) if runs else Pair()


def load_machine_code(path: Path) -> None:
    """As a process that runs filters has it, and the loops of this log's reader with it."""
    import llvmlite.binding  # noqa: F401  (readers look whether it is loaded)

    columns(formats.open(path), WANTED[path.suffix.lower()])


def columns(log: Messages, names: list[str] | None) -> None:
    """Decode every column of the wanted messages."""
    for (name, _), table in log.items():
        if names is None or name in names:
            for column in table.fields:
                table[column]


def _peer(suffix: str) -> Callable[[Path, list[str] | None], object]:
    """The official reader, imported."""
    if suffix == ".ulg":
        from pyulog import ULog

        return lambda path, names: ULog(str(path), names)
    from pymavlink import mavutil
    from pymavlink.DFReader import DFReader_binary
    from pymavlink.dialects.v20 import ardupilotmega  # noqa: F401  (a connection imports it)

    def read(path: Path, names: list[str] | None) -> None:
        log = (
            DFReader_binary(str(path))
            if suffix == ".bin"
            else mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
        )
        while (message := log.recv_match(type=names)) is not None:
            message.to_dict()

    return read


def index_against_copy(path: Path, runs: int = 5) -> Pair:
    """The bare pass of a ULog that finds every data record, against a plain copy of the mapped file."""
    from attlog.formats.ulog import walk

    mapped = np.memmap(path, np.uint8, "r")
    data, log = np.asarray(mapped), formats.open(path)
    sizes = walk.Sizes()
    for table in log.values():
        at = int(table.offsets[0])
        size = int(data[at]) + 256 * int(data[at + 1])
        sizes.set(int(data[at + 3]) + 256 * int(data[at + 4]), size, size)
    begin = min(int(table.offsets[0]) for table in log.values())

    def follow() -> None:
        chain, position = walk.DataChain(data, sizes), begin
        while position < len(data):
            starts, _ = chain.follow(position, len(data))
            if len(starts):
                position = int(starts[-1])
            position += 3 + int(data[position]) + 256 * int(data[position + 1])  # also over a record of another type

    follow()
    return by_turns(lambda: cpu(follow), lambda: cpu(lambda: mapped.copy()), runs)


def peak_share(path: Path) -> float:
    """Most anonymous memory that opening and the wanted columns take beside the file's own bytes, as a share of the
    file; NaN where not told. What code takes (imports, loops, dialects) is loaded before."""
    import threading

    from attlog.core.limits import READ_BYTES

    load_machine_code(path)
    release_memory(path.stat().st_size)
    base = most = anonymous_mb()
    done = threading.Event()

    def watch() -> None:
        nonlocal most
        while not done.wait(0.001):
            most = max(most, anonymous_mb())

    watcher = threading.Thread(target=watch)
    watcher.start()
    log = formats.open(path)
    columns(log, WANTED[path.suffix.lower()])
    most = max(most, anonymous_mb())
    done.set()
    watcher.join()
    size = path.stat().st_size
    return (most - base) * 2**20 / size - (size <= READ_BYTES)


def real(corpus: Path | None, suffix: str) -> list[Path]:
    """Logs that were not made long: of the corpus where there is one, else the samples."""
    found = [corpus / name for name in REAL[suffix] if (corpus / name).is_file()] if corpus else []
    return found or sorted(SAMPLES.glob(f"*{suffix}"))


def corpus_of(given: str | None) -> Path | None:
    """The folder of real logs, if one is given or named by the environment."""
    name = given or os.environ.get("ATTLOG_CORPUS")
    return Path(name) if name else None


GROUPS = ("Readers", "Readers' memory")


@cache
def reading(make: Callable[[], Path], everything: bool, runs: int) -> Reading:
    """A log that may have to be made first, read by both."""
    return compared(make(), everything, runs)


def tasks(runs: int = 5, corpus: Path | None = None, megabytes: float = 60, slow_megabytes: float = 10) -> list[Task]:
    """Every row about readers."""
    speed, memory = GROUPS

    def ulog() -> Path:
        return kept("px4_steps.ulg", megabytes)

    def binary() -> Path:
        return kept("copter_steps_stabilize.bin", slow_megabytes)

    def telemetry() -> Path:
        return kept("copter_steps_stabilize.tlog", slow_megabytes)

    def later(make: Callable[[], Path], everything: bool = False) -> Callable[[], Measured]:
        return lambda: of_pair(reading(make, everything, runs).later, short(make().suffix), faster=True)

    def first(make: Callable[[], Path], everything: bool = False) -> Callable[[], Measured]:
        return lambda: of_pair(reading(make, everything, runs).first, short(make().suffix), faster=True)

    def short(suffix: str) -> str:
        return "pyulog" if suffix == ".ulg" else "pymavlink"

    def numpy_alone() -> Measured:
        return of_pair(compared(ulog(), False, runs, compiled=False).later, "pyulog", faster=True)

    def of_several(suffix: str) -> Callable[[], Measured]:
        """Real logs: all their times together."""

        def measure() -> Measured:
            found = [compared(path, False, runs).later for path in real(corpus, suffix)]
            ours, theirs = (sum(median(getattr(p, side)) for p in found) for side in ("ours", "peer"))
            peer = f"{short(suffix)} {seconds(theirs)}"
            return Measured(theirs / ours, seconds(ours), peer, min(len(p.ours) for p in found))

        return measure

    def names(suffix: str) -> str:
        found = real(corpus, suffix)
        kind = "samples as they are" if found[0].parent == SAMPLES else "real logs"
        return f"{len(found)} {kind}, {min(p.stat().st_size for p in found) / 1e6:.1f} to " + (
            f"{max(p.stat().st_size for p in found) / 1e6:.1f} MB"
        )

    def against_copy() -> Measured:
        pair = apart(index_against_copy, ulog(), runs)
        return of_pair(pair, "numpy copy", faster=True)

    def share(make: Callable[[], Path]) -> Callable[[], Measured]:
        def measure() -> Measured:
            value = apart(peak_share, make())
            size = make().stat().st_size / 1e6
            return Measured(value, f"{value * size:.1f} MB", f"file of {size:.0f} MB")

        return measure

    return [
        Task(speed, f"ULog wanted, {megabytes:g} MB", Target("≥", 40, earlier=50), later(ulog), True),
        Task(speed, f"ULog wanted, {megabytes:g} MB, first log of a process", None, first(ulog), True),
        Task(speed, f"ULog wanted, {megabytes:g} MB, numpy alone", Target("≥", 12), numpy_alone, True),
        Task(speed, f"ULog all topics, {megabytes:g} MB", Target("≥", 25), later(ulog, True), True),
        Task(speed, f"ULog wanted, {names('.ulg')}", None, of_several(".ulg")),
        Task(speed, "ULog index", Target("≥", 0.7), against_copy, True),
        Task(speed, f"DataFlash wanted, {slow_megabytes:g} MB", Target("≥", 100, earlier=120), later(binary)),
        Task(speed, f"DataFlash wanted, {slow_megabytes:g} MB, first log of a process", None, first(binary)),
        Task(speed, f"DataFlash wanted, {names('.bin')}", Target("≥", 60), of_several(".bin")),
        Task(speed, f"tlog wanted, {slow_megabytes:g} MB", Target("≥", 60, earlier=100), later(telemetry)),
        Task(speed, f"tlog wanted, {slow_megabytes:g} MB, first log of a process", None, first(telemetry)),
        Task(speed, f"tlog wanted, {names('.tlog')}", None, of_several(".tlog")),
        Task(memory, "ULog, share of the file beside its own bytes", Target("≤", 1.0), share(ulog), True),
        Task(memory, "DataFlash, share of the file beside its own bytes", Target("≤", 1.0), share(binary)),
        Task(memory, "tlog, share of the file beside its own bytes", Target("≤", 1.0), share(telemetry)),
    ]


def readings(megabytes: float, slow_megabytes: float, corpus: Path | None, runs: int) -> Iterator[Reading]:
    """Every log of the table."""
    ulog = kept("px4_steps.ulg", megabytes)
    yield compared(ulog, False, runs)
    yield compared(ulog, True, runs)
    for path in real(corpus, ".ulg"):
        yield compared(path, False, runs)
    yield compared(kept("copter_steps_stabilize.bin", slow_megabytes), False, runs)
    for path in real(corpus, ".bin"):
        yield compared(path, False, runs)
    yield compared(kept("copter_steps_stabilize.tlog", slow_megabytes), False, runs)
    for path in real(corpus, ".tlog"):
        yield compared(path, False, runs)


def main(arguments: list[str] | None = None) -> list[Reading]:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--megabytes", type=float, default=60)
    parser.add_argument("--slow-megabytes", type=float, default=10)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--corpus")
    options = parser.parse_args(arguments)
    print(f"{'log':44}{'MB':>6} {'columns':8}{'ms':>8}{'peer ms':>9}{'faster':>8}{'first':>8}  peer")
    found = []
    for row in readings(options.megabytes, options.slow_megabytes, corpus_of(options.corpus), options.runs):
        found.append(row)
        print(
            f"{row.path.name:44}{row.path.stat().st_size / 1e6:6.1f} {'all' if row.everything else 'wanted':8}"
            f"{1e3 * median(row.later.ours):8.1f}{1e3 * median(row.later.peer):9.0f}{row.times_faster:8.1f}"
            f"{row.first_times_faster:8.1f}  {PEERS[row.path.suffix.lower()]}",
            flush=True,
        )
    return found


if __name__ == "__main__":
    main()
