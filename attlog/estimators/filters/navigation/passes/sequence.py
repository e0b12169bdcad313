"""The passes of the smoother: five, or more where the gyro bias jumps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from attlog.base import rotation
from attlog.estimators.base import Array
from attlog.estimators.filters.navigation import calibration
from attlog.estimators.filters.navigation.layout import KICKED, POS, V
from attlog.estimators.filters.navigation.measured import Inputs
from attlog.estimators.filters.navigation.passes import jumps as jumping
from attlog.estimators.filters.navigation.schedule import Schedule
from attlog.estimators.filters.navigation.settings import FINE_S, NODE_S, NoiseLevels
from attlog.estimators.filters.navigation.solve import Pass, Runner
from attlog.estimators.filters.navigation.start import StartState, covariance, start

PASSES, OWN_LINEARISATION = 5, 3
"""Passes, and how many of them the filter linearises about itself; the others, which a smoother tells, about the pass
before."""
LOOK = 3
"""After so many passes jumps of the gyro bias are looked for: noise levels are calibrated, and not yet to a jump."""
SEARCH = {1: 0.030, 2: 0.012}
"""After these passes the GNSS delay is searched with this step in s."""
FOUND_SIGMA_S = 0.003
HEADINGS = 12
WORSE = 0.01
"""A likelihood that falls by more is a pass that went wrong."""


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
    jumps: tuple[jumping.Jump, ...] = ()
    """Jumps of the gyro bias that are modelled."""
    unmodelled: float = 0.0
    """What a further jump would add to the likelihood that cannot be modelled; 0 where there is none."""


def solved(
    inputs: Inputs,
    begun: NoiseLevels,
    gate: float,
    passes: int = PASSES,
    spread: bool = True,
    suspected: bool = False,
    known: jumping.Times = (),
) -> Solution:
    """All passes of the smoother over one run; ``spread``: whether the attitude's variance is asked for.

    Jumps of the gyro bias are looked for after LOOK passes; with one that is found the passes begin anew.
    ``suspected``: another run over the same gyro finds one; then, or if the bias at rest changed, less evidence is
    enough. ``known``: times in s of jumps that need none.
    """
    runner, look = Runner(inputs), min(LOOK, passes)
    begun = calibration.first_guess(inputs, begun)
    run = Sequence(runner, begun, gate, passes, spread, known)
    run.advance(look)
    suspected |= inputs.mag is None or jumping.changed_at_rest(inputs)
    least = jumping.GAIN if suspected else jumping.GAIN_COMPASS
    unmodelled = 0.0
    while True:
        when, gain = run.candidate()
        if gain < least:
            break
        unmodelled = gain
        if len(run.jumps) == jumping.MOST:
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
    runner.store.clear()
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
        """Passes until there were so many."""
        self.runner.timetable.jumps = self.jumps
        while self.number < to:
            self._once()
            self.number += 1

    def _once(self) -> None:
        """One pass and, unless it is the last, the calibration for the next."""
        inputs, number, tuned = self.runner.inputs, self.number, self.tuned
        if number > 0:
            self.begin = start(inputs, tuned, self.begin if self.moving else None)
        told = self.spread and number >= min(OWN_LINEARISATION, self.passes - 1)
        schedule = self.runner.timetable.scheduled(tuned, every=FINE_S if told else NODE_S)
        use = self.along if number >= OWN_LINEARISATION and not self.kicked else None
        if use is not None and self.schedule is not None:
            use = _at_nodes(use, self.schedule, schedule, inputs)
        found = self.runner.both(schedule, self.begin, tuned.packed(inputs.gravity, self.gate), use, self.spread)
        before = self.kept
        better = before is None or found.likelihood >= before.found.likelihood - WORSE * abs(before.found.likelihood)
        ratios = calibration.ratios(found)
        flight = float(np.sum(inputs.dt[inputs.rest == 0]))
        following = calibration.calibrated(found, tuned, self.begun, flight, number < 2)
        if better:
            self.kept = Solution(found, tuned, self.begin, self.runner, following, number + 1, number, ratios)
            self.along, self.schedule = found.smoothed_nodes(), schedule
        self.best.passes = number + 1
        self.kicked = found.memory[KICKED] > 0
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
        return jumping.modelled(found, when, self.jumps, self.jump_sigmas)

    @property
    def believable(self) -> bool:
        """Whether its jumps are such as a gyro bias makes."""
        return all(jump.believable for jump in self.modelled)

    def candidate(self) -> tuple[float, float]:
        """When in s a further jump is likeliest, and what it would add to the logarithm of the likelihood."""
        found = self.best.found
        return jumping.candidate(found, self.runner.inputs.sensed_at[found.schedule.node_at], self.jumps)

    def tried(self, when: float) -> tuple[jumping.Times, float]:
        """The jumps with one more near ``when`` s, and what that adds to the way forth."""
        likelihood = self._likelihood()
        times, _ = jumping.placed(tuple(sorted((*self.jumps, when))), likelihood)
        return times, likelihood(times) - likelihood(self.jumps)

    def place_jumps(self) -> None:
        """Each jump moved to where the way forth is likeliest."""
        self.jumps, self.jump_sigmas = jumping.placed(self.jumps, self._likelihood())

    def _likelihood(self) -> Callable[[jumping.Times], float]:
        """The logarithm of the likelihood of the way forth by the times of jumps, with the levels of the best pass."""
        timetable, gravity = self.runner.timetable, self.runner.inputs.gravity
        begin, tuned = self.best.begin, self.best.tuned
        schedule, par = timetable.scheduled(tuned), tuned.packed(gravity, self.gate)

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
