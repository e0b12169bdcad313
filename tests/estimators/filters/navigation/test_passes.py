"""In which order passes begin, are calibrated, kept and begun anew with jumps: declared passes stand for the filter."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.estimators import Measurements, estimate
from attlog.estimators.filters.navigation import passes
from attlog.estimators.filters.navigation import passes as sequence
from attlog.estimators.filters.navigation.inputs import Inputs, NoiseLevels, prepare_inputs
from attlog.estimators.filters.navigation.model import MEM, MEMORY
from attlog.estimators.filters.navigation.passes import learning_stages, levels_of_past, trusted
from attlog.estimators.filters.navigation.solve import Runner as NavigationRunner
from attlog.estimators.filters.navigation.start import StartState
from tests.estimators.filters.navigation.made import flight, off

Array = np.ndarray
BEGUN = NoiseLevels()


def state(how: Any = "static") -> StartState:
    return StartState(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(39), np.eye(39), how)


class Timetable:
    """Remembers how it was asked; its schedules hold two nodes."""

    def __init__(self) -> None:
        self.jumps: tuple[float, ...] = ()
        self.every: list[float] = []

    def scheduled(self, tuned: NoiseLevels, every: float = 0.04) -> Any:
        self.every.append(every)
        return SimpleNamespace(node_at=np.array([0, 1]))


class Runner:
    """Passes of declared likelihoods; ``kicks`` are the passes in which the filter is kicked."""

    def __init__(self, likelihoods: list[float], kicks: tuple[int, ...] = (), mag: Any = True) -> None:
        self.timetable, self.likelihoods, self.kicks = Timetable(), likelihoods, kicks
        self.inputs = SimpleNamespace(
            mag=mag, velocity=None, gravity=9.8, dt=np.array([0.5, 0.25]), rest=np.array([0, 1]),
            sensed_at=np.array([0.0, 1.0]),
        )  # fmt: skip
        self.ran: list[Any] = []

    def both(self, schedule: Any, begin: Any, par: Any, along: Any, spread: bool) -> Any:
        number = len(self.ran)
        self.ran.append(SimpleNamespace(begin=begin, along=along, spread=spread))
        memory = np.zeros(18)
        memory[14] = number in self.kicks
        first = np.zeros(39)
        first[:9] = [0.0, 0.0, 0.1, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
        nodes = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1))
        return SimpleNamespace(
            likelihood=self.likelihoods[number], memory=memory, first=first, smoothed_nodes=lambda: nodes,
            schedule=schedule, number=number,
        )  # fmt: skip


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Calibration that only notes with what it was called; each pass has its own gyro noise."""
    seen: dict[str, list[Any]] = {"calibrated": [], "prior": [], "delays": [], "start": []}

    def calibrated(found: Any, tuned: Any, begun: Any, flight: float, early: bool) -> Any:
        seen["calibrated"].append((flight, early))
        return replace(tuned, gyro=tuned.gyro + 1.0)

    def prior_of(found: Any, x: Any, prior: Any, begun: Any) -> Any:
        seen["prior"].append(found.number)
        return replace(prior, arm=float(found.number))

    def delays(*given: Any) -> Any:
        seen["delays"].append(given[-1])
        return given[4]

    def start(inputs: Any, tuned: Any, known: Any = None) -> StartState:
        seen["start"].append((tuned.gyro, known))
        return state()

    monkeypatch.setattr(sequence.calibration, "calibrated", calibrated)
    monkeypatch.setattr(sequence.calibration, "prior_of", prior_of)
    monkeypatch.setattr(sequence.calibration, "ratios", lambda found: np.full(8, float(found.number)))
    monkeypatch.setattr(sequence, "_delays", delays)
    monkeypatch.setattr(sequence, "start", start)
    monkeypatch.setattr(sequence, "first_start", lambda *given: state())
    return seen


def run(runner: Any, passes: int = 5, spread: bool = True) -> Any:
    one = sequence.Sequence(runner, BEGUN, 2.5, passes, spread, ())
    one.advance(passes)
    return one


