"""``python -m tests.fuzz.campaign --seconds 600``: break logs, run attlog on them, keep what it did wrong.

Each trial takes a log, a kind of damage (bytes or columns), a seed and a command, and
runs attlog in a child process of its own with limits of time and memory. Seeds are
printed; a failing input is kept (bytes as a file; columns as log and seed) with what
attlog said. Logs: those of ATTLOG_CORPUS, else the samples.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

from tests.conftest import SAMPLES, corpus_root
from tests.fuzz.fields import swept
from tests.fuzz.mutate import mutated
from tests.fuzz.sensors import any_fault
from tests.fuzz.values import hostile

SUFFIXES = (".ulg", ".bin", ".tlog", ".log", ".px4log", ".mavlink")
COMMANDS = ("analyze", "analyze", "analyze", "analyze", "default", "report", "info", "extract")
KINDS = ("bytes", "columns", "sensors", "fields")
"""Broken bytes, broken columns of a sound file, whole sensors that fail as they do on vehicles, and each field that is
read with each value that no sensor gives."""
CODES = {
    "analyze": {0, 65, 66},
    "default": {0, 65, 66},
    "report": {0, 65, 66},
    "info": {0, 65, 66},
    "extract": {0, 2, 65, 66},
}
"""What each command may end with: done, nothing to analyse, no file to read; 2 where nothing is to extract."""
SECONDS, SECONDS_PER_MB = 20.0, 6.0
"""CPU time of a child: loading, kernels and a page, and time that grows with the log and not faster."""
MEGABYTES, MULTIPLE = 500.0, 60.0
"""Peak memory of a child beyond its parent: libraries, and so many times the log (columns as float64, six filters)."""
BUG = 70


@dataclass(frozen=True)
class Trial:
    """One run: everything that decides what happens."""

    log: Path
    kind: str
    seed: int
    command: str

    def __str__(self) -> str:
        return f"{self.log.name} {self.kind} {self.seed} {self.command}"


@dataclass(frozen=True)
class Outcome:
    """What became of it; ``faults`` is empty where attlog did well."""

    code: int
    faults: list[str]
    seconds: float
    megabytes: float


def logs(largest: int) -> list[Path]:
    """Every log in hand up to a size in bytes."""
    root = corpus_root()
    folders = (
        [SAMPLES]
        if root is None
        else [SAMPLES, root / "logs", root / "logs/cases", root / "sitl/px4", root / "sitl/ardupilot"]
    )
    found = [p for folder in folders if folder.is_dir() for p in sorted(folder.iterdir())]
    return [p for p in found if p.suffix.lower() in SUFFIXES and 0 < p.stat().st_size <= largest]


def trials(paths: Sequence[Path], seed: int, commands: Sequence[str] = COMMANDS) -> Iterator[Trial]:
    """Endless: logs by suffix in turn, so that no format is left out because it has few logs."""
    rng = random.Random(seed)
    by_suffix: dict[str, list[Path]] = {}
    for path in paths:
        by_suffix.setdefault(path.suffix.lower(), []).append(path)
    number = seed
    while True:
        for suffix in by_suffix:
            number += 1
            yield Trial(rng.choice(by_suffix[suffix]), rng.choice(KINDS), number, rng.choice(commands))


def with_flight(paths: Sequence[Path], folder: Path) -> list[Path]:
    """Four of each log that can be analysed when it is whole, one of the others: most trials should get far."""
    return [p for p in paths for _ in range(1 if run(Trial(p, "whole", 0, "analyze"), folder).code else 4)]


def run(trial: Trial, folder: Path) -> Outcome:
    """The trial in a child process, with limits."""
    path = trial.log
    if trial.kind == "bytes":
        path = folder / f"broken{trial.log.suffix}"
        path.write_bytes(mutated(trial.log.read_bytes(), trial.seed))
    megabytes = path.stat().st_size / 1e6
    allowed = SECONDS + SECONDS_PER_MB * megabytes
    told = folder / "told.txt"
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    child = os.fork()
    if child == 0:
        _child(trial, path, folder, told, allowed)
    _, status, usage = _waited(child, 4 * allowed)
    peak, spent = usage.ru_maxrss / 1024 - before, usage.ru_utime + usage.ru_stime
    said = told.read_text("utf-8", "replace") if told.is_file() else ""
    code = os.waitstatus_to_exitcode(status)
    faults = [line for line in said.splitlines() if line.startswith("FAULT ")]
    if code < 0:
        slow = code in (-signal.SIGXCPU, -signal.SIGKILL)
        faults.append(f"FAULT more than {allowed:.0f} s" if slow else f"FAULT {signal.Signals(-code).name}")
    elif code not in CODES[trial.command]:
        faults.append(f"FAULT exit code {code}: " + " | ".join(said.strip().splitlines()[-6:])[-900:])
    if spent > allowed:
        faults.append(f"FAULT {spent:.0f} s of CPU for {megabytes:.1f} MB")
    if peak > MEGABYTES + MULTIPLE * megabytes:
        faults.append(f"FAULT {peak:.0f} MB of memory for {megabytes:.1f} MB")
    return Outcome(code, faults, spent, peak)


def _waited(child: int, seconds: float) -> tuple[int, int, resource.struct_rusage]:
    """The end of a child; one that does nothing for too long is killed."""
    end = time.monotonic() + seconds
    while True:
        done = os.wait4(child, os.WNOHANG)
        if done[0]:
            return done
        if time.monotonic() > end:
            os.kill(child, signal.SIGKILL)
        time.sleep(0.005)


def _child(trial: Trial, path: Path, folder: Path, told: Path, seconds: float) -> None:
    """Run, tell into a file, and end with the exit code; never returns."""
    code = BUG
    try:
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
        with told.open("w", encoding="utf-8") as out, contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            try:
                code = _attempt(trial, path, folder, out)
            except BaseException:
                traceback.print_exc(file=out)
    finally:
        os._exit(code)


def _attempt(trial: Trial, path: Path, folder: Path, out: io.TextIOBase) -> int:
    from attlog import formats

    opened = formats.open
    change = {"columns": hostile, "sensors": any_fault, "fields": swept}.get(trial.kind)
    broken = opened if change is None else (lambda *a, **k: change(opened(*a, **k), trial.seed))
    output = tempfile.mkdtemp(dir=folder)
    with mock.patch.object(formats, "open", broken):
        code, documents = _commanded(trial.command, path, Path(output))
    if documents:
        from tests.fuzz.verdict import wrong

        for text in documents:
            for fault in wrong(text)[:5]:
                out.write(f"\nFAULT {fault}\n")
    return code


def _commanded(command: str, path: Path, output: Path) -> tuple[int, list[str]]:
    """Exit code, and the JSON texts of the results."""
    if command in ("analyze", "default"):
        from attlog import analysis
        from attlog.base import errors

        chosen = ["default"] if command == "default" else ["gyro", "mahony"]
        try:
            return 0, [analysis.evaluate(analysis.prepare(path), chosen).to_json()]
        except errors.AttlogError as error:
            print(error)
            return error.exit_code, []
    words = {
        "report": ["analyze", str(path), "-o", str(output), "--estimators", "gyro,mahony"],
        "info": ["info", "--json", str(path)],
        "extract": ["extract", str(path), "--streams", "-o", str(output)],
    }[command]
    from attlog.cli import main

    try:
        with mock.patch.object(sys, "argv", ["attlog", *words]):
            main()
        code = 0
    except SystemExit as stop:
        code = int(stop.code or 0)
    return code, [p.read_text("utf-8") for p in sorted(output.glob("*.json")) if command == "report"]


def keep(trial: Trial, outcome: Outcome, folder: Path, kept: Path) -> None:
    """A failing input for later: the bytes, or what makes them."""
    kept.mkdir(parents=True, exist_ok=True)
    name = f"{trial.command}-{trial.kind}-{trial.seed}"
    if trial.kind == "bytes":
        (kept / f"{name}{trial.log.suffix}").write_bytes((folder / f"broken{trial.log.suffix}").read_bytes())
    said = (folder / "told.txt").read_text("utf-8", "replace") if (folder / "told.txt").is_file() else ""
    head = {"log": str(trial.log), "kind": trial.kind, "seed": trial.seed, "command": trial.command}
    (kept / f"{name}.txt").write_text(json.dumps(head) + "\n" + "\n".join(outcome.faults) + "\n" + said)


def warm() -> None:
    """Load what every child needs, once."""
    from tests.fuzz import verdict

    os.environ.setdefault("ATTLOG_RAISE", "1")  # the last barrier would hide what this looks for
    _commanded("default", SAMPLES / "copter_yaw_turns.bin", Path())
    verdict.wrong("{}")


def main() -> int:
    """The campaign; 1 where anything failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--largest", type=float, default=4.0, help="MB of a log")
    parser.add_argument("--commands", default=",".join(COMMANDS))
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"))
    parser.add_argument("--again", type=Path, help="a .txt of an earlier failure")
    chosen = parser.parse_args()
    warm()
    if chosen.again:
        head = json.loads(chosen.again.read_text().splitlines()[0])
        todo: Iterator[Trial] = iter([Trial(Path(head["log"]), head["kind"], head["seed"], head["command"])])
    else:
        with tempfile.TemporaryDirectory() as name:
            paths = with_flight(logs(int(chosen.largest * 1e6)), Path(name))
        todo = trials(paths, chosen.seed, chosen.commands.split(","))
        print(f"seed {chosen.seed}, {chosen.seconds:.0f} s", flush=True)
    end, counts, failed = time.monotonic() + chosen.seconds, Counter[str](), 0
    for trial in todo:
        if time.monotonic() > end:
            break
        with tempfile.TemporaryDirectory() as name:
            outcome = run(trial, Path(name))
            counts[f"{trial.command} {outcome.code}"] += 1
            if sum(counts.values()) % 100 == 0:
                print(f"{sum(counts.values())} runs, {failed} failed, next is {trial.seed + 1}", flush=True)
            if outcome.faults:
                failed += 1
                print(trial, *outcome.faults, sep="\n  ", flush=True)
                keep(trial, outcome, Path(name), chosen.keep)
    print(f"{sum(counts.values())} runs, {failed} failed:", ", ".join(f"{k} {n}" for k, n in sorted(counts.items())))
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
