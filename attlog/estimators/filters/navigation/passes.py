"""Passes over a log: each calibrates noise, delays and prior spreads for the next, and the likeliest one is kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from attlog.core import rotation
from attlog.core.log_cache import cached_by_content
from attlog.estimators.filters.navigation import calibration
from attlog.estimators.filters.navigation import jumps as jumping
from attlog.estimators.filters.navigation.inputs import FINE_S, NODE_S, Inputs, NoiseLevels
from attlog.estimators.filters.navigation.jumps import Jump
from attlog.estimators.filters.navigation.model import MEM, E, State
from attlog.estimators.filters.navigation.schedule import Schedule
from attlog.estimators.filters.navigation.solve import Pass, Runner
from attlog.estimators.filters.navigation.start import StartState, covariance, start
from attlog.estimators.interface import Array

# The passes of the smoother: five, or more where the gyro bias jumps.

# Passes, and how many of them the filter linearises about itself; the others about the pass before.
PASSES, OWN_LINEARISATION = 5, 3
# After so many passes jumps of the gyro bias are looked for: noise levels are calibrated, and not yet to a jump.
LOOK = 3
# The pass, counted from 0, after which the likelihood is searched for the GNSS delay; before, the state estimates it.
SEARCH_AFTER = 2
# Grid of that search, and the prior spread of the delay in later passes, s.
SEARCH_STEP_S, FOUND_SIGMA_S = 0.012, 0.003
# Start headings that are tried without a compass.
HEADINGS = 12
# Nodes between comparisons of their log likelihoods, and how far one may trail the best: 20 sigma. Winners of 118 runs
# trailed by 31 at most, but for three logs whose aids contradict each other; a smaller limit saves 1 to 5 ms.
RACE_NODES, MAX_TRAIL = 100, 0.5 * 20.0**2
# A likelihood that falls by more is a pass that went wrong.
WORSE = 0.01


@dataclass(slots=True)
class Solution:
    """The pass that is kept, what it was run with, and how it began."""

    found: Pass
    tuned: NoiseLevels
    begin: StartState
    # Levels after the last calibration.
    next: NoiseLevels
    passes: int
    kept: int
    # u^2 / D of each group (8,) in the pass that is kept.
    ratios: Array
    # Jumps of the gyro bias that are modelled.
    jumps: tuple[jumping.Jump, ...] = ()
    # What a further jump would add to the likelihood that cannot be modelled; 0 where there is none.
    unmodelled: float = 0.0


def solved(
    inputs: Inputs,
    begun: NoiseLevels,
    gate: float,
    passes: int = PASSES,
    spread: bool = True,
    suspected: bool = False,
    known: jumping.Times = (),
    before: NoiseLevels | None = None,
) -> Solution:
    """Run all passes of the smoother; ``spread``: whether the attitude's variance is needed.

    Jumps of the gyro bias are looked for after LOOK passes; with one that is found the passes begin anew.
    ``suspected``: another run over the same gyro finds one; then, or if the bias at rest changed, less evidence is
    enough. ``known``: times in s of jumps that need none. ``before``: levels from a shorter part of the same run,
    which replace the first pass.
    """
    runner, look = Runner(inputs), min(LOOK, passes)
    begun = calibration.first_guess(inputs, begun)
    run = Sequence(runner, begun, gate, passes, spread, known)
    if before is not None:
        run.tuned, run.number = before, 1
    run.advance(look)
    suspected |= inputs.mag is None or jumping.changed_at_rest(inputs)
    least = jumping.MIN_GAIN if suspected else jumping.GAIN_COMPASS
    unmodelled = 0.0
    while True:
        when, gain = run.candidate()
        if gain < least:
            break
        unmodelled = gain
        if len(run.jumps) == jumping.MAX_JUMPS:
            break
        times, gain = run.tried(when)
        if gain < least:
            break
        further = Sequence(runner, begun, gate, passes, spread, times)
        further.advance(look)
        if not further.believable:
            break
        run, unmodelled = further, 0.0
    if len(run.jumps) > len(known):
        run.place_jumps()
    run.advance(passes)
    return replace(run.best, jumps=run.modelled, unmodelled=unmodelled)


@dataclass(slots=True)
class Sequence:
    """Passes over one run, with jumps of the gyro bias at given times, and the likeliest pass of them."""

    runner: Runner
    begun: NoiseLevels
    gate: float
    passes: int
    spread: bool
    jumps: jumping.Times
    jump_sigmas: jumping.Times = field(init=False)
    tuned: NoiseLevels = field(init=False)
    begin: StartState = field(init=False)
    moving: bool = field(init=False)
    number: int = 0
    kept: Solution | None = None
    along: Array | None = None
    schedule: Schedule | None = None
    kicked: bool = False

    def __post_init__(self) -> None:
        self.runner.timetable.jumps = self.jumps
        self.jump_sigmas = (0.0,) * len(self.jumps)
        self.tuned = self.begun
        self.begin = first_start(self.runner, self.runner.inputs, self.begun, self.gate)
        self.moving = self.begin.how == "motion" or self.runner.inputs.mag is None

    @property
    def best(self) -> Solution:
        """The likeliest pass so far."""
        assert self.kept is not None
        return self.kept

    def advance(self, to: int) -> None:
        """Run passes until there were so many."""
        self.runner.timetable.jumps = self.jumps
        while self.number < to:
            self._once()
            self.number += 1

    def _once(self) -> None:
        """Run one pass and, unless it is the last, calibrate for the next."""
        inputs, number, tuned = self.runner.inputs, self.number, self.tuned
        if number > 0:
            self.begin = start(inputs, tuned, self.begin if self.moving else None)
        final = self.spread and number >= min(OWN_LINEARISATION, self.passes - 1)
        schedule = self.runner.timetable.scheduled(tuned, every=FINE_S if final else NODE_S)
        use = self.along if number >= OWN_LINEARISATION and not self.kicked else None
        if use is not None and self.schedule is not None:
            use = _at_nodes(use, self.schedule, schedule, inputs)
        found = self.runner.both(schedule, self.begin, tuned.settings(inputs.gravity, self.gate), use, self.spread)
        before = self.kept
        better = before is None or found.likelihood >= before.found.likelihood - WORSE * abs(before.found.likelihood)
        ratios = calibration.ratios(found)
        flight = float(np.sum(inputs.dt[inputs.rest == 0]))
        following = calibration.calibrated(found, tuned, self.begun, flight, number < 2)
        if better:
            self.kept = Solution(found, tuned, self.begin, following, number + 1, number, ratios)
            self.along, self.schedule = found.smoothed_nodes(), schedule
        self.best.passes = number + 1
        self.kicked = found.memory[MEM.kicked] > 0
        if self.moving:
            self.begin = _moved(self.begin, found)
        if number + 1 == self.passes:
            return
        if number >= 1:
            prior = calibration.prior_of(found, self.begin.x, following.prior, self.begun.prior)
            following = replace(following, prior=prior)
        self.tuned = _delays(self.runner, inputs, found, tuned, following, self.begin, self.gate, number)
        self.best.next = self.tuned

    @property
    def modelled(self) -> tuple[jumping.Jump, ...]:
        """The jumps of the likeliest pass."""
        found = self.best.found
        when = self.runner.inputs.sensed_at[found.schedule.node_at]
        return jumping.modelled_jumps(found, when, self.jumps, self.jump_sigmas)

    @property
    def believable(self) -> bool:
        """Return whether a gyro bias can make all its jumps."""
        return all(jump.believable for jump in self.modelled)

    def candidate(self) -> tuple[float, float]:
        """Return when in s a further jump is likeliest, and its gain in log likelihood."""
        found = self.best.found
        return jumping.candidate(found, self.runner.inputs.sensed_at[found.schedule.node_at], self.jumps)

    def tried(self, when: float) -> tuple[jumping.Times, float]:
        """Return the jumps with one more near ``when`` s, and its gain in log likelihood."""
        likelihood = self._likelihood()
        times, _ = jumping.refine_times(tuple(sorted((*self.jumps, when))), likelihood)
        return times, likelihood(times) - likelihood(self.jumps)

    def place_jumps(self) -> None:
        """Move each jump to where the forward pass is likeliest."""
        self.jumps, self.jump_sigmas = jumping.refine_times(self.jumps, self._likelihood())

    def _likelihood(self) -> Callable[[jumping.Times], float]:
        """Return the log likelihood of the forward pass as a function of the times of jumps."""
        timetable, gravity = self.runner.timetable, self.runner.inputs.gravity
        begin, tuned = self.best.begin, self.best.tuned
        schedule, par = timetable.scheduled(tuned), tuned.settings(gravity, self.gate)

        def likelihood(times: jumping.Times) -> float:
            at = replace(schedule, jump=timetable.jumps_at(schedule.node_at, times))
            return self.runner.forward(at, begin.copy(), par).likelihood

        return likelihood


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
    """Return the delays for the next pass."""
    moved = calibration.delays_by_state(found, used)
    following = replace(following, mag_delay=moved.mag_delay)
    if inputs.velocity is None or number > SEARCH_AFTER:
        return following
    following = replace(following, gnss_delay=moved.gnss_delay)
    if number < SEARCH_AFTER:
        return following
    begin = start(inputs, following, begin if begin.how == "motion" or inputs.mag is None else None)
    following = calibration.delay_by_likelihood(runner, inputs, following, begin, gate, SEARCH_STEP_S)
    return replace(following, prior=replace(following.prior, gnss_delay=FOUND_SIGMA_S))


def first_start(runner: Runner, inputs: Inputs, tuned: NoiseLevels, gate: float) -> StartState:
    """Return the start by the sensors; without a magnetometer the likeliest of twelve headings."""
    begin = start(inputs, tuned)
    if inputs.mag is not None or inputs.velocity is None:
        return begin
    schedule, par = runner.timetable.scheduled(tuned), tuned.settings(inputs.gravity, gate)
    tried = [begin.turned(2.0 * np.pi * k / HEADINGS) for k in range(HEADINGS)]
    for one in tried:
        one.P[:, :] = covariance(inputs, tuned, one.q, one.x, one.how, bool(one.P[E.pos, E.pos] < 100.0))

    def likelihood(runs: tuple[StartState, State, Any]) -> float:
        """Return the log likelihood so far; none is less likely than a run that diverged."""
        value = float(runs[1].memory[MEM.likelihood])
        return value if math.isfinite(value) else -math.inf

    found, nodes = runner.begun(schedule, begin)[0], len(schedule.node_at)
    race = []
    for one in tried:
        state = runner.begun(schedule, one)[1]
        race.append((one, state, runner.bound(found, state, one, par, None, None)))
    for a in range(0, nodes, RACE_NODES):
        for _, _, run in race:
            run(a, min(a + RACE_NODES, nodes), -1, 0)
        best = max(map(likelihood, race))
        race = [runs for runs in race if likelihood(runs) >= best - MAX_TRAIL]
        if len(race) == 1:
            break
    return max(race, key=likelihood)[0]


def _moved(begin: StartState, found: Pass) -> StartState:
    """Return the start with smoothed attitude, velocity and position."""
    out = begin.copy()
    out.q = rotation.normalize(rotation.multiply(rotation.from_rotvec(found.first[:3]), out.q))
    out.x[E.v : E.v + 6] += found.first[E.v : E.v + 6]
    return out


def _at_nodes(q: Array, before: Schedule, now: Schedule, inputs: Inputs) -> Array:
    """Interpolate attitudes to the nodes of another schedule."""
    t = inputs.sensed_at
    a, b = t[before.node_at], t[now.node_at]
    return np.ascontiguousarray(rotation.slerp(a, q, np.clip(b, a[0], a[-1])))


# The passes with the compass and without it, which share the gyro and so its jumps.
#
# The run with the compass sees the time of a jump sharper, and jumps about the vertical while nothing accelerates;
# the
# one without it is not fooled by a bad compass. What the second finds makes the first look closer, and what the first
# finds the second takes over where its own size of the jump agrees.


@cached_by_content
def solved_without_compass(blind: Inputs, begun: NoiseLevels, gate: float, passes: int) -> Solution:
    """Solve a run that has no compass, once for a reference and for the attitude by motion alone."""
    return solved(blind, begun, gate, passes)


def solved_twice(inputs: Inputs, begun: NoiseLevels, gate: float, passes: int) -> tuple[Solution, Solution]:
    """Solve the runs with and without the compass over inputs that hold one."""
    blind = replace(inputs, mag=None)
    without = solved_without_compass(blind, begun, gate, passes)
    suspected = without.unmodelled > 0.0 or any(jump.counts for jump in without.jumps)
    with_compass = solved(inputs, begun, gate, passes, suspected=suspected)
    known = {jump.t: jump.t_sigma for jump in with_compass.jumps if jump.counts}
    if known:
        again = solved(blind, begun, gate, passes, known=tuple(known))
        if jumping.agree(with_compass.jumps, again.jumps):
            jumps = tuple(replace(jump, t_sigma=known.get(jump.t, jump.t_sigma)) for jump in again.jumps)
            without = replace(again, jumps=jumps)
    return with_compass, without


# The one pass forward of a filter, with constants of the sensors that passes found in the log.

# Constants of the sensors: their rows and how sure the whole log is of them.
CONSTANTS = {
    "acc_bias": (E.ba, 3, 0.01),
    "hard": (E.hard, 3, 1e-3),
    "soft": (E.soft, 6, 1e-3),
    "field": (E.earth, 3, np.deg2rad(0.1)),
    "scale": (E.scale, 3, 5e-4),
    "arm": (E.arm, 3, 0.01),
}


def run_causal(
    inputs: Inputs, tuned: NoiseLevels, gate: float, known: Array | None = None, constants: Collection[str] = ()
) -> tuple[Pass, StartState, tuple[Jump, ...]]:
    """Run one pass forward with noise and delays ``tuned``, from ``constants`` of a ``known`` state (39,)."""
    runner = Runner(inputs)
    begin = first_start(runner, inputs, tuned, gate)
    if known is not None:
        begin = _begun_with(begin, known, constants)
    settling = begin.how == "motion" and inputs.velocity is not None
    schedule = runner.timetable.scheduled(tuned, settling, once=True)
    del runner.timetable
    found, jumps = jumping.filtered(runner, schedule, begin, tuned.settings(inputs.gravity, gate))
    found.schedule = schedule.nodes()
    return found, begin, jumps


def _begun_with(begin: StartState, smoothed: Array, constants: Collection[str]) -> StartState:
    """Return a start with some constants of the sensors from a smoothed state (39,)."""
    out = begin.copy()
    level = float(np.hypot(smoothed[E.earth], smoothed[E.earth + 1]))
    for name in constants:
        row, count, sigma = CONSTANTS[name]
        sigma *= max(level, 1e-3) if name == "field" else 1.0
        own = slice(row, row + count)
        out.x[own] = smoothed[own]
        out.P[own, :] = 0.0
        out.P[:, own] = 0.0
        out.P[own, own] = np.diag(np.where(np.diag(begin.P)[own] > 0.0, sigma**2, 0.0))
    return out


# What a filter learns of its sensors on the way: the passes of the smoother over what came so far, again and again.
#
# At some moments noise levels, delays and prior spreads are estimated from the log up to there, from those of the
# moment before on: that saves a pass, and errors differ by 1 % (24 flights). The filter then runs
# again from the start with these, and its attitudes count from that moment on: no attitude knows what comes after it.
# Scale factors and lever arm it estimates itself: begun from smoothed ones it would count the same samples twice.
# What shows constants is motion, so these moments lie at 10, 16, 26, ... s of it, up to 400 s.

# Of a longer log so much is looked at for the constants, where it turns most (measured: docs/smoother.md).
MAX_LEARNING_S = 400.0
# Seconds of motion before the first look, and how much more each further one has. 1.2 to 2 give the same in 2 %.
FIRST_S, FURTHER = 10.0, 1.6
GRID_S = 15.0
# A rate in rad/s, the mean between two fixes, and the longest time between these that counts.
FASTEST, FIXES_S = 1.0, 2.0
MIN_FIXES_S = 10.0
LEARNING_PASSES = 3
# Noise of gyro and accelerometer counts as learnt by that much motion: at take-off it is still that of rest.
DOUBT_S = 40.0


class Constants(NamedTuple):
    """``levels`` of noise, delays and spreads; ``state`` (39,) the smoothed state at the start, None where unknown."""

    levels: NoiseLevels
    state: Array | None = None


def learning_stages(inputs: Inputs) -> list[tuple[int, int]]:
    """Return begin and end (samples) of the parts of a run between which constants are learnt anew."""
    motion = np.cumsum(np.where(inputs.rest == 0, inputs.dt, 0.0))
    looks, seconds = [0], FIRST_S
    while seconds < min(motion[-1], MAX_LEARNING_S):
        k = int(np.searchsorted(motion, seconds))
        if inputs.velocity is not None and inputs.sensed_at[k] - inputs.velocity.t[0] >= MIN_FIXES_S:
            looks.append(k)
        seconds *= FURTHER
    return list(pairwise([*looks, len(inputs.t)]))


def levels_of_past(inputs: Inputs, begun: NoiseLevels, gate: float, before: NoiseLevels | None = None) -> NoiseLevels:
    """Estimate noise levels, delays and spreads from a run up to now; ``begun`` are the default levels.

    ``before``: those of the stage before, from where it goes on.
    """
    part = most_turning_part(inputs, MAX_LEARNING_S)
    return solved(part, begun, gate, passes=LEARNING_PASSES, spread=False, before=before).next


def trusted(learnt: NoiseLevels, begun: NoiseLevels, inputs: Inputs) -> NoiseLevels:
    """Return levels of the past as a filter begins with them: their delays held, little trust in a short motion."""
    seen = float(np.sum(inputs.dt[inputs.rest == 0]))
    share = seen / (seen + DOUBT_S)
    return replace(
        hold_delays(learnt),
        gyro=begun.gyro ** (1.0 - share) * learnt.gyro**share,
        acc=begun.acc ** (1.0 - share) * learnt.acc**share,
    )


def constants_of_log(inputs: Inputs, begun: NoiseLevels, gate: float) -> Constants:
    """Estimate constants of the sensors from a whole run, as of a tuned vehicle."""
    solution = solved(most_turning_part(inputs, MAX_LEARNING_S), begun, gate, spread=False)
    return Constants(hold_delays(solution.next), solution.begin.x + solution.found.first)


def most_turning_part(inputs: Inputs, longest: float) -> Inputs:
    """Return the part that shows constants: of a long run the ``longest`` s with fixes that turn most.

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
    energy = np.cumsum(np.where(moving, np.minimum(square, FASTEST**2) * seconds, 0.0))
    energy = np.concatenate([[0.0, 0.0], energy])
    begins = np.arange(t[0], t[-1] - longest + GRID_S, GRID_S)
    seen = energy[np.searchsorted(fixes.t, begins + longest)] - energy[np.searchsorted(fixes.t, begins)]
    begin = float(begins[np.argmax(seen)])
    a, b = np.searchsorted(t, [begin, begin + longest])
    return inputs.part(int(a), int(b))


def hold_delays(tuned: NoiseLevels) -> NoiseLevels:
    """Hold delays that were found within 10 and 5 ms."""
    prior = replace(tuned.prior, gnss_delay=0.010, mag_delay=0.005)
    return replace(tuned, prior=prior)
