"""Rows that are one filter twice, in a sentence."""

from __future__ import annotations

from attlog.present.names import name_in_sentence
from attlog.present.numbers import listed
from attlog.result import Duplicates, Result


def alike(result: Result, equations: bool = True) -> list[str]:
    """A sentence for each group of rows that share an equation (unless left out) or their attitudes."""
    names = {row.name: name_in_sentence(row) for row in result.estimators}
    return [
        likeness_sentence(group, [names.get(row, row) for row in group.rows])
        for group in result.alike
        if equations or group.by == "attitudes"
    ]


def likeness_sentence(group: Duplicates, names: list[str]) -> str:
    """The sentence for one group."""
    which = listed(names)
    values = [f"{name} ({', '.join(_short(v) for v in own)})" for name, own in group.differ.items()]
    if group.by == "attitudes":
        but = f" in spite of {listed(values)}" if values else ""
        return f"{which} give the same attitudes in this log{but}: here they are one filter."
    differ = f" and differ in {listed(values)}" if values else ""
    return f"{which} share one equation ({group.source}){differ}."


def _short(value: float | str) -> str:
    return f"{value:g}" if isinstance(value, float | int) else str(value)
