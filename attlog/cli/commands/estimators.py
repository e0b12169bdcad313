"""What filters need, how far they are from the truth on public data and what they cost: the table of the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog.cli import options
from attlog.cli.printing import TextLine, console, json_to_stdout, say, table, to_stdout
from attlog.estimators.accuracy import NOT_MEASURED, SETS, MeanRmse, read_accuracy

if TYPE_CHECKING:
    from attlog.estimators import Estimator


SHOWN = ("broad", "euroc", "simulated")
"""The sets that have a column; the others are in JSON and on the page of one filter."""
SENSORS = ("gyro", "acc", "mag")
NEEDED = (*SENSORS, "gnss")


def accuracy_lines(name: str) -> list[str]:
    """What was measured of a filter and its presets, a line for each set; that nothing was, where nothing was."""
    found = {row: sets for row, sets in read_accuracy().items() if row.partition("@")[0] == name}
    told = []
    for row, sets in found.items():
        for key, one in sets.items():
            angles = ", ".join(f"{angle} {_interval(rmse)}" for angle, rmse in one.rmse_deg.items())
            told.append(f"  {row}, {SETS[key]}, {one.trials} trials: {angles}; {one.ns:.0f} ns")
    return told or [f"  {NOT_MEASURED}"]


def accuracy_table(estimators: Sequence[Estimator]) -> Iterator[TextLine]:
    """What each needs, its mean errors on the sets and its cost, with what the columns are."""
    known = read_accuracy()
    rows = []
    for e in estimators:
        sets = known.get(e.name, {})
        cells = [sets[key].short() if key in sets else "-" for key in SHOWN] if sets else [NOT_MEASURED, "", ""]
        cost = next((f"{one.ns:.0f}" for one in sets.values()), "")
        rows.append([e.name, *cells, cost, _short_needs(e)])
    head = ["filter", *(f"{SETS[key]} °" for key in SHOWN), "ns", "needs (uses)"]
    yield from table(rows, head, left=(0, -1), indent="  ")
    every = [sets for name, sets in known.items() if "@" not in name]
    trials = ", ".join(str(max((s[key].trials for s in every if key in s), default=0)) for key in SHOWN)
    dated = sorted({(one.date, one.version) for sets in every for one in sets.values()})
    when = " to ".join(f"{version} ({day})" for day, version in dict.fromkeys([*dated[:1], *dated[-1:]]))
    yield TextLine(f"  Mean RMSE of {trials} trials: total/heading/tilt; EuRoC: tilt.")
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


# ``attlog estimators``: which filters there are, and everything about one.

Name = Annotated[
    str | None,
    typer.Argument(
        metavar="[NAME|FILE.py]",
        autocompletion=options.complete_filters,
        help="Print all about this filter. [default: list all]",
    ),
]


def command(
    name: Name = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print JSON on standard output, one line for each filter.")
    ] = False,
) -> None:
    """List the filters, or show one with its equations.

    The list says what each needs, its errors on public data and its cost.

    Example: attlog estimators mahony
    """
    from attlog.estimators import get, names

    if json:
        for one in names() if name is None else [name]:
            json_to_stdout(document(one, strict=name is not None))
    elif name is None:
        out = console()
        say(overview(out.width), out)
    else:
        to_stdout(describe(get(name)))


def describe(estimator: Estimator) -> str:
    """All about one estimator as plain text: title, equations, sensors, parameters, presets."""
    optional = estimator.uses - estimator.needs
    lines = [f"{estimator.name}: {estimator.title}", "", estimator.text.rstrip(), ""]
    lines.append(f"Source: {estimator.source}")
    lines.append(f"Needs: {_sensors(estimator.needs)}" + (f"; uses {_sensors(optional)} if there" if optional else ""))
    if not estimator.causal:
        lines.append("Looks ahead: its attitude at a time uses samples from later, which no autopilot can.")
    lines += ["", "Parameters"]
    for p in estimator.parameters:
        kind = " | ".join(p.choices) if p.choices else f"{p.low:g} to {p.high:g} {p.unit}".rstrip()
        default = p.default if p.choices else f"{p.default:g}"
        lines += [f"  {p.name} = {default}   ({kind})", f"      {p.meaning}", f"      default from: {p.source}"]
    if estimator.presets:
        lines += ["", "Presets"]
        for preset, values in estimator.presets.items():
            pairs = ", ".join(f"{k} {v:g}" if isinstance(v, float | int) else f"{k} {v}" for k, v in values.items())
            lines.append(f"  {estimator.name}@{preset}: {pairs}")
    lines += ["", "Accuracy: RMSE in deg, mean over trials (95 %)", *accuracy_lines(estimator.name)]
    return "\n".join(lines)


def document(name: str, strict: bool = False) -> dict[str, Any]:
    """All about one filter as JSON; ``accuracy`` is null where none was measured.

    One that cannot be loaded has its ``error``, or raises it where ``strict``.
    """
    from attlog.core.errors import AttlogError
    from attlog.estimators import get
    from attlog.estimators.accuracy import read_accuracy

    try:
        e = get(name)
    except AttlogError as error:
        if strict:
            raise
        return {"name": name, "error": str(error)}
    sets = {key: asdict(one) for key, one in read_accuracy().get(e.name, {}).items()}
    return {
        "name": e.name,
        "title": e.title,
        "source": e.source,
        "needs": sorted(e.needs),
        "uses": sorted(e.uses - e.needs),
        "presets": list(e.presets),
        "causal": e.causal,
        "accuracy": sets or None,
    }


def overview(width: int) -> Iterator[TextLine]:
    """Every estimator with source and presets, one that cannot be loaded with why; then needs, errors and cost."""
    from attlog.core.errors import AttlogError
    from attlog.estimators import DEFAULT, get, names

    rows: list[tuple[str, str]] = []
    found: list[Estimator] = []
    for name in names():
        try:
            e = get(name)
        except AttlogError as error:
            rows.append((name, str(error)))
            continue
        found.append(e)
        rows += [(name, e.title), ("", f"source: {e.source}")]
        rows += [("", f"presets: {', '.join(f'{name}@{p}' for p in e.presets)}")] if e.presets else []
    yield from table(rows, left=(0, -1), width=width, styles=["bold" if name else "" for name, _ in rows])
    yield TextLine("")
    yield from accuracy_table(found)
    yield TextLine("")
    yield TextLine(f"default: {', '.join(DEFAULT)}")
    yield TextLine(
        "attlog estimators NAME prints parameters and equations; attlog new FILE.py starts a filter of your own."
    )


def _sensors(sensors: frozenset[str]) -> str:
    known = ("gyro", "acc", "mag")
    return ", ".join([*(s for s in known if s in sensors), *sorted(sensors - set(known))])
