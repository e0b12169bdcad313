"""Small drawings for pages: axes, lines and coloured cells as SVG text that needs no script."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

INK, MUTED, RULE, SURFACE = "#1b1f24", "#525c67", "#d3d9e0", "#ffffff"
ACCENT, MARK = "#0b57a4", "#b3261e"
RAMP = ("#f7fbff", "#d9e7f5", "#b0d2e8", "#79b5d9", "#4691c6", "#206fb2", "#084d97", "#08306b")
"""From light (near the best) to dark."""
MISSING = "#ececec"
FONT = "font-family='system-ui,-apple-system,Segoe UI,Roboto,sans-serif'"


def picture(width: float, height: float, parts: Sequence[str], title: str) -> str:
    """A drawing with its words for those who do not see it."""
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {width:g} {height:g}' width='{width:g}' "
        f"height='{height:g}' role='img' aria-label='{escape(title)}' {FONT} font-size='12'>"
        f"<rect width='100%' height='100%' fill='{SURFACE}'/>"
        f"{''.join(parts)}</svg>"
    )


def text(x: float, y: float, words: str, anchor: str = "middle", fill: str = INK, more: str = "") -> str:
    """Words at a place."""
    return f"<text x='{x:.1f}' y='{y:.1f}' text-anchor='{anchor}' fill='{fill}' {more}>{escape(words)}</text>"


def line(points: Sequence[tuple[float, float]], colour: str, width: float = 1.5, more: str = "") -> str:
    """A line through points; those that are not finite break it."""
    pieces: list[list[str]] = [[]]
    for x, y in points:
        if math.isfinite(x) and math.isfinite(y):
            pieces[-1].append(f"{x:.1f},{y:.1f}")
        elif pieces[-1]:
            pieces.append([])
    return "".join(
        f"<polyline points='{' '.join(p)}' fill='none' stroke='{colour}' stroke-width='{width:g}' {more}/>"
        for p in pieces
        if len(p) > 1
    )


def dot(x: float, y: float, words: str, fill: str, stroke: str = ACCENT, radius: float = 4.0) -> str:
    """A dot that tells its words where the pointer rests on it."""
    return (
        f"<circle cx='{x:.1f}' cy='{y:.1f}' r='{radius:g}' fill='{fill}' stroke='{stroke}' stroke-width='1.5'>"
        f"<title>{escape(words)}</title></circle>"
    )


def shade(share: float) -> tuple[str, str]:
    """The colour of a cell for 0 (light) to 1 (dark), and that of words on it."""
    k = min(int(max(share, 0.0) * len(RAMP)), len(RAMP) - 1)
    return RAMP[k], INK if k < 4 else "#ffffff"


@dataclass(frozen=True, slots=True)
class Scale:
    """Values along an axis from ``low`` to ``high``, drawn between two places; logarithmic where wanted."""

    low: float
    high: float
    start: float
    end: float
    log: bool = False

    def __call__(self, value: float) -> float:
        if self.log:
            value, low, high = (math.log(max(v, 1e-300)) for v in (value, self.low, self.high))
        else:
            low, high = self.low, self.high
        return self.start + (self.end - self.start) * ((value - low) / (high - low) if high > low else 0.5)


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Round values between two, up to ``most``."""
    if not high > low:
        return [low]
    raw = (high - low) / max(most - 1, 1)
    unit = 10.0 ** math.floor(math.log10(raw))
    step = next(s * unit for s in (1.0, 2.0, 5.0, 10.0) if s * unit >= raw)
    first = math.ceil(low / step - 1e-9)
    return [float(f"{k * step:.10g}") for k in range(first, math.floor(high / step + 1e-9) + 1)]
