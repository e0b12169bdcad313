"""The one pass forward of a filter, with constants of the sensors that passes found in the log."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from attlog.estimators.base import Array
from attlog.estimators.filters.navigation.layout import ARM, BA, EARTH, HARD, SCALE, SOFT
from attlog.estimators.filters.navigation.measured import Inputs
from attlog.estimators.filters.navigation.passes import online
from attlog.estimators.filters.navigation.passes.jumps import Jump
from attlog.estimators.filters.navigation.passes.sequence import first_start
from attlog.estimators.filters.navigation.settings import NoiseLevels
from attlog.estimators.filters.navigation.solve import Pass, Runner
from attlog.estimators.filters.navigation.start import StartState

GRID_S = 15.0
FASTEST, FIXES_S = 1.0, 2.0
"""A rate in rad/s, the mean between two fixes, and the longest time between these that counts."""

CONSTANTS = {
    "acc_bias": (BA, 3, 0.01),
    "hard": (HARD, 3, 1e-3),
    "soft": (SOFT, 6, 1e-3),
    "field": (EARTH, 3, np.deg2rad(0.1)),
    "scale": (SCALE, 3, 5e-4),
    "arm": (ARM, 3, 0.01),
}
"""Constants of the sensors: their rows and how sure the whole log is of them."""


def telling(inputs: Inputs, longest: float) -> Inputs:
    """What constants are found in: all of a run, or of a longer one the ``longest`` s with fixes that turn most.

    Who accelerates has to turn before: without that nothing shows a delay, and without turns nothing soft iron. Rest
    and what lacks fixes count nothing, and no rate counts more than FASTEST, else a blow would win.
    """
    t, fixes = inputs.sensed_at, inputs.velocity
    if fixes is None or t[-1] - t[0] <= longest:
        return inputs
    at = np.clip(np.searchsorted(t, fixes.t), 0, len(t) - 1)
    turned = np.cumsum(inputs.gyr * inputs.dt[:, None], axis=0)[at]
    seconds = np.diff(t[at])
    moving = (seconds > 0.0) & (seconds < FIXES_S) & (inputs.rest[at[1:]] == 0)
    square = np.sum(np.diff(turned, axis=0) ** 2, axis=1) / np.where(moving, seconds, 1.0) ** 2
    told = np.cumsum(np.where(moving, np.minimum(square, FASTEST**2) * seconds, 0.0))
    told = np.concatenate([[0.0, 0.0], told])
    begins = np.arange(t[0], t[-1] - longest + GRID_S, GRID_S)
    seen = told[np.searchsorted(fixes.t, begins + longest)] - told[np.searchsorted(fixes.t, begins)]
    begin = float(begins[np.argmax(seen)])
    a, b = np.searchsorted(t, [begin, begin + longest])
    return inputs.part(int(a), int(b))


def causal(
    inputs: Inputs, tuned: NoiseLevels, gate: float, known: Array | None = None, constants: Collection[str] = ()
) -> tuple[Pass, StartState, tuple[Jump, ...]]:
    """One pass forward. ``tuned`` says noise and delays; ``constants`` of a ``known`` state (39,) are begun with."""
    runner = Runner(inputs)
    begin = first_start(runner, inputs, tuned, gate)
    if known is not None:
        begin = _begun_with(begin, known, constants)
    settling = begin.how == "motion" and inputs.velocity is not None
    schedule = runner.timetable.scheduled(tuned, settling, once=True)
    del runner.timetable
    found, jumps = online.filtered(runner, schedule, begin, tuned.packed(inputs.gravity, gate))
    found.schedule = schedule.nodes()
    return found, begin, jumps


def held(tuned: NoiseLevels) -> NoiseLevels:
    """Delays that were found are held within 10 and 5 ms."""
    prior = replace(tuned.prior, gnss_delay=0.010, mag_delay=0.005)
    return replace(tuned, prior=prior)


def _begun_with(begin: StartState, smoothed: Array, constants: Collection[str]) -> StartState:
    """A start with some constants of the sensors where a smoothed state (39,) has them."""
    out = begin.copy()
    level = float(np.hypot(smoothed[EARTH], smoothed[EARTH + 1]))
    for name in constants:
        row, count, sigma = CONSTANTS[name]
        sigma *= max(level, 1e-3) if name == "field" else 1.0
        own = slice(row, row + count)
        out.x[own] = smoothed[own]
        out.P[own, :] = 0.0
        out.P[:, own] = 0.0
        out.P[own, own] = np.diag(np.where(np.diag(begin.P)[own] > 0.0, sigma**2, 0.0))
    return out
