"""How often each check and each question about a sensor fires on the corpus: logs on which it answers, warns, or finds
a fault, and what is offered to be set.

    python benchmarks/firing.py [--corpus DIR] [--list NAME] [--questions | --events]

Real logs (``logs/``) and simulated flights (``sitl/``) are counted apart; logs that were made or damaged on purpose
(``made_``, ``hostile/``) are left out. Checks see no logged truth; questions (``--questions``) do, as in ``attlog
health``; ``--events`` counts what the story names instead, by kind of event. ``--list`` prints each firing of one name
with its sentence, to be read against the raw data; with ``--list settings`` what is offered.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path

from attlog import flight, segments, story
from attlog.core.errors import AttlogError
from attlog.health import run_checks
from attlog.health.check import HealthCase, agreed_settings
from attlog.pipeline.evaluation import health

SETS = ("logs", "sitl")
BAD = ("warning", "fault")
SUFFIXES = (".ulg", ".bin", ".log", ".tlog")
Fired = tuple[str, str, str]
"""Name, verdict, sentence."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", default=os.environ.get("ATTLOG_CORPUS", ""))
    parser.add_argument("--list", default="", help="print the firings of this check or question")
    parser.add_argument("--questions", action="store_true", help="questions about sensors instead of checks")
    parser.add_argument("--events", action="store_true", help="events of the story instead of checks")
    given = parser.parse_args()
    ask = asked if given.questions else happened if given.events else checked
    counted: dict[str, dict[str, Counter[str]]] = defaultdict(lambda: {name: Counter() for name in SETS})
    logs: Counter[str] = Counter()
    for which in SETS:
        for path in sorted((Path(given.corpus) / which).rglob("*")):
            if path.suffix.lower() not in SUFFIXES or path.name.startswith("made_"):
                continue
            try:
                found = list(ask(path))
            except AttlogError:
                continue
            logs[which] += 1
            for name, verdict, sentence in found:
                if name == given.list and verdict in (*BAD, "set"):
                    print(f"{path.name}: {verdict}: {sentence}")
            for name, verdict in worst(found).items():
                counted[name][which][verdict] += 1
    print(f"| name | fires on {logs['logs']} real logs, of answered | on {logs['sitl']} simulated, of answered |")
    print("| --- | --- | --- |")
    for name, sets in sorted(counted.items()):
        cells = [f"{sum(c[v] for v in (*BAD, 'set'))} of {c.total() - c['unknown']}" for c in sets.values()]
        print(f"| `{name}` | {cells[0]} | {cells[1]} |")


def checked(path: Path) -> Iterator[Fired]:
    """The checks of one log, its truth taken away."""
    log = flight.read(path)
    log.truth = None
    for check in run_checks(HealthCase(log, segments.build(log) if log.imus else None)):
        yield check.question, check.verdict, check.text


def asked(path: Path) -> Iterator[Fired]:
    """What the questions about the sensors of one log say, and as ``settings`` what they offer."""
    told = health(path).checks
    for one in told:
        yield one.question, one.verdict, f"{one.sensor}: {one.text} {one.why_no_setting}".strip()
    offers = ", ".join(f"{s.name} {s.old} -> {s.new:.7g}" for s in agreed_settings(told))
    yield "settings", "set" if offers else "ok", offers


def happened(path: Path) -> Iterator[Fired]:
    """The events of one log by kind, its truth taken away; every kind answers."""
    log = flight.read(path)
    log.truth = None
    told = story.events(log, segments.build(log))
    for kind in story.KINDS:
        yield kind, "ok", ""
    for event in told:
        yield event.kind, "fault" if event.severity in ("serious", "warning") else "ok", event.text


def worst(found: list[Fired]) -> dict[str, str]:
    """Of each name the worst verdict, so that a log with three sensors counts once."""
    order = ("unknown", "ok", "set", *BAD)
    told: dict[str, str] = {}
    for name, verdict, _ in found:
        told[name] = max(told.get(name, "unknown"), verdict, key=lambda v: order.index(v) if v in order else 0)
    return told


if __name__ == "__main__":
    main()
