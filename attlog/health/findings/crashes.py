"""How often did it crash, and what is said of each crash? Events that belong together are one crash."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from attlog.health.findings.finding import Finding, of_event
from attlog.story.event import Event

KIND = "crash"
TOGETHER_S = 5.0
"""Blows and overturns that follow each other so soon are one crash, as in the headline."""
MOST = 3
"""Later crashes that are told by their time."""
SOON_S = 10.0
FLIPPED = "Check motor order, spin and propellers, and how the autopilot is mounted."


def signs(events: Sequence[Event], hovers: bool = True) -> list[Finding]:
    """One sign for each event that is a crash, in time order; the first of them says what all of them were.

    Who ``hovers`` and turns over soon after arming, before any lift-off, has its rotors or its autopilot mounted
    otherwise than set.
    """
    happened = [event for event in events if event.is_crash]
    found = [of_event(event, KIND) for event in happened]
    if found:
        flipped = hovers and happened[0].kind == "overturn" and _stood_before(events, happened[0].t)
        found[0] = replace(found[0], text=_text(_crashes(happened)), action=FLIPPED if flipped else "")
    return found


def wrecks(events: Sequence[Event]) -> list[tuple[float, float]]:
    """Spans (t0, t1) s from each crash to the next lift-off, or for ever."""
    lifts = [event.t for event in events if event.kind == "liftoff"]
    return [(e.t, min((t for t in lifts if t > e.t), default=float("inf"))) for e in events if e.is_crash]


def _stood_before(events: Sequence[Event], t: float) -> bool:
    """Whether it armed just before and did not lift off; a log that begins long after arming may begin in the air."""
    before = [event for event in events if event.t < t]
    armed = any(event.kind == "armed" and event.t >= max(t - SOON_S, 0.0) for event in before)
    return armed and not any(event.kind in ("liftoff", "landing") for event in before)


def _crashes(events: Sequence[Event]) -> list[list[Event]]:
    """The events of each crash."""
    groups = [[event] for event in events[:1]]
    for before, event in pairwise(events):
        if event.t - (before.t_end or before.t) < TOGETHER_S:
            groups[-1].append(event)
        else:
            groups.append([event])
    return groups


def _text(groups: Sequence[Sequence[Event]]) -> str:
    """What happened in the first crash and how it lay in the end, then when it crashed again."""
    told = [event.text.split(". ", 1) for event in groups[0]]
    moves = list(dict.fromkeys(f"{sentences[0].rstrip('.')}." for sentences in told))
    lay = told[-1][1:]  # how it lay before the last of them is over
    again = [f"{group[0].t:.1f} s" for group in groups[1:]]
    if len(again) > MOST:
        again = [*again[: MOST - 1], f"{len(again) - MOST + 1} times more"]
    times = " and ".join([", ".join(again[:-1]), again[-1]] if len(again) > 1 else again)
    return " ".join([*moves, *lay, *([f"Crashed again at {times}."] if again else [])])
