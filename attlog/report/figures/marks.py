"""What stands on the time axis: phases, modes, messages, failsafes, resets, gaps, impact."""

from __future__ import annotations

import math
from typing import Any

from attlog.present.messages import WARNING, alarming, messages
from attlog.result import Result

MAX_MESSAGES = 2000
"""Messages drawn on the time axis; the worst are kept, the list in the page says how many there are."""

AFTER_S = 5.0
"""What figures show after a crash, s, until all of the time is asked for."""


def time_marks(result: Result) -> dict[str, Any]:
    """Everything to draw on the time axes: spans as [[t0, t1, why]], instants as [[t, why]], modes and texts."""
    line = result.log.get("timeline") or {}
    return {
        "range": time_range(result),
        "first": [time_range(result)[0], min(time_range(result)[1], crash(result) + AFTER_S)],
        "crash": crash(result) if crash(result) < time_range(result)[1] else None,
        "modes": [[float(a), float(b), str(name)] for a, b, name in line.get("modes") or []],
        "armed": [[float(a), float(b)] for a, b in line.get("armed") or []],
        "airborne": [[float(a), float(b)] for a, b in line.get("airborne") or []],
        "rest": spans(result, "rest"),
        "gaps": spans(result, "gap"),
        "resets": jumps(result),
        "impact": spans(result, "impact"),
        "texts": drawn(messages(result)),
    }


def spans(result: Result, kind: str) -> list[list[Any]]:
    """Segments of a kind (``rest``: long and short) as [t0, t1, why]."""
    return [[s.t0, s.t1, s.why] for s in result.segments if s.kind.partition(".")[0] == kind]


def jumps(result: Result) -> list[list[Any]]:
    """Jumps of the onboard attitude as the list of events has them, [t, text]."""
    return [[e.t, e.text] for e in result.events if e.kind == "reset"]


def time_range(result: Result) -> list[float]:
    """First and last second that any figure shows."""
    times = [float(x) for t in result.traces if t.figure == "attitude" and len(t.t) for x in (t.t[0], t.t[-1])]
    end = max([*times, float(result.log.get("duration_s") or 0.0), 1e-3])
    return [min([*times, 0.0]), end]


def crash(result: Result) -> float:
    """When the last flight ended in a crash, s; infinite where it did not."""
    flights = [float(a) for a, _ in (result.log.get("timeline") or {}).get("airborne") or []]
    last = max(flights, default=-math.inf)
    return min((e.t for e in result.events if e.is_crash and e.t >= last), default=math.inf)


def drawn(found: list[tuple[float, int, str]]) -> list[list[Any]]:
    """The worst MAX_MESSAGES messages as [t, severity, text]; severity 2 is an alarm, 1 a warning, 0 the rest."""
    graded: list[list[Any]] = [
        [t, 2 if alarming(level, text) else 1 if level <= WARNING else 0, text[:200]] for t, level, text in found
    ]
    if len(graded) > MAX_MESSAGES:
        worst = sorted(range(len(graded)), key=lambda i: -graded[i][1])[:MAX_MESSAGES]
        graded = [graded[i] for i in sorted(worst)]
    return graded
