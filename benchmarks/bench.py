"""Every aim about speed and memory with its verdict, as one table: what attlog takes, what the peer takes, the ratio.

    python benchmarks/bench.py [--quick] [--runs 5] [--minutes 30] [--only TEXT] [--corpus DIR]
        [--peers PYTHON] [--page docs/speed.md]

Runs on a clean clone: long logs are made from ``sample_logs`` and kept in the temporary folder; real logs come from
``--corpus`` (default $ATTLOG_CORPUS), readers to compare with from the environment of ``--peers`` (``readers.py`` says
how it is made; default $ATTLOG_PEERS), where there are some. Some ten minutes on a quiet machine with two cores,
``--quick`` (no logs of 60 MB) four. ``--page`` also writes the page of the docs.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

import commands
import kernels
import readers
import stages
from machine import described, load
from table import Row, Task, as_markdown, as_text, rows

PAGE = Path(__file__).with_name("speed_page.md")
"""The words around the tables: how to read them, what is cold and what is warm."""


def tasks(runs: int, corpus: Path | None) -> list[Task]:
    """Every row, in the order of the page."""
    return [*commands.tasks(runs), *readers.tasks(runs, corpus), *kernels.tasks()]


def page(found: list[Row], machine: list[tuple[str, str]], where: str) -> str:
    """The page of the docs."""
    table = "\n".join(f"| {name} | {value} |" for name, value in machine)
    text = PAGE.read_text(encoding="utf-8")
    return text.format(machine=table, count=counted(found), tables=as_markdown(found), stages=where)


def counted(found: list[Row]) -> str:
    """How many aims were met, missed, not measured."""
    aimed = [row for row in found if row.task.target is not None]
    missed = sum(row.missed for row in aimed)
    without = sum(row.measured is None for row in aimed)
    return f"{len(aimed)} aims: {len(aimed) - missed - without} met, {missed} missed, {without} not measured."


def main(arguments: list[str] | None = None) -> list[Row]:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="no logs of 60 MB")
    parser.add_argument("--minutes", type=float, default=30, help="rows after that are not measured")
    parser.add_argument("--corpus")
    parser.add_argument("--only", default="", help="rows whose group or name holds this")
    parser.add_argument("--peers", help="a Python beside which other readers are installed")
    parser.add_argument("--page", type=Path, help="write the page of the docs")
    options = parser.parse_args(arguments)
    os.environ.update({"ATTLOG_PEERS": options.peers} if options.peers else {})
    before, begin = load(), time.monotonic()
    chosen = tasks(3 if options.quick else options.runs, readers.corpus_of(options.corpus))
    group, found = "", []
    chosen = [t for t in chosen if options.only.lower() in f"{t.group} {t.what}".lower()]
    for row in rows(sorted(chosen, key=lambda t: t.large), options.quick, options.minutes):  # small ones first
        if row.task.group != group:
            group = row.task.group
            print(f"\n{group}", flush=True)
        print(as_text(row), flush=True)
        found.append(row)
    found.sort(key=lambda row: chosen.index(row.task))
    where = "" if options.only else stages.table()
    minutes = (time.monotonic() - begin) / 60
    machine = [
        *described(),
        ("readers", readers.peers_described()),
        ("load", f"{before} before, {load()} after {minutes:.0f} min (1, 5, 15 min)"),
    ]
    print("\n" + "\n".join(f"{name}: {value}" for name, value in machine) + "\n" + counted(found) + "\n\n" + where)
    if options.page:
        options.page.write_text(page(found, machine, where), encoding="utf-8")
    return found


if __name__ == "__main__":
    main()
