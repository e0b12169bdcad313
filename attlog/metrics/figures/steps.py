"""Arrays of steps: one that is like most of them, and what all of them have in common."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.base import Case, per_case
from attlog.metrics.figures.trace import Trace
from attlog.metrics.steps import curves as step_curves
from attlog.metrics.steps import events as steps
from attlog.metrics.steps import fits as step_fits
from attlog.metrics.steps.curves import Curve
from attlog.metrics.steps.events import StepEvent
from attlog.metrics.steps.fit.groups import STRIDE_S
from attlog.reference.model import Row

Array = NDArray[np.float64]

GRID_S = np.linspace(-0.3, 1.2, 151)
"""Times from the onset at which events are compared."""
SHARES = (0.1, 0.5, 0.9)
"""The band holds four in five of the events."""
FEWEST = 3
"""Events from which a band is drawn; of fewer it would be the events themselves."""


def step_traces(case: Case, row: Row) -> list[Trace]:
    """``step``: the representative event. ``steps``: over all events of each axis, and of all axes together."""
    if row.is_reference or case.reference.rate < step_fits.MIN_REFERENCE_HZ:
        return []
    curves = step_curves.curves(case, row, "all")
    event = representative(case)
    found = [one(case, row, curve) for curve in curves if curve.event == event]
    if len(curves) < FEWEST:
        return found
    axes, (error, moved) = np.array([c.event.axis for c in curves]), in_percent(curves)
    for axis in (None, *range(len(steps.AXES))):
        own = np.ones(len(axes), bool) if axis is None else axes == axis
        if np.count_nonzero(own) >= FEWEST and (axis is not None or len(set(axes.tolist())) > 1):
            found.append(together(row, error[own], moved[own], "all axes" if axis is None else steps.AXES[axis]))
    return found


@per_case
def representative(case: Case) -> StepEvent | None:
    """The event of median stroke about the axis with most events; None without events."""
    events = steps.of_reference(case)
    if not events:
        return None
    count = [sum(e.axis == axis for e in events) for axis in range(len(steps.AXES))]
    own = sorted((e for e in events if e.axis == int(np.argmax(count))), key=lambda e: (abs(e.delta_deg), e.onset))
    return own[(len(own) - 1) // 2]


def one(case: Case, row: Row, curve: Curve) -> Trace:
    """What row, reference and set-point turned about the axis of one event since its onset, stroke positive."""
    columns = {"est": curve.row, "ref": curve.reference}
    wanted = step_curves.setpoint(case, curve)
    if wanted is not None:
        columns["set"] = wanted
    event = curve.event
    return Trace("step", row.name, curve.seconds, columns, f"{steps.AXES[event.axis]}@{event.onset:.2f}")


def in_percent(curves: list[Curve]) -> tuple[Array, Array]:
    """The row's error and the reference's turning (events, times) laid on their onset, in % of the stroke."""
    stroke = np.array([abs(c.event.delta_deg) for c in curves])[:, None]
    error = laid(curves, [c.error for c in curves]) / stroke * 100.0
    return error, laid(curves, [c.reference for c in curves]) / stroke * 100.0


def together(row: Row, error: Array, moved: Array, axis: str) -> Trace:
    """Median and band of the row's error over events (events, times) in % of the stroke; NaN where few reach."""
    enough = np.isfinite(error).sum(axis=0) >= FEWEST
    columns = {name: np.full(len(GRID_S), np.nan) for name in ("median", "low", "high", "ref")}
    columns["low"][enough], columns["median"][enough], columns["high"][enough] = of_known(error[:, enough], SHARES)
    columns["ref"][enough] = of_known(moved[:, enough], (0.5,))[0]
    return Trace("steps", row.name, GRID_S, columns, axis, values={"events": float(len(error))})


def of_known(x: Array, shares: tuple[float, ...]) -> Array:
    """Quantiles (len(shares), n) of the numbers in each column of (k, n), NaN left out; one number at least in each.

    As numpy.nanquantile has them, which goes through the columns one by one.
    """
    ordered, known = np.sort(x, axis=0), np.isfinite(x).sum(axis=0)
    found = np.empty((len(shares), x.shape[1]))
    for k, share in enumerate(shares):
        place = share * (known - 1)
        below = np.floor(place).astype(np.int64)
        low, high = (np.take_along_axis(ordered, i[None], axis=0)[0] for i in (below, np.minimum(below + 1, known - 1)))
        found[k] = low + (place - below) * (high - low)
    return found


def laid(curves: list[Curve], values: list[Array]) -> Array:
    """Values (n,) of each curve on the common times (events, times); NaN beyond its ends.

    All curves lie behind each other: a row has hundreds.
    """
    begin = STRIDE_S * np.arange(len(curves))
    seconds = [c.seconds for c in curves]
    at = GRID_S + begin[:, None]
    found = np.interp(at, np.concatenate([s + b for s, b in zip(seconds, begin, strict=True)]), np.concatenate(values))
    low, high = (np.array([s[k] for s in seconds])[:, None] for k in (0, -1))
    return np.where((low <= GRID_S) & (high >= GRID_S), found, np.nan)
