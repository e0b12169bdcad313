"""Colours and lines of rows, equal in every figure, table and log."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from attlog.result import EstimatorRow, Result
from attlog.words.names import row_names
from attlog.words.ranking import count_best, is_baseline, rows_in_order

# Number of filter colours of the palette in ``style.css``; slot 0 is black.
COLOURS = 8

# Slot of the gyro alone, drawn for comparison.
GREY = 9

DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")

# Slots whose filter is dashed: half of them, so that colours of one dash differ with any colour vision.
DASHED = (1, 5, 6, 8)

# Fixed slot and dash, equal in every log. Filters of one family share a colour.
FIXED_LINES = {
    "onboard": (0, "solid"),
    "rerun": (0, "dash"),
    "truth": (0, "dot"),
    "gyro": (GREY, "solid"),
    "complementary": (1, "dash"),
    "mahony": (2, "solid"),
    "madgwick": (3, "solid"),
    "ekf12": (4, "solid"),
    "vqf": (5, "dash"),
    "mekf": (6, "dash"),
    "eskf": (7, "solid"),
    "smoother": (8, "dash"),
    "variable_integral": (1, "dot"),
    "mahony_passive": (2, "dash"),
    "mahony_dcm": (2, "dot"),
    "mahony_adaptive": (2, "dashdot"),
    "fusion": (3, "dash"),
    "ap_dcm": (4, "dash"),
    "px4_q": (5, "dot"),
    "gsf": (7, "dash"),
    "accel_mag": (8, "dot"),
}

# Filters without memory: their angle follows every vibration, so it does not set axis ranges.
UNFILTERED = ("accel_mag",)

# From this number of replayed rows on only FEW_ROWS of them are shown at first.
MANY_ROWS = 9

FEW_ROWS = 6


class RowStyle(NamedTuple):
    """Style of a row: palette ``slot``, ``dash``, and whether it is ``shown`` at first.

    A ``lost`` row (diverged, or of a filter without memory) does not set the range of an axis.
    """

    name: str
    slot: int
    dash: str
    shown: bool = True
    onboard: bool = False
    lost: bool = False

    @property
    def depth(self) -> int:
        """Drawing order: gyro at the bottom, onboard and reference, filters on top."""
        return 0 if self.slot == GREY else 1 if self.onboard else 2


def row_styles(result: Result) -> dict[str, RowStyle]:
    """Return the style of every row by id.

    The order is: reference and onboard, re-runs, filters, other onboard rows.
    """
    rows = rows_in_order(result)
    reruns = [r.name for r in rows if r.kind == "rerun"]
    replays = [r.name for r in rows if r.kind == "replay"]
    shown = set(replays)
    if len(replays) >= MANY_ROWS:
        shown = set(sorted(replays, key=lambda name: -count_best(result, name))[:FEW_ROWS])
    known = {r.name for r in rows}
    called = row_names(result)
    alone = list(dict.fromkeys(t.row for t in result.traces if t.row and t.row not in known))
    others = alone + [r.name for r in rows if r.kind == "onboard"]
    references = {r.name for r in rows if r.is_reference} or set(others[:1])
    lost = {r.name for r in rows if r.status in ("diverged", "failed") or r.estimator in UNFILTERED}
    first = [name for name in others if name in references or name == "onboard"]
    names = [*first, *reruns, *replays, *(n for n in others if n not in first)]
    lines = dict(zip(names, assign_lines(line_key(name, rows) for name in names), strict=True))
    shown.update(others[:2], references, reruns)
    return {
        name: RowStyle(called.get(name, name.capitalize()), *lines[name], name in shown, name in others, name in lost)
        for name in names
    }


def line_key(name: str, rows: Iterable[EstimatorRow]) -> str:
    """Return the key of a row in FIXED_LINES."""
    row = next((r for r in rows if r.name == name), None)
    if row is None:
        return name
    if row.kind != "replay":
        return row.kind
    return "gyro" if is_baseline(row) else row.estimator or name


def assign_lines(filters: Iterable[str]) -> list[tuple[int, str]]:
    """Assign slot and dash to lines by key, in the order of the page.

    Keys of FIXED_LINES have a fixed style. Further lines of one filter share its colour with another dash. An unknown
    filter takes the first free colour.
    """
    filters = list(filters)
    known = [FIXED_LINES[f] for f in dict.fromkeys(filters) if f in FIXED_LINES]
    slots = range(1, COLOURS + 1)
    spare = [s for s in slots if s not in {slot for slot, _ in known}] or slots
    unknown = [f for f in dict.fromkeys(filters) if f not in FIXED_LINES]
    home = FIXED_LINES | {f: (spare[k % len(spare)], "") for k, f in enumerate(unknown)}
    taken: set[tuple[int, str]] = set()
    found: list[tuple[int, str]] = []
    for name in filters:
        slot, dash = home[name]
        choices = [dash] if (slot, dash) in known and (slot, dash) not in taken else []
        choices += [d for d in (*DASHES[1:], DASHES[0]) if (slot, d) not in taken and (slot, d) not in known]
        line = (slot, choices[0] if choices else DASHES[len(found) % len(DASHES)])
        taken.add(line)
        found.append(line)
    return found


def assign_colours(names: Sequence[str]) -> list[int]:
    """Assign slots to settings (``mahony:kp=0.5``), each its own."""
    own = [slot for slot, _ in assign_lines(re.split("[@:]", name)[0] for name in names)]
    return own if len(set(own)) == len(own) else [0 if not k else 1 + (k - 1) % COLOURS for k in range(len(names))]


STYLE_SHEET = Path(__file__).parents[1] / "web" / "style.css"
COLOUR = re.compile(r"--(\w+):(#[0-9a-fA-F]{3,6})\b")
INK = "#000000"
# Print dashes by palette colour, so that filters differ in grey print too. plotly's own are too long here.
DASH, DOT = "4px,2px", "1.2px,1.8px"
PRINT_DASHES = (
    *("solid", DASH, DOT, "5px,1.6px,1.2px,1.6px", "8px,2px", "8px,1.6px,1.2px,1.6px,1.2px,1.6px"),
    *("2.4px,2.4px", "6px,1.6px,2.4px,1.6px", "10px,1.6px,4px,1.6px"),
)
# Sequences that plotly interprets as tags, entities or formulas; untrusted texts must not contain them.
SIGNS = str.maketrans({"&": "＆", "<": "‹", ">": "›", "$": "＄"})


@cache
def palette() -> dict[str, str]:
    """Return light-theme colours by their names in the style sheet: ``e1``, ``ax``, ``bad``."""
    light = re.search(r"^:root\{([^}]*)\}", STYLE_SHEET.read_text(encoding="utf-8"), re.MULTILINE)
    assert light is not None
    found = {name: "#" + "".join(2 * c for c in h[1:]) if len(h) == 4 else h for name, h in COLOUR.findall(light[1])}
    return found | {"e0": INK, "tx": INK, "mu": "#404040", "bg": "#ffffff"}


def print_dash(style: RowStyle) -> str:
    """Return the print dash of a row, by its colour and the page's dash."""
    shift = (DASHES.index(style.dash) - (style.slot in DASHED)) % len(DASHES)
    return PRINT_DASHES[shift if style.slot == 0 else (style.slot - 1 + 3 * shift) % len(PRINT_DASHES)]


def safe(text: Any, most: int = 60) -> str:
    """Make a log's text safe for plotly, and shorten it."""
    whole = str(text)
    return (whole if len(whole) <= most else whole[: most - 1] + "…").translate(SIGNS).replace("%{", "%(")
