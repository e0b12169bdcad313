"""Runs for long: does anything grow, does anything end?

    python benchmarks/soak.py [many|huge|hours|filters|all] [--analyses 1000] [--gigabytes 2] [--corpus DIR]

many      so many analyses in one process, sample logs and small logs of the corpus by turns, reports written: memory,
          file handles, threads, child processes, temporary files before and after, and the trends of memory and of
          Python's blocks with their intervals; nothing may grow once the first fifth has passed
huge      a log of two gigabytes, made by repetition: ``info``, and ``analyze`` with gyro and mahony
hours     six hours at 25 Hz, default filters
filters   twenty estimators at once on a sample log

Prints a line for each with the limit it was given; exit code 1 where one is broken.
"""

from __future__ import annotations

import argparse
import gc
import os
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import commands
from made_logs import SAMPLES, kept
from measured import anonymous_mb, child, children
from readers import corpus_of

SMALL, LOGS = 450_000, (".ulg", ".bin", ".log", ".tlog", ".mavlink")
"""Bytes and kinds of the corpus's logs that are taken."""
GROWTH_MB = 30.0
"""What a thousand analyses may add to the process: arenas of the allocator breathe by some MB."""
TREND_MB, TREND_BLOCKS = 10.0, 2000.0
"""What 1000 analyses may add beyond doubt, by the lower end of the interval: the whole memory wanders by tens of MB
with the allocator; blocks that Python holds (some 300,000) are counted to the last and tell what is kept for good."""
HUGE_MB_PER_GB, HUGE_S_PER_GB, INFO_S_PER_GB = 1500.0, 120.0, 15.0
HOURS_S, HOURS_MB = 30.0, 400.0
TWENTY = (
    "gyro,accel_mag,complementary,complementary@fan,variable_integral,mahony_passive,mahony_dcm,mahony,mahony@xu-0.6,"
    "mahony:kp=0.8,mahony_adaptive,madgwick,ekf12,mekf,px4_q,ap_dcm,vqf,vqf@package,eskf"
)


@dataclass(frozen=True)
class Seen:
    """One thing that was looked at, and what it may be."""

    what: str
    value: float
    limit: float
    unit: str

    def __str__(self) -> str:
        word = "ok" if self.value <= self.limit else "BROKEN"
        return f"{self.what:58}{self.value:10.1f} {self.unit:6} limit {self.limit:g}  {word}"


