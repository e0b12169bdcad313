"""Huang run again: numbers by other ways, verdicts that can go either way, times that are those of the table."""

from __future__ import annotations

import math

import numpy as np
import pytest

from attlog.core import rotation
from attlog.estimators import estimate
from attlog.reproduce import bench, huang
from attlog.reproduce.bench import CostSamples
from attlog.reproduce.huang import DCM, EKF, FLOWN_ON, LEVELS, PHASES, ROWS, STAND, TRACKS, cost_claim
from attlog.reproduce.page import render_paper
from attlog.reproduce.paper import Claim, Measures, Paper, PaperNumber, PaperOptions, Seeds
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.onboard import TRUE_ATTITUDE
from attlog.testing import Noise, flight, swing
from attlog.testing.motions import total_deg

SEEDS = 20


@pytest.fixture(scope="module")
def huang_flight() -> Flight:
    """The flight on the true attitude in still air."""
    return fly(huang.huang_scenario(TRUE_ATTITUDE, wind=0.0), seed=0)


def made(seed: int, error: float = 0.3, left: float = 0.2, most: float = 1.5, gain: float = 0.9) -> Measures:
    """A seed as the flights would give it, with numbers by hand."""
    rng = np.random.default_rng(seed)
    found: Measures = {}
    for row in FLOWN_ON:
        found |= {("most", row): most, ("spread", row): 0.4, ("drift", row): 0.5, ("crashed", row): 0.0}
        found |= {("flown", row, phase, k): error for phase in PHASES for k in range(3)}
        found |= {(what, row, k): x for what, x in (("delay", 217.0), ("gain", gain)) for k in range(len(TRACKS))}
    for row in (*FLOWN_ON, STAND):
        levels = {"settling": 0.5, "fall": 0.35, "overshoot": 0.1, "left": left}
        found |= {(what, row, k): x for what, x in levels.items() for k in range(len(LEVELS))}
    for phase, k in [(phase, k) for phase in PHASES for k in range(3)]:
        found |= {("replayed", row, phase, k): error if row == DCM else 0.5 for row in ROWS}
        found["apart", DCM, phase, k] = 0.4
    found |= {("error", STAND, k): error for k in (0, 1)}
    found |= {("windy", wind): 3.0 * wind for wind in huang.MORE_WIND_M_S}
    return {key: x * (1.0 + 0.05 * float(rng.standard_normal())) for key, x in found.items()}


def many(**values: float) -> Seeds:
    return Seeds([made(seed, **values) for seed in range(SEEDS)])


def numbers(claim: Claim, what: str) -> list[PaperNumber]:
    return [n for n in claim.numbers if what in n.what]


@pytest.mark.slow
def test_flown_on_the_truth_there_is_no_error_and_it_returns_to_level(huang_flight: Flight) -> None:
    found = huang.measure_flight(huang_flight, DCM)
    assert max(x for key, x in found.items() if key[0] == "flown") < 1e-9
    assert found["most", DCM] < 0.5
    assert not found["crashed", DCM]
    assert found["drift", DCM] < 0.05
    for k, (angle, axis) in enumerate(LEVELS):
        column = ("roll", "pitch").index(axis)
        since = huang.LEVEL_AT + k * huang.LEVEL_EVERY_S + huang.TILTED_S
        y = np.degrees(rotation.to_euler(huang_flight.truth.q))[:, column]
        beyond = huang_flight.truth.t[(np.abs(y) > 2.0) & (huang_flight.truth.t < since + huang.LEVEL_S)]
        assert found["settling", DCM, k] == pytest.approx(beyond[-1] - since, abs=0.01)
        assert np.interp(since, huang_flight.truth.t, y) == pytest.approx(angle, rel=0.05)
        assert found["left", DCM, k] < 0.3


@pytest.mark.slow
def test_tracking_is_that_of_the_transfer_function(huang_flight: Flight) -> None:
    found = huang.measure_flight(huang_flight, DCM)
    for k, (_, period, axis) in enumerate(TRACKS):
        w = 2.0 * math.pi / period
        linear = huang.axis_of(("roll", "pitch").index(axis)).response(w)
        assert found["delay", DCM, k] == pytest.approx(-1e3 * np.angle(linear) / w, abs=3.0)
        assert found["gain", DCM, k] == pytest.approx(abs(linear), abs=0.015)


