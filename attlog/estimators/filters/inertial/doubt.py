"""What the covariance of ``mekf`` leaves out: an accelerometer bias beyond its prior, accelerations that last.

    D = d error / d bias:   D <- F D,   D <- (I - K H) D,   variance += sigma^2 D D^T                  (1)
    excess = <u^2 / w>,     u = sum of what velocity corrects in tilt,   w = its variance as modelled   (2)
    doubt  = (<(L - <L>)^2> + <(Z - <Z>)^2>) / <L>^2,   L, Z the field's level and down parts,
             or <(D - psi)^2> where that is more                                                     (3)

The prior of the bias is tight, because a wide one takes every acceleration that lasts for a bias (flights: tilt 1.0 to
1.5 deg and more). The attitude keeps it; the sigma does not: (1) is Schmidt's consider parameter, a bias that is not
estimated but counted. (2) asks whether corrections add up as white noise would. Velocity that lasts for seconds makes
them agree with each other; the variance of tilt is multiplied by their excess.

A field fixed to the body bends the heading as much as it changes L and Z, on average over a turn; a compass that is
stuck turns with the body. (3) beyond what rooms do is a variance of heading that no averaging takes away. It moves no
attitude either.

Source: Jazwinski1970, chapter 8 (consider parameters).
"""

from __future__ import annotations

import math
from typing import Any

from attlog.estimators.filters.inertial.layout import (
    ACC_BIAS_CONSIDERED,
    DOWN,
    DOWN_SPREAD,
    EXCESS,
    FIELD_CLOCK,
    FIELD_DOUBT,
    FIELD_OFF,
    H_SINCE,
    HEADING_DOUBT,
    HL,
    LEVEL,
    LEVEL_SPREAD,
    MOVING_RATE,
    REACH,
    SIGMA,
    SLOW,
    SLOW_VARIANCE,
    TURNED,
    N,
    P,
    T,
    X,
    square,
)

SLOW_TIME, EXCESS_TIME = 5.0, 20.0
"""Corrections add up over that long [s]; the excess is a mean over that long. 3 to 10 and 10 to 30 s give the same."""

SOUND_FIELD, LOST = math.radians(12.0), math.radians(104.0)
"""Rooms and currents bend a sound field by that much; sigma [rad] of a heading of which nothing is known."""
FIELD_MEMORY, FIELD_KNOWN = 30.0, 20.0
"""Seconds of motion over which the field is compared with itself; before that much the heading is its first."""


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


def watch_field(state: Any, value: float) -> None:
    """(3) after the low-passed field ``HL`` was renewed; ``value`` [rad]: by how much it would turn the heading."""
    level = math.sqrt(square(state[HL]) + square(state[HL + 1]))
    down = state[HL + 2]
    if state[FIELD_CLOCK] == 0.0:
        state[LEVEL] = level
        state[DOWN] = down
    moving = min(1.0, math.sqrt(state[TURNED] / state[T]) / MOVING_RATE)
    state[FIELD_CLOCK] += moving * state[H_SINCE]
    share = moving * state[H_SINCE] / min(max(state[FIELD_CLOCK], 1.0), FIELD_MEMORY)
    off = level - state[LEVEL]
    state[LEVEL] += share * off
    state[LEVEL_SPREAD] += share * (off * off - state[LEVEL_SPREAD])
    off = down - state[DOWN]
    state[DOWN] += share * off
    state[DOWN_SPREAD] += share * (off * off - state[DOWN_SPREAD])
    state[FIELD_OFF] += share * (value * value - state[FIELD_OFF])
    spread = (state[LEVEL_SPREAD] + state[DOWN_SPREAD]) / max(square(state[LEVEL]), 1e-30)
    spread = max(spread, state[FIELD_OFF])
    state[FIELD_DOUBT] = min(max(spread - square(SOUND_FIELD), 0.0), square(LOST))
    if state[FIELD_CLOCK] < FIELD_KNOWN:
        state[HEADING_DOUBT] = state[FIELD_DOUBT]


def take_field(state: Any, gain: float) -> None:
    """(3): the heading takes on that share of the field's doubt."""
    keep = square(1.0 - gain)
    state[HEADING_DOUBT] = keep * state[HEADING_DOUBT] + (1.0 - keep) * state[FIELD_DOUBT]


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
    state[SIGMA + 1] = math.sqrt(max(state[P + 2 * (N + 1)], 0.0) + bias * heading + state[HEADING_DOUBT])
