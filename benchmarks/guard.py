"""Fails when attlog got slower against a peer measured in the same minute than ``guard.toml`` allows.

    python benchmarks/guard.py [--only TEXT] [--write]

No timed test: CPU seconds of small works, ours and the peer's by turns, the smallest of each side, as a ratio. A ratio
above its limit by more than the margin is measured again, up to four times with all runs counted, so that a busy
machine does not fail it; what is still above then fails with exit code 1. ``--write`` puts what was measured into
``guard.toml`` as the new limits: after a change that is meant, in the same commit. About a minute.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import commands
import figures
import kernels
import readers
from made_logs import SAMPLES
from measured import Pair, apart, by_turns
from table import seconds

LIMITS = Path(__file__).with_name("guard.toml")
ROUNDS = 4
HEAD = """# What attlog's CPU time may be against a peer's in the same run (benchmarks/guard.py); written by --write.
# A ratio may lie above its limit by the margin (0.4: four tenths) before it fails.
"""
ULOG, DATAFLASH, TLOG = (SAMPLES / n for n in ("px4_steps.ulg", "copter_yaw_turns.bin", "copter_steps_stabilize.tlog"))


def processes(ours: list[str], theirs: list[str], runs: int = 3) -> Pair:
    """Two commands, after one run of each that warms caches."""
    commands.warm(ULOG)
    return by_turns(commands.whole(ours), commands.whole(theirs), runs)


def analyze(log: Path, code: str) -> Pair:
    """``analyze`` against a process that loads the log."""
    commands.warm(ULOG)
    theirs = commands.whole([*commands.PYTHON, code, str(log)])
    return by_turns(lambda: commands.analyze(log).cpu_s, theirs, 2)


def read(log: Path) -> Pair:
    """Wanted columns, kernels loaded, in a fresh process."""
    return readers.compared(log, False, runs=5).later


def update(name: str) -> Callable[[], Pair]:
    """Nanoseconds per update against package vqf."""

    def measure() -> Pair:
        found = apart(kernels.per_update, (name, "vqf"), 7)
        return Pair([1e-9 * x for x in found[name]], [1e-9 * x for x in found["vqf"]])

    return measure


WORKS: dict[str, Callable[[], Pair]] = {
    "attlog --help / typer": lambda: processes(
        [*commands.ATTLOG, "--help"], [*commands.PYTHON, commands.TYPER, "--help"]
    ),
    "attlog info / ulog_info": lambda: processes(
        [*commands.ATTLOG, "info", str(ULOG)], [*commands.PYTHON, commands.ULOG_INFO, str(ULOG)]
    ),
    "attlog analyze / pyulog": lambda: analyze(ULOG, commands.LOAD),
    "attlog analyze / pymavlink scan": lambda: analyze(DATAFLASH, commands.SCAN),
    "ULog / pyulog": lambda: read(ULOG),
    "DataFlash / pymavlink": lambda: read(DATAFLASH),
    "tlog / pymavlink": lambda: read(TLOG),
    "mahony / vqf": update("mahony"),
    "ekf12 / vqf": update("ekf12"),
    "eskf / vqf": update("eskf"),
    "figures / plotly": lambda: apart(figures.compared, 5),
}
"""One work of each kind; what is left of the slash is ours."""


def judged(name: str, allowed: float) -> Pair:
    """Runs of a work: more of them while the ratio of the smallest is above what is allowed."""
    pair = Pair()
    for _ in range(ROUNDS):
        more = WORKS[name]()
        pair.ours += more.ours
        pair.peer += more.peer
        if pair.best_ratio <= allowed:
            break
    return pair


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="works whose name holds this")
    parser.add_argument("--write", action="store_true", help="put what was measured into guard.toml")
    options = parser.parse_args(arguments)
    told = tomllib.loads(LIMITS.read_text(encoding="utf-8"))
    margin, limits = 1.0 + float(told["margin"]), {name: float(value) for name, value in told["ratios"].items()}
    slower = []
    for name in [name for name in WORKS if options.only.lower() in name.lower()]:
        limit = 0.0 if options.write else limits[name]
        pair = judged(name, limit * margin)
        worse = not options.write and bool(pair.best_ratio > limit * margin)
        slower += [name] * worse
        print(
            f"{name:34}{seconds(min(pair.ours)):>9}{seconds(min(pair.peer)):>9}{pair.best_ratio:9.3f}"
            f"  limit {limit:.3f} x {margin:g}  {'SLOWER' if worse else 'ok'}  [{len(pair.ours)}]",
            flush=True,
        )
        limits[name] = pair.best_ratio if options.write else limit
    if options.write:
        ratios = "".join(f'"{name}" = {limits[name]:.3g}\n' for name in WORKS)
        LIMITS.write_text(f"{HEAD}margin = {told['margin']}\n\n[ratios]\n{ratios}", encoding="utf-8")
    if slower:
        print(f"slower than committed by more than {told['margin']:.0%}: {', '.join(slower)}", file=sys.stderr)
    return 1 if slower else 0


if __name__ == "__main__":
    sys.exit(main())