def many(analyses: int, corpus: Path | None) -> Iterator[Seen]:
    """Analyses by turns in this process; growth between the first fifth and the end, and the trend of memory there."""
    import attlog

    logs = sorted(p for p in SAMPLES.iterdir() if p.suffix in (".ulg", ".bin", ".tlog"))
    if corpus:
        found = sorted((corpus / "logs").iterdir())
        logs += [p for p in found if p.stat().st_size < SMALL and p.suffix.lower() in LOGS]
    temporary, ended = tempfile.mkdtemp(prefix="attlog-soak-"), 0
    tempfile.tempdir = temporary
    folder = Path(temporary) / "out"
    folder.mkdir()
    settled = max(analyses // 5, min(len(logs), analyses))
    first: dict[str, float] = {}
    memory: list[float] = []
    blocks: list[int] = []
    begin = time.process_time()
    for i in range(analyses):
        which = i % len(logs)
        try:
            # Every fourth log has the default filters.
            result = attlog.analyze(logs[which], {"estimators": ["gyro", "mahony"]} if which % 4 else None)
            result.to_html(folder / "page.html")
            del result
        except attlog.AttlogError:
            ended += 1
        memory.append(anonymous_mb())
        if which == len(logs) - 1:
            gc.collect()
            blocks.append(sys.getallocatedblocks())
        if i + 1 == settled:
            first = held(temporary)
        if (i + 1) % 50 == 0:
            now = ", ".join(f"{name} {value:.0f}" for name, value in held(temporary).items())
            print(f"  {i + 1} analyses, {ended} refused: {now}", flush=True)
    last = held(temporary)
    tempfile.tempdir = None
    shutil.rmtree(temporary)
    each = (time.process_time() - begin) / analyses
    print(f"  {each:.2f} s of CPU each, {len(logs)} logs, {ended} refused")
    rounds = [memory[at : at + len(logs)] for at in range(settled, analyses - len(logs) + 1, len(logs))]
    if len(rounds) > 2:
        low, high = trend([sum(each) / len(each) for each in rounds], 1000 / len(logs))
        print(f"  memory's trend over {len(rounds)} rounds of all logs: {low:+.1f} to {high:+.1f} MB in 1000 analyses")
        yield Seen("memory's trend, lower end, in 1000 analyses", low, TREND_MB, "MB")
        late = [float(each) for each in blocks[-len(rounds) :]]
        low, high = trend(late, 1000 / len(logs))
        print(f"  Python's blocks of memory, {late[-1]:.0f}: {low:+.0f} to {high:+.0f} in 1000 analyses")
        yield Seen("blocks' trend, lower end, in 1000 analyses", low, TREND_BLOCKS, "")
    yield Seen(f"{analyses} analyses, memory grown by", last["MB"] - first["MB"], GROWTH_MB, "MB")
    for name in ("handles", "threads", "children", "temporaries"):
        yield Seen(f"{analyses} analyses, {name} grown by", last[name] - first[name], 0.0, "")


def trend(means: list[float], steps: float) -> tuple[float, float]:
    """How much a series changes in so many of its steps: the 95 % interval of the straight line through it.

    Each value is a mean over one round of all logs: what a single log needs more than another has cancelled in it.
    """
    import numpy as np

    from attlog.metrics.statistics import student

    x = np.arange(len(means)) - (len(means) - 1) / 2
    y = np.array(means) - np.mean(means)
    slope = float(x @ y / (x @ x))
    off = y - slope * x
    wide = student(0.975, len(means) - 2) * float(np.sqrt(off @ off / (len(means) - 2) / (x @ x)))
    return steps * (slope - wide), steps * (slope + wide)


def held(temporary: str) -> dict[str, float]:
    """What the process holds now."""
    gc.collect()
    handles = Path("/proc/self/fd")
    return {
        "MB": anonymous_mb(),
        "handles": float(len(os.listdir(handles))) if handles.is_dir() else 0.0,
        "threads": float(threading.active_count()),
        "children": float(sum(1 for _ in children(os.getpid()))),
        "temporaries": float(len(os.listdir(temporary))),
    }


def huge(gigabytes: float) -> Iterator[Seen]:
    """A log of two gigabytes."""
    log = kept("px4_steps.ulg", 1000 * gigabytes)
    commands.warm()
    size = log.stat().st_size / 1e9
    told = child([*commands.ATTLOG, "info", str(log)])
    yield Seen(f"info of {size:.1f} GB, CPU", told.cpu_s, INFO_S_PER_GB * size, "s")
    yield Seen(f"info of {size:.1f} GB, memory of its own", told.anonymous_mb, HUGE_MB_PER_GB * size, "MB")
    cost = commands.analyze(log, "--estimators", "gyro,mahony")
    yield Seen(f"analyze of {size:.1f} GB with gyro, mahony, CPU", cost.cpu_s, HUGE_S_PER_GB * size, "s")
    yield Seen(f"analyze of {size:.1f} GB, memory of its own", cost.anonymous_mb, HUGE_MB_PER_GB * size, "MB")


def hours() -> Iterator[Seen]:
    """Six hours at 25 Hz with the default filters."""
    cost, log = commands.hours(), commands.six_hours()
    yield Seen(f"6 h at 25 Hz ({log.stat().st_size / 1e6:.0f} MB), CPU", cost.cpu_s, HOURS_S, "s")
    yield Seen("6 h at 25 Hz, memory of its own", cost.anonymous_mb, HOURS_MB, "MB")


def filters() -> Iterator[Seen]:
    """Twenty estimators on one log, all with a row."""
    import json

    with tempfile.TemporaryDirectory() as folder:
        cost = child([*commands.ATTLOG, "analyze", str(commands.STEPS), "-q", "-o", folder, "--estimators", TWENTY])
        document = json.loads(next(Path(folder).glob("*.json")).read_bytes())
        size = next(Path(folder).glob("*.html")).stat().st_size / 1e6
    bad = [row["name"] for row in document["estimators"] if row["kind"] == "replay" and row["status"] != "ok"]
    rows = [row for row in document["estimators"] if row["kind"] == "replay"]
    yield Seen(f"20 estimators, missing rows of {len(rows)}", float(20 - len(rows) + len(bad)), 0.0, "")
    yield Seen("20 estimators, CPU", cost.cpu_s, 20.0, "s")
    yield Seen("20 estimators, memory of its own", cost.anonymous_mb, 500.0, "MB")
    yield Seen("20 estimators, page", size, 5.0, "MB")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="?", default="all", choices=["many", "huge", "hours", "filters", "all"])
    parser.add_argument("--analyses", type=int, default=1000)
    parser.add_argument("--gigabytes", type=float, default=2.0)
    parser.add_argument("--corpus")
    options = parser.parse_args(arguments)
    works = {
        "filters": filters,
        "hours": hours,
        "huge": lambda: huge(options.gigabytes),
        "many": lambda: many(options.analyses, corpus_of(options.corpus)),
    }
    broken = False
    for name, work in works.items():
        if options.what in (name, "all"):
            for seen in work():
                print(seen, flush=True)
                broken |= not seen.value <= seen.limit
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
