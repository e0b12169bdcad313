"""How fast attlog reads logs, against every other reader of the same format that is at hand.

    python benchmarks/readers.py [--runs 5] [--only TEXT] [--corpus DIR] [--peers PYTHON]

Each reader reads the same file in a process of its own, by turns, file in the page cache; CPU seconds, medians, the
fastest peer counts. *Reading*: further readings of a process, imports outside. *Whole process*: start, imports and one
reading. Peers are looked for beside ``--peers`` (default $ATTLOG_PEERS, else this Python), in an environment of their
own, because some bring half a web framework:

    python -m venv peers && peers/bin/pip install pyulog pymavlink ardupilot-mcp signalviewer mavparser
    peers/bin/pip install scikit-build-core pybind11 && peers/bin/pip install --no-build-isolation fasttlogparser

Peers read as they offer it: SignalViewer and fasttlogparser scaled to doubles or as stored, mavparser into a dictionary
for each record, ardupilot-mcp without the raw batches of the IMU. Those that cannot leave messages out read all.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from statistics import median

from made_logs import SAMPLES, kept
from measured import child
from table import Measured, Target, Task, as_text, rows, seconds

from attlog.formats import Messages

WANTED = {
    ".ulg": ["sensor_combined", "vehicle_magnetometer", "vehicle_attitude", "vehicle_gps_position"],
    ".bin": ["IMU", "MAG", "ATT", "GPS"],
    ".tlog": ["RAW_IMU", "ATTITUDE", "GPS_RAW_INT"],
}
"""What a replay reads: IMU, magnetometer, attitude and GNSS."""
SOURCES = {".ulg": "px4_steps.ulg", ".bin": "copter_yaw_turns.bin", ".tlog": "copter_steps_stabilize.tlog"}
TITLES = {".ulg": "ULog", ".bin": "DataFlash", ".tlog": "tlog"}
REAL = {
    ".ulg": ["logs/ulg_px4_1.15dev_cubeorange_quad_cut.ulg", "logs/ulg_px4_1.16_cuav7nano_quad_cut.ulg"],
    ".bin": ["logs/bin_copter_3.6.4_781s.bin", "logs/bin_copter_4.7dev_crash_isb_cut.bin"],
    ".tlog": ["logs/tlog_mav1_copter_3.5.7_radio_cut.tlog", "logs/tlog_mav2_sub_10hz_cut.tlog"],
}
"""Logs of a corpus that somebody flew, cut at record boundaries."""


@dataclass(frozen=True)
class Reader:
    """A package, and code that defines ``read(path, wanted)`` with it; logs beyond ``most_mb`` take it minutes."""

    name: str
    code: str
    most_mb: float = 100.0


OURS = Reader(
    "attlog",
    """
from attlog import formats
def read(path, wanted):
    log = formats.open(path)
    for (name, _), table in log.items():
        if wanted is None or name in wanted:
            for column in table.fields:
                table[column]
    return log
""",
)
SIGNALVIEWER = """
import signalviewer
def read(path, wanted):
    log = signalviewer.load(path)
    for name in log.signals:
        if wanted is None or name.split(".")[0].split("[")[0] in wanted:
            log.signal(name)
    return log
"""
PYMAVLINK = """
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega
def read(path, wanted):
    log = mavutil.mavlink_connection(path, dialect="ardupilotmega")
    while (message := log.recv_match(type=wanted)) is not None:
        message.to_dict()
"""
PEERS = {
    ".ulg": (
        Reader("pyulog", "from pyulog import ULog\ndef read(path, wanted):\n    return ULog(path, wanted)\n"),
        Reader("signalviewer", SIGNALVIEWER),
    ),
    ".bin": (
        Reader(
            "ardupilot-mcp",
            "from ardupilot_mcp.parser import parse_bin\ndef read(path, wanted):\n    return parse_bin(path)\n",
        ),
        Reader("signalviewer", SIGNALVIEWER),
        Reader("mavparser", "import mavparser\ndef read(path, wanted):\n    return mavparser.parse(path)\n"),
        Reader("pymavlink", PYMAVLINK, 3.0),
    ),
    ".tlog": (
        Reader(
            "fasttlogparser",
            "import fasttlogparser\ndef read(path, wanted):\n"
            "    return fasttlogparser.parseTLog(path, whitelist=wanted)\n",
        ),
        Reader("signalviewer", SIGNALVIEWER, 3.0),
        Reader("pymavlink", PYMAVLINK, 3.0),
    ),
}
TIMED = """
import contextlib, io, json, sys, time
path, wanted, runs = sys.argv[1], json.loads(sys.argv[2]), int(sys.argv[3])
times = []
with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    for _ in range(runs):
        begin = time.process_time()
        held = read(path, wanted)
        times.append(time.process_time() - begin)
        del held
print(*times)
"""


@dataclass
class Times:
    """CPU seconds of one reader: further readings, and processes that read once."""

    later: list[float] = field(default_factory=list)
    process: list[float] = field(default_factory=list)


def peers_python() -> str:
    """The Python beside which peers are installed."""
    return os.environ.get("ATTLOG_PEERS") or sys.executable


@cache
def peers_installed() -> dict[str, str]:
    """Version of each peer that is at hand."""
    names = sorted({reader.name for group in PEERS.values() for reader in group})
    code = f"""
import json
from importlib import metadata
found = {{}}
for name in {names!r}:
    try:
        found[name] = metadata.version(name)
    except metadata.PackageNotFoundError:
        pass
