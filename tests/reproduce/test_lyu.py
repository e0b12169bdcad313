"""Lyu run again: the equality of the two filters, and every number of a claim by another way."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np
import pytest

import attlog
from attlog.reproduce import lyu
from attlog.reproduce.paper import Paper, PaperOptions, Seeds
from tests.conftest import few

SEEDS = 2


@pytest.fixture(scope="module", autouse=True)
def short_flights() -> Iterator[None]:
    """Flights end soon after the sine began: each takes its second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lyu, "SECONDS", 23.0)
        for name in ("bench_seed", "flight_seed"):
            patch.setattr(lyu, name, functools.cache(getattr(lyu, name)))
        yield


@pytest.fixture(scope="module")
def found(short_flights: None) -> Paper:
    return lyu.paper(PaperOptions(seeds=SEEDS))


def number(paper: Paper, claim: str, what: str) -> float:
    hits = [n for c in paper.claims if c.id == claim for n in c.numbers if what in n.what]
    assert len(hits) == 1, [n.what for n in hits]
    assert hits[0].value is not None
    return hits[0].value


@pytest.mark.parametrize("reading", few(["second", "sample"], 1))
def test_at_rest_the_two_filters_are_one_to_the_last_bit(reading: str) -> None:
    s = lyu.at_rest(0)
    gains = {"kp": 0.5, "ki": 0.001, "mag_gain": 0.0, "acc_form": "direction", "integrator": "first_order"}
    fixed = attlog.estimate("complementary", s.t, s.gyr, s.acc, dt=s.dt, ki_per=reading, **gains)
    variable = attlog.estimate(
        "variable_integral", s.t, s.gyr, s.acc, dt=s.dt, ki_per=reading, err1=0.3, err2=0.8, **gains
    )
    assert np.array_equal(fixed.q, variable.q)
    other = attlog.estimate(
        "variable_integral", s.t, s.gyr, s.acc, dt=s.dt, ki_per=reading, err1=0.001, err2=0.002, **gains
    )
    assert not np.array_equal(fixed.q, other.q)


@pytest.mark.slow
def test_the_spread_at_rest_is_that_of_a_line_fitted_by_hand(found: Paper) -> None:
    spreads = []
    for seed in range(SEEDS):
        s = lyu.at_rest(seed)
        late = s.t >= 20.0
        found_q = attlog.estimate("complementary@lyu-fixed", s.t, s.gyr, s.acc, dt=s.dt).q
        w, x, y, z = found_q.T
        roll = np.degrees(np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))[late]
        left = roll - np.polyval(np.polyfit(s.t[late], roll, 1), s.t[late])
        spreads.append(np.sqrt(np.sum(left**2) / (len(left) - 2)))
    assert next(c for c in found.claims if c.id == "rest").verdict == "does not hold"
    assert number(found, "rest", "equal to the last bit") == 100.0
    told = number(found, "rest", "spread of roll, both filters, ki per second")
    assert told == pytest.approx(np.mean(spreads), rel=1e-9)


@pytest.mark.slow
def test_settling_after_a_wrong_start_is_that_of_the_differential_equation(found: Paper) -> None:
    """Per second ki is nothing: the error obeys x' = -kp sin x, whose solution is known."""
    rows = {row[0]: row[1:] for row in found.tables[0].rows}
    for column, angle in enumerate(lyu.WRONG_DEG):
        ideal = 2.0 * np.log(np.tan(np.radians(angle) / 2) / np.tan(np.radians(1.0) / 2))
        told = float(rows["fixed, ki per second"][2 * column].removesuffix(" s"))
        assert told == pytest.approx(ideal, abs=1.2)  # the gyro's bias moves the end by some tenths of a degree


@pytest.mark.slow
def test_a_better_filter_would_be_found_better() -> None:
    """The verdicts are not stuck: with the spreads of another filter the claim holds."""
    better, rows = [], [(lyu.variable(r), lyu.fixed(r)) for r in lyu.READINGS]
    for seed in range(SEEDS):
        b = lyu.bench_seed(seed)
        quiet = {("spread", new, k): (0.5 + 0.1 * k) * b["spread", old, k] for new, old in rows for k in (0, 1)}
        better.append(b | quiet)
    assert lyu._rest_claim(Seeds(better)).verdict == "holds"
    worse = [b | {("spread", lyu.variable("second"), k): 1.0 for k in (0, 1)} for b in better]
    assert lyu._rest_claim(Seeds(worse)).verdict == "holds in part"


