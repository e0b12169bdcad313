"""Who gets which colour and line, and who is shown at first: the same in every figure, card and table."""

from __future__ import annotations

from dataclasses import dataclass

from attlog.present.names import row_names
from attlog.present.table.rows import is_baseline, leads, ordered
from attlog.result import Result

COLOURS = 8
"""Filter colours of the palette in ``style.css``; slot 0 is the onboard attitude."""

GREY = 9
"""Slot of the gyro alone, which is shown for comparison."""

DASHES = ("solid", "dash", "dot", "dashdot")
"""Line of filters 1 to 8, 9 to 16, 17 to 24, and so on."""

ONBOARD_DASHES = ("solid", "dot", "dashdot", "dash", "longdash", "longdashdot")

MANY = 9
"""From so many replayed rows on only FEW of them are shown at first."""

FEW = 6


@dataclass(frozen=True, slots=True)
class Look:
    """How one row is drawn: its name for people, ``slot`` of the palette, ``dash``, whether it is shown at first.

    A ``lost`` row (diverged) does not set the range of an axis.
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
    others = list(dict.fromkeys(t.row for t in result.traces if t.row and t.row not in known))
    others += [r.name for r in rows if r.kind != "replay"]
    lost = {r.name for r in rows if r.status in ("diverged", "failed")}
    references = {r.name for r in rows if r.is_reference} or set(others[:1])
    out = {
        name: Look(
            called.get(name, name),
            0,
            ONBOARD_DASHES[i % len(ONBOARD_DASHES)],
            i < 2 or name in references,
            True,
            name in lost,
        )
        for i, name in enumerate(others)
    }
    grey = {r.name for r in rows if is_baseline(r)}
    for name in replays:
        if name in grey:
            out[name] = Look(called[name], GREY, DASHES[0], name in shown, False, name in lost)
    for i, name in enumerate(n for n in replays if n not in grey):
        dash = DASHES[(i // COLOURS) % len(DASHES)]
        out[name] = Look(called[name], 1 + i % COLOURS, dash, name in shown, False, name in lost)
    first = [name for name in others if name in references or name == "onboard"]
    return {name: out[name] for name in (*first, *replays, *(n for n in others if n not in first))}
