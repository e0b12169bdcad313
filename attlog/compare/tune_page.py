"""The page of a tuning: sentences, gains to paste, what was judged where, and how flat the optimum is."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from attlog.compare import page, svg
from attlog.compare.search import Free
from attlog.compare.sweep_words import named, references_of
from attlog.compare.tune import Tuned
from attlog.compare.tune_words import gain_rows, judged_rows, part_rows, paste, sentences
from attlog.present.numbers import counted
from attlog.present.text import clean

WIDTH, HEIGHT, LEFT, ABOVE, BELOW = 560.0, 300.0, 64.0, 26.0, 46.0
WORST_SHOWN = 1.5
"""Costs beyond this share above the spread of the better half are drawn at the upper edge."""


def tune_page(t: Tuned, about: Mapping[str, Any], firmware: Mapping[str, str]) -> str:
    """The page as text; ``about``: version, command and logs as in the JSON."""
    where = counted(len(t.logs), "log") if len(t.logs) > 1 else "one log"
    told = f"attlog {about['attlog']['version']} · {clean(str(about['command']))}"
    return page.page("tune", f"{clean(t.filter)}: gains from {where}", told, _parts(t, about, firmware))


def _parts(t: Tuned, about: Mapping[str, Any], firmware: Mapping[str, str]) -> Iterator[str]:
    yield page.said(map(clean, sentences(t, references_of(about))))
    yield page.heading("Gains, ready to paste")
    yield page.code("\n".join(paste(t, firmware)))
    yield page.heading("On what was left out")
    yield page.table(judged_rows(t))
    yield page.heading("How much the gains depend on the logs")
    yield page.table(gain_rows(t))
    yield page.heading("How flat the optimum is")
    yield page.figures(
        (f"Every setting that was tried, by {f.name}; red: the gains to take.", scatter(t, f)) for f in t.free
    )
    yield page.heading("Each part, with gains that were not found on it")
    yield page.table(part_rows(t))


def scatter(t: Tuned, f: Free) -> str:
    """The change of the objective over one gain, a dot for each setting that was tried."""
    changes = [100.0 * (math.exp(cost) - 1.0) for _, cost in t.found.tried]
    low, middle = min(changes), sorted(changes)[len(changes) // 2]
    top = max(middle + WORST_SHOWN * (middle - low), low + 1.0)
    x = svg.Scale(f.low, f.high, LEFT + 10, WIDTH - 30, f.log)
    y = svg.Scale(low - 0.05 * (top - low), top, HEIGHT - BELOW, ABOVE)
    side, tall = WIDTH - LEFT - 20, HEIGHT - BELOW - ABOVE
    frame = f"<rect x='{LEFT:g}' y='{ABOVE:g}' width='{side:g}' height='{tall:g}' fill='none' "
    parts = [f"{frame}stroke='{svg.RULE}'/>"]
    for tick in svg.ticks(y.low, y.high):
        parts.append(svg.line([(LEFT, y(tick)), (WIDTH - 20.0, y(tick))], svg.RULE, 1.0))
        parts.append(svg.text(LEFT - 6, y(tick) + 4, f"{tick:g}", "end", svg.MUTED))
    for (setting, _), change in sorted(zip(t.found.tried, changes, strict=True), key=lambda one: -one[1]):
        best = setting == t.found.setting
        colour = svg.MARK if best else svg.ACCENT
        words = f"{named(setting)}: {change:+.0f} %"
        place = y(min(change, top))
        parts.append(
            svg.dot(
                x(float(setting[f.name])), place, words, colour if best else svg.SURFACE, colour, 5.0 if best else 3.0
            )
        )
    for tick in decades(f) if f.log else svg.ticks(f.low, f.high):
        parts.append(svg.text(x(tick), HEIGHT - BELOW + 18, f"{tick:g}"))
    parts.append(svg.text(WIDTH / 2 + 20, HEIGHT - 8, f"{f.name} [{f.unit}]" if f.unit else f.name, fill=svg.MUTED))
    parts.append(svg.text(6, 14, "objective, % of the filter as it is", "start", svg.MUTED))
    return svg.picture(WIDTH, HEIGHT, parts, f"the objective over {f.name}")


def decades(f: Free) -> list[float]:
    """1, 2 and 5 of every power of ten within a range; of long ranges the powers alone."""
    powers = range(math.floor(math.log10(f.low)), math.ceil(math.log10(f.high)) + 1)
    steps = (1.0, 2.0, 5.0) if len(powers) <= 3 else (1.0,)
    return [v for p in powers for s in steps if f.low <= (v := float(f"{s * 10.0**p:.3g}")) <= f.high]