def test_five_passes_calibrate_four_times_and_the_last_two_are_fine_and_linearised_along_the_best(calls: Any) -> None:
    runner = Runner([1.0, 2.0, 3.0, 4.0, 5.0])
    one = run(runner)
    assert runner.timetable.every == [0.04, 0.04, 0.04, 0.02, 0.02]
    assert [x.along is not None for x in runner.ran] == [False, False, False, True, True]
    assert [early for _, early in calls["calibrated"]] == [True, True, False, False, False]
    assert {flight for flight, _ in calls["calibrated"]} == {0.5}
    assert calls["prior"] == [1, 2, 3]
    assert calls["delays"] == [0, 1, 2, 3]
    assert [gyro - BEGUN.gyro for gyro, _ in calls["start"]] == pytest.approx([1.0, 2.0, 3.0, 4.0])
    assert (one.best.kept, one.best.passes, one.best.ratios[0]) == (4, 5, 4.0)
    assert one.best.next.gyro == pytest.approx(BEGUN.gyro + 5.0)
    assert one.best.tuned.prior.arm == 3.0


def test_after_a_kick_the_next_pass_is_linearised_about_itself(calls: Any) -> None:
    runner = Runner([1.0, 2.0, 3.0, 4.0, 5.0], kicks=(3,))
    run(runner)
    assert [x.along is not None for x in runner.ran] == [False, False, False, True, False]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("diverging", "heading"), [(1, 120.0), (12, 0.0)])
def test_headings_whose_run_diverges_drop_out(
    monkeypatch: pytest.MonkeyPatch, bad: float, diverging: int, heading: float
) -> None:
    """The first of twelve headings diverges at once, or all of them do: then the first begins."""

    def bound(found: Any, state: Any, begin: StartState, *others: Any) -> Any:
        number = round(np.degrees(2.0 * np.arctan2(begin.q[3], begin.q[0])) / 30.0) % 12

        def run(a: int, b: int, origin: int, used: int) -> None:
            state.memory[MEM.likelihood] += bad if number < diverging else float(a - b) * abs(number - 4)

        return run

    monkeypatch.setattr(sequence, "start", lambda inputs, tuned: state("quiet"))
    monkeypatch.setattr(sequence, "covariance", lambda *given: np.eye(39))
    runner: Any = SimpleNamespace(
        timetable=SimpleNamespace(scheduled=lambda tuned: SimpleNamespace(node_at=np.arange(250))),
        begun=lambda schedule, begin: (None, SimpleNamespace(memory=np.zeros(MEMORY))),
        bound=bound,
    )
    inputs: Any = SimpleNamespace(mag=None, velocity=True, gravity=9.8)
    found = sequence.first_start(runner, inputs, BEGUN, 2.5)
    assert np.degrees(2.0 * np.arctan2(found.q[3], found.q[0])) == pytest.approx(heading)


def test_without_a_compass_the_likeliest_of_twelve_headings_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[Any, bool]] = []

    def covariance(inputs: Any, tuned: Any, q: Array, x: Array, how: Any, near: bool) -> Array:
        told.append((how, near))
        return np.full((39, 39), 7.0)

    runs: list[float] = []

    def begun(schedule: Any, begin: StartState) -> Any:
        return None, SimpleNamespace(memory=np.zeros(MEMORY))

    def bound(found: Any, state: Any, begin: StartState, *others: Any) -> Any:
        heading = 2.0 * np.arctan2(begin.q[3], begin.q[0])

        def run(a: int, b: int, origin: int, used: int) -> None:
            runs.append(np.degrees(heading))
            state.memory[MEM.likelihood] += 4.0 * (b - a) * np.cos(heading - np.radians(155.0))

        return run

    begin = state("quiet")
    begin.P[6, 6] = 25.0
    monkeypatch.setattr(sequence, "start", lambda inputs, tuned: begin)
    monkeypatch.setattr(sequence, "covariance", covariance)
    timetable = SimpleNamespace(scheduled=lambda tuned: SimpleNamespace(node_at=np.arange(1050)))
    runner: Any = SimpleNamespace(timetable=timetable, begun=begun, bound=bound)
    inputs: Any = SimpleNamespace(mag=None, velocity=True, gravity=9.8)
    found = sequence.first_start(runner, inputs, BEGUN, 2.5)
    assert np.degrees(2.0 * np.arctan2(found.q[3], found.q[0])) == pytest.approx(150.0)
    assert (found.P == 7.0).all()
    assert told == [("quiet", True)] * 12
    # Each block of 100 nodes 180 deg trails by 36 more; with it gone the race is over.
    counts = Counter(np.round(runs) % 360.0)
    assert (counts[150.0], counts[180.0], counts[330.0]) == (6, 6, 1)
    begin.P[6, 6] = 400.0
    sequence.first_start(runner, inputs, BEGUN, 2.5)
    assert told[-1] == ("quiet", False)
    for other in (SimpleNamespace(mag=True, velocity=True), SimpleNamespace(mag=None, velocity=None)):
        assert sequence.first_start(runner, other, BEGUN, 2.5) is begin  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(3))
