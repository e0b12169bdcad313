"""What a filter learns of its sensors on the way: the passes of the smoother over what came so far, again and again.

At some moments the log up to there tells noise levels, delays, prior spreads and scale factors. The filter then runs
again from the start with these, and its attitudes count from that moment on: no attitude knows what comes after it.
What shows constants is motion, so these moments lie at 10, 16, 26, ... s of it, up to 400 s.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from attlog.estimators.base import Array
from attlog.estimators.filters.navigation.measured import Inputs
from attlog.estimators.filters.navigation.passes.sequence import solved
from attlog.estimators.filters.navigation.settings import NoiseLevels

TOLD_S = 400.0
"""Of a longer log so much is looked at for the constants, where it turns most (measured: docs/smoother.md)."""
FIRST_S, FURTHER = 10.0, 1.6
"""Seconds of motion before the first look, and how much more each further one has. 1.2 to 2 give the same in 2 %."""
GRID_S = 15.0
FASTEST, FIXES_S = 1.0, 2.0
"""A rate in rad/s, the mean between two fixes, and the longest time between these that counts."""
LEAST_FIXES_S = 10.0
PASSES = 3
DOUBT_S = 40.0
"""Noise of gyro and accelerometer counts as learnt by that much motion: at take-off it is still that of rest."""


@dataclass(frozen=True, slots=True)
class Constants:
    """``levels`` of noise, delays and spreads; ``state`` (39,) the smoothed state at the start, None where unknown."""

    levels: NoiseLevels
    state: Array | None = None


def stages(inputs: Inputs) -> list[tuple[int, int]]:
    """Begin and end (samples) of the parts of a run between which constants are learnt anew."""
    motion = np.cumsum(np.where(inputs.rest == 0, inputs.dt, 0.0))
    looks, seconds = [0], FIRST_S
    while seconds < min(motion[-1], TOLD_S):
        k = int(np.searchsorted(motion, seconds))
        if inputs.velocity is not None and inputs.sensed_at[k] - inputs.velocity.t[0] >= LEAST_FIXES_S:
            looks.append(k)
        seconds *= FURTHER
    return list(pairwise([*looks, len(inputs.t)]))


def learnt(inputs: Inputs, begun: NoiseLevels, gate: float) -> Constants:
    """What a run up to now tells of the sensors; ``begun`` are the levels of one who knows nothing of them."""
    solution = solved(telling(inputs, TOLD_S), begun, gate, passes=PASSES, spread=False)
    seen = float(np.sum(inputs.dt[inputs.rest == 0]))
    share = seen / (seen + DOUBT_S)
    levels = replace(
        held(solution.next),
        gyro=begun.gyro ** (1.0 - share) * solution.next.gyro**share,
        acc=begun.acc ** (1.0 - share) * solution.next.acc**share,
    )
    return Constants(levels, solution.begin.x + solution.found.first)


def told(inputs: Inputs, begun: NoiseLevels, gate: float) -> Constants:
    """What a whole run tells of the sensors, as a vehicle that was tuned before has them."""
    solution = solved(telling(inputs, TOLD_S), begun, gate, spread=False)
    return Constants(held(solution.next), solution.begin.x + solution.found.first)


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


def held(tuned: NoiseLevels) -> NoiseLevels:
    """Delays that were found are held within 10 and 5 ms."""
    prior = replace(tuned.prior, gnss_delay=0.010, mag_delay=0.005)
    return replace(tuned, prior=prior)