print(json.dumps(found))
"""
    found: dict[str, str] = json.loads(child([peers_python(), "-c", code]).output)
    return found


def peers_described() -> str:
    """Versions of the peers that are at hand, and which are not."""
    names = dict.fromkeys(reader.name for group in PEERS.values() for reader in group)
    return ", ".join(f"{name} {peers_installed().get(name, 'not installed')}" for name in names)


@cache
def compared(path: Path, everything: bool = True, runs: int = 5, most_s: float = 12.0) -> dict[str, Times]:
    """Times of attlog and of every peer at hand, none of one that fails; after ``most_s`` fewer turns than ``runs``."""
    names, size = None if everything else WANTED[path.suffix.lower()], path.stat().st_size / 1e6
    chosen = [r for r in PEERS[path.suffix.lower()] if r.name in peers_installed() and size <= r.most_mb]
    readers = [OURS, *chosen]
    found = {reader.name: Times() for reader in readers}
    path.read_bytes()  # the page cache
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as home:  # SignalViewer keeps an index there
        for turn in range(runs):
            for reader in readers[:: -1 if turn % 2 else 1]:
                if turn and not found[reader.name].process:
                    continue
                python = sys.executable if reader is OURS else peers_python()
                command = [python, "-c", reader.code + TIMED, str(path), json.dumps(names), "4"]
                try:
                    cost = child(command, environment={"HOME": home, **_cache_of_user()})
                except SystemExit:
                    if reader is OURS:
                        raise
                    continue  # a peer that fails on this log has no time
                _, *later = map(float, cost.output.split())
                found[reader.name].later += later
                found[reader.name].process.append(cost.cpu_s - sum(later))
            if (time.monotonic() - begin) * (turn + 2) / (turn + 1) > most_s:
                break
    return found


def _cache_of_user() -> dict[str, str]:
    """Where attlog looks for machine code that is kept, whatever HOME is."""
    return {"XDG_CACHE_HOME": os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")}


def judged(found: list[dict[str, Times]], which: str, suffix: str) -> Measured:
    """What attlog and the peers took for all these logs, against the fastest peer; peers that are missing."""
    took = {
        name: sum(median(getattr(log[name], which)) for log in found)
        for name in found[0]
        if all(name in log and log[name].process for log in found)
    }
    ours = took.pop(OURS.name)
    if not took:
        raise RuntimeError(f"no peer is installed beside {Path(peers_python()).name}")
    words = [f"{name} {seconds(x)}" for name, x in sorted(took.items(), key=lambda item: item[1])]
    words += [f"{name} fails" for name in found[0] if any(name in log and not log[name].process for log in found)]
    words += [f"{reader.name} not installed" for reader in PEERS[suffix] if reader.name not in peers_installed()]
    return Measured(min(took.values()) / ours, seconds(ours), ", ".join(words), len(found[0][OURS.name].process))


def columns(log: Messages, names: list[str] | None) -> None:
    """Decode every column of the wanted messages."""
    for (name, _), table in log.items():
        if names is None or name in names:
            for column in table.fields:
                table[column]


def real(corpus: Path | None, suffix: str) -> list[Path]:
    """The corpus's logs of a format, empty without a corpus."""
    return [corpus / name for name in REAL[suffix] if corpus and (corpus / name).is_file()]


def corpus_of(given: str | None) -> Path | None:
    """The folder of real logs, if one is given or named by the environment."""
    name = given or os.environ.get("ATTLOG_CORPUS")
    return Path(name) if name else None


AIM = Target("≥", 1.3)
GROUP = "Readers, against the fastest peer"


def tasks(runs: int = 5, corpus: Path | None = None) -> list[Task]:
    """Every row about readers."""
    return [task for suffix in TITLES for task in tasks_of(suffix, runs, corpus)]


def tasks_of(suffix: str, runs: int, corpus: Path | None) -> list[Task]:
    """The rows of a format."""
    sample, flown = SAMPLES / SOURCES[suffix], real(corpus, suffix)

    def row(
        what: str, logs: Callable[[], list[Path]], which: str = "later", everything: bool = True, large: bool = False
    ) -> Task:
        return Task(
            GROUP,
            f"{TITLES[suffix]}, {what}",
            AIM,
            lambda: judged([compared(log, everything, runs) for log in logs()], which, suffix),
            large,
        )

    def short() -> list[Path]:
        return [sample]

    def ten() -> list[Path]:
        return [kept(sample.name, 10)]

    def sixty() -> list[Path]:
        return [kept(sample.name, 60)]

    size = f"{sample.stat().st_size / 1e6:.1f} MB"
    return [
        row(size, short),
        row("10 MB", ten),
        row("60 MB", sixty, large=True),
        row("60 MB, messages of a replay", sixty, everything=False, large=True),
        *([row(f"{len(flown)} real logs, 0.5 to 1 MB", lambda: flown)] if flown else []),
        row(f"{size}, whole process", short, "process"),
        row("10 MB, whole process", ten, "process"),
    ]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--only", default="", help="rows whose name holds this")
    parser.add_argument("--corpus")
    parser.add_argument("--peers", help="a Python beside which peers are installed")
    options = parser.parse_args(arguments)
    os.environ.update({"ATTLOG_PEERS": options.peers} if options.peers else {})
    chosen = [t for t in tasks(options.runs, corpus_of(options.corpus)) if options.only.lower() in t.what.lower()]
    for row in rows(chosen, False):
        print(as_text(row), flush=True)


if __name__ == "__main__":
    main()
