"""``attlog estimators``: which filters there are, and everything about one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from attlog.cli.shared import completion
from attlog.cli.shared.printing import TextLine, columns, console, say, to_stdout

if TYPE_CHECKING:
    from attlog.estimators import Estimator

Name = Annotated[
    str | None,
    typer.Argument(
        metavar="[NAME|FILE.py]",
        autocompletion=completion.filters,
        help="Print all about this filter. [default: list all]",
    ),
]


def command(name: Name = None) -> None:
    """List the filters, or show one with its equations.

    Example: attlog estimators mahony
    """
    from attlog.estimators import get

    if name is None:
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
    return "\n".join(lines)


def overview(width: int) -> Iterator[TextLine]:
    """Every estimator with source, sensors and presets; one that cannot be loaded says why."""
    from attlog.base.errors import AttlogError
    from attlog.estimators import DEFAULT, get, names

    rows: list[tuple[str, str]] = []
    for name in names():
        try:
            e = get(name)
        except AttlogError as error:
            rows.append((name, str(error)))
            continue
        optional = e.uses - e.needs
        rows += [
            (name, e.title),
            ("", f"needs {_sensors(e.needs)}" + (f"; uses {_sensors(optional)} if there" if optional else "")),
            ("", f"source: {e.source}"),
        ]
        rows += [("", f"presets: {', '.join(f'{name}@{p}' for p in e.presets)}")] if e.presets else []
    for row, laid in zip(rows, columns(rows, width, indent=""), strict=True):
        yield from (TextLine(line, "bold" if row[0] else "") for line in laid)
    yield TextLine("")
    yield TextLine(f"default: {', '.join(DEFAULT)}")
    yield TextLine(
        "attlog estimators NAME prints parameters and equations; attlog new FILE.py starts a filter of your own."
    )


def _sensors(sensors: frozenset[str]) -> str:
    known = ("gyro", "acc", "mag")
    return ", ".join([*(s for s in known if s in sensors), *sorted(sensors - set(known))])
