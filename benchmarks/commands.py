"""What whole commands cost, start-up and report included, against processes of the official libraries.

    python benchmarks/commands.py [--quick] [--runs 5]

CPU seconds of child processes, by turns, medians, warm caches unless said otherwise. ``analyze`` runs its default
filters. Where the peer is a library call, its imports are left out; "process" counts them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from statistics import median

from made_logs import SAMPLES, kept
from measured import Child, Pair, by_turns, child
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
ULOG_INFO = "import sys; sys.argv[0] = 'ulog_info'; from pyulog.info import main; main()"
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
"""Peers' work, imports outside; the last line printed is what the work took."""
SIX = "gyro,mahony,madgwick,ekf12,mekf,vqf"
EIGHT = "gyro,complementary,mahony,madgwick,ekf12,mekf,vqf"
STEPS, HOVER = SAMPLES / "px4_steps.ulg", SAMPLES / "px4_hover.ulg"
GROUPS = ("Start", "analyze", "Many configurations", "Memory and long logs")


def bench() -> Path:
    """60 MB in 11 min: rest and hover at 200 Hz, thickened to 0.1 MB of log in a second."""
    return kept("px4_hover.ulg", 60, mb_per_second=0.1)


def many_steps() -> Path:
    """60 MB with some 650 steps: 36 min at 250 Hz."""
    return kept("px4_steps.ulg", 60)


def dense() -> Path:
    """60 MB in under 3 min."""
    return kept("px4_hover.ulg", 60, mb_per_second=0.35)


def six_hours() -> Path:
    """Six hours at 25 Hz."""
    return kept("px4_hover.ulg", 143, imu_hz=25)


def analyze(log: Path, *more: str, environment: dict[str, str] | None = None) -> Child:
    """One ``attlog analyze`` into a folder that is dropped."""
    with tempfile.TemporaryDirectory() as folder:
        return child([*ATTLOG, "analyze", str(log), "-q", "-o", folder, *more], environment=environment)


def whole(command: list[str]) -> Callable[[], float]:
    """CPU seconds of the whole process."""
    return lambda: child(command).cpu_s


def inside(code: str, log: Path) -> Callable[[], float]:
    """What the peer's code says that its work took."""
    return lambda: float(child([*PYTHON, code, str(log)]).output.split()[-1])


@cache
def warm(log: Path) -> None:
    """Files in the page cache, kernels compiled and kept."""
    log.read_bytes()
    analyze(STEPS)
    child([*ATTLOG, "info", str(STEPS)])


@cache
def analyzed(log: Path, code: str, runs: int) -> Pair:
    """``analyze`` and the peer's work by turns."""
    warm(STEPS)
    log.read_bytes()
    return by_turns(lambda: analyze(log).cpu_s, inside(code, log), runs)


def against(make: Callable[[], Path], code: str, peer: str, runs: int) -> Callable[[], Measured]:
    """``analyze`` of a log that may have to be made first."""
    return lambda: of_pair(analyzed(make(), code, runs), peer)


def first_run() -> Measured:
    """``analyze`` of a small log by somebody who has never run it: no cache of any kind."""
    times = []
    for _ in range(2):
        with tempfile.TemporaryDirectory() as home:
            own = {name: home for name in ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "TMPDIR", "LOCALAPPDATA")}
            times.append(analyze(STEPS, environment=own).cpu_s)
    return Measured(median(times), seconds(median(times)), runs=len(times))


@cache
def configurations(command: str, n: int) -> Child:
    """``n`` settings of a filter on a 10 MB log."""
    log = kept("px4_steps.ulg", 10)
    warm(STEPS)
    settings = [f"mahony:kp={0.3 + 0.01 * i:.2f}" for i in range(n)]
    if command == "analyze":
        return analyze(log, "--estimators", ",".join(settings))
    with tempfile.TemporaryDirectory() as folder:
        return child([*ATTLOG, "compare", str(log), *settings, "-q", "-o", folder])


def one_more(command: str, memory: bool) -> Measured:
    """What each of ten further configurations adds."""
    few, many = configurations(command, 2), configurations(command, 12)
    if memory:
        more = (many.anonymous_mb - few.anonymous_mb) / 10
        return Measured(more, f"{more:.1f} MB", f"{few.anonymous_mb:.0f} MB with two")
    more = (many.cpu_s - few.cpu_s) / 10
    return Measured(more, seconds(more), f"{seconds(few.cpu_s)} with two")


def fifty() -> Measured:
    """The whole command with 50 settings."""
    took = configurations("compare", 50).cpu_s
    return Measured(took, seconds(took))


@cache
def long_run(make: Callable[[], Path], estimators: str) -> tuple[Child, Path]:
    """One analysis with what it cost."""
    log = make()
    warm(STEPS)
    return analyze(log, *(["--estimators", estimators] if estimators else [])), log


def memory_of(make: Callable[[], Path], estimators: str) -> Measured:
    """Most memory of its own while it runs."""
    cost, log = long_run(make, estimators)
    size = log.stat().st_size / 1e6
    return Measured(
        cost.anonymous_mb, f"{cost.anonymous_mb:.0f} MB", f"log {size:.0f} MB, resident {cost.resident_mb:.0f} MB"
    )


