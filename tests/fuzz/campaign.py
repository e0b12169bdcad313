"""What must hold of every result, whatever the log: sound JSON and no number outside physics that nothing marks."""

from __future__ import annotations

import argparse
import contextlib
import functools
import io
import itertools
import json
import math
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
from typing import Any
from unittest import mock

import numpy as np

from attlog.core.limits import LAST_TIME_US
from attlog.flight import limits
from attlog.result.document import complete_answers
from attlog.result.schema import schema
from tests.conftest import SAMPLES, corpus_root
from tests.fuzz.mutate import mutated
from tests.fuzz.values import any_fault, hostile

DAY_S = limits.MAX_LOG_S
BY_UNIT = {
    "deg": 720.0,
    "rad": 4 * math.pi,
    "deg/s": 6000.0,
    "rad/s": 110.0,
    "m/s^2": 4000.0,
    "uT": 1e4,
    "T": 1e-2,
    "Hz": limits.RAW_HZ,
    "s": DAY_S,
    "ms": 1e3 * DAY_S,
    "1": 1e6,
    "%": 1e6,
    "deg/min": 1e6,
    "m": 2e5,
    "m/s": 3e3,
}
"""Largest sizes that a number in a unit may have in a result."""
BY_NAME = {
    "rate_hz": (0.0, limits.RAW_HZ),
    "lat": (-90.0, 90.0),
    "lon": (-180.0, 180.0),
    "delay_ms": (0.0, 1000.0),
    "alt_m": (limits.HEIGHT.low, limits.HEIGHT.high),
    "duration_s": (0.0, DAY_S),
    "t": (-DAY_S, DAY_S),
    "t0": (-DAY_S, DAY_S),
    "t1": (-DAY_S, DAY_S),
    "t0_us": (0.0, LAST_TIME_US),
    "seconds": (0.0, DAY_S),
    "utc_offset": (-LAST_TIME_US * 1e-6, limits.UTC_US.high * 1e-6),
    "scoring_start_s": (-DAY_S, DAY_S),
    "floor_deg": (0.0, 180.0),
    "earth_turn_deg_per_min": (-1.0, 1.0),
    "start_s": (-DAY_S, DAY_S),
}
UNKNOWN = ("params", "params_changed", "detail", "config", "timing", "count", "size", "offset", "boot", "ns_per_update")
"""What may be any number: what the vehicle was set to is shown as it is, counts and places depend on the file."""
LARGEST = 1e9
IN_UNIT = ("value", "each", "floor", "ci95", "disagree", "changes")
"""What of an answer is in its unit: ends of intervals are numbers that people read, too."""


def wrong(text: str) -> list[str]:
    """Everything that is wrong with the JSON text of a result, with the place; empty for a sound one."""
    try:
        document = json.loads(text, parse_constant=_refused)
    except ValueError as error:
        return [f"no JSON: {error}"]
    found = [f"schema: {e.json_path}: {e.message[:200]}" for e in _validator().iter_errors(document)]
    complete_answers(document)
    return found + list(unphysical(document))


def unphysical(value: Any, path: str = "", name: str = "", unit: str = "") -> Iterator[str]:
    """Places of numbers that no flight has."""
    if name in UNKNOWN:
        return
    if isinstance(value, dict):
        own = str(value.get("unit", ""))
        for key, inner in value.items():
            yield from unphysical(inner, f"{path}.{key}", key, own if key in IN_UNIT else "")
        yield from _interval(value, path)
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from unphysical(inner, f"{path}[{k}]", name, unit)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        size = BY_UNIT.get(unit, LARGEST)
        low, high = BY_NAME.get(name, (-size, size))
        if not low <= value <= high:
            yield f"{path} = {value:g} {unit}"


def _interval(answer: dict[str, Any], path: str) -> Iterator[str]:
    """What is wrong with the interval of an answer: it holds the value, in order, and rests on something."""
    value, ci95 = answer.get("value"), answer.get("ci95")
    if isinstance(value, int | float) and isinstance(ci95, list) and len(ci95) == 2:
        slack = 1e-9 * max(1.0, abs(value))
        if not ci95[0] - slack <= value <= ci95[1] + slack:
            yield f"{path}: {value:g} outside its interval {ci95[0]:g} to {ci95[1]:g}"
        if answer.get("n") == 0:
            yield f"{path}: an interval from nothing"


