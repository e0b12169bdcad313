"""The passes with the compass and without it, which share the gyro and so its jumps.

The run with the compass sees the time of a jump sharper, and jumps about the vertical while nothing accelerates; the
one without it is not fooled by a bad compass. What the second finds makes the first look closer, and what the first
finds the second takes over where its own size of the jump agrees.
"""

from __future__ import annotations

from dataclasses import replace

from attlog.estimators.filters.navigation.measured import Inputs
from attlog.estimators.filters.navigation.passes import jumps as jumping
from attlog.estimators.filters.navigation.passes.sequence import Solution, solved
from attlog.estimators.filters.navigation.settings import NoiseLevels


def solved_twice(inputs: Inputs, begun: NoiseLevels, gate: float, passes: int) -> tuple[Solution, Solution]:
    """The runs with and without the compass over inputs that hold one."""
    blind = replace(inputs, mag=None)
    without = solved(blind, begun, gate, passes)
    suspected = without.unmodelled > 0.0 or any(jump.counts for jump in without.jumps)
    with_compass = solved(inputs, begun, gate, passes, suspected=suspected)
    known = {jump.t: jump.t_sigma for jump in with_compass.jumps if jump.counts}
    if known:
        again = solved(blind, begun, gate, passes, known=tuple(known))
        if jumping.agree(with_compass.jumps, again.jumps):
            jumps = tuple(replace(jump, t_sigma=known.get(jump.t, jump.t_sigma)) for jump in again.jumps)
            without = replace(again, jumps=jumps)
    return with_compass, without
