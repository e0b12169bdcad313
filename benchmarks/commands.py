"""What whole commands cost, start-up and report included, against processes of the official libraries.

    python benchmarks/commands.py [--quick] [--runs 5] [--only TEXT]

CPU seconds of child processes, by turns, medians, warm caches unless said otherwise; ``analyze`` runs its default
filters. Logs of 60 MB are compared with the peer's reading alone, imports outside.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from statistics import median

from made_logs import SAMPLES, kept
from measured import AS_INSTALLED, ONE_THREAD, Child, Pair, by_turns, child
from table import Measured, Target, Task, as_text, of_pair, rows, seconds

PYTHON = [sys.executable, "-c"]
ATTLOG = [sys.executable, "-m", "attlog"]
TYPER = """
import typer
app = typer.Typer()
@app.command()
def one(): "First."
@app.command()
def two(): "Second."
app()
"""
LOAD = """
import sys, time
from pyulog import ULog
begin = time.process_time()
ULog(sys.argv[1])
print(time.process_time() - begin)
"""
SCAN = """
import sys, time
from pymavlink.DFReader import DFReader_binary
begin = time.process_time()
log = DFReader_binary(sys.argv[1])
while log.recv_msg() is not None:
    pass
print(time.process_time() - begin)
"""
"""Peers' reading; the last line printed is what it took without imports."""
ULOG2CSV = "import sys; sys.argv[0] = 'ulog2csv'; from pyulog.ulog2csv import main; main()"
MAVLOGDUMP = str(Path(sys.executable).with_name("mavlogdump.py"))
EIGHT = "gyro,complementary,mahony,madgwick,ekf12,mekf,vqf"
STEPS, TURNS = SAMPLES / "px4_steps.ulg", SAMPLES / "copter_yaw_turns.bin"
COMMANDS = ("info", "health", "analyze")
BATCH_S = 8 * 60 * 2 / 1000
"""CPU seconds for a small log if two cores shall have done a thousand in 8 minutes."""


def long_rest() -> Path:
    """60 MB in 11 min: rest and hover at 200 Hz, thickened to 0.1 MB of log in a second."""
    return kept("px4_hover.ulg", 60, mb_per_second=0.1)


def many_steps() -> Path:
    """60 MB with some 650 steps: 36 min at 250 Hz."""
    return kept("px4_steps.ulg", 60)


def sixty_binary() -> Path:
    """60 MB of DataFlash."""
    return kept("copter_yaw_turns.bin", 60)


def six_hours() -> Path:
    """Six hours at 25 Hz."""
    return kept("px4_hover.ulg", 143, imu_hz=25)


def command(name: str, log: Path, *more: str, environment: dict[str, str] | None = None) -> Child:
    """``attlog info``, ``health``, ``analyze`` or ``extract``; what it writes goes into a folder that is dropped."""
    with tempfile.TemporaryDirectory() as folder:
        output = ["-q", "-o", folder] if name in ("analyze", "extract") else []
        codes = (0, 1) if name == "health" else (0,)  # 1: a sensor is at fault
        return child([*ATTLOG, name, str(log), *output, *more], environment=environment, codes=codes)


def analyze(log: Path, *more: str, environment: dict[str, str] | None = None) -> Child:
    """One ``attlog analyze``."""
    return command("analyze", log, *more, environment=environment)


def whole(*words: str) -> Callable[[], float]:
    """CPU seconds of the whole process."""
    return lambda: child(list(words)).cpu_s


@cache
def warm() -> None:
    """Files in the page cache, loops compiled and kept."""
    for name in COMMANDS:
        command(name, STEPS)
        command(name, TURNS)


@cache
def against_process(name: str, log: Path, code: str, runs: int) -> Pair:
    """A command and a process that only reads, by turns."""
    warm()
    return by_turns(lambda: command(name, log).cpu_s, whole(*PYTHON, code, str(log)), runs)


@cache
def long_commands(make: Callable[[], Path], code: str) -> tuple[dict[str, Child], float]:
    """The three commands on a long log, and the CPU seconds in which the peer reads it: once each, or twice."""
    warm()
    log = make()
    log.read_bytes()
    read = [float(child([*PYTHON, code, str(log)]).output.split()[-1])]
    found = {name: command(name, log) for name in COMMANDS}
    read.append(float(child([*PYTHON, code, str(log)]).output.split()[-1]))
    return found, median(read)


def against_reading(name: str, make: Callable[[], Path], code: str, peer: str) -> Measured:
    """A command on a long log against its reading."""
    found, read = long_commands(make, code)
    return Measured(found[name].cpu_s / read, seconds(found[name].cpu_s), f"{peer} {seconds(read)}")


