"""What filters need, how far they are from the truth on public data and what they cost: the table of the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from attlog.cli.shared.printing import TextLine, aligned
from attlog.estimators.accuracy import NOT_MEASURED, SETS, MeanRmse, measured

if TYPE_CHECKING:
    from attlog.estimators import Estimator

SHOWN = ("broad", "euroc", "simulated")
"""The sets that have a column; the others are in JSON and on the page of one filter."""
SENSORS = ("gyro", "acc", "mag")
NEEDED = (*SENSORS, "gnss")


def lines(name: str) -> list[str]:
    """What was measured of a filter and its presets, a line for each set; that nothing was, where nothing was."""
    found = {row: sets for row, sets in measured().items() if row.partition("@")[0] == name}
    told = []
    for row, sets in found.items():
        for key, one in sets.items():
            angles = ", ".join(f"{angle} {_interval(rmse)}" for angle, rmse in one.rmse_deg.items())
            told.append(f"  {row}, {SETS[key]}, {one.trials} trials: {angles}; {one.ns:.0f} ns")
    return told or [f"  {NOT_MEASURED}"]


def table(estimators: Sequence[Estimator]) -> Iterator[TextLine]:
    """What each needs, its mean errors on the sets and its cost, with what the columns are."""
    known = measured()
    rows = []
    for e in estimators:
        sets = known.get(e.name, {})
        cells = [sets[key].short() if key in sets else "-" for key in SHOWN] if sets else [NOT_MEASURED, "", ""]
        cost = next((f"{one.ns:.0f}" for one in sets.values()), "")
        rows.append([e.name, *cells, cost, _short_needs(e)])
    yield from aligned(["filter", *(f"{SETS[key]} °" for key in SHOWN), "ns", "needs (uses)"], rows)
    every = [sets for name, sets in known.items() if "@" not in name]
    trials = ", ".join(str(max((s[key].trials for s in every if key in s), default=0)) for key in SHOWN)
    dated = sorted({(one.date, one.version) for sets in every for one in sets.values()})
    when = " to ".join(f"{version} ({day})" for day, version in dict.fromkeys([*dated[:1], *dated[-1:]]))
    yield TextLine(f"  Mean RMSE of {trials} trials: total/heading/inclination; EuRoC: inclination.")
    yield TextLine(
        "  -: needs mag or gnss. aids: GNSS, barometer, airspeed, rest: of simulated flights. ns: per update."
    )
    yield TextLine(f"  Measured with attlog {when}.")
    yield TextLine("  Intervals: --json, or attlog estimators NAME.")


def _short_needs(e: Estimator) -> str:
    """The sensors that a filter needs, in brackets what it uses; the kinds of aids are not told apart."""
    more = [s for s in SENSORS if s in e.uses - e.needs] + ["aids"] * bool(e.uses - e.needs - set(SENSORS))
    return " ".join(s for s in NEEDED if s in e.needs) + (f" ({' '.join(more)})" if more else "")


def _interval(rmse: MeanRmse) -> str:
    between = "" if rmse.low is None or rmse.high is None else f" ({rmse.low:.3g} to {rmse.high:.3g})"
    return f"{rmse.value:.3g}{between}"
