"""What did a row show in the steps? One linear fit of its turning to the reference's, all events together.

Body rates w are summed increments of attitude over a span h; u is the event's axis.
Minimised over delay tau, gain k, body misalignment phi, aiding gains a_j
(:mod:`attlog.metrics.steps.fit.aiding`) and one constant c per event:

    sum ( u.w_est(t + tau) - k u.w_ref(t) - phi.(w_ref x u) - sum_j a_j u.n_j(t + tau) - c )^2

Gauss-Newton in tau; everything else is linear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.base import Case, per_case, per_row, per_times
from attlog.metrics.evidence.phases import why_never_airborne
from attlog.metrics.steps import events as steps
from attlog.metrics.steps.events import AXES
from attlog.metrics.steps.fit import aiding
from attlog.metrics.steps.fit import groups as step_groups
from attlog.metrics.steps.fit.groups import Groups
from attlog.metrics.steps.fit.sensors import RowSensors, seen_by
from attlog.metrics.steps.fit.solution import GAIN, MIN_EVENTS, PLAIN, Fit, Sums, Y, left, ridge
from attlog.metrics.steps.fit.turning import SummedTurning, Timing
from attlog.reference.model import Row

Array = NDArray[np.float64]


RANGE_S, COARSE_S = 0.25, 0.025
"""A delay is looked for up to this far on both sides."""
SLOPE_S, LARGEST_STEP_S = 0.008, 0.020
ENOUGH_S, MOST_STEPS = 3e-5, 20


def fit(groups: Groups) -> dict[str, Fit]:
    """The fit of all events (``all``) and, with its misalignment and aiding kept, of each axis that has some."""
    delay, at_edge = _start(groups)
    sums = _sums(groups, delay, None)
    for _ in range(MOST_STEPS):
        total = sums.products.sum(axis=0)
        x = sums.solve(total)
        step = float(np.clip(sums.step(x), -LARGEST_STEP_S, LARGEST_STEP_S))
        delay = float(np.clip(delay + step, -RANGE_S, RANGE_S))
        sums = _sums(groups, delay, (x, float(left(total, x))))
        if abs(step) < ENOUGH_S or abs(delay) >= RANGE_S:
            break
    at_edge = at_edge or abs(delay) > RANGE_S - 1e-3
    sums.plain, _ = groups.products(delay, SLOPE_S, np.zeros(len(aiding.NAMES)))
    present = np.flatnonzero(sums.lines)
    if len(present) == 0:
        return {}
    fits = {"all": sums.fit(present)}
    kept = sums.keeping(fits["all"].x)
    for axis, name in enumerate(AXES):
        own = present[sums.axis[present] == axis]
        if len(own):
            fits[name] = kept.fit(own)
    for found in fits.values():
        found.at_edge = at_edge or abs(found.delay) > RANGE_S - 1e-3
    return fits


def _start(groups: Groups) -> tuple[float, bool]:
    """The delay of the largest correlation on a coarse grid, and whether that is the grid's end."""
    grid = np.arange(-RANGE_S, RANGE_S + 1e-9, COARSE_S)
    best = int(np.argmax(groups.correlations(grid)))
    return float(grid[best]), best in (0, len(grid) - 1)


def _sums(groups: Groups, delay: float, last: tuple[Array, float] | None) -> Sums:
    """The products at a delay; ``last`` are coefficients and residual squares of the step before."""
    aids = np.zeros(len(aiding.NAMES)) if last is None else last[0][PLAIN:]
    products, count = groups.products(delay, SLOPE_S, aids)
    total, lines = products.sum(axis=0), max(int(count.sum()), 1)
    squares = total[Y, Y] - total[Y, GAIN] ** 2 / max(total[GAIN, GAIN], 1e-30) if last is None else last[1]
    return Sums(
        products,
        products,
        count,
        np.array([e.end - e.begin for e in groups.events]),
        delay,
        groups.slow_row,
        ridge(total, float(max(squares, 0.0)) / lines, lines),
        heavy=groups.heavy,
        axis=np.array([e.axis for e in groups.events], np.int64),
    )


MIN_REFERENCE_HZ = 5.0


def fits(case: Case, row: Row, window: str) -> dict[str, Fit]:
    """The fits of a row over the events of a window: per axis and ``all``; shared by everything that looks at steps."""
    found = evidence(case, row, window)
    return {} if found is None else found.fits


@dataclass(slots=True)
class RowFits:
    """The fits of a row per axis and ``all``, and the events that their numbers mean."""

    fits: dict[str, Fit]
    events: list[steps.StepEvent]


def evidence(case: Case, row: Row, window: str) -> RowFits | None:
    """What a row showed in the events of a window; None without any that it covers."""
    return _evidence(case, row, first_with(case, row, window)) if events_in(case, row, window) else None


def first_with(case: Case, row: Row, window: str) -> str:
    """``all`` where this window holds the same events, else the window: what was found there is not computed again."""
    return "all" if events_in(case, row, window) == events_in(case, row, "all") else window


@per_row
def events_in(case: Case, row: Row, window: str) -> list[steps.StepEvent]:
    """The events of a window for which this row is scored."""
    return steps.in_window(case, scored_events(case, row), window)


@per_row
def _evidence(case: Case, row: Row, window: str) -> RowFits | None:
    track = SummedTurning(row.t, row.q, row.segment, timing(case, row.t))
    seen = seen_by(case, row)
    sensors = None if seen is None else RowSensors(case, row, track, seen)
    groups = step_groups.groups(track, reference_turning(case), events_in(case, row, window), sensors)
    return None if groups is None else RowFits(fit(groups), groups.events)


@per_times
def timing(case: Case, t: Array) -> Timing:
    """What :class:`Turning` needs to know of the times (n,) of rows; replays of one unit share them."""
    return Timing.of(t)


@per_case
def reference_turning(case: Case) -> SummedTurning:
    """The reference's attitude as summed turning."""
    return SummedTurning(case.reference.t, case.reference.q, case.reference.segment)


def scored_events(case: Case, row: Row) -> list[steps.StepEvent]:
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
        return "no_events", f"no step {where} {start}; turns of {sizes} within 1 s are needed"
    return None


def too_few(count: int, where: str = "") -> str:
    """The reason where there are fewer than MIN_EVENTS; ``where`` follows with a blank before it."""
    return f"{count} step{'' if count == 1 else 's'}{where}; at least {MIN_EVENTS} are needed"