def memory(make: Callable[[], Path], code: str) -> Measured:
    """Most memory of its own while ``analyze`` runs."""
    return memory_of(long_commands(make, code)[0]["analyze"], make())


def memory_of(cost: Child, log: Path) -> Measured:
    """Most memory of a child's own."""
    words = f"log {log.stat().st_size / 1e6:.0f} MB, resident {cost.resident_mb:.0f} MB"
    return Measured(cost.anonymous_mb, f"{cost.anonymous_mb:.0f} MB", words)


def first_run() -> Measured:
    """``analyze`` of a small log by somebody who has never run it: no cache of any kind."""
    times = []
    for _ in range(2):
        with tempfile.TemporaryDirectory() as home:
            own = {name: home for name in ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "TMPDIR", "LOCALAPPDATA")}
            times.append(analyze(STEPS, environment=own).cpu_s)
    return Measured(median(times), seconds(median(times)), runs=len(times))


def headline(name: str, runs: int) -> Measured:
    """Time until title and headline, the first two lines, are out; the least of all runs, as other work delays it."""
    warm()
    titles, headlines = [], []
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            output = ["-o", folder] if name == "analyze" else []
            begin = time.monotonic()
            with subprocess.Popen(
                [*ATTLOG, name, str(STEPS), *output],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **ONE_THREAD, **AS_INSTALLED},
            ) as process:
                assert process.stdout is not None
                for times in (titles, headlines):
                    if not process.stdout.readline():
                        raise RuntimeError(f"attlog {name} ended without a headline")
                    times.append(time.monotonic() - begin)
                process.stdout.read()
                ended = time.monotonic() - begin
    return Measured(
        min(headlines), seconds(min(headlines)), f"title {seconds(min(titles))}, all {seconds(ended)}", runs
    )


def extracted(log: Callable[[], Path], messages: tuple[str, ...], peer: list[str], title: str, runs: int) -> Measured:
    """``extract`` to CSV against the official tool, whole processes."""

    def ours() -> float:
        return command("extract", log(), *messages).cpu_s

    def theirs() -> float:
        with tempfile.TemporaryDirectory() as folder:
            return child([word.format(log=log(), folder=folder) for word in peer]).cpu_s

    ours()
    return of_pair(by_turns(ours, theirs, runs), title)


def batch() -> Measured:
    """CPU seconds for each of 16 small logs, workers, index and start of the batch included."""
    warm()
    with tempfile.TemporaryDirectory() as folder:
        logs, count = Path(folder) / "logs", 4
        logs.mkdir()
        for i in range(count):
            for sample in (STEPS, SAMPLES / "px4_hover.ulg", TURNS, SAMPLES / "copter_steps_stabilize.tlog"):
                shutil.copy(sample, logs / f"{i}-{sample.name}")
        cost = child([*ATTLOG, "batch", str(logs), "-q", "-j", "2", "-o", str(Path(folder) / "out")], codes=(0, 1))
    each = cost.cpu_s / (4 * count)
    return Measured(each, seconds(each), f"{4 * count} logs, all processes {cost.anonymous_mb:.0f} MB")


@cache
def configurations(name: str, n: int) -> Child:
    """``n`` settings of a filter on a 10 MB log."""
    log = kept("px4_steps.ulg", 10)
    warm()
    settings = [f"mahony:kp={0.3 + 0.01 * i:.2f}" for i in range(n)]
    if name == "analyze":
        return analyze(log, "--estimators", ",".join(settings))
    with tempfile.TemporaryDirectory() as folder:
        return child([*ATTLOG, "compare", str(log), *settings, "-q", "-o", folder])


def one_more(name: str, of_memory: bool = False) -> Measured:
    """What each of ten further configurations adds."""
    few, many = configurations(name, 2), configurations(name, 12)
    if of_memory:
        more = (many.anonymous_mb - few.anonymous_mb) / 10
        return Measured(more, f"{more:.1f} MB", f"{few.anonymous_mb:.0f} MB with two")
    more = (many.cpu_s - few.cpu_s) / 10
    return Measured(more, seconds(more), f"{seconds(few.cpu_s)} with two")


@cache
def hours() -> Child:
    """``analyze`` of six hours."""
    warm()
    return analyze(six_hours())


def size_of_report() -> Measured:
    """The page of a small log with eight rows."""
    with tempfile.TemporaryDirectory() as folder:
        child([*ATTLOG, "analyze", str(STEPS), "-q", "-o", folder, "--estimators", EIGHT])
        size = next(Path(folder).glob("*.html")).stat().st_size / 1e6
    return Measured(size, f"{size:.2f} MB")


def tasks(runs: int = 5) -> list[Task]:
    """Every row about whole commands."""
    return [*_short(runs), *_long(), *_files_and_many(runs)]


