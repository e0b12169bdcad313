"""Passes over a log: each calibrates noise, delays and prior spreads for the next, and the likeliest one is kept."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from attlog.base import rotation
from attlog.estimators.base import Array
from attlog.estimators.filters.navigation import calibration
from attlog.estimators.filters.navigation.layout import ARM, BA, EARTH, HARD, KICKED, POS, SCALE, SOFT, V
from attlog.estimators.filters.navigation.measured import Inputs
from attlog.estimators.filters.navigation.schedule import Schedule
from attlog.estimators.filters.navigation.settings import FINE_S, NODE_S, NoiseLevels
from attlog.estimators.filters.navigation.solve import Pass, Runner
from attlog.estimators.filters.navigation.start import StartState, covariance, start

PASSES, OWN_LINEARISATION = 5, 3
"""Passes, and how many of them the filter linearises about itself; the others, which a smoother tells, about the pass
before."""
SEARCH = {1: 0.030, 2: 0.012}
"""After these passes the GNSS delay is searched with this step in s."""
FOUND_SIGMA_S = 0.003
HEADINGS = 12
GRID_S = 15.0
FASTEST, FIXES_S = 1.0, 2.0
"""A rate in rad/s, the mean between two fixes, and the longest time between these that counts."""
WORSE = 0.01
"""A likelihood that falls by more is a pass that went wrong."""


CONSTANTS = {
    "acc_bias": (BA, 3, 0.01),
    "hard": (HARD, 3, 1e-3),
    "soft": (SOFT, 6, 1e-3),
    "field": (EARTH, 3, np.deg2rad(0.1)),
    "scale": (SCALE, 3, 5e-4),
    "arm": (ARM, 3, 0.01),
}
"""Constants of the sensors: their rows and how sure the whole log is of them."""


@dataclass(slots=True)
class Solution:
    """The pass that is kept, what it was run with, how it began, and the run's tools."""

    found: Pass
    tuned: NoiseLevels
    begin: StartState
    runner: Runner
    next: NoiseLevels
    """Levels after the last calibration."""
    passes: int
    kept: int
    ratios: Array
    """u^2 / D of each group (8,) in the pass that is kept."""


def solved(inputs: Inputs, begun: NoiseLevels, gate: float, passes: int = PASSES, spread: bool = True) -> Solution:
    """All passes of the smoother over one run; ``spread``: whether the attitude's variance is asked for."""
    runner = Runner(inputs)
    begun = calibration.first_guess(inputs, begun)
    tuned, flight = begun, float(np.sum(inputs.dt[inputs.rest == 0]))
    begin = first_start(runner, inputs, tuned, gate)
    moving = begin.how == "motion" or inputs.mag is None
    best: Solution | None = None
    along: Array | None = None
    schedule_of: Schedule | None = None
    kicked = False
    for number in range(passes):
        if number > 0:
            begin = start(inputs, tuned, begin if moving else None)
        told = spread and number >= min(OWN_LINEARISATION, passes - 1)
        schedule = runner.timetable.scheduled(tuned, every=FINE_S if told else NODE_S)
        use = along if number >= OWN_LINEARISATION and not kicked else None
        if use is not None and schedule_of is not None:
            use = _at_nodes(use, schedule_of, schedule, inputs)
        found = runner.both(schedule, begin, tuned.packed(inputs.gravity, gate), use, spread)
        better = best is None or found.likelihood >= best.found.likelihood - WORSE * abs(best.found.likelihood)
        ratios = calibration.ratios(found)
        following = calibration.calibrated(found, tuned, begun, flight, number < 2)
        if better:
            best = Solution(found, tuned, begin, runner, following, number + 1, number, ratios)
            along, schedule_of = found.smoothed_nodes(), schedule
        assert best is not None
        best.passes = number + 1
        kicked = found.memory[KICKED] > 0
        if moving:
            begin = _moved(begin, found)
        if number + 1 == passes:
            break
        if number >= 1:
            following = replace(following, prior=calibration.prior_of(found, begin.x, following.prior, begun.prior))
        following = _delays(runner, inputs, found, tuned, following, begin, gate, number)
        tuned = following
        best.next = tuned
    assert best is not None
    return best


def _delays(
    runner: Runner,
    inputs: Inputs,
    found: Pass,
    used: NoiseLevels,
    following: NoiseLevels,
    begin: StartState,
    gate: float,
    number: int,
) -> NoiseLevels:
    """The delays for the next pass."""
    moved = calibration.delays_by_state(found, used)
    following = replace(following, mag_delay=moved.mag_delay)
    if inputs.velocity is None:
        return following
    if number < max(SEARCH):
        following = replace(following, gnss_delay=moved.gnss_delay)
    if number in SEARCH:
        begin = start(inputs, following, begin if begin.how == "motion" or inputs.mag is None else None)
        following = calibration.delay_by_likelihood(runner, inputs, following, begin, gate, SEARCH[number])
    if number >= max(SEARCH):
        following = replace(following, prior=replace(following.prior, gnss_delay=FOUND_SIGMA_S))
    return following


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


def first_start(runner: Runner, inputs: Inputs, tuned: NoiseLevels, gate: float) -> StartState:
    """The start by the sensors; without a magnetometer the likeliest of twelve headings where GNSS can tell."""
    begin = start(inputs, tuned)
    if inputs.mag is not None or inputs.velocity is None:
        return begin
    schedule, par = runner.timetable.scheduled(tuned), tuned.packed(inputs.gravity, gate)
    tried = [begin.turned(2.0 * np.pi * k / HEADINGS) for k in range(HEADINGS)]
    for one in tried:
        one.P[:, :] = covariance(inputs, tuned, one.q, one.x, one.how, bool(one.P[POS, POS] < 100.0))
    found = [runner.forward(schedule, one.copy(), par).likelihood for one in tried]
    return tried[int(np.argmax(found))]


def _moved(begin: StartState, found: Pass) -> StartState:
    """The start with smoothed attitude, velocity and position."""
    out = begin.copy()
    out.q = rotation.normalize(rotation.multiply(rotation.from_rotvec(found.first[:3]), out.q))
    out.x[V : V + 6] += found.first[V : V + 6]
    return out


def _at_nodes(q: Array, before: Schedule, now: Schedule, inputs: Inputs) -> Array:
    """Attitudes at the nodes of another schedule."""
    t = inputs.sensed_at
    a, b = t[before.node_at], t[now.node_at]
    return np.ascontiguousarray(rotation.slerp(a, q, np.clip(b, a[0], a[-1])))


def causal(
    inputs: Inputs, tuned: NoiseLevels, gate: float, known: Array | None = None, constants: Collection[str] = ()
) -> tuple[Pass, StartState]:
    """One pass forward. ``tuned`` says noise and delays; ``constants`` of a ``known`` state (39,) are begun with."""
    runner = Runner(inputs)
    begin = first_start(runner, inputs, tuned, gate)
    if known is not None:
        begin = _begun_with(begin, known, constants)
    settling = begin.how == "motion" and inputs.velocity is not None
    schedule = runner.timetable.scheduled(tuned, settling, once=True)
    del runner.timetable
    found = runner.forward(schedule, begin, tuned.packed(inputs.gravity, gate))
    found.schedule = schedule.nodes()
    return found, begin


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