def test_the_start_heading_is_that_of_twelve_whole_runs(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """The heading that leads after the first hundred nodes is another one."""
    made = flight(seconds=40.0, still=10.0, seed=seed)
    inputs = replace(prepare_inputs(*made.motion.sensors, made.aids, 0.0, ahead=True), mag=None)
    runner = NavigationRunner(inputs)
    chosen: dict[float, Array] = {}
    usual = sequence.MAX_TRAIL
    for trail in (usual, np.inf, 0.0):
        monkeypatch.setattr(sequence, "MAX_TRAIL", trail)
        chosen[trail] = sequence.first_start(runner, inputs, BEGUN, 2.5).q
    assert np.array_equal(chosen[usual], chosen[np.inf])
    assert not np.array_equal(chosen[0.0], chosen[np.inf])


# `eskf` learns the constants of its sensors on the way: when it looks, what it then knows; and without GNSS.


def inputs_of(seconds: float, still: float = 10.0) -> Inputs:
    made = flight(seconds=seconds, still=still)
    return prepare_inputs(*made.motion.sensors, made.aids, 0.0, ahead=False)


def test_it_looks_after_10_16_and_26_seconds_of_motion():
    inputs = inputs_of(60.0, still=20.0)
    cuts = [a for a, _ in learning_stages(inputs)]
    motion = np.cumsum(np.where(inputs.rest == 0, inputs.dt, 0.0))
    assert motion[cuts[1:]] == pytest.approx([10.0, 16.0, 25.6], abs=0.02)
    assert [b for _, b in learning_stages(inputs)] == [*cuts[1:], len(inputs.t)]
    assert cuts[0] == 0


def test_without_ten_seconds_of_fixes_there_is_no_look():
    inputs = inputs_of(40.0)
    assert inputs.velocity is not None
    late = replace(inputs, velocity=inputs.velocity.between(31.0, 40.0))
    assert learning_stages(late) == [(0, len(inputs.t))]
    assert learning_stages(replace(inputs, velocity=None)) == [(0, len(inputs.t))]


def test_the_delay_of_gnss_is_learnt_within_half_a_minute_of_flight():
    """Planted are 100 ms, begun with 250 ms."""
    inputs = inputs_of(40.0)
    begun = replace(NoiseLevels(), gnss_delay=0.25)
    found = levels_of_past(inputs, begun, 2.5)
    assert found.gnss_delay == pytest.approx(0.100, abs=0.02)
    assert trusted(found, begun, inputs).prior.gnss_delay == 0.010


def test_a_stage_goes_on_from_the_levels_of_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """They stand for the first pass: two are run, not three, and the first of them begins with these levels."""
    ran: list[float] = []
    both = NavigationRunner.both

    def counted(self: NavigationRunner, schedule: Any, begin: Any, par: Any, *others: Any) -> Any:
        ran.append(par.q_acc)
        return both(self, schedule, begin, par, *others)

    monkeypatch.setattr(NavigationRunner, "both", counted)
    inputs = inputs_of(60.0)
    early = levels_of_past(inputs.part(0, len(inputs.t) // 2), NoiseLevels(), 2.5)
    ran.clear()
    alone = levels_of_past(inputs, NoiseLevels(), 2.5)
    assert len(ran) == 3
    ran.clear()
    after = levels_of_past(inputs, NoiseLevels(), 2.5, early)
    assert len(ran) == 2
    assert ran[0] == early.acc != NoiseLevels().acc
    assert after.gyro == pytest.approx(alone.gyro, rel=0.2)
    assert after.acc == pytest.approx(alone.acc, rel=0.2)
    assert after.r == pytest.approx(alone.r, rel=0.1)
    assert after.gnss_delay == pytest.approx(alone.gnss_delay, abs=0.005)


def test_a_gyro_scale_far_from_its_prior_is_not_held_by_what_is_learnt_early():
    """Planted are 3 %, six sigma; where samples count twice, heading errs by 3.2 of its own sigma."""
    z = []
    for seed in (1, 2):
        made = flight(seconds=40.0, seed=seed)
        t, gyr, acc, mag = made.motion.sensors
        found = estimate("eskf", t, 1.03 * gyr, acc, mag, aids=made.aids)
        z.append((off(found.q, made.motion.q)[1] / found.aux["sigma_heading"])[t > 20.0])
    assert np.sqrt(np.mean(np.concatenate(z) ** 2)) < 2.8


def test_what_was_learnt_makes_the_filter_better_than_one_that_never_learns():
    made = flight(seconds=120.0)
    late = made.motion.t > 40.0
    learning, fixed = (
        np.sqrt(
            [np.mean(x[late] ** 2) for x in off(estimate(spec, *made.motion.sensors, aids=made.aids).q, made.motion.q)]
        )
        for spec in ("eskf", "eskf@fixed")
    )
    assert (learning < 0.9 * fixed).any()
    assert (learning < 1.1 * fixed).all()


def test_the_last_look_and_their_number_are_told():
    made = flight(seconds=60.0)
    told = estimate("eskf", *made.motion.sensors, aids=made.aids).quality
    assert told["constants"] == "past"
    assert told["constants_learnt"] == 3.0
    assert "constants_learnt" not in estimate("eskf@fixed", *made.motion.sensors, aids=made.aids).quality


def test_without_gnss_it_is_the_model_of_mekf():
    made = flight(seconds=30.0)
    alone = estimate("eskf", *made.motion.sensors, declination=3.0)
    barometer = estimate(
        "eskf", *made.motion.sensors, declination=3.0, aids=replace(made.aids, velocity=None, position=None)
    )
    want = estimate("mekf", *made.motion.sensors, declination=3.0)
    assert np.array_equal(alone.q, want.q)
    assert np.array_equal(barometer.q, want.q)
    assert alone.quality["model"] == "mekf"


# Which part of a long run tells the constants of its sensors, and when it is looked at: rates made by hand.

STEP, SECONDS = 0.1, 300.0
T = STEP * np.arange(round(SECONDS / STEP) + 1)


def turning_run(
    turning: list[tuple[float, float, float]], gaps: tuple[float, float] = (-1.0, -1.0), every: float = 1.0
) -> Any:
    """A run that turns about y at rates between times; fixes ``every`` s but in ``gaps``; rest before 20 s."""
    gyr = np.zeros((len(T), 3))
    for begin, end, rate in turning:
        gyr[(begin <= T) & (end > T), 1] = rate
    fixes = np.arange(0.0, SECONDS, every)
    fixes = fixes[(fixes < gaps[0]) | (fixes > gaps[1])]
    rest = (T < 20.0).astype(np.int8)
    dt = np.diff(T, prepend=0.0)
    own = SimpleNamespace(
        t=T, sensed_at=T, gyr=gyr, dt=dt, rest=rest, velocity=Measurements(fixes, np.zeros((len(fixes), 3)))
    )
    own.part = lambda a, b: (round(a * STEP, 6), round(b * STEP, 6))
    return own


def test_the_part_that_turns_most_tells() -> None:
    """Looked for every 15 s: a minute that holds the turn from 160 to 200 s."""
    begin, end = passes.most_turning_part(turning_run([(40.0, 90.0, 0.3), (160.0, 200.0, 0.6)]), 60.0)
    assert end - begin == pytest.approx(60.0)
    assert begin == 150.0


def test_delays_that_were_found_are_held_and_nothing_else() -> None:
    found = passes.hold_delays(NoiseLevels(gnss_delay=0.2))
    assert (found.prior.gnss_delay, found.prior.mag_delay) == (0.010, 0.005)
    assert found.gnss_delay == 0.2
    assert found.prior.hard == NoiseLevels().prior.hard
