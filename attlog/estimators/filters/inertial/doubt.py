"""What the covariance of ``mekf`` leaves out: an accelerometer bias beyond its prior, accelerations that last.

    D = d error / d bias:   D <- F D,   D <- (I - K H) D,   variance += sigma^2 D D^T                  (1)
    excess = <u^2 / w>,     u = sum of what velocity corrects in tilt,   w = its variance as modelled   (2)

The prior of the bias is tight, because a wide one takes every acceleration that lasts for a bias (flights: tilt 1.0 to
1.5 deg and more). The attitude keeps it; the sigma does not: (1) is Schmidt's consider parameter, a bias that is not
estimated but counted. (2) asks whether corrections add up as white noise would. Velocity that lasts for seconds makes
them agree with each other; the variance of tilt is multiplied by their excess.

Source: Jazwinski1970, chapter 8 (consider parameters).
"""

from __future__ import annotations

import math
from typing import Any

from attlog.estimators.filters.inertial.layout import (
    ACC_BIAS_CONSIDERED,
    EXCESS,
    REACH,
    SIGMA,
    SLOW,
    SLOW_VARIANCE,
    N,
    P,
    T,
    X,
    square,
)

SLOW_TIME, EXCESS_TIME = 5.0, 20.0
"""Corrections add up over that long [s]; the excess is a mean over that long. 3 to 10 and 10 to 30 s give the same."""


def correct_reach(state: Any, k: int, s: float, C: int) -> None:
    """(1) at the update that measures entry k of the error: K = s times the column at ``C``."""
    for i in range(3):
        c = s * state[REACH + N * i + k]
        for j in range(N):
            state[REACH + N * i + j] -= c * state[C + j]


def add_slow_variance(state: Any, k: int, r: float) -> None:
    """(2): the variance of what an update with entry k, measured with variance ``r``, will correct in tilt."""
    row = P + N * k
    state[SLOW_VARIANCE] += (square(state[row]) + square(state[row + 1])) / (state[row + k] + r)


def fade_slow(state: Any) -> None:
    """(2): older corrections count less."""
    fade = math.exp(-state[T] / SLOW_TIME)
    state[SLOW] *= fade
    state[SLOW + 1] *= fade
    state[SLOW_VARIANCE] *= fade * fade


def weigh_slow(state: Any) -> None:
    """(2): the excess after the block's velocity has corrected the tilt by the error x."""
    state[SLOW] += state[X]
    state[SLOW + 1] += state[X + 1]
    ratio = (square(state[SLOW]) + square(state[SLOW + 1])) / max(state[SLOW_VARIANCE], 1e-16)
    state[EXCESS] += (1.0 - math.exp(-state[T] / EXCESS_TIME)) * (ratio - state[EXCESS])


def own_sigmas(state: Any, params: Any) -> None:
    """Sigma of tilt (two axes together) and of heading."""
    tilt = 0.0
    heading = 0.0
    for i in range(3):
        tilt += square(state[REACH + N * i]) + square(state[REACH + N * i + 1])
        heading += square(state[REACH + N * i + 2])
    bias = square(params[ACC_BIAS_CONSIDERED])
    known = max(state[P] + state[P + N + 1], 0.0)
    state[SIGMA] = math.sqrt(known * max(state[EXCESS], 1.0) + bias * tilt)
    state[SIGMA + 1] = math.sqrt(max(state[P + 2 * (N + 1)], 0.0) + bias * heading)
