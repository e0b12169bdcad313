"""The spectrum of vibration with rotors, notches and what faster shaking folds back to."""

from __future__ import annotations

from typing import Any

import numpy as np

from attlog.report.journal.canvas import Canvas
from attlog.report.journal.legend import Key
from attlog.report.journal.panels import decades
from attlog.report.journal.store import array
from attlog.report.journal.style import AXIS_DASHES, AXIS_LINE, DASH, axis, below, faded, palette

QUANTITIES = {"°/s/√Hz": "gyro", "m/s²/√Hz": "accelerometer"}
DEEP = 5.0
"""Decades below the highest line that are shown."""


def spectrum(canvas: Canvas, data: dict[str, Any]) -> None:
    """Amplitude density of the three axes over frequency."""
    x, colours = array(data["x"]), palette()
    lines = {a: array(y) for a, y in data["axes"].items()}
    for a, y in lines.items():
        canvas.plain(a, colours[f"a{a}"], x, y, line={"dash": AXIS_DASHES[a]})
    every = np.concatenate(list(lines.values()))
    good = np.sort(every[np.isfinite(every) & (every > 0)])
    high = float(np.log10(good[-1])) if len(good) else 0.0
    low = max(float(np.log10(good[len(good) // 100])) if len(good) else -1.0, high - DEEP)
    reach = [low - 0.1, high + 0.3]
    canvas.axes["yaxis"] = axis(
        f"{QUANTITIES.get(data['unit'], 'density')}, {data['unit']}", type="log", range=reach, **decades(every, 6)
    )
    ends = [float(np.log10(x[0])), float(np.log10(1.12 * data["nyquist"]))]
    canvas.axes["xaxis"] = below("frequency, Hz", type="log", range=ends, **decades(x, 5))
    _bands(canvas, data, reach)
    canvas.upright(data["nyquist"], colours["bad"], DASH)
    canvas.key(Key("half the rate", colours["bad"], DASH))


def _bands(canvas: Canvas, data: dict[str, Any], reach: list[float]) -> None:
    """Rotors grey, notches that are set blue, proposed ones green, folded frequencies hatched at the top."""
    colours = palette()
    boxes = [(b, "rotors", colours["e9"]) for b in data.get("rotor", [])]
    for b in data.get("notches", []):
        proposed = b["key"] == "proposed"
        boxes.append((b, "notch proposed" if proposed else "notch set", colours["e3" if proposed else "e1"]))
    for b, name, colour in boxes:
        canvas.key(Key(name, colour, fill=True))
        line = {"color": faded(colour, 0.6), "width": AXIS_LINE}
        canvas.band(b["low"], max(b["high"], 1.01 * b["low"]), faded(colour, 0.18), line=line)
    for i, b in enumerate(data.get("rotor", [])):
        if b["f"] < data["nyquist"]:
            canvas.note(float(np.log10(b["f"])), f"{i + 1}×")
    if data["folded"] < data["nyquist"]:
        low, high = reach
        x = [max(data["folded"], float(data["x"][0])), data["nyquist"]]
        hatched = {"shape": "/", "fgcolor": colours["bad"], "size": 5, "solidity": 0.25, "fillmode": "overlay"}
        canvas.edge(x, [10.0 ** (high - 0.05 * (high - low))] * 2)
        canvas.edge(x, [10.0**high] * 2, fill="tonexty", fillcolor="rgba(0,0,0,0)", fillpattern=hatched)
