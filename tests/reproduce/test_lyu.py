"""Lyu run again: the equality of the two filters, and every number of a claim by another way."""

from __future__ import annotations

import numpy as np
import pytest

import attlog
from attlog.reproduce import lyu, lyu_runs
from attlog.reproduce.paper import Options, Paper

SEEDS = 3


@pytest.fixture(scope="module")
def found() -> Paper:
    return lyu.paper(Options(seeds=SEEDS))


def number(paper: Paper, claim: str, what: str) -> float:
    hits = [n for c in paper.claims if c.id == claim for n in c.numbers if what in n.what]
    assert len(hits) == 1, [n.what for n in hits]
    assert hits[0].value is not None
    return hits[0].value


@pytest.mark.parametrize("reading", ["second", "sample"])
@pytest.mark.parametrize("seed", range(SEEDS))
def test_at_rest_the_two_filters_are_one_to_the_last_bit(seed: int, reading: str) -> None:
    s = lyu_runs.at_rest(seed)
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


def test_the_claim_of_a_quieter_rest_does_not_hold(found: Paper) -> None:
    claim = next(c for c in found.claims if c.id == "rest")
    assert claim.verdict == "does not hold"
    assert number(found, "rest", "equal to the last bit") == 100.0
    assert "equal to the last bit in 100 %" in claim.by
    assert number(found, "rest", "spread of roll, variable over fixed integral, ki per sample") == 1.0


def test_the_spread_at_rest_is_that_of_a_line_fitted_by_hand(found: Paper) -> None:
    spreads = []
    for seed in range(SEEDS):
        s = lyu_runs.at_rest(seed)
        late = s.t >= 20.0
        found_q = attlog.estimate("complementary@lyu-fixed", s.t, s.gyr, s.acc, dt=s.dt).q
        w, x, y, z = found_q.T
        roll = np.degrees(np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)))[late]
        left = roll - np.polyval(np.polyfit(s.t[late], roll, 1), s.t[late])
        spreads.append(np.sqrt(np.sum(left**2) / (len(left) - 2)))
    told = number(found, "rest", "spread of roll, both filters, ki per second")
    assert told == pytest.approx(np.mean(spreads), rel=1e-9)


def test_settling_after_a_wrong_start_is_that_of_the_differential_equation(found: Paper) -> None:
    """Per second ki is nothing: the error obeys x' = -kp sin x, whose solution is known."""
    rows = {row[0]: row[1:] for row in found.tables[0].rows}
    for column, angle in enumerate(lyu_runs.WRONG_DEG):
        ideal = 2.0 * np.log(np.tan(np.radians(angle) / 2) / np.tan(np.radians(1.0) / 2))
        told = float(rows["fixed, ki per second"][2 * column].removesuffix(" s"))
        assert told == pytest.approx(ideal, abs=1.2)  # the gyro's bias moves the end by some tenths of a degree


def test_a_better_filter_would_be_found_better() -> None:
    """The verdicts are not stuck: with the sums of another filter the claims hold."""
    benches = [lyu_runs.bench(seed) for seed in range(SEEDS)]
    for b in benches:
        for reading in lyu_runs.READINGS:
            for axis_pair in [b.spread[lyu_runs.fixed(reading)]]:
                b.spread[lyu_runs.variable(reading)] = (0.5 * axis_pair[0], 0.6 * axis_pair[1])
    assert lyu._at_rest(benches).verdict == "holds"


def test_every_figure_has_lines_with_numbers(found: Paper) -> None:
    for figure in found.figures:
        assert figure.lines
        for line in figure.lines:
            assert np.isfinite(np.asarray(line.y)).all()
            assert len(line.x) == len(line.y)


def test_the_same_seeds_give_the_same_numbers_in_several_processes(found: Paper) -> None:
    assert lyu.paper(Options(seeds=SEEDS, processes=2)).claims == found.claims
