"""The pieces of time in a file: how long each lasts, by all of its messages, and which was taken."""

from __future__ import annotations

import numpy as np

from attlog.formats.base import Messages

STAMPS = (("TimeUS", 1.0), ("timestamp", 1.0), ("time_boot_ms", 1e3), ("TimeMS", 1e3))
"""Columns of boot clocks, and their units in us."""
LONGEST_S = 7 * 86_400.0
"""A table that spans more than a week has a false stamp."""
LISTED = 4


def seconds_of(messages: Messages) -> float:
    """From the first to the last stamp of any message in s; 0 where nothing carries a time."""
    spans = []
    for (name, _), table in messages.items():
        column, us = next(((c, us) for c, us in STAMPS if c in table), ("", 1.0))
        if not column or len(table) == 0 or (name == "GPS" and column == "TimeMS"):  # that is the time of the week
            continue
        t = np.asarray(table[column], np.float64).ravel() * us * 1e-6
        t = t[np.isfinite(t) & (t > 0.0)]
        if len(t) and np.ptp(t) < LONGEST_S:
            spans.append((float(t.min()), float(t.max())))
    if not spans:
        return 0.0
    middle = float(np.median([a for a, _ in spans]))
    near = [(a, b) for a, b in spans if abs(a - middle) < LONGEST_S]
    return max(b for _, b in near) - min(a for a, _ in near)


def others(messages: Messages, chosen: int) -> str:
    """The power-ups that were not taken, each with its length: "Number 1 lasts 12 s, number 2 3 s"."""
    numbers = [k for k in range(len(messages.boots)) if k != chosen]
    told = [f"number {k} lasts {seconds_of(messages.boot(k)):.0f} s" for k in numbers[:LISTED]]
    more = f" and {len(numbers) - LISTED} more" if len(numbers) > LISTED else ""
    text = ", ".join(told) + more
    return text[:1].upper() + text[1:]