@pytest.mark.slow
def test_every_figure_has_lines_with_numbers(found: Paper) -> None:
    for figure in found.figures:
        assert figure.lines
        for line in figure.lines:
            assert np.isfinite(np.asarray(line.y)).all()
            assert len(line.x) == len(line.y)


@pytest.mark.slow
def test_flights_are_one_to_the_last_bit_while_the_error_stays_small() -> None:
    found = lyu.flight_seed(0)
    for reading in lyu.READINGS:
        row, old = lyu.variable(reading), lyu.fixed(reading)
        assert found["equal", row] == (found["e", row] < 0.299) or 0.29 < found["e", row] < 0.31
        assert found["error", row] == pytest.approx(found["error", old], abs=0.05)


@pytest.mark.slow
def test_the_error_in_flight_is_that_of_the_attitude_that_flew() -> None:
    flight = lyu.fly_row(lyu.fixed("second"), 0)
    on, truth = flight.onboard, flight.truth
    rows = np.searchsorted(truth.t, on.t[on.t >= 12.0] - 1e-9)
    w, x, y, z = on.q[on.t >= 12.0].T
    down = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    w, x, y, z = truth.q[rows].T
    true = np.column_stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    angle = np.degrees(np.arcsin(np.linalg.norm(np.cross(down, true), axis=1)))
    told = lyu.flight_seed(0)["error", lyu.fixed("second")]
    assert told == pytest.approx(np.sqrt(np.mean(angle**2)), rel=1e-6)


@pytest.mark.slow
def test_under_vibration_the_variable_integral_is_quieter_where_ki_counts_per_sample(found: Paper) -> None:
    """By hand: the integral fades while |e| is above 0.3, so that less of the noise is summed."""
    assert number(found, "rest", "mean |e| under vibration") > lyu.ERR1
    ratios = []
    for seed in range(SEEDS):
        s = lyu.shaken(lyu.at_rest(seed), seed)
        spreads = []
        for name in ("variable_integral@lyu:ki_per=sample", "complementary@lyu-fixed:ki_per=sample"):
            q = attlog.estimate(name, s.t, s.gyr, s.acc, dt=s.dt).q
            w, x, y, z = q[s.t >= 20.0].T
            pitch = np.degrees(np.arcsin(2.0 * (w * y - z * x)))
            left = pitch - np.polyval(np.polyfit(s.t[s.t >= 20.0], pitch, 1), s.t[s.t >= 20.0])
            spreads.append(np.sqrt(np.sum(left**2) / (len(left) - 2)))
        ratios.append(spreads[0] / spreads[1])
    told = number(found, "rest", "spread of pitch under 3 m/s^2 of vibration, variable over fixed, ki per sample")
    assert told == pytest.approx(np.exp(np.mean(np.log(ratios))), rel=1e-6)
    assert told < 0.98


@pytest.mark.slow
def test_both_filters_keep_control_and_a_flight_that_does_not_is_told() -> None:
    flights = [lyu.flight_seed(seed) for seed in range(2)]
    claim = lyu.flight_claim(Seeds(flights))
    assert claim.verdict == "holds"
    assert [n.value for n in claim.numbers if "in control" in n.what] == [100.0, 100.0]
    lost = flights[0] | {("kept", lyu.variable("second")): 0.0}
    assert lyu.flight_claim(Seeds([lost, flights[1]])).verdict == "does not hold"


def test_an_improvement_that_costs_hardly_more_is_told_from_one_that_costs_twice_as_much() -> None:
    new, old = lyu.variable("second"), lyu.fixed("second")
    assert lyu.cost_claim({new: [40.0, 41.0, 40.5], old: [33.0, 33.5, 33.0]}).verdict == "holds"
    assert lyu.cost_claim({new: [80.0, 81.0, 80.5], old: [33.0, 33.5, 33.0]}).verdict == "does not hold"
