"""The one pass forward of a filter, with constants of the sensors that passes found in the log."""

from __future__ import annotations

from collections.abc import Collection

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

CONSTANTS = {
    "acc_bias": (BA, 3, 0.01),
    "hard": (HARD, 3, 1e-3),
    "soft": (SOFT, 6, 1e-3),
    "field": (EARTH, 3, np.deg2rad(0.1)),
    "scale": (SCALE, 3, 5e-4),
    "arm": (ARM, 3, 0.01),
}
"""Constants of the sensors: their rows and how sure the whole log is of them."""


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
