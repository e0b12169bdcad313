"""How a figure for a journal looks: one column wide, 8 pt, black axes, the page's light colours."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

STYLE = Path(__file__).parents[1] / "web" / "style.css"
COLOUR = re.compile(r"--(\w+):(#[0-9a-fA-F]{3,6})\b")

PT = 96.0 / 72.0
"""Pixels of a picture (96 to the inch) in a point."""
WIDTH = 332
"""Pixels: 88 mm, one column of a page with two."""
FONT = "Arial, Helvetica, Liberation Sans, sans-serif"
"""Fonts that journals take, and one with the same widths that is free."""
TEXT = 8.0 * PT
AXIS_LINE = 0.5 * PT
"""Thinnest line that printers keep."""
LINE, STRONG = 0.75 * PT, 1.25 * PT
MARKER = 4.5

INK = "#000000"
DASH, DOT = "4px,2px", "1.2px,1.8px"
DASHES = (
    *("solid", DASH, DOT, "5px,1.6px,1.2px,1.6px", "8px,2px", "8px,1.6px,1.2px,1.6px,1.2px,1.6px"),
    *("2.4px,2.4px", "6px,1.6px,2.4px,1.6px", "10px,1.6px,4px,1.6px"),
)
"""Of lines, for each colour of the palette its own: filters differ in grey print too. plotly's are too long here."""
AXIS_DASHES = {"x": "solid", "y": DASH, "z": DOT}
SIGNS = str.maketrans({"&": "＆", "<": "‹", ">": "›", "$": "＄"})
"""plotly reads tags, entities and formulas in texts: nothing that looks like one may reach it."""


@cache
def palette() -> dict[str, str]:
    """The page's colours in light theme by their names in its style sheet: ``e1``, ``ax``, ``bad``."""
    light = re.search(r"^:root\{([^}]*)\}", STYLE.read_text(encoding="utf-8"), re.MULTILINE)
    assert light is not None
    found = {name: "#" + "".join(2 * c for c in h[1:]) if len(h) == 4 else h for name, h in COLOUR.findall(light[1])}
    return found | {"e0": INK, "tx": INK, "mu": "#404040"}


def faded(colour: str, share: float) -> str:
    """A colour that lets what is behind it through."""
    return f"rgba({','.join(str(int(colour[i : i + 2], 16)) for i in (1, 3, 5))},{share})"


def safe(text: Any, most: int = 60) -> str:
    """Text of a log as plotly may have it, cut where it is long."""
    whole = str(text)
    return (whole if len(whole) <= most else whole[: most - 1] + "…").translate(SIGNS).replace("%{", "%(")


def axis(title: str, **more: Any) -> dict[str, Any]:
    """A black axis with outward ticks and its title."""
    return {
        "title": {"text": title, "font": {"size": TEXT, "color": INK}},
        "showline": True,
        "linecolor": INK,
        "linewidth": AXIS_LINE,
        "ticks": "outside",
        "ticklen": 3,
        "tickwidth": AXIS_LINE,
        "tickcolor": INK,
        "tickfont": {"size": TEXT, "color": INK},
        "showgrid": False,
        "zeroline": False,
        "automargin": False,
        "tickangle": 0,
        "exponentformat": "none",
    } | more


def below(title: str, **more: Any) -> dict[str, Any]:
    """The horizontal axis, its title near."""
    found = axis(title, **({"nticks": 7} | more))
    found["title"]["standoff"] = 3
    return found
