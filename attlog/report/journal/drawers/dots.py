"""Values with their intervals, a line for each row: lag and drift."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.report.figures.drift import place_text
from attlog.report.journal.canvas import Canvas
from attlog.report.journal.legend import Key, text_width
from attlog.report.journal.style import AXIS_LINE, INK, LINE, MARKER, WIDTH, axis, below, palette

SYMBOLS = {
    "against truth": "diamond",
    "against smoother": "diamond",
    "against mag": "square",
    "against gnss_yaw": "triangle-up",
    "against yaw_estimator": "pentagon",
    "against course": "triangle-down",
}
FULL = ("", "at rest", "against truth")
"""Where a drift was found whose dot is filled."""
NEAR = 4.0
"""What is beyond so many times the largest ranked value runs out of the figure."""
LETTERS = 26


def lag(canvas: Canvas, data: dict[str, Any]) -> None:
    """Lag of each row with its interval and its single steps; grey: half a sample of the IMU either way."""
    if data["half"]:
        canvas.band(-data["half"], data["half"], palette()["arm"])
        canvas.key(Key("± half a sample of the IMU", palette()["mu"], fill=True))
    dots(canvas, data["rows"], "lag, ms")


def drifts(canvas: Canvas, data: dict[str, Any]) -> None:
    """Drift of each row with its interval, a symbol for each place where it was found."""
    dots(canvas, data["rows"], "drift of the heading, °/min")
    for where in dict.fromkeys(d["where"] for d in data["rows"] if d["r"] in canvas.shown):
        canvas.key(Key(place_text(where), INK, symbol=SYMBOLS.get(where, "circle"), full=where in FULL))


def dots(canvas: Canvas, found: list[dict[str, Any]], title: str) -> None:
    """A line for each row from the top down; hollow: not ranked, or not against a truth."""
    found = [d for d in found if d["r"] in canvas.shown and d["v"] is not None]
    rows = list(dict.fromkeys(d["r"] for d in found))
    ends = _ends(canvas, found)
    places = {r: float(len(rows) - 1 - i) for i, r in enumerate(rows)}
    for r in rows:
        own = [d for d in found if d["r"] == r]
        for i, d in enumerate(own):
            y = places[r] + (0.28 - 0.56 * i / (len(own) - 1) if len(own) > 1 else 0.0)
            _dot(canvas, d, y, ends)
            _singles(canvas, d, places[r], ends)
    names = [n if len(n := canvas.rows[r].name) <= LETTERS else n[: LETTERS - 1] + "…" for r in rows]
    canvas.left = min(12.0 + max(map(text_width, names), default=0.0), 0.42 * WIDTH)
    canvas.height = 16.0 * max(len(rows), 3) * (1.4 if len(found) > len(rows) else 1.0)
    canvas.axes["xaxis"] = below(title, range=ends)
    canvas.axes["yaxis"] = axis(
        "", tickvals=list(places.values()), ticktext=names, range=[-0.6, len(rows) - 0.4], ticks=""
    )
    canvas.upright(0.0, INK, width=AXIS_LINE)


def _dot(canvas: Canvas, d: dict[str, Any], y: float, ends: list[float]) -> None:
    """A value with its interval; beyond the figure an arrow."""
    colour = canvas.rows[d["r"]].colour
    out = -1 if d["v"] < ends[0] else 1 if d["v"] > ends[1] else 0
    full = d.get("where", "") in FULL and d["ok"] is not False
    symbol = ("", "triangle-right", "triangle-left")[out] or SYMBOLS.get(d.get("where", ""), "circle")
    line = {"color": colour, "width": LINE}
    marker = {"size": MARKER + 1.5, "symbol": symbol, "color": colour if full else "#ffffff", "line": line}
    bars = {}
    if d["ci"] and not out:
        sizes = {"array": [d["ci"][1] - d["v"]], "arrayminus": [d["v"] - d["ci"][0]]}
        bars = {"error_x": {"symmetric": False, "color": colour, "thickness": LINE, "width": 2} | sizes}
    canvas.marker([min(max(d["v"], ends[0]), ends[1])], [y], marker, cliponaxis=not out, meta=d["r"], **bars)


def _singles(canvas: Canvas, d: dict[str, Any], y: float, ends: list[float]) -> None:
    """Single steps as small dots around the row's line, those in the figure."""
    x = [v for v in d.get("single", []) if ends[0] <= v <= ends[1]]
    if x:
        away = [y + ((i * 7919) % 101) / 101 * 0.5 - 0.25 for i in range(len(x))]
        marker = {"size": 2.2, "color": canvas.rows[d["r"]].colour, "opacity": 0.55}
        canvas.marker(x, away, marker, meta=d["r"], hoverinfo="skip")


def _ends(canvas: Canvas, found: list[dict[str, Any]]) -> list[float]:
    """A range fitted to what is ranked: values far beyond it and intervals far wider leave it."""
    sound = [d for d in found if d["ok"] is not False and not canvas.rows[d["r"]].lost] or found
    most = max([1e-3, *(abs(d["v"]) for d in sound)])
    values = [v for d in found for v in (d["v"], *d.get("single", []))] + [v for d in sound for v in d["ci"] or ()]
    near = np.array([0.0, *(v for v in values if abs(v) < NEAR * most)])
    pad = 0.08 * float(near.max() - near.min()) or 1.0
    return [float(near.min()) - pad, float(near.max()) + pad]