def time_of(make: Callable[[], Path], estimators: str) -> Measured:
    """CPU seconds of it."""
    cost, _ = long_run(make, estimators)
    return Measured(cost.cpu_s, seconds(cost.cpu_s))


def size_of_report() -> Measured:
    """The page of a small log with eight rows."""
    with tempfile.TemporaryDirectory() as folder:
        child([*ATTLOG, "analyze", str(STEPS), "-q", "-o", folder, "--estimators", EIGHT])
        size = next(Path(folder).glob("*.html")).stat().st_size / 1e6
    return Measured(size, f"{size:.2f} MB")


def tasks(runs: int = 5) -> list[Task]:
    """Every row about whole commands."""
    start, analysis, many, long = GROUPS

    def small(name: str) -> Callable[[], Path]:
        return lambda: SAMPLES / name

    def turns(ours: list[str], theirs: list[str], peer: str) -> Callable[[], Measured]:
        def measure() -> Measured:
            warm(STEPS)
            return of_pair(by_turns(whole(ours), whole(theirs), runs), peer)

        return measure

    def cost() -> Measured:
        pair = analyzed(STEPS, LOAD, runs)
        return Measured(median(pair.ours), seconds(median(pair.ours)), runs=len(pair.ours))

    def process() -> Measured:
        warm(STEPS)
        return of_pair(
            by_turns(lambda: analyze(STEPS).cpu_s, whole([*PYTHON, LOAD, str(STEPS)]), runs), "pyulog process"
        )

    def double() -> Path:
        return kept("copter_yaw_turns.bin", 2.6)

    def four() -> Path:
        return kept("copter_yaw_turns.bin", 4)

    def sixty() -> Path:
        return kept("copter_yaw_turns.bin", 60)

    return [
        Task(start, "attlog --help", Target("≤", 1.2), turns([*ATTLOG, "--help"], [*PYTHON, TYPER, "--help"], "typer")),
        Task(
            start,
            "attlog info, 2.6 MB .ulg",
            Target("≤", 1.2, earlier=1 / 1.2),
            turns([*ATTLOG, "info", str(STEPS)], [*PYTHON, ULOG_INFO, str(STEPS)], "ulog_info"),
        ),
        Task(start, "attlog analyze, first run, empty cache", Target("≤", 3, "s"), first_run),
        Task(analysis, "2.6 MB .ulg, CPU seconds", Target("≤", 1.0, "s"), cost),
        Task(analysis, "2.6 MB .ulg", Target("≤", 5), process),
        Task(
            analysis,
            "2.6 MB .ulg, imports of the peer left out",
            Target("≤", 5),
            against(lambda: STEPS, LOAD, "pyulog", runs),
        ),
        Task(
            analysis,
            "60 MB .ulg, 11 min, no steps",
            Target("≤", 4, earlier=1 / 1.2),
            against(bench, LOAD, "pyulog", runs),
            True,
        ),
        Task(
            analysis, "60 MB .ulg, 36 min, 650 steps", Target("≤", 6), against(many_steps, LOAD, "pyulog", runs), True
        ),
        Task(analysis, "60 MB .ulg, dense, 3 min", Target("≤", 2), against(dense, LOAD, "pyulog", runs), True),
        Task(
            analysis,
            "1.3 MB .bin",
            Target("≤", 3),
            against(small("copter_yaw_turns.bin"), SCAN, "pymavlink scan", runs),
        ),
        Task(analysis, "2.6 MB .bin", Target("≤", 3), against(double, SCAN, "pymavlink scan", runs)),
        Task(analysis, "4 MB .bin", Target("≤", 1.5), against(four, SCAN, "pymavlink scan", runs)),
        Task(analysis, "60 MB .bin", Target("≤", 0.5), against(sixty, SCAN, "pymavlink scan", runs), True),
        Task(
            many,
            "one more configuration, analyze, 10 MB .ulg",
            Target("≤", 0.08, "s"),
            lambda: one_more("analyze", False),
        ),
        Task(many, "one more configuration, analyze, memory", Target("≤", 5, "MB"), lambda: one_more("analyze", True)),
        Task(
            many,
            "one more configuration, compare, 10 MB .ulg",
            Target("≤", 0.08, "s"),
            lambda: one_more("compare", False),
        ),
        Task(many, "one more configuration, compare, memory", Target("≤", 5, "MB"), lambda: one_more("compare", True)),
        Task(many, "50 configurations, compare, 10 MB .ulg", Target("≤", 5, "s"), fifty, True),
        Task(long, "60 MB .ulg, six rows, most memory", Target("≤", 300, "MB"), lambda: memory_of(bench, SIX), True),
        Task(
            long,
            "60 MB .ulg, 650 steps, six rows, most memory",
            Target("≤", 300, "MB"),
            lambda: memory_of(many_steps, SIX),
            True,
        ),
        Task(long, "6 h at 25 Hz, CPU seconds", Target("≤", 30, "s"), lambda: time_of(six_hours, ""), True),
        Task(long, "6 h at 25 Hz, most memory", Target("≤", 400, "MB"), lambda: memory_of(six_hours, ""), True),
        Task(long, "report of eight rows, size", Target("≤", 3, "MB"), size_of_report),
    ]


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="no logs of 60 MB")
    options = parser.parse_args(arguments)
    for row in rows(tasks(options.runs), options.quick):
        print(as_text(row), flush=True)


if __name__ == "__main__":
    main()
