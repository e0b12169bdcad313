"""How late is an estimate in step events? One linear fit of its turning to the reference's, all events together.

Body rates w are summed increments of attitude over a span h; u is the event's axis.
Minimised over delay tau, gain k, body misalignment phi, aiding gains a_j
(:mod:`attlog.metrics.evidence.aiding`) and one constant c per event:

    sum ( u.w_est(t + tau) - k u.w_ref(t) - phi.(w_ref x u) - sum_j a_j u.n_j(t + tau) - c )^2

Gauss-Newton in tau; everything else is linear.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.evidence import aiding
from attlog.metrics.steps.events import AXES
from attlog.metrics.steps.fit.groups import Groups
from attlog.metrics.steps.fit.solution import GAIN, PLAIN, Fit, Sums, Y, left, ridge

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
