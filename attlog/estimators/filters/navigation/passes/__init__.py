"""Passes over a log: each calibrates noise, delays and prior spreads for the next, and the likeliest one is kept."""

from attlog.estimators.filters.navigation.passes.causal import CONSTANTS, causal
from attlog.estimators.filters.navigation.passes.learning import Constants, learnt, stages, told
from attlog.estimators.filters.navigation.passes.sequence import Solution, first_start, solved
from attlog.estimators.filters.navigation.passes.twice import solved_twice

__all__ = [
    "CONSTANTS",
    "Constants",
    "Solution",
    "causal",
    "first_start",
    "learnt",
    "solved",
    "solved_twice",
    "stages",
    "told",
]
