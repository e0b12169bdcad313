"""What does the gyro itself wander by in flight? Below that nobody can order what filters add to it."""

from __future__ import annotations

import math

import numpy as np

from attlog.metrics.base import Case, per_case
from attlog.metrics.evidence.phases import phase_spans
from attlog.metrics.noise import windows

TINY = 1e-18
"""A gyro that shows one value has no logarithm, deg^2."""


@per_case
def gyro_share(case: Case, index: int, phase: str) -> list[float]:
    """What the gyro of a unit itself wanders by in windows of a phase: deg about roll, pitch, heading and tilt.

    Neither its noise nor motion between samples can be integrated, and both show as changes d from one
    sample to the next. Rate noise of variance d^2 / 2 integrated every dt walks at random, and keeps 1/15 of its last
    variance about its own line: sqrt(dt T / 30) d in windows of T = 5 s, the typical window as for the rows.
    On 24 simulated flights with truth 0.4 to 2 times what the integrated gyro wanders by in hover.
    """
    gyro, found = case.log.imus[index].gyro, []
    for span in phase_spans(case, phase, phase):
        for _, inside in windows.filled_in(case, gyro.t_best, phase, span):
            if inside is not None:
                step = (gyro.t_best[inside.stop - 1] - gyro.t_best[inside.start]) / (inside.stop - inside.start - 1)
                changes = np.nanmean(np.diff(np.degrees(gyro.x[inside]), axis=0) ** 2, axis=0)
                found.append(step * windows.SECONDS / 30.0 * changes)
    if not found:
        return [0.0] * 4
    roll, pitch, heading = np.exp(np.mean(np.log(np.maximum(found, TINY)), axis=0)).tolist()
    return [math.sqrt(v) for v in (roll, pitch, heading, 0.5 * (roll + pitch))]
