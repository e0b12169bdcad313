"""Where the CPU time of ``info``, ``health`` and ``analyze`` goes, by room of the package.

    python benchmarks/stages.py [LOG] [--runs 3]

A timer of the process's CPU time looks every 2 ms where the program is and books the time since it looked last:
to imports while one is under way, else to the innermost room of the package that a stage is made of. What passes before
and after (the interpreter's start and end) counts as imports. Long calls of machine code are booked as a whole when
they return.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from pathlib import Path
from statistics import mean

from commands import COMMANDS, PYTHON, STEPS, warm
from measured import child

STAGES = {
    "start, imports": (),
    "reading the log, sensors": ("formats", "flight"),
    "segments, reference": ("segments", "reference", "external"),
    "checks": ("health",),
    "filters": ("estimators",),
    "metrics, ranks": ("metrics",),
    "events, headline": ("story",),
    "page, JSON, text": ("report", "result", "words", "cli"),
}
"""Rooms of each stage; other rooms (core, pipeline) belong to the stage that calls them, else to the rest."""
REST = "the rest"
WATCHED = """
import json, signal, sys, time
from collections import Counter
stages, target = json.loads(sys.argv[1]), sys.argv[2]
of_room = {room: stage for stage, rooms in stages.items() for room in rooms}
found, last = Counter(), time.process_time()

def stage_of(frame):
    innermost = ""
    while frame is not None:
        name = frame.f_globals.get("__name__", "")
        if name == "importlib._bootstrap":
            return "start, imports"
        if not innermost and name.startswith("attlog."):
            innermost = of_room.get(name.split(".")[1], "")
        frame = frame.f_back
    return innermost or "the rest"

def look(_, frame):
    global last
    now = time.process_time()
    found[stage_of(frame)] += now - last
    last = now

signal.signal(signal.SIGPROF, look)
signal.setitimer(signal.ITIMER_PROF, 0.002, 0.002)
sys.argv = ["attlog", *sys.argv[3:]]
try:
    from attlog.__main__ import main
    main()
except SystemExit:
    pass
finally:
    signal.setitimer(signal.ITIMER_PROF, 0)
    open(target, "w").write(json.dumps(found))
"""


def shares(name: str, log: Path, runs: int = 3) -> dict[str, float]:
    """CPU seconds of a command by stage, means of some runs."""
    found: list[dict[str, float]] = []
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            target, output = Path(folder) / "stages", ["-q", "-o", folder] if name == "analyze" else []
            cost = child([*PYTHON, WATCHED, json.dumps(STAGES), str(target), name, str(log), *output], codes=(0, 1))
            booked = Counter(json.loads(target.read_text()))
        booked["start, imports"] += max(cost.cpu_s - sum(booked.values()), 0.0)
        found.append(booked)
    return {stage: mean(run.get(stage, 0.0) for run in found) for stage in [*STAGES, REST]}


def table(log: Path = STEPS, runs: int = 3) -> str:
    """The stages of all three commands, as a table of the docs."""
    warm()
    found = {name: shares(name, log, runs) for name in COMMANDS}
    lines = ["| stage | " + " | ".join(f"`{name}`" for name in COMMANDS) + " |", "| --- |" + " --- |" * len(COMMANDS)]
    for stage in [*STAGES, REST]:
        cells = [f"{found[name][stage]:.2f} s" if found[name][stage] >= 0.005 else "" for name in COMMANDS]
        lines.append(f"| {stage} | " + " | ".join(cells) + " |")
    lines.append("| together | " + " | ".join(f"{sum(found[name].values()):.2f} s" for name in COMMANDS) + " |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", nargs="?", type=Path, default=STEPS)
    parser.add_argument("--runs", type=int, default=3)
    options = parser.parse_args(arguments)
    print(table(options.log, options.runs))


if __name__ == "__main__":
    main()
