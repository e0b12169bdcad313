"""``attlog estimators``: which filters there are, and everything about one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from attlog.cli.shared import accuracy_table, completion
from attlog.cli.shared.printing import TextLine, columns, console, json_line, json_to_stdout, say, to_stdout

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
            json_to_stdout(json_line(document(one, strict=name is not None)))
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
    lines += ["", "Accuracy: RMSE in deg, mean over trials (95 %)", *accuracy_table.lines(estimator.name)]
    return "\n".join(lines)


def document(name: str, strict: bool = False) -> dict[str, Any]:
    """All about one filter as JSON; ``accuracy`` is null where none was measured.

    One that cannot be loaded has its ``error``, or raises it where ``strict``.
    """
    from attlog.base.errors import AttlogError
    from attlog.estimators import get
    from attlog.estimators.accuracy import measured

    try:
        e = get(name)
    except AttlogError as error:
        if strict:
            raise
        return {"name": name, "error": str(error)}
    sets = {key: asdict(one) for key, one in measured().get(e.name, {}).items()}
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
    from attlog.base.errors import AttlogError
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
    for row, laid in zip(rows, columns(rows, width, indent=""), strict=True):
        yield from (TextLine(line, "bold" if row[0] else "") for line in laid)
    yield TextLine("")
    yield from accuracy_table.table(found)
    yield TextLine("")
    yield TextLine(f"default: {', '.join(DEFAULT)}")
    yield TextLine(
        "attlog estimators NAME prints parameters and equations; attlog new FILE.py starts a filter of your own."
    )


def _sensors(sensors: frozenset[str]) -> str:
    known = ("gyro", "acc", "mag")
    return ", ".join([*(s for s in known if s in sensors), *sorted(sensors - set(known))])