def _short(runs: int) -> list[Task]:
    start, small = "Start", "A short log, whole processes"

    def help_() -> Measured:
        pair = by_turns(whole(*ATTLOG, "--help"), whole(*PYTHON, TYPER, "--help"), runs)
        return of_pair(pair, "typer")

    def row(name: str, log: Path, aim: float) -> Task:
        code, peer = (LOAD, "pyulog") if log.suffix == ".ulg" else (SCAN, "pymavlink scan")
        what = f"{name}, {log.stat().st_size / 1e6:.1f} MB {log.suffix}"
        return Task(small, what, Target("≤", aim), lambda: of_pair(against_process(name, log, code, runs), peer))

    def line(name: str) -> Task:
        return Task(start, f"headline of {name}, 2.6 MB .ulg", Target("≤", 0.5, "s"), lambda: headline(name, runs))

    return [
        Task(start, "attlog --help", Target("≤", 1.2), help_),
        line("health"),
        line("analyze"),
        Task(start, "attlog analyze, first run, empty cache", Target("≤", 3, "s"), first_run),
        row("info", STEPS, 2.5),
        row("health", STEPS, 2.5),
        row("analyze", STEPS, 5),
        row("info", TURNS, 2.5),
        row("health", TURNS, 2.5),
        row("analyze", TURNS, 5),
    ]


def _long() -> list[Task]:
    pace, group = "60 MB, against reading them", "Memory and long logs"

    def rows_of(what: str, make: Callable[[], Path], code: str, peer: str) -> list[Task]:
        def row(name: str) -> Task:
            return Task(
                pace, f"{name}, {what}", Target("≤", 2), lambda: against_reading(name, make, code, peer), large=True
            )

        return [row(name) for name in COMMANDS]

    return [
        *rows_of(".ulg, 11 min, no steps", long_rest, LOAD, "pyulog"),
        *rows_of(".ulg, 36 min, 650 steps", many_steps, LOAD, "pyulog"),
        *rows_of(".bin", sixty_binary, SCAN, "pymavlink scan"),
        Task(group, "60 MB .ulg, 11 min, most memory", Target("≤", 300, "MB"), lambda: memory(long_rest, LOAD), True),
        Task(
            group, "60 MB .ulg, 650 steps, most memory", Target("≤", 300, "MB"), lambda: memory(many_steps, LOAD), True
        ),
        Task(group, "6 h at 25 Hz, CPU seconds", Target("≤", 30, "s"), lambda: _seconds_of(hours()), True),
        Task(group, "6 h at 25 Hz, most memory", Target("≤", 400, "MB"), lambda: memory_of(hours(), six_hours()), True),
        Task(group, "report of eight rows, size", Target("≤", 3, "MB"), size_of_report),
    ]


def _seconds_of(cost: Child) -> Measured:
    return Measured(cost.cpu_s, seconds(cost.cpu_s))


def _files_and_many(runs: int) -> list[Task]:
    files, many = "extract to CSV, whole processes", "Many logs and configurations"
    to_csv, dump = (
        [*PYTHON, ULOG2CSV, "-o", "{folder}", "{log}"],
        [sys.executable, MAVLOGDUMP, "--format", "csv", "--types", "IMU", "{log}"],
    )

    def middle() -> Path:
        return kept("px4_steps.ulg", 6.5)

    def row(what: str, log: Callable[[], Path], messages: tuple[str, ...], peer: list[str], title: str) -> Task:
        return Task(files, what, Target("≤", 1), lambda: extracted(log, messages, peer, title, min(runs, 3)))

    limit = Target("≤", 0.08, "s")
    return [
        row("2.6 MB .ulg", lambda: STEPS, (), to_csv, "ulog2csv"),
        row("6.5 MB .ulg", middle, (), to_csv, "ulog2csv"),
        row("IMU of a 1.3 MB .bin", lambda: TURNS, ("IMU",), dump, "mavlogdump"),
        Task(many, "batch, a small log", Target("≤", BATCH_S, "s"), batch, True),
        Task(many, "one more configuration, analyze, 10 MB .ulg", limit, lambda: one_more("analyze")),
        Task(many, "one more configuration, analyze, memory", Target("≤", 5, "MB"), lambda: one_more("analyze", True)),
        Task(many, "one more configuration, compare, 10 MB .ulg", limit, lambda: one_more("compare")),
    ]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="no logs of 60 MB")
    parser.add_argument("--only", default="", help="rows whose group or name holds this")
    options = parser.parse_args(arguments)
    chosen = [t for t in tasks(options.runs) if options.only.lower() in f"{t.group} {t.what}".lower()]
    for row in rows(chosen, options.quick):
        print(as_text(row), flush=True)


if __name__ == "__main__":
    main()
