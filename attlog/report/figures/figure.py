"""What figures are made of: places in the page, stored lines, dots with intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from attlog.present.numbers import interval, quantity
from attlog.report.pack import Store
from attlog.result import Answer, Trace


@dataclass(slots=True)
class PageFigure:
    """A place in the page: ``kind`` names the drawing function of the script, ``data`` is what it draws.

    ``words`` says for those who do not see it what it shows. ``views`` names what can be
    chosen in it: ``data["views"]`` holds as many, each laid over the rest of ``data``. Where
    ``data`` names rows as ``focus``, only they are drawn. ``bands`` are rows whose band can be chosen, by position and
    name; ``data["band"]`` is drawn first.
    """

    id: str
    kind: str
    title: str
    caption: str
    height: int
    data: dict[str, Any] = field(default_factory=dict)
    wide: bool = True
    words: str = ""
    views: list[str] = field(default_factory=list)
    bands: list[tuple[int, str]] = field(default_factory=list)


class Rows:
    """The rows of all figures: figures know them by their position, people by their name."""

    def __init__(self, called: Mapping[str, str]) -> None:
        """``called``: names by id, in the order of the page."""
        self.ids, self.called = list(called), list(called.values())

    def index(self, row: str) -> int:
        """The position of a row by its id."""
        return self.ids.index(row)

    def __contains__(self, row: str) -> bool:
        return row in self.ids

    def __getitem__(self, i: int) -> str:
        return self.called[i]


def series(
    traces: list[Trace], columns: tuple[str, ...], names: Rows, store: Store, step: float
) -> tuple[list[dict[str, Any]], float]:
    """Traces put into the store, and how many samples one stored sample stands for (1: all were kept)."""
    drawn = [
        {
            "r": names.index(trace.row),
            "k": trace.key,
            "ratio": round(trace.ratio, 2),
            **stored(trace, columns, store, step),
        }
        for trace in traces
    ]
    whole, kept = sum(len(t.t) * t.ratio for t in traces), sum(len(t.t) for t in traces)
    return drawn, whole / kept if kept else 1.0


def stored(trace: Trace, columns: tuple[str, ...], store: Store, step: float) -> dict[str, Any]:
    """Where times and columns of a trace stand in the store."""
    present = {c: np.asarray(trace.columns[c], np.float64) for c in columns if c in trace.columns}
    return {
        "t": store.times(np.asarray(trace.t, np.float64)),
        "y": {c: store.values(y, step) for c, y in present.items()},
    }


def reduction_text(ratio: float) -> str:
    """The sentence about reduction."""
    if ratio <= 1.005:
        return "Every sample is stored."
    return f"Stored: smallest and largest value of each interval, 1 in {ratio:.1f} samples; no peak is lost."


def reach(traces: list[Trace], names: Rows, unit: str = "deg") -> str:
    """What lines show in words: of each row and column the smallest and the largest value."""
    rows: dict[str, list[str]] = {}
    for trace in traces:
        for column, y in trace.columns.items():
            good = np.asarray(y, np.float64)[np.isfinite(y)]
            if len(good):
                ends = f"{quantity(float(good.min()), unit, False)} to {quantity(float(good.max()), unit, False)}"
                rows.setdefault(trace.row, []).append(f"{column} {ends}")
    return "; ".join(f"{names[names.index(row)]}: {', '.join(parts)}" for row, parts in rows.items())


def dots_text(dots: list[dict[str, Any]], names: Rows, unit: str) -> str:
    """What dots show in words: of each the row, where it was found, the value and its interval."""
    parts = []
    for d in dots:
        bounds = f" ({interval(d['ci'], unit)})" if d["ci"] else ""
        value = "not judged" if d["v"] is None else quantity(d["v"], unit) + bounds
        parts.append(f"{names[d['r']]}{' ' + d['where'] if 'where' in d else ''}: {value}")
    return "; ".join(parts)


def dot(r: int, found: Answer) -> dict[str, Any]:
    """A value with its interval as a figure draws it."""
    interval = [float(x) for x in found.ci95] if found.ci95 and all(map(number, found.ci95)) else None
    value = None if found.value is None else float(found.value)
    return {"r": r, "v": value, "ci": interval, "ok": found.ranked, "n": found.n}


def dot_height(dots: list[dict[str, Any]]) -> int:
    """Pixels for a figure with one line per row."""
    return 90 + 34 * max(len({d["r"] for d in dots}), 2)


def listed(y: Any) -> list[float | None]:
    """A short array as JSON numbers; what is not finite becomes null."""
    return [float(f"{v:.5g}") if math.isfinite(v) else None for v in np.asarray(y, np.float64).tolist()]


def number(x: Any) -> bool:
    """Whether x is a finite number."""
    return isinstance(x, (int, float, np.number)) and not isinstance(x, bool) and math.isfinite(x)
