"""``attlog estimators``: which filters there are, and everything about one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from attlog.cli.common import NoColor, console

if TYPE_CHECKING:
    from attlog.estimators import Estimator

Name = Annotated[str | None, typer.Argument(metavar="[NAME|FILE.py]", help="Print all about this one.")]


def command(name: Name = None, no_color: NoColor = False) -> None:
    """List the filters, or print one filter's parameters and equations."""
    from attlog.estimators import get

    if name is None:
        _table()
    else:
        typer.echo(describe(get(name)))


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


def _table() -> None:
    """One row for each estimator; one that cannot be loaded is a row that says why."""
    from rich.table import Table

    from attlog.errors import AttlogError
    from attlog.estimators import DEFAULT, get, names

    table = Table(box=None, pad_edge=False, header_style="bold")
    for head in ("name", "what", "source", "needs", "uses", "presets"):
        table.add_column(head, overflow="fold")
    for name in names():
        try:
            e = get(name)
        except AttlogError as error:
            table.add_row(name, str(error), "", "", "", "")
            continue
        table.add_row(name, e.title, e.source, _sensors(e.needs), _sensors(e.uses - e.needs), ", ".join(e.presets))
    out = console()
    out.print(table)
    out.print(f"\ndefault: {', '.join(DEFAULT)}", soft_wrap=True)
    out.print("attlog estimators NAME prints parameters and equations; attlog new FILE.py starts a filter of your own.")


def _sensors(sensors: frozenset[str]) -> str:
    return ", ".join(s for s in ("gyro", "acc", "mag") if s in sensors)
