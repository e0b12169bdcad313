"""How often each check fires on the corpus: logs on which it answers, warns, finds a fault, or cannot tell.

    python benchmarks/firing.py [--corpus DIR] [--list CHECK]

Real logs (``logs/``) and simulated flights (``sitl/``, the logged truth taken away) are counted apart; logs that were
made or damaged on purpose (``made_``, ``hostile/``) are left out. ``--list`` prints each firing of one check with its
sentence, to be read against the raw data. Nothing is kept between runs.
"""

from __future__ import annotations

import argparse
import os
from collections import Counter, defaultdict
from pathlib import Path

from attlog import flight, segments
from attlog.base.errors import AttlogError
from attlog.health import audit

SETS = ("logs", "sitl")
BAD = ("warning", "fault")
SUFFIXES = (".ulg", ".bin", ".log", ".tlog")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", default=os.environ.get("ATTLOG_CORPUS", ""))
    parser.add_argument("--list", default="", help="print the firings of this check")
    given = parser.parse_args()
    counted: dict[str, dict[str, Counter[str]]] = defaultdict(lambda: {name: Counter() for name in SETS})
    logs: Counter[str] = Counter()
    for which in SETS:
        for path in sorted((Path(given.corpus) / which).rglob("*")):
            if path.suffix.lower() not in SUFFIXES or path.name.startswith("made_"):
                continue
            try:
                log = flight.read(path)
            except AttlogError:
                continue
            log.truth = None
            logs[which] += 1
            for check in audit(log, segments.build(log) if log.imus else None):
                counted[check.name][which][check.verdict] += 1
                if check.name == given.list and check.verdict in BAD:
                    print(f"{path.name}: {check.verdict}: {check.text}")
    print(f"| check | fires on {logs['logs']} real logs, of answered | on {logs['sitl']} simulated, of answered |")
    print("| --- | --- | --- |")
    for name, sets in sorted(counted.items()):
        cells = [f"{sum(c[v] for v in BAD)} of {sum(c[v] for v in ('ok', *BAD))}" for c in sets.values()]
        print(f"| `{name}` | {cells[0]} | {cells[1]} |")


if __name__ == "__main__":
    main()
