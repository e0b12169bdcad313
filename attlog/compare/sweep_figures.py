"""A sweep drawn: a heat map of the first two parameters, and a curve along each."""

from __future__ import annotations

import math
from collections.abc import Iterator
from html import escape
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.compare import svg
from attlog.compare.grid import Axis
from attlog.compare.sweep import Column, Sweep
from attlog.compare.sweep_words import beside_text, named, value_text
from attlog.present.numbers import number, quantity

Array = NDArray[np.float64]

DARKEST = 3.0
"""Cells three times as far from perfect as the best, and beyond, are the darkest."""
CELL, ROOM_LEFT, ROOM_BELOW = 54.0, 92.0, 46.0
WRITTEN = 16
"""Up to so many cells a side carry their number."""
WIDTH, HEIGHT = 560.0, 300.0


def figures(s: Sweep) -> Iterator[tuple[str, str]]:
    """(caption, SVG) of every figure, metric by metric."""
    free = [a for a in s.grid.axes if len(a.values) > 1]
    for column in (c for c in s.columns if c.single is not None):
        title = f"{column.metric.title} [{column.metric.unit}]"
        if len(free) > 1:
            others = [a.name for a in free[2:]]
            rest = f"; {', '.join(others)} each at its best" if others else ""
            caption = (
                f"{title} over {free[0].name} and {free[1].name}{rest}: the mean over the logs. Framed: the best; "
                "with a dot: cannot be told from it; grey: no value on every log."
            )
            yield caption, heat_map(s, column, free[1], free[0])
        for axis in free:
            rest = "" if len(free) == 1 else ", all others each at its best"
            lines = "; thin lines: each log" if len(s.logs) > 1 else ""
            caption = f"{title} along {axis.name}{rest}. Filled: cannot be told from the best{lines}."
            yield caption, curve(s, column, axis)


def heat_map(s: Sweep, c: Column, across: Axis, down: Axis) -> str:
    """Cells of two parameters; of settings that share both the best is shown."""
    size = max(14.0, min(CELL, 900.0 / max(len(across.values), len(down.values))))
    chosen = {
        (i, j): _best(
            c, [k for k in range(s.base) if s.settings[k][across.name] == x and s.settings[k][down.name] == y]
        )
        for i, x in enumerate(across.values)
        for j, y in enumerate(down.values)
    }
    lowest = float(np.nanmin(c.score[: s.base]))
    written = max(len(across.values), len(down.values)) <= WRITTEN
    near, parts = set(c.near), []
    for (i, j), k in chosen.items():
        x, y = ROOM_LEFT + i * size, 24.0 + (len(down.values) - 1 - j) * size
        value = math.nan if k is None else float(c.score[k])
        share = math.log(max(value, 1e-300) / max(lowest, 1e-300)) / math.log(DARKEST) if value > 0 else 0.0
        fill, ink = (svg.MISSING, svg.INK) if k is None or math.isnan(value) else svg.shade(share)
        words = "no value" if k is None else _words(s, c, k)
        parts.append(f"<g><title>{escape(words)}</title>{_square(x, y, size, fill)}")
        if written and not math.isnan(value):
            parts.append(
                svg.text(
                    x + size / 2, y + size / 2 + 4, number(value, c.metric.unit, False), fill=ink, more="font-size='11'"
                )
            )
        if k in near:
            parts.append(
                f"<circle cx='{x + 6:.1f}' cy='{y + 6:.1f}' r='2.5' fill='{svg.MARK if k == c.single else ink}'/>"
            )
        parts.append("</g>")
    for (i, j), k in chosen.items():
        if k is not None and k == c.single:
            x, y = ROOM_LEFT + i * size, 24.0 + (len(down.values) - 1 - j) * size
            parts.append(_square(x, y, size, "none", f"stroke='{svg.MARK}' stroke-width='2.5'"))
    bottom = 24.0 + len(down.values) * size
    parts += [
        _label(ROOM_LEFT + (i + 0.5) * size, bottom + 16, v, i, len(across.values)) for i, v in enumerate(across.values)
    ]
    parts += [
        svg.text(ROOM_LEFT - 6, 24.0 + (len(down.values) - 0.5 - j) * size + 4, value_text(v), "end")
        for j, v in enumerate(down.values)
    ]
    parts.append(svg.text(ROOM_LEFT + len(across.values) * size / 2, bottom + 36, _titled(across), fill=svg.MUTED))
    parts.append(svg.text(6, 14, _titled(down), "start", svg.MUTED))
    width = max(ROOM_LEFT + len(across.values) * size + 10, 240.0)
    return svg.picture(
        width, bottom + ROOM_BELOW, parts, f"heat map of {c.metric.title} over {across.name} and {down.name}"
    )


