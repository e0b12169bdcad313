"""In which order passes begin, are calibrated, kept and begun anew with jumps: declared passes stand for the filter."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.estimators.filters.navigation.passes import sequence
from attlog.estimators.filters.navigation.passes.jumps import Jump
from attlog.estimators.filters.navigation.settings import NoiseLevels
from attlog.estimators.filters.navigation.start import StartState

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