@functools.cache
def _validator() -> Any:
    import jsonschema  # type: ignore[import-untyped]

    return jsonschema.Draft202012Validator(schema())


def _refused(word: str) -> float:
    raise ValueError(f"{word} in a result")


# ``python -m tests.fuzz.campaign --seconds 600``: break logs, run attlog on them, keep what it did wrong.
#
# Each trial takes a log, a kind of damage (bytes or columns), a seed and a command, and
# runs attlog in a child process of its own with limits of time and memory. Seeds are
# printed; a failing input is kept (bytes as a file; columns as log and seed) with what
# attlog said. Logs: those of ATTLOG_CORPUS, else the samples, and ROS 2 bags of a sample.
# ``--short 100 --commands read``: their first kilobytes through all readers, 50 a second, many to a process.

SUFFIXES = (".ulg", ".bin", ".tlog", ".log", ".mavlink", ".mcap", ".db3")
BAG_SAMPLE = "px4_hover.ulg"
BAG_TOPICS = (
    *("sensor_combined", "vehicle_attitude", "vehicle_magnetometer", "vehicle_local_position"),
    *("vehicle_land_detected", "vehicle_status", "actuator_motors", "sensor_gps", "vehicle_gps_position"),
)
"""What PX4's bridge publishes, of a sample."""
COMMANDS = ("analyze", "analyze", "analyze", "analyze", "default", "report", "info", "extract")
KINDS = ("bytes", "columns", "sensors")
"""Broken bytes, broken columns of a sound file, whole sensors that fail as they do on vehicles."""
CODES = {
    "analyze": {0, 65, 66},
    "default": {0, 65, 66},
    "report": {0, 65, 66},
    "info": {0, 65, 66},
    "extract": {0, 2, 65, 66},
    "read": {0, 2, 65, 66},
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


def bags(folder: Path, seconds: float) -> list[Path]:
    """Write a part of a sample as bags: plain, without checksums, in packed chunks, as SQLite."""
    from mcap.reader import make_reader
    from mcap.writer import CompressionType, Writer
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as BagWriter
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    from attlog import formats

    messages = formats.open(SAMPLES / BAG_SAMPLE)
    begin = int(messages["sensor_combined", 0]["timestamp"][0]) + int(1e6 * max(0.0, 30.0 - seconds))
    taken = {}
    for name in BAG_TOPICS:
        table = messages.first(name)
        if table is not None:
            rows = table.rows(np.abs(table["timestamp"].astype(np.int64) - begin - 5e5 * seconds) < 5e5 * seconds)
            numbers = [c for c in rows.fields if "[" not in c and "." not in c and not c.startswith("_")]
            taken[name, 0] = {c: rows[c] for c in numbers if rows[c].dtype.kind in "buif"}
    plain = folder / "plain.mcap"
    formats.write(plain, formats.Recording({key: own for key, own in taken.items() if len(own["timestamp"])}))
    with plain.open("rb") as file:
        stored = list(make_reader(file).iter_messages())
    for name, packed in (("unchecked", "NONE"), ("zstd", "ZSTD"), ("lz4", "LZ4")):
        with (folder / f"{name}.mcap").open("wb") as file:
            writer = Writer(file, 1 << 15, CompressionType[packed], enable_crcs=False)
            writer.start(profile="ros2", library="attlog")
            schemas = {s.id: writer.register_schema(s.name, s.encoding, s.data) for s, _, _ in stored if s}
            channels = {c.id: writer.register_channel(c.topic, "cdr", schemas[c.schema_id]) for _, c, _ in stored}
            for _, channel, m in stored:
                writer.add_message(channels[channel.id], m.log_time, m.data, m.publish_time, m.sequence)
            writer.finish()
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, definition in {s.name: s.data.decode() for s, _, _ in stored if s}.items():
        store.register(get_types_from_msg(definition, name))
    with BagWriter(folder / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        named = {c.topic: (c, s) for s, c, _ in stored if s}
        topics = {topic: bag.add_connection(topic, s.name, typestore=store) for topic, (_, s) in named.items()}
        for _, channel, m in stored:
            bag.write(topics[channel.topic], m.log_time, m.data)
    return [*sorted(folder.glob("*.mcap")), *sorted((folder / "bag").glob("*.db3"))]


def shortened(paths: Sequence[Path], size: int, folder: Path) -> list[Path]:
    """Write the beginnings of logs, each under a name of its own."""
    found = []
    for k, path in enumerate(paths):
        cut = folder / f"{k}-{path.name}"
        with path.open("rb") as file:
            cut.write_bytes(file.read(size))
        found.append(cut)
    return found


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
    path = _broken_file(trial, folder)
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


READ_TOGETHER = 100
"""Trials of readers in one process: a fork takes longer than a short log."""


def run_reads(todo: Sequence[Trial], folder: Path) -> Iterator[tuple[Trial, Outcome]]:
    """Trials of readers, many in one process; what ends the process is the fault of the trial under way."""
    rest = list(todo)
    while rest:
        told = folder / "reads.txt"
        told.write_text("")
        child = os.fork()
        if child == 0:
            _read_child(rest, folder, told)
        _, status, usage = _waited(child, 4.0 * SECONDS * len(rest))
        outcomes = [json.loads(line) for line in told.read_text("utf-8").splitlines()]
        for trial, (code, faults, seconds, megabytes) in zip(rest, outcomes, strict=False):
            yield trial, Outcome(code, faults, seconds, megabytes)
        rest = rest[len(outcomes) :]
        if rest:
            code = os.waitstatus_to_exitcode(status)
            yield rest.pop(0), Outcome(code, [f"FAULT the process ended with {code}"], usage.ru_utime, 0.0)


def _read_child(todo: Sequence[Trial], folder: Path, told: Path) -> None:
    """Run trials of readers one by one, a line of JSON each; never returns."""
    try:
        with told.open("a", encoding="utf-8") as lines, open(os.devnull, "w", encoding="utf-8") as silence:
            for trial in todo:
                path = _broken_file(trial, folder)
                allowed = SECONDS + SECONDS_PER_MB * path.stat().st_size / 1e6
                begin, held = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
                resource.setrlimit(resource.RLIMIT_CPU, (int(begin + allowed) + 1, resource.RLIM_INFINITY))
                code, faults = BUG, []
                with contextlib.redirect_stdout(silence), contextlib.redirect_stderr(silence):
                    try:
                        code = _attempt(trial, path, folder, silence)
                    except BaseException:
                        faults = ["FAULT " + " | ".join(traceback.format_exc().strip().splitlines()[-6:])[-900:]]
                spent = time.process_time() - begin
                grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - held
                if not faults and code not in CODES[trial.command]:
                    faults.append(f"FAULT exit code {code}")
                if spent > allowed:
                    faults.append(f"FAULT {spent:.0f} s of CPU")
                if grown > MEGABYTES + MULTIPLE * path.stat().st_size / 1e6:
                    faults.append(f"FAULT {grown:.0f} MB of memory")
                lines.write(json.dumps([code, faults, spent, grown]) + "\n")
                lines.flush()
    finally:
        os._exit(0)


def _broken_file(trial: Trial, folder: Path) -> Path:
    """Write the broken bytes of a trial, or return its log."""
    if trial.kind != "bytes":
        return trial.log
    path = folder / f"broken{trial.log.suffix}"
    path.write_bytes(mutated(trial.log.read_bytes(), trial.seed))
    return path


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
    change = {"columns": hostile, "sensors": any_fault}.get(trial.kind)
    broken = opened if change is None else (lambda *a, **k: change(opened(*a, **k), trial.seed))
    output = tempfile.mkdtemp(dir=folder)
    with mock.patch.object(formats, "open", broken):
        code, documents = _commanded(trial.command, path, Path(output))
    if documents:
        for text in documents:
            for fault in wrong(text)[:5]:
                out.write(f"\nFAULT {fault}\n")
    return code


def _commanded(command: str, path: Path, output: Path) -> tuple[int, list[str]]:
    """Exit code, and the JSON texts of the results."""
    if command in ("analyze", "default"):
        from attlog import pipeline
        from attlog.core import errors

        chosen = ["default"] if command == "default" else ["gyro", "mahony"]
        try:
            return 0, [pipeline.evaluate(pipeline.prepare(path), chosen).to_json()]
        except errors.AttlogError as error:
            print(error)
            return error.exit_code, []
    if command == "read":
        return _read_all(path), []
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


def _read_all(path: Path) -> int:
    """Decode every column of a log, then its flight and all signals."""
    from attlog import flight, formats
    from attlog.core import errors
    from attlog.flight.signals import Signals

    try:
        messages = formats.open(path)
        for table in messages.values():
            for name in list(table.fields):
                with contextlib.suppress(KeyError, ValueError):
                    table[name]
        messages.forget()
        log = flight.flight_in(messages)
        signals = Signals(log)
        for signal in signals.all:
            signals.read(signal.name)
    except errors.AttlogError as error:
        print(error)
        return error.exit_code
    return 0


def keep(trial: Trial, outcome: Outcome, folder: Path, kept: Path) -> None:
    """A failing input for later: the bytes, or what makes them."""
    kept.mkdir(parents=True, exist_ok=True)
    name = f"{trial.command}-{trial.kind}-{trial.seed}"
    if trial.kind == "bytes":
        (kept / f"{name}{trial.log.suffix}").write_bytes(_broken_file(trial, folder).read_bytes())
    said = (folder / "told.txt").read_text("utf-8", "replace") if (folder / "told.txt").is_file() else ""
    head = {"log": str(trial.log), "kind": trial.kind, "seed": trial.seed, "command": trial.command}
    (kept / f"{name}.txt").write_text(json.dumps(head) + "\n" + "\n".join(outcome.faults) + "\n" + said)


def warm() -> None:
    """Load what every child needs, once."""

    os.environ.setdefault("ATTLOG_RAISE", "1")  # the last barrier would hide what this looks for
    _commanded("default", SAMPLES / "copter_yaw_turns.bin", Path())
    wrong("{}")


def main() -> int:
    """The campaign; 1 where anything failed."""
    with contextlib.ExitStack() as stack:
        return _campaign(stack)


def _campaign(stack: contextlib.ExitStack) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--seed", type=int, default=int(time.time()))
    parser.add_argument("--largest", type=float, default=4.0, help="MB of a log")
    parser.add_argument("--short", type=float, default=0.0, help="kB of each log that are taken, 0 for all")
    parser.add_argument("--commands", default=",".join(COMMANDS))
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"))
    parser.add_argument("--again", type=Path, help="a .txt of an earlier failure")
    chosen = parser.parse_args()
    warm()
    if chosen.again:
        head = json.loads(chosen.again.read_text().splitlines()[0])
        todo: Iterator[Trial] = iter([Trial(Path(head["log"]), head["kind"], head["seed"], head["command"])])
    else:
        held = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        paths = logs(int(chosen.largest * 1e6)) if chosen.short == 0.0 else logs(1 << 62)
        if chosen.short:
            paths = [*shortened(paths, int(1e3 * chosen.short), held), *bags(held, 1.0)]
        else:
            with tempfile.TemporaryDirectory() as name:
                paths = with_flight([*paths, *bags(held, 20.0)], Path(name))
        todo = trials(paths, chosen.seed, chosen.commands.split(","))
        print(f"seed {chosen.seed}, {chosen.seconds:.0f} s", flush=True)
    end, counts, failed = time.monotonic() + chosen.seconds, Counter[str](), 0
    while some := list(itertools.islice(todo, READ_TOGETHER if chosen.commands == "read" else 1)):
        if time.monotonic() > end:
            break
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            together = run_reads(some, folder) if some[0].command == "read" else ((t, run(t, folder)) for t in some)
            for trial, outcome in together:
                counts[f"{trial.command} {outcome.code}"] += 1
                if sum(counts.values()) % 100 == 0:
                    print(f"{sum(counts.values())} runs, {failed} failed, next is {trial.seed + 1}", flush=True)
                if outcome.faults:
                    failed += 1
                    print(trial, *outcome.faults, sep="\n  ", flush=True)
                    keep(trial, outcome, folder, chosen.keep)
    print(f"{sum(counts.values())} runs, {failed} failed:", ", ".join(f"{k} {n}" for k, n in sorted(counts.items())))
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
