"""In which order passes begin, are calibrated, kept and begun anew with jumps: declared passes stand for the filter."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.estimators import Measurements, estimate
from attlog.estimators.filters.navigation import passes
from attlog.estimators.filters.navigation import passes as sequence
from attlog.estimators.filters.navigation.inputs import Inputs, NoiseLevels, prepare_inputs
from attlog.estimators.filters.navigation.jumps import Jump
from attlog.estimators.filters.navigation.passes import constants_of_past, stages
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


@pytest.mark.parametrize(("passes", "fine"), [(1, [0.02]), (2, [0.04, 0.02]), (3, [0.04, 0.04, 0.02])])
def test_of_few_passes_the_last_is_fine(calls: Any, passes: int, fine: list[float]) -> None:
    runner = Runner([1.0] * passes)
    run(runner, passes)
    assert runner.timetable.every == fine
    assert len(calls["delays"]) == passes - 1
    coarse = Runner([1.0] * passes)
    run(coarse, passes, spread=False)
    assert coarse.timetable.every == [0.04] * passes
    assert not any(x.spread for x in coarse.ran)


@pytest.mark.parametrize(("last", "kept"), [(99.1, 1), (98.9, 0), (120.0, 1)])
def test_a_pass_is_kept_unless_it_is_a_hundredth_less_likely(calls: Any, last: float, kept: int) -> None:
    for sign in (1.0, -1.0):
        first = 100.0 * sign
        one = run(Runner([first, first + (last - 100.0)]), 2)
        assert one.best.kept == kept
        assert one.best.passes == 2


def test_after_a_kick_the_next_pass_is_linearised_about_itself(calls: Any) -> None:
    runner = Runner([1.0, 2.0, 3.0, 4.0, 5.0], kicks=(3,))
    run(runner)
    assert [x.along is not None for x in runner.ran] == [False, False, False, True, False]


def test_without_a_compass_each_pass_begins_where_the_one_before_was_smoothed_to(calls: Any) -> None:
    runner = Runner([1.0, 2.0, 3.0], mag=None)
    run(runner, 3)
    assert [known is not None for _, known in calls["start"]] == [True, True]
    known = calls["start"][0][1]
    assert known.q == pytest.approx(np.roll(Rotation.from_rotvec([0.0, 0.0, 0.1]).as_quat(), 1))
    assert known.x[3:9] == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    calls["start"].clear()
    run(Runner([1.0, 2.0, 3.0]), 3)
    assert [known for _, known in calls["start"]] == [None, None]


def test_a_pass_is_linearised_at_the_nodes_of_its_own_schedule() -> None:
    """A turn at a constant rate between the nodes; before the first and after the last it stays."""
    t = np.linspace(0.0, 4.0, 41)
    turns = Rotation.from_rotvec(np.outer([0.0, 0.5, 2.0], [0.0, 0.0, 1.0]))
    before: Any = SimpleNamespace(node_at=np.array([5, 15, 35]))
    now: Any = SimpleNamespace(node_at=np.array([0, 10, 25, 40]))
    inputs: Any = SimpleNamespace(sensed_at=t)
    found = sequence._at_nodes(np.roll(turns.as_quat(), 1, axis=1), before, now, inputs)
    assert 2.0 * np.arctan2(found[:, 3], found[:, 0]) == pytest.approx([0.0, 0.25, 1.25, 2.0])


@pytest.mark.parametrize(
    ("number", "delay", "step", "sigma"),
    [(0, 0.3, None, 0.08), (1, 0.7, 0.030, 0.08), (2, 0.7, 0.012, 0.003), (3, 0.1, None, 0.003)],
)
def test_the_delay_of_gnss_is_moved_twice_searched_twice_and_then_held(
    monkeypatch: pytest.MonkeyPatch, number: int, delay: float, step: float | None, sigma: float
) -> None:
    """By the state after the first passes, by the likelihood after the second and third, known to 3 ms from then."""
    moved = replace(BEGUN, gnss_delay=0.3, mag_delay=0.02)
    searched: list[Any] = []

    def search(runner: Any, inputs: Any, tuned: Any, begin: Any, gate: Any, by: float) -> Any:
        searched.append((by, tuned.gnss_delay))
        return replace(tuned, gnss_delay=0.7)

    known: list[Any] = []
    monkeypatch.setattr(sequence.calibration, "delays_by_state", lambda found, used: moved)
    monkeypatch.setattr(sequence.calibration, "delay_by_likelihood", search)
    monkeypatch.setattr(sequence, "start", lambda inputs, tuned, begin: known.append(begin))
    inputs: Any = SimpleNamespace(velocity=True, mag=True)
    following, begin, none = replace(BEGUN, gnss_delay=0.1), state(), None

    def delays(inputs: Any, begin: StartState) -> NoiseLevels:
        return sequence._delays(none, inputs, none, BEGUN, following, begin, 2.5, number)  # type: ignore[arg-type]

    found = delays(inputs, begin)
    assert (found.gnss_delay, found.mag_delay, found.prior.gnss_delay) == (delay, 0.02, sigma)
    assert searched == ([] if step is None else [(step, 0.3 if number < 2 else 0.1)])
    if step is not None:
        delays(inputs, state("motion"))
        inputs.mag = None
        delays(inputs, begin)
        assert [one is not None for one in known] == [False, True, True]
    inputs.velocity = None
    assert delays(inputs, begin).gnss_delay == 0.1


def test_without_a_compass_the_likeliest_of_twelve_headings_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[Any, bool]] = []

    def covariance(inputs: Any, tuned: Any, q: Array, x: Array, how: Any, near: bool) -> Array:
        told.append((how, near))
        return np.full((39, 39), 7.0)

    def forward(schedule: Any, begin: StartState, par: Any) -> Any:
        heading = 2.0 * np.arctan2(begin.q[3], begin.q[0])
        return SimpleNamespace(likelihood=np.cos(heading - np.radians(155.0)))

    begin = state("quiet")
    begin.P[6, 6] = 25.0
    monkeypatch.setattr(sequence, "start", lambda inputs, tuned: begin)
    monkeypatch.setattr(sequence, "covariance", covariance)
    runner: Any = SimpleNamespace(timetable=Timetable(), forward=forward)
    inputs: Any = SimpleNamespace(mag=None, velocity=True, gravity=9.8)
    found = sequence.first_start(runner, inputs, BEGUN, 2.5)
    assert np.degrees(2.0 * np.arctan2(found.q[3], found.q[0])) == pytest.approx(150.0)
    assert (found.P == 7.0).all()
    assert told == [("quiet", True)] * 12
    begin.P[6, 6] = 400.0
    sequence.first_start(runner, inputs, BEGUN, 2.5)
    assert told[-1] == ("quiet", False)
    for other in (SimpleNamespace(mag=True, velocity=True), SimpleNamespace(mag=None, velocity=None)):
        assert sequence.first_start(runner, other, BEGUN, 2.5) is begin  # type: ignore[arg-type]


class Declared:
    """A sequence of passes in which each further jump gains what ``gains`` says: predicted, and on the way forth."""

    gains: list[tuple[float, float]] = []  # noqa: RUF012
    believable = True
    made: list[Any] = []  # noqa: RUF012

    def __init__(self, runner: Any, begun: Any, gate: float, passes: int, spread: bool, jumps: Any) -> None:
        self.jumps, self.advanced, self.placed = jumps, list[int](), False
        self.made.append(self)

    def advance(self, to: int) -> None:
        self.advanced.append(to)

    def _gain(self) -> tuple[float, float]:
        return self.gains[len(self.jumps)] if len(self.jumps) < len(self.gains) else (0.0, 0.0)

    def candidate(self) -> tuple[float, float]:
        return 10.0 * (len(self.jumps) + 1), self._gain()[0]

    def tried(self, when: float) -> tuple[Any, float]:
        return (*self.jumps, when), self._gain()[1]

    def place_jumps(self) -> None:
        self.placed = True

    @property
    def modelled(self) -> tuple[Jump, ...]:
        return tuple(Jump(t, 0.0, np.ones(3), np.ones(3)) for t in self.jumps)

    @property
    def best(self) -> Any:
        none: Any = None
        return sequence.Solution(none, BEGUN, state(), none, BEGUN, 5, 4, np.zeros(8))


def solved(monkeypatch: pytest.MonkeyPatch, gains: list[tuple[float, float]], **given: Any) -> tuple[Any, list[Any]]:
    made: list[Any] = []
    mag, changed = given.pop("mag", True), given.pop("changed", False)
    monkeypatch.setattr(Declared, "gains", gains)
    monkeypatch.setattr(Declared, "made", made)
    monkeypatch.setattr(Declared, "believable", given.pop("believable", True))
    monkeypatch.setattr(sequence, "Sequence", Declared)
    monkeypatch.setattr(sequence, "Runner", lambda inputs: SimpleNamespace(store={}))
    monkeypatch.setattr(sequence.calibration, "first_guess", lambda inputs, tuned: tuned)
    monkeypatch.setattr(sequence.jumping, "changed_at_rest", lambda inputs: changed)
    return sequence.solved(SimpleNamespace(mag=mag), BEGUN, 2.5, **given), made  # type: ignore[arg-type]


SUSPECTED = [{"mag": None}, {"changed": True}, {"suspected": True}]


@pytest.mark.parametrize(("given", "least"), [*((one, 20.0) for one in SUSPECTED), ({}, 200.0)])
def test_a_jump_must_gain_20_where_one_is_suspected_and_200_beside_a_compass(
    monkeypatch: pytest.MonkeyPatch, given: dict[str, Any], least: float
) -> None:
    for predicted, real, jumps, unmodelled in (
        (least - 0.1, 1e3, 0, 0.0),
        (least + 0.1, least - 0.1, 0, least + 0.1),
        (least + 0.1, least + 0.1, 1, 0.0),
    ):
        found, made = solved(monkeypatch, [(predicted, real)], **given)
        assert len(found.jumps) == jumps
        assert found.unmodelled == unmodelled
        assert made[-1].placed == bool(jumps)
        assert made[-1].advanced == [3, 5]


def test_no_jump_is_modelled_that_a_bias_does_not_make_and_none_beyond_four(monkeypatch: pytest.MonkeyPatch) -> None:
    found, made = solved(monkeypatch, [(300.0, 300.0)], believable=False)
    assert (found.jumps, found.unmodelled) == ((), 300.0)
    assert made[0].advanced == [3, 5]
    assert made[1].advanced == [3]
    found, _ = solved(monkeypatch, [(300.0 + k, 400.0) for k in range(9)])
    assert [jump.t for jump in found.jumps] == [10.0, 20.0, 30.0, 40.0]
    assert found.unmodelled == 304.0
    found, made = solved(monkeypatch, [], known=(5.0,), passes=2)
    assert [jump.t for jump in found.jumps] == [5.0]
    assert not made[0].placed
    assert made[0].advanced == [2, 2]


# `eskf` learns the constants of its sensors on the way: when it looks, what it then knows; and without GNSS.


def inputs_of(seconds: float, still: float = 10.0) -> Inputs:
    made = flight(seconds=seconds, still=still)
    return prepare_inputs(*made.motion.sensors, made.aids, 0.0, ahead=False)


def test_it_looks_after_10_16_and_26_seconds_of_motion():
    inputs = inputs_of(60.0, still=20.0)
    cuts = [a for a, _ in stages(inputs)]
    motion = np.cumsum(np.where(inputs.rest == 0, inputs.dt, 0.0))
    assert motion[cuts[1:]] == pytest.approx([10.0, 16.0, 25.6], abs=0.02)
    assert [b for _, b in stages(inputs)] == [*cuts[1:], len(inputs.t)]
    assert cuts[0] == 0


def test_without_ten_seconds_of_fixes_there_is_no_look():
    inputs = inputs_of(40.0)
    assert inputs.velocity is not None
    late = replace(inputs, velocity=inputs.velocity.between(31.0, 40.0))
    assert stages(late) == [(0, len(inputs.t))]
    assert stages(replace(inputs, velocity=None)) == [(0, len(inputs.t))]


def test_the_delay_of_gnss_is_learnt_within_half_a_minute_of_flight():
    """Planted are 100 ms, begun with 250 ms."""
    inputs = inputs_of(40.0)
    found = constants_of_past(inputs, replace(NoiseLevels(), gnss_delay=0.25), 2.5)
    assert found.levels.gnss_delay == pytest.approx(0.100, abs=0.02)
    assert found.levels.prior.gnss_delay == 0.010
    assert found.state is not None


def test_noise_is_believed_by_the_motion_that_showed_it():
    """30 s of motion count 30 parts against 40 of the noise begun with: geometric means."""
    inputs = inputs_of(40.0)
    begun = NoiseLevels()
    sure = constants_of_past(inputs, replace(begun, acc=1.0), 2.5).levels.acc
    unsure = constants_of_past(inputs, replace(begun, acc=0.01), 2.5).levels.acc
    seen = float(np.sum(inputs.dt[inputs.rest == 0]))
    assert np.log(sure / unsure) == pytest.approx(np.log(100.0) * 40.0 / (40.0 + seen), rel=0.1)


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


def test_a_blow_counts_as_one_rad_per_second_rest_and_gaps_count_nothing() -> None:
    slow = (200.0, 240.0, 0.8)
    assert passes.most_turning_part(turning_run([(60.0, 62.0, 30.0), slow]), 60.0)[0] in (180.0, 195.0)
    assert passes.most_turning_part(turning_run([(0.0, 18.0, 0.9), (230.0, 240.0, 0.9)]), 60.0)[0] >= 180.0
    assert passes.most_turning_part(turning_run([(100.0, 140.0, 0.9), slow], gaps=(95.0, 145.0)), 60.0)[0] >= 180.0
    assert passes.most_turning_part(turning_run([(100.0, 120.0, 1.6), slow]), 60.0)[0] >= 180.0
    seldom = turning_run([slow], every=2.5)
    assert passes.most_turning_part(seldom, 60.0)[0] == 0.0


def test_a_run_without_fixes_or_not_longer_tells_as_a_whole() -> None:
    short = turning_run([(100.0, 140.0, 0.5)])
    assert passes.most_turning_part(short, SECONDS) is short
    assert passes.most_turning_part(short, SECONDS - 0.2) is not short
    short.velocity = None
    assert passes.most_turning_part(short, 60.0) is short


def test_looks_end_at_400_seconds_of_motion_and_begin_with_ten_of_fixes() -> None:
    n = 6001
    t = 0.1 * np.arange(n)
    own: Any = SimpleNamespace(t=t, sensed_at=t, dt=np.full(n, 0.1), rest=np.zeros(n, np.int8))
    own.velocity = Measurements(np.array([6.5, 7.0]), np.zeros((2, 3)))
    looks = [round(a * 0.1, 1) for a, _ in passes.stages(own)]
    assert looks[:2] == [0.0, pytest.approx(25.6, abs=0.2)]
    assert looks[-1] == pytest.approx(10.0 * 1.6**7, abs=0.2)
    own.velocity = Measurements(np.array([5.5, 7.0]), np.zeros((2, 3)))
    assert passes.stages(own)[0][1] * 0.1 == pytest.approx(15.9, abs=0.2)


def test_delays_that_were_found_are_held_and_nothing_else() -> None:
    found = passes.held(NoiseLevels(gnss_delay=0.2))
    assert (found.prior.gnss_delay, found.prior.mag_delay) == (0.010, 0.005)
    assert found.gnss_delay == 0.2
    assert found.prior.hard == NoiseLevels().prior.hard


def test_the_noise_learnt_counts_by_forty_seconds_of_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = NoiseLevels(gyro=1e-4, acc=1e-2)
    following = NoiseLevels(gyro=1e-2, acc=1.0)
    begin, found = SimpleNamespace(x=np.arange(39.0)), SimpleNamespace(first=np.ones(39))
    asked: list[Any] = []

    def solved(inputs: Any, levels: Any, gate: float, **given: Any) -> Any:
        asked.append(given)
        return SimpleNamespace(next=following, begin=begin, found=found)

    monkeypatch.setattr(passes, "solved", solved)
    inputs: Any = SimpleNamespace(
        velocity=None, sensed_at=T, dt=np.full(100, 0.5), rest=(np.arange(100) < 60).astype(int)
    )
    constants = passes.constants_of_past(inputs, begun, 2.5)
    share = 20.0 / 60.0
    assert constants.levels.gyro == pytest.approx(1e-4 * 100.0**share)
    assert constants.levels.acc == pytest.approx(1e-2 * 100.0**share)
    assert constants.state == pytest.approx(np.arange(1.0, 40.0))
    told = passes.constants_of_log(inputs, begun, 2.5)
    assert told.levels.gyro == 1e-2
    assert told.state == pytest.approx(np.arange(1.0, 40.0))
    assert asked == [{"passes": 3, "spread": False}, {"spread": False}]