def test_a_sine_is_found_by_its_amplitude_and_phase() -> None:
    t = np.arange(0.0, 6.0, 0.0025)
    y = 3.0 * np.sin(np.pi * (t - 0.2)) + 0.5 * t - 2.0
    found = huang._fundamental(t, y, 2.0) / huang._fundamental(t, np.sin(np.pi * t), 2.0)
    assert abs(found) == pytest.approx(3.0)
    assert -np.angle(found) / np.pi == pytest.approx(0.2)


@pytest.mark.slow
def test_on_the_stand_the_vehicle_hardly_moves_and_the_filter_stays_right() -> None:
    flight = huang.fly_stand(0)
    late = flight.truth.t > huang.STAND_AT
    assert np.abs(flight.truth.v[late, :2]).max() < 0.8
    tilt = np.degrees(np.abs(rotation.to_euler(flight.truth.q)[late, :2])).max(axis=0)
    assert tilt[0] > 40.0
    assert tilt[1] > 25.0
    error = rotation.tilt_angle(
        rotation.earth_error(
            flight.onboard.q[-1], rotation.slerp(flight.truth.t, flight.truth.q, flight.onboard.t[-1:])[0]
        )
    )
    assert np.degrees(error) < 1.5


def test_the_ekf_costs_more_compiled_and_in_numpy() -> None:
    spent = bench.time_updates((DCM, EKF), rounds=3, repeats=5)
    assert np.median(np.array(spent[EKF]) / np.array(spent[DCM])) > 1.3
    numpy = huang.time_numpy(rounds=3, updates=100)
    claim = cost_claim(spent, spent, numpy)
    assert numbers(claim, "4,000 updates of Mahony")[0].value == pytest.approx(np.mean(spent[DCM]))
    assert numbers(claim, "both plain numpy arrays")[0].value > 1.0


def test_the_cost_claim_goes_by_every_implementation() -> None:
    dearer, equal = {DCM: [2.0, 2.1, 2.0], EKF: [5.0, 5.0, 5.1]}, {DCM: [2.0, 2.1, 2.0], EKF: [2.0, 2.0, 2.1]}
    assert cost_claim(dearer, dearer, ([30.0, 31.0, 30.0], [40.0, 41.0, 41.0])).verdict == "holds"
    assert cost_claim(dearer, dearer, ([40.0, 41.0, 41.0], [30.0, 31.0, 30.0])).verdict == "holds in part"
    assert cost_claim(equal, equal, ([40.0, 41.0, 41.0], [30.0, 31.0, 30.0])).verdict != "holds"


def test_the_return_to_level_is_judged_on_the_stand_as_the_figure_simulates_it() -> None:
    flown = [
        made(seed, left=0.3) | {key: x for key, x in made(seed, left=4.0).items() if key[1] != STAND}
        for seed in range(SEEDS)
    ]
    claim = huang._level_claim(Seeds(flown))
    assert claim.verdict == "holds"
    assert claim.where == "fig. 6"
    assert claim.numbers[0].value < 1.0 < claim.numbers[1].value


@pytest.mark.parametrize(
    ("claim", "good", "bad"),
    [
        (huang._follow_claim, {"error": 0.3}, {"error": 20.0}),
        (huang._ekf_claim, {"error": 0.4}, {"error": 0.9}),
        (huang._level_claim, {"left": 0.3}, {"left": 4.0}),
        (huang._hover_claim, {"most": 2.0}, {"most": 7.0}),
        (huang._tracking_claim, {"gain": 0.9}, {"gain": 0.5}),
    ],
)
def test_each_verdict_goes_with_the_numbers(claim: object, good: dict, bad: dict) -> None:
    assert callable(claim)
    assert claim(many(**good)).verdict == "holds"
    assert claim(many(**bad)).verdict == "does not hold"
    assert all(n.n == SEEDS for n in claim(many()).numbers)


