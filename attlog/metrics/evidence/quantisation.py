"""What can the steps of the logged values hide? Noise below that is not known, and not ranked."""

from __future__ import annotations

import math

import numpy as np

from attlog.metrics.base import Case, per_case
from attlog.metrics.noise.windows import SECONDS

STEP_SAMPLES = 20_000
"""Gyro samples of the whole log that are enough to see the step of its values."""


@per_case
def hidden_deg(case: Case, index: int) -> list[float]:
    """The angle noise in deg per body axis at rest that the steps of the logged gyro of unit ``index`` can hide.

    White rate noise of half a step q may not show at all. Integrated every dt it walks at
    random, and a random walk of length T keeps 1/15 of its last variance about its own
    straight line: sqrt(dt T / 15) q / 2 in windows of T = 5 s. Tiny for floating-point
    logs, 0.005 deg at 10 Hz and 1 mrad/s, infinite for an axis that never changes.
    """
    gyro = case.log.imus[index].gyro
    if len(gyro.t) < 2:
        return [0.0] * 3
    some = np.degrees(gyro.x[:: len(gyro.t) // STEP_SAMPLES + 1])
    steps = [np.diff(np.unique(x[np.isfinite(x)])).min(initial=math.inf) for x in some.T]
    share = 0.5 * math.sqrt(float(np.median(np.diff(gyro.t))) * SECONDS / 15.0)
    return [share * float(step) for step in steps]
