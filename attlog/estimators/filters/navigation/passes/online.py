"""Jumps of the gyro bias as a filter finds them: by what came so far, and of use from then on.

Each second the filter asks whether its innovations have grown. Then the scores of the last seconds (see
:mod:`jumps`) say whether a jump of the bias explains it; where one does, these seconds are filtered again with it,
and the filter goes on from there. What it said before stands. A compass that is turned or offset looks like a jump
too, but such a jump worsens the fit of GNSS: then there is none.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from attlog.estimators.base import Array
from attlog.estimators.filters.navigation.layout import LIKELIHOOD, PHI, ROW
from attlog.estimators.filters.navigation.passes import jumps as jumping
from attlog.estimators.filters.navigation.schedule import Schedule
from attlog.estimators.filters.navigation.settings import JUMP_RAD_S
from attlog.estimators.filters.navigation.solve import Pass, Runner
from attlog.estimators.filters.navigation.start import StartState

EVERY_S, WINDOW_S = 1.0, 10.0
"""How often the filter asks, and how far back it looks."""
GROWN = 0.5
"""Mean square, over the gate's, of the worst of three innovations of velocity or field: 0.3 where noise levels fit."""
GAIN, LARGEST_RAD_S = 40.0, np.deg2rad(4.0)
"""Least gain in log likelihood, and what a filter that a bad compass misleads would take for a jump."""
GNSS, GNSS_GAIN = slice(0, 4), -5.0
"""Groups of GNSS velocities and positions, and what they must gain at least: -3 and more for real jumps on 24 flights
(a plane's -12 in the first second), -6 to -32 in 11 of the 18 copies where a compass feigned one."""
LOOKS, SELDOM = 5, 5
"""After so many looks in vain it looks in every fifth second only: aids that stay bad must not cost minutes."""
UNSURE_S = 0.5
"""How well the time of a jump is known, about."""
FRESH_S = 0.3
"""So near to the end a jump is not told from a single odd fix."""


def filtered(
    runner: Runner, schedule: Schedule, begin: StartState, par: Array
) -> tuple[Pass, tuple[jumping.Jump, ...]]:
    """The way forth with jumps of the gyro bias where the innovations ask for them, and these jumps."""
    schedule = replace(schedule, jump=schedule.jump.copy())
    found, state = runner.begun(schedule, begin)
    when = runner.inputs.sensed_at[schedule.node_at]
    bounds = np.unique(np.append(np.searchsorted(when, np.arange(when[0], when[-1], EVERY_S)), [0, len(when)]))
    begun: list[tuple[int, list[Array]]] = []
    told: list[jumping.Jump] = []
    looks = 0
    for second, (a, b) in enumerate(pairwise(bounds)):
        begun.append((int(a), [x.copy() for x in state]))
        while when[b - 1] - when[begun[0][0]] > WINDOW_S:
            begun.pop(0)
        runner.run(int(a), int(b), found, state, begin, par, None, None)
        looks = looks + 1 if grown(found.ratio[a:b]) else 0
        if looks == 0 or (looks > LOOKS and second % SELDOM):
            continue
        first, before = begun[0]
        shocks, _, without = runner.shocks(schedule, begin, par, before, first, int(b))
        gain, size = jumping.gains(shocks)
        rate = np.sqrt(np.sum(size**2, axis=1))
        gain[(when[first:b] > when[b - 1] - FRESH_S) | (rate < jumping.SMALLEST_RAD_S)] = -np.inf
        k = int(np.argmax(gain))
        if gain[k] < GAIN or rate[k] > LARGEST_RAD_S or len(told) == jumping.MOST:
            continue
        opened = replace(schedule, jump=schedule.jump.copy())
        opened.jump[first + k] = JUMP_RAD_S
        _, after, with_it = runner.shocks(opened, begin, par, before, first, int(b))
        if after[3][LIKELIHOOD] - state[3][LIKELIHOOD] < GAIN:
            continue
        if np.sum((with_it - without)[GNSS]) < GNSS_GAIN:
            continue
        for i in range(3):  # what it turned while its time is unsure
            after[2][(ROW + 1) * (PHI + i)] += (UNSURE_S * size[k, i]) ** 2
        state[:] = after
        schedule.jump[:] = opened.jump
        begun.clear()
        looks = 0
        told.append(jumping.Jump(float(when[first + k]), 0.0, size[k], np.zeros(3)))
    found.memory = state[3]
    return found, tuple(told)


def grown(ratio: Array) -> bool:
    """Whether velocities or fields did not fit of late; ``ratio`` (k, 4) at some nodes, NaN without an aid."""
    for column in (0, 3):
        known = ratio[np.isfinite(ratio[:, column]), column]
        if len(known) and float(np.mean(np.minimum(known, 9.0))) > GROWN:
            return True
    return False