def test_flights_that_never_settle_are_said_and_not_averaged() -> None:
    seeds = [made(seed) for seed in range(SEEDS)]
    seeds[0]["settling", STAND, 0] = math.nan
    claim = huang._level_claim(Seeds(seeds))
    assert numbers(claim, "settled as the filter sees it, from 20 deg of roll, stand")[0].value == 95.0
    assert numbers(claim, "settling time as the filter sees it, from 20 deg of roll, stand")[0].n == 19


@pytest.mark.slow
def test_the_figures_show_the_flight() -> None:
    spent = {DCM: [1.0, 1.1, 1.0], EKF: [4.0, 4.2, 4.1]}
    found = huang.paper_figures(spent, huang.PRINTED_MAHONY_S[:3], huang.PRINTED_EKF_S[:3])
    assert [f.where for f in found[:3]] == ["fig. 3", "fig. 4", "table 1"]
    for figure in found:
        assert figure.lines
        assert {line.panel for line in figure.lines} == set(range(len(figure.panels)))
        for line in figure.lines:
            assert len(line.x) == len(line.y) > 0
            assert np.isfinite(np.asarray(line.y)).all()
    level = next(f for f in found if f.id == "level")
    linear = next(line for line in level.lines if line.name == huang.LINEAR)
    assert np.max(linear.y) == pytest.approx(20.0, rel=0.06)
    assert abs(linear.y[-1]) < 0.5
    paper = Paper(
        "huang", "t", "c", huang._settings(), (), found, (huang.times_table({DCM: [1.0] * 9, EKF: [2.0] * 9}),)
    )
    page = render_paper(paper)
    assert "1.0837 s" in page
    assert "2.0289 s" in page


@pytest.mark.slow
def test_the_whole_paper_runs_and_says_what_does_not_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(huang, "FLOWN_ON", (DCM, TRUE_ATTITUDE))
    found = huang.paper(PaperOptions(seeds=2))
    verdicts = {c.id: c.verdict for c in found.claims}
    assert set(verdicts) == {"follows", "ekf", "cost", "level", "hover", "tracks"}
    assert verdicts["cost"] == "holds"
    assert verdicts["follows"] == "holds in part"
    assert {c.id: c.where for c in found.claims}["hover"] == "fig. 8"
    assert len(found.figures) == 6
    assert {row[0] for row in found.tables[1].rows} == {"Huang's filter", "the true attitude"}


# The filters as plain numpy arrays are filters: the one is mahony_dcm, the other finds attitude and bias.


def test_mahony_in_numpy_is_mahony_dcm() -> None:
    """The shared loop hands a step the vectors of the sample before and the gyro's own."""
    m = flight(5.0, 400.0)
    s = CostSamples(m.t[1:], m.gyr[1:], m.acc[:-1], m.mag[:-1])
    e = estimate("mahony_dcm@huang", *m.sensors, q0=m.q[0])
    assert huang.numpy_mahony(s, m.q[0]) == pytest.approx(rotation.to_matrix(e.q[1:]), abs=1e-6)


@pytest.mark.slow
def test_the_dense_ekf_follows_the_truth_and_finds_the_bias() -> None:
    bias = np.array([0.02, -0.01, 0.015])
    m = swing(40.0, 400.0, noise=Noise(gyro=1e-4, bias=tuple(bias)))
    x = huang.numpy_ekf(CostSamples(m.t[1:], m.gyr[1:], m.acc[1:], m.mag[1:]), m.q[0])
    assert total_deg(x[-2000:, :4], m.q[-2000:]).max() < 1.0
    assert x[-1, 4:] == pytest.approx(bias, abs=1e-3)


def test_the_derivative_of_a_turned_vector_is_the_numerical_one() -> None:
    random = np.random.default_rng(3)
    q, v = random.standard_normal(4), random.standard_normal(3)
    value, by_q = huang.turned_back(q, v)
    unit = rotation.normalize(q)
    assert huang.turned_back(unit, v)[0] == pytest.approx(rotation.rotate_inverse(unit, v))
    steps = 1e-6 * np.eye(4)
    numerical = [(huang.turned_back(q + d, v)[0] - huang.turned_back(q - d, v)[0]) / 2e-6 for d in steps]
    assert by_q == pytest.approx(np.array(numerical).T, abs=1e-8)
    assert value.shape == (3,)