def curve(s: Sweep, c: Column, axis: Axis) -> str:
    """Values along one parameter, all others each at its best; the mean over the logs and each log."""
    best = [_best(c, [k for k in range(s.base) if s.settings[k][axis.name] == v]) for v in axis.values]
    places = _places(axis)
    mean = [math.nan if k is None else float(c.score[k]) for k in best]
    each = [
        [math.nan if k is None else abs(float(c.values[k, j])) for k in best]
        for j in (c.used if len(s.logs) > 1 else [])
    ]
    known = [v for v in [*mean, *(v for one in each for v in one)] if math.isfinite(v)]
    top, low = max(known), min(known)
    low = 0.0 if low < 0.5 * top else low - 0.2 * (top - low)
    y = svg.Scale(low, top * 1.04 if top > 0 else 1.0, HEIGHT - ROOM_BELOW, 16.0)
    parts = [
        f"<rect x='64' y='16' width='{WIDTH - 84:g}' height='{HEIGHT - ROOM_BELOW - 16:g}' fill='none' "
        f"stroke='{svg.RULE}'/>"
    ]
    for tick in svg.ticks(y.low, y.high):
        parts.append(svg.line([(64.0, y(tick)), (WIDTH - 20.0, y(tick))], svg.RULE, 1.0))
        parts.append(svg.text(58, y(tick) + 4, f"{tick:g}", "end", svg.MUTED))
    parts += [
        svg.line(list(zip(places, map(y, one), strict=True)), svg.MUTED, 1.0, "stroke-opacity='0.45'") for one in each
    ]
    parts.append(svg.line(list(zip(places, map(y, mean), strict=True)), svg.ACCENT, 2.5))
    near = set(c.near)
    for k, x, value in zip(best, places, mean, strict=True):
        if k is not None and math.isfinite(value):
            words = _words(s, c, k)
            colour = svg.MARK if k == c.single else svg.ACCENT
            parts.append(
                svg.dot(x, y(value), words, colour if k in near else svg.SURFACE, colour, 5.0 if k == c.single else 4.0)
            )
    parts += [
        _label(x, HEIGHT - ROOM_BELOW + 18, v, i, len(places))
        for i, (x, v) in enumerate(zip(places, axis.values, strict=True))
    ]
    parts.append(svg.text(WIDTH / 2 + 20, HEIGHT - 8, _titled(axis), fill=svg.MUTED))
    return svg.picture(WIDTH, HEIGHT, parts, f"{c.metric.title} along {axis.name}")


def _words(s: Sweep, c: Column, k: int) -> str:
    """What the pointer is told of a setting."""
    value = quantity(float(c.score[k]), c.metric.unit, False) or "no value"
    return f"{named(s.settings[k])}: {value}, {beside_text(c.beside[k], c.metric.unit)}"


def _square(x: float, y: float, size: float, fill: str, more: str = "") -> str:
    side = size - 1.0
    return f"<rect x='{x:.1f}' y='{y:.1f}' width='{side:.1f}' height='{side:.1f}' fill='{fill}' {more}/>"


def _best(c: Column, numbers: list[int]) -> int | None:
    """Of these settings the one with the smallest score, None where none has one."""
    known = [k for k in numbers if math.isfinite(c.score[k])]
    return min(known, key=lambda k: (float(c.score[k]), k)) if known else None


def _places(axis: Axis) -> list[float]:
    """Where the values of an axis stand: by size, words and lists that hold very different sizes side by side."""
    values = [v for v in axis.values if isinstance(v, float)]
    left, right = 88.0, WIDTH - 44.0
    side_by_side = svg.Scale(0.0, max(len(axis.values) - 1, 1), left, right)
    if len(values) < len(axis.values):
        return [side_by_side(i) for i in range(len(axis.values))]
    ordered = sorted(values)
    steps = [b - a for a, b in pairwise(ordered)]
    log = axis.spacing == "log" or (ordered[0] > 0 and ordered[-1] / ordered[0] >= 10.0)
    if not log and steps and max(steps) > 20.0 * min(steps):
        return [side_by_side(i) for i in range(len(axis.values))]
    scale = svg.Scale(ordered[0], ordered[-1], left, right, log)
    return [scale(v) for v in values]


def _label(x: float, y: float, value: float | str, i: int, count: int) -> str:
    every = max(1, math.ceil(count / 12))
    return svg.text(x, y, value_text(value) if i % every == 0 else "")


def _titled(axis: Axis) -> str:
    return f"{axis.name} [{axis.unit}]" if axis.unit else axis.name
