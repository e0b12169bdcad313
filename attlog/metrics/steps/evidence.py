"""What did a row show in the quick movements? Its fits over the events of a window, for all that looks at steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.base import Case, per_case, per_row, per_times
from attlog.metrics.errors.rmse import why_never_airborne
from attlog.metrics.evidence import aiding
from attlog.metrics.steps import events as steps
from attlog.metrics.steps.fit import groups as step_groups
from attlog.metrics.steps.fit import line as step_fit
from attlog.metrics.steps.fit.solution import MIN_EVENTS, Fit
from attlog.metrics.steps.turning import Timing, Turning
from attlog.reference.model import Row

Array = NDArray[np.float64]

MIN_REFERENCE_HZ = 5.0


def fits(case: Case, row: Row, window: str) -> dict[str, Fit]:
    """The fits of a row over the events of a window: per axis and ``all``; shared by everything that looks at steps."""
    found = evidence(case, row, window)
    return {} if found is None else found.fits


@dataclass(slots=True)
class Evidence:
    """The fits of a row per axis and ``all``, and the events that their numbers mean."""

    fits: dict[str, Fit]
    events: list[steps.Event]


def evidence(case: Case, row: Row, window: str) -> Evidence | None:
    """What a row showed in the events of a window; None without any that it covers."""
    return _evidence(case, row, first_with(case, row, window)) if events_in(case, row, window) else None


def first_with(case: Case, row: Row, window: str) -> str:
    """``all`` where this window holds the same events, else the window: what was found there is not computed again."""
    return "all" if events_in(case, row, window) == events_in(case, row, "all") else window


@per_row
def events_in(case: Case, row: Row, window: str) -> list[steps.Event]:
    """The events of a window for which this row is scored."""
    return steps.in_window(case, scored_events(case, row), window)


@per_row
def _evidence(case: Case, row: Row, window: str) -> Evidence | None:
    track = Turning(row.t, row.q, row.segment, timing(case, row.t))
    seen = aiding.seen_by(case, row)
    sensors = None if seen is None else aiding.Sensors(case, row, track, seen)
    groups = step_groups.groups(track, reference_turning(case), events_in(case, row, window), sensors)
    return None if groups is None else Evidence(step_fit.fit(groups), groups.events)


@per_times
def timing(case: Case, t: Array) -> Timing:
    """What :class:`Turning` needs to know of the times (n,) of rows; replays of one unit share them."""
    return Timing.of(t)


@per_case
def reference_turning(case: Case) -> Turning:
    """The reference's attitude as summed turning."""
    return Turning(case.reference.t, case.reference.q, case.reference.segment)


def scored_events(case: Case, row: Row) -> list[steps.Event]:
    """The events of the reference for which this row is scored (after a restart it settles first)."""
    errors = row.errors
    if errors is None or len(errors.t) == 0:
        return []
    events = steps.of_reference(case)
    at = np.clip(np.searchsorted(errors.t, [e.onset for e in events]), 0, len(errors.t) - 1)
    return [e for e, i in zip(events, at, strict=True) if errors.scored[i]]


def why_no_events(case: Case, row: Row, window: str) -> tuple[str, str] | None:
    """Code and reason where a window has no events at all for a row, else None."""
    rate = case.reference.rate
    if rate < MIN_REFERENCE_HZ:
        return (
            "reference_too_slow",
            f"the reference comes at {rate:.1f} Hz; {MIN_REFERENCE_HZ:.0f} Hz are needed for steps",
        )
    if not events_in(case, row, window):
        where = {"all": "in this log", "airborne": "in flight"}.get(window, f"in {window}")
        if window == "airborne" and not case.segments.spans("airborne"):
            return "no_events", why_never_airborne(case)
        sizes = f"{steps.SMALLEST_DEG[0]:.0f} deg in roll or pitch or {steps.SMALLEST_DEG[2]:.0f} deg in yaw"
        start = f"from {case.reference.scoring_start:.0f} s on"
        return "no_events", f"no quick movement {where} {start}; turns of {sizes} within 1 s are needed"
    return None


def too_few(count: int, where: str = "") -> str:
    """The reason where there are fewer than MIN_EVENTS; ``where`` follows with a blank before it."""
    return f"{count} quick movement{'' if count == 1 else 's'}{where}; at least {MIN_EVENTS} are needed"
