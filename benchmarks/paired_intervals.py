"""Do paired intervals hold? Over halves of the simulated flights with truth, and over halves of the set of flights.

    python benchmarks/paired_intervals.py FOLDER_WITH_FLIGHTS

For each flight, question and pair of configurations the common units are cut into two halves: the first and the
second (time order), every other one, and at random. Each half has a difference and an interval; the true difference
is the same in both, so that their difference must lie within the root of the sum of both half widths squared: 95 %
if the intervals are right. The same for the mean over flights: halves of the set of flights, at random.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.compare import paired
from attlog.compare.comparison import select_questions
from attlog.compare.filter_input import ConfiguredFilter
from attlog.compare.paired import estimate_difference
from attlog.compare.run import answer_place
from attlog.compare.setting import parse_configuration
from attlog.core.errors import AttlogError
from attlog.metrics.statistics import UnitValues
from attlog.pipeline import evaluate, prepare

Index = NDArray[np.int64]
FIRST = "mahony:kp=0.6"
OTHERS = ("mahony:kp=0.3", "mahony:kp=1.1", "madgwick", "vqf", "ekf12", "complementary@fan", "mahony:kp=0.6,lowpass=20")
LEAST = {"log_variance": 8, "mean_square": 8, "slope_group": 8, "lag_event": 8, "step_event": 14}
"""Fewer common units make no halves."""
DRAWS, SETS = 10, 200


def units_of(flight: Path) -> dict[tuple[str, str], UnitValues]:
    """The units of evidence of a flight by question and configuration."""
    result = evaluate(prepare(flight), [ConfiguredFilter(parse_configuration(text)) for text in (FIRST, *OTHERS)])
    rows = [row for row in result.estimators if row.kind == "replay" and row.status == "ok"]
    found = {}
    for question in select_questions():
        metric, window = answer_place(question, rows)
        for row in rows:
            answer = row.metrics.get(window, {}).get(metric)
            if answer is not None and answer.ranked and answer.units is not None:
                found[question.id, row.name] = answer.units
    return found


def halves(n: int, rng: np.random.Generator) -> Iterator[tuple[str, Index, Index]]:
    """Two halves of n units, in several ways."""
    whole = np.arange(n)
    yield "first and second half", whole[: n // 2], whole[n // 2 : 2 * (n // 2)]
    yield "every other unit", whole[::2], whole[1::2]
    for _ in range(DRAWS):
        drawn = rng.permutation(n)
        yield "at random", np.sort(drawn[: n // 2]), np.sort(drawn[n // 2 : 2 * (n // 2)])


def within(flights: dict[str, dict[tuple[str, str], UnitValues]]) -> None:
    """Halves of each flight."""
    rng, held = np.random.default_rng(0), defaultdict(list)
    for units in flights.values():
        for (question, name), b in units.items():
            a = units.get((question, FIRST))
            if a is None or name == FIRST:
                continue
            common = np.intersect1d(a.ids, b.ids)
            if len(common) < LEAST[a.kind]:
                continue
            for way, i, j in halves(len(common), rng):
                one, two = (estimate_difference(a, b, common[k]) for k in (i, j))
                if one.ci95 is None or two.ci95 is None:
                    continue
                width = math.hypot(one.ci95[1] - one.value, two.ci95[1] - two.value)
                inside = abs(one.value - two.value) <= width
                held[f"{way:22} {question.partition('@')[0]}"].append(inside)
                held[f"{way:22} all"].append(inside)
    for key in sorted(held):
        print(f"{key:60} {len(held[key]):6} {100.0 * float(np.mean(held[key])):6.1f} %")


def over(flights: dict[str, dict[tuple[str, str], UnitValues]]) -> None:
    """Halves of the set of flights: the pooled interval of one against the mean of the other."""
    rng, held = np.random.default_rng(0), defaultdict(list)
    for question in (q.id for q in select_questions()):
        for name in OTHERS:
            differences = []
            for units in flights.values():
                a, b = units.get((question, FIRST)), units.get((question, name))
                if a is None or b is None:
                    continue
                common = np.intersect1d(a.ids, b.ids)
                if len(common) >= LEAST[a.kind] // 2:
                    differences.append(estimate_difference(a, b, common))
            if len(differences) < 8:
                continue
            for _ in range(SETS):
                drawn = rng.permutation(len(differences))
                one, two = (
                    paired.pool_values([differences[k].value for k in some], [differences[k].error for k in some])
                    for some in (drawn[: len(drawn) // 2], drawn[len(drawn) // 2 :])
                )
                if one.ci95 is None or two.ci95 is None:
                    continue
                width = math.hypot(one.ci95[1] - one.value, two.ci95[1] - two.value)
                held[question.partition("@")[0]].append(abs(one.value - two.value) <= width)
                held["all"].append(abs(one.value - two.value) <= width)
    for key in sorted(held):
        print(f"{'over flights':22} {key:37} {len(held[key]):6} {100.0 * float(np.mean(held[key])):6.1f} %")


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER_WITH_FLIGHTS")
    folder = parser.parse_args(arguments).folder
    flights = {}
    for flight in sorted(p for p in folder.rglob("*") if p.suffix in (".ulg", ".bin")):
        try:
            flights[flight.name] = units_of(flight)
        except AttlogError as error:
            print(f"{flight}: {error}", file=sys.stderr)
    print(f"{len(flights)} flights; interval of one half against the difference of the other, nominal 95 %")
    within(flights)
    over(flights)


if __name__ == "__main__":
    main()
