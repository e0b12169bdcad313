"""Do the intervals of errors hold for every row? Simulated flights, with their truth and with it taken away.

    python benchmarks/error_intervals.py [--corpus DIR] [--flights GLOB] [--misses]

Each flight below ``sitl/`` of the corpus folder (default $ATTLOG_CORPUS) is compared with its truth, without it with
what an analysis would then choose. Per row, over tilt, heading and total error in the air:

- *holds*: without truth, the interval holds the value that truth gives for the same window;
- *halves, truth* and *halves, without*: the values of both halves of the flight differ by less than the root sum of
  squares of the sides of their intervals that face each other;
- *width*: the median width of the whole flight's interval over its value, with truth and without.

Rows that gravity does not correct are left out: their error grows with the flight. Last come the orders: pairs of rows
that differ significantly without truth, and how many of them truth has the other way round.
"""

from __future__ import annotations

import argparse
import fnmatch
import os
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from intervals import halves_of, meets

from attlog import flight, metrics, pipeline, reference
from attlog.flight.model import FlightLog
from attlog.metrics import Answer, Case, following, ranking
from attlog.metrics.accuracy import ERRORS
from attlog.metrics.statistics import Summary
from attlog.pipeline import replay
from attlog.reference.model import Track

METRICS = [m.name for q in ERRORS.values() for m in q.metrics]
FILTERS = ("default", "eskf", "mekf")
Table = dict[str, dict[str, dict[str, Answer]]]


class Side:
    """A flight seen with or without truth: its rows, and their errors in the air and in both halves of it."""

    def __init__(self, log: FlightLog, halves: tuple[str, ...] = ()) -> None:
        case: Case = pipeline.prepare(log)
        rows = [*replay.run_rows(case, FILTERS), *reference.onboard_rows(log, case.segments, case.reference)]
        self.case = case.with_rows(rows)
        self.rows: dict[str, Track] = {
            r.name: r for r in rows if not (r.is_reference or following.why_uncorrected(case, r))
        }
        self.halves = halves or halves_of(case)[:2]
        windows = ("airborne", *self.halves)
        self.table: Table = {n: metrics.compute(self.case, r, windows, only=METRICS) for n, r in self.rows.items()}
        metrics.finish(self.case, self.table, cost=False, only=METRICS)

    def answers(self, window: str, metric: str) -> dict[str, Answer]:
        """What the rows answer that have a value."""
        found = {n: t.get(window, {}).get(metric) for n, t in self.table.items()}
        return {n: a for n, a in found.items() if a is not None and a.value is not None}

    def significant(self, metric: str) -> list[tuple[str, str]]:
        """Pairs (better, worse) of rows in the air; the answers keep their values."""
        answers = self.answers("airborne", metric)
        copies = {n: replace(a) for n, a in answers.items() if ranking.may_be_best(self.rows[n])}
        return ranking.family(copies, "low").significant


def agree(early: Answer, late: Answer) -> bool:
    """Whether two halves say the same."""
    return meets(Summary(early.value or 0.0, early.ci95), Summary(late.value or 0.0, late.ci95))


def judge(name: str, truth: Side, blind: Side) -> Iterator[tuple[str, str, str, float, str]]:
    """Everything of one flight: statistic, row, what, whether it is so (or how wide), and the words for a miss."""
    for metric in METRICS:
        statistic = metric.split("_")[1]
        known, seen = truth.answers("airborne", metric), blind.answers("airborne", metric)
        for row, answer in seen.items():
            if row in known and answer.ci95 is not None:
                value = known[row].value or 0.0
                holds = answer.ci95[0] <= value <= answer.ci95[1]
                yield statistic, row, "holds", holds, f"{name} {metric} {answer.value} {answer.ci95} truth {value}"
        for what, side, whole in (("truth", truth, known), ("without", blind, seen)):
            for row, answer in whole.items():
                if answer.ci95 is not None and answer.value:
                    yield statistic, row, f"width {what}", (answer.ci95[1] - answer.ci95[0]) / answer.value, ""
            early, late = (side.answers(window, metric) for window in side.halves)
            for row in early.keys() & late.keys():
                a, b = early[row], late[row]
                if a.ci95 is not None and b.ci95 is not None:
                    words = f"{name} {metric} {a.value} {a.ci95} then {b.value} {b.ci95}"
                    yield statistic, row, f"halves {what}", agree(a, b), words
        if statistic == "rmse":
            for better, worse in blind.significant(metric):
                if better in known and worse in known:
                    right = (known[better].value or 0.0) <= (known[worse].value or 0.0)
                    yield "order", metric, "right", right, f"{name} {metric} {better} before {worse}"


def share(values: list[float]) -> str:
    """A share in percent with its count."""
    return f"{100 * np.mean(values):.0f} ({len(values)})" if values else "-"


def show(found: dict[tuple[str, str], dict[str, list[float]]]) -> None:
    """One table per statistic, then the orders."""
    for statistic in ("rmse", "p95"):
        print(f"\n| {statistic} | holds, % | halves, truth, % | halves, without, % | width, truth | width, without |")
        print("| --- | --- | --- | --- | --- | --- |")
        for (own, row), of in found.items():
            if own == statistic:
                shares = " | ".join(share(of[k]) for k in ("holds", "halves truth", "halves without"))
                widths = " | ".join(f"{np.median(of[f'width {k}'] or [np.nan]):.1f}" for k in ("truth", "without"))
                print(f"| `{row}` | {shares} | {widths} |")
    orders = Counter(
        {row: (len(of["right"]) - int(sum(of["right"]))) for (k, row), of in found.items() if k == "order"}
    )
    total = sum(len(of["right"]) for (k, _), of in found.items() if k == "order")
    print(f"\nsignificant pairs: {total}, wrong: {sum(orders.values())} {dict(orders)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", type=Path, default=os.environ.get("ATTLOG_CORPUS"), help="folder with the data")
    parser.add_argument("--flights", default="*", help="names of the flights, as a pattern")
    parser.add_argument("--misses", action="store_true", help="also every single miss")
    given = parser.parse_args()
    if given.corpus is None:
        print("error_intervals.py: skipped, needs the flights with truth (sitl/ below --corpus or ATTLOG_CORPUS)")
        return
    found: dict[tuple[str, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for path in sorted((Path(given.corpus) / "sitl").glob("*/*")):
        if path.suffix not in (".ulg", ".bin", ".tlog") or not fnmatch.fnmatch(path.name, given.flights):
            continue
        log = flight.read(path)
        truth = Side(log)
        if truth.case.reference.kind != "truth" or not truth.halves:
            continue
        for statistic, row, what, value, words in judge(path.name, truth, Side(replace(log, truth=None), truth.halves)):
            row = "onboard, others" if row.startswith("onboard:") else row
            found[statistic, row][what].append(value)
            if given.misses and words and not value:
                print(f"{what}: {row}: {words}")
    show(found)


if __name__ == "__main__":
    main()
