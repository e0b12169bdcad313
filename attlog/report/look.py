"""Who gets which colour and line, and who is shown at first: the same in every figure, table and log."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from attlog.present.names import row_names
from attlog.present.table.rows import is_baseline, leads, ordered
from attlog.result import EstimatorRow, Result

COLOURS = 8
"""Filter colours of the palette in ``style.css``; slot 0 is black."""

GREY = 9
"""Slot of the gyro alone, which is shown for comparison."""

DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")

FIXED = {
    "onboard": (0, "solid"),
    "truth": (0, "dot"),
    "gyro": (GREY, "solid"),
    "complementary": (1, "solid"),
    "mahony": (2, "solid"),
    "madgwick": (3, "solid"),
    "ekf12": (4, "solid"),
    "vqf": (5, "solid"),
    "mekf": (6, "solid"),
    "eskf": (7, "solid"),
    "smoother": (8, "solid"),
    "variable_integral": (1, "dash"),
    "mahony_passive": (2, "dash"),
    "mahony_dcm": (2, "dot"),
    "mahony_adaptive": (2, "dashdot"),
    "fusion": (3, "dash"),
    "ap_dcm": (4, "dash"),
    "px4_q": (5, "dash"),
    "gsf": (7, "dash"),
    "ukf": (6, "dash"),
    "accel_mag": (8, "dash"),
}
"""Slot and dash of what every log may hold, the same in all of them. Filters of one family share a colour."""

BOUNCING = ("accel_mag",)
"""Filters without memory: their angle follows every shake and sets no range."""

MANY = 9
"""From so many replayed rows on only FEW of them are shown at first."""

FEW = 6


@dataclass(frozen=True, slots=True)
class Look:
    """How one row is drawn: its name for people, ``slot`` of the palette, ``dash``, whether it is shown at first.

    A ``lost`` row (diverged, or of a filter that bounces) does not set the range of an axis.
    """

    name: str
    slot: int
    dash: str
    shown: bool
    onboard: bool
    lost: bool


def looks(result: Result) -> dict[str, Look]:
    """The look of every row by id: reference and onboard, the filters, other onboard rows."""
    rows = ordered(result)
    replays = [r.name for r in rows if r.kind == "replay"]
    shown = set(replays)
    if len(replays) >= MANY:
        shown = set(sorted(replays, key=lambda name: -leads(result, name))[:FEW])
    known = {r.name for r in rows}
    called = row_names(result)
    alone = list(dict.fromkeys(t.row for t in result.traces if t.row and t.row not in known))
    others = alone + [r.name for r in rows if r.kind != "replay"]
    references = {r.name for r in rows if r.is_reference} or set(others[:1])
    lost = {r.name for r in rows if r.status in ("diverged", "failed") or r.estimator in BOUNCING}
    first = [name for name in others if name in references or name == "onboard"]
    names = [*first, *replays, *(n for n in others if n not in first)]
    lines = dict(zip(names, lines_of(filter_of(name, rows) for name in names), strict=True))
    shown.update(others[:2], references)
    return {
        name: Look(called.get(name, name.capitalize()), *lines[name], name in shown, name in others, name in lost)
        for name in names
    }


def filter_of(name: str, rows: Iterable[EstimatorRow]) -> str:
    """What decides how a row is drawn: its estimator, ``onboard``, or of a reference that is no row its name."""
    row = next((r for r in rows if r.name == name), None)
    if row is None:
        return name
    if row.kind != "replay":
        return "onboard"
    return "gyro" if is_baseline(row) else row.estimator or name


def lines_of(filters: Iterable[str]) -> list[tuple[int, str]]:
    """Slot and dash of lines by what they draw: estimators, ``onboard``, ``truth``, in the order of the page.

    What stands in FIXED looks the same everywhere. Further lines of one filter share its colour with another dash;
    a filter that is not known takes the first colour without a line.
    """
    filters = list(filters)
    known = [FIXED[f] for f in dict.fromkeys(filters) if f in FIXED]
    slots = range(1, COLOURS + 1)
    spare = [s for s in slots if s not in {slot for slot, _ in known}] or slots
    unknown = [f for f in dict.fromkeys(filters) if f not in FIXED]
    home = FIXED | {f: (spare[k % len(spare)], "") for k, f in enumerate(unknown)}
    taken: set[tuple[int, str]] = set()
    found: list[tuple[int, str]] = []
    for name in filters:
        slot, dash = home[name]
        choices = [dash] if (slot, dash) in known and (slot, dash) not in taken else []
        choices += [d for d in DASHES if (slot, d) not in taken and (slot, d) not in known]
        line = (slot, choices[0] if choices else DASHES[len(found) % len(DASHES)])
        taken.add(line)
        found.append(line)
    return found


def colours_of(names: Sequence[str]) -> list[int]:
    """Slots of configurations (``mahony:kp=0.5``), which colour alone tells: of each filter its own, of several of one
    filter one after another, the first black."""
    own = [slot for slot, _ in lines_of(re.split("[@:]", name)[0] for name in names)]
    return own if len(set(own)) == len(own) else [0 if not k else 1 + (k - 1) % COLOURS for k in range(len(names))]
