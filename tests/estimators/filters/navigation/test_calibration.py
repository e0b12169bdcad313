"""Noise levels from the samples themselves."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from attlog.estimators import Aids, Measurements
from attlog.estimators.filters.navigation import calibration
from attlog.estimators.filters.navigation.calibration import WHITE_FACTOR, first_guess
from attlog.estimators.filters.navigation.inputs import LEAST_R, NoiseLevels, PriorSpreads, prepare_inputs
from attlog.estimators.filters.navigation.start import StartState


def test_white_noise_is_found_whatever_the_motion_and_its_level_is_sigma_over_the_root_of_the_rate() -> None:
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 60.0, 0.01)
    slow = np.sin(np.outer(t, [0.5, 0.4, 0.3]))
    gyr = slow + 0.02 * rng.standard_normal((len(t), 3))
    acc = slow + [0.0, 0.0, -9.81] + 0.3 * rng.standard_normal((len(t), 3))
    found = first_guess(prepare_inputs(t, gyr, acc, np.full_like(acc, np.nan), Aids(), 0.0, ahead=True), NoiseLevels())
    assert found.gyro == pytest.approx(WHITE_FACTOR * 0.02 * 0.1, rel=0.05)
    assert found.acc == pytest.approx(WHITE_FACTOR * 0.3 * 0.1, rel=0.05)


# What one pass teaches the next: each level, spread and delay by its own closed form, and its ends.

FIRST_LEVELS = NoiseLevels()
ROWS = {"gyro": (0, 3), "acc": (3, 3), "gyro_walk": (9, 3), "acc_walk": (12, 3), "hard_walk": (18, 3)}
ROWS |= {"wander_walk": (27, 3), "baro_walk": (30, 1)}


def passed(**given: Any) -> Any:
    own = {
        "score": np.zeros(0),
        "group": np.zeros(0, np.int8),
        "soft": np.zeros(0, np.int8),
        "scores": np.zeros((2, 39)),
        "first": np.zeros(39),
        "first_spread": np.zeros(39),
    }
    return SimpleNamespace(**(own | given))


def of_groups(scores: dict[int, tuple[float, int]]) -> dict[str, Any]:
    """So many updates of one score in each group."""
    group = np.concatenate([np.full(n, g, np.int8) for g, (_, n) in scores.items()])
    score = np.concatenate([np.full(n, s) for s, n in scores.values()])
    return {"score": score, "group": group, "soft": np.zeros(len(score), np.int8)}


def test_a_group_is_known_by_the_median_of_twenty_scores_over_that_of_chi_square() -> None:
    """A score that was made soft counts nine at least."""
    given = of_groups({0: (1.3, 20), 2: (2.0, 19), 5: (0.7, 21)})
    given["score"][:9] = 50.0
    found = calibration.ratios(passed(**given))
    usual = stats.chi2.ppf(0.5, 1)
    assert found[[0, 5]] == pytest.approx(np.array([1.3, 0.7]) / usual, rel=1e-3)
    assert np.flatnonzero(np.isfinite(found)).tolist() == [0, 5]
    given["soft"][9:13] = 1
    assert calibration.ratios(passed(**given))[0] == pytest.approx(9.0 / usual, rel=1e-3)


@pytest.mark.parametrize(("early", "clip"), [(True, 50.0), (False, 5.0)])
def test_noise_follows_the_root_of_its_ratio_within_the_clip_and_above_the_least(early: bool, clip: float) -> None:
    usual = stats.chi2.ppf(0.5, 1)
    score = {0: (2.0 * usual, 30), 2: (1e4, 30), 3: (1e-6, 30), 5: (1e-6, 30), 7: (9.0, 30)}
    tuned = replace(FIRST_LEVELS, r=np.array([0.1, 0.2, 0.5, 0.9, 0.3, 0.0011, 1e-4, 0.02]))
    found = calibration.calibrated(passed(**of_groups(score)), tuned, FIRST_LEVELS, 9.9, early)
    want = tuned.r * np.sqrt([2.0, 1.0, clip, 1.0 / clip, 1.0, 0.0, 1.0, 1.0])
    want[5] = 0.001
    assert found.r == pytest.approx(want, rel=1e-3)
    assert (found.r >= LEAST_R).all()
    assert found.gyro == tuned.gyro


@pytest.mark.parametrize("name", list(ROWS))
def test_process_noise_follows_the_scores_of_its_own_rows(name: str) -> None:
    row, count = ROWS[name]
    scores = np.zeros((2, 39))
    scores[0, row : row + count], scores[1, row : row + count] = 2.0, 0.5
    found = calibration.calibrated(passed(scores=scores), FIRST_LEVELS, FIRST_LEVELS, 10.0, False)
    for other in ROWS:
        assert getattr(found, other) == pytest.approx(getattr(FIRST_LEVELS, other) * (2.0 if other == name else 1.0))
    assert (
        calibration.calibrated(passed(scores=scores), FIRST_LEVELS, FIRST_LEVELS, 9.99, False).gyro == FIRST_LEVELS.gyro
    )
    scores[0] *= 1e6
    for early, clip in ((True, 50.0), (False, 5.0)):
        found = calibration.calibrated(passed(scores=scores), FIRST_LEVELS, FIRST_LEVELS, 10.0, early)
        if name in {"gyro", "acc"}:
            assert getattr(found, name) == pytest.approx(getattr(FIRST_LEVELS, name) * np.sqrt(clip))


RANGES = [
    ("gyro", 2e-5, 3e-2),
    ("acc", 1e-3, 1.0),
    ("gyro_walk", 0.3e-5, 10e-5),
    ("acc_walk", 0.9e-4, 3e-3),
    ("hard_walk", 2e-6, 600e-6),
    ("wander_walk", 0.01414214, 0.4242641),
    ("baro_walk", 0.005, 0.25),
]


@pytest.mark.parametrize(("name", "low", "high"), RANGES)
def test_process_noise_stays_what_sensors_can_have(name: str, low: float, high: float) -> None:
    """Walks by what a run begins with: of the gyro 1e-5 rad/s, of the barometer 0.05 m, of a position 1 m in 100 s."""
    for value, want in ((low / 3.0, low), (high * 3.0, high)):
        tuned: Any = replace(FIRST_LEVELS, **{name: value})  # type: ignore[arg-type]
        found = calibration.calibrated(passed(), tuned, FIRST_LEVELS, 60.0, True)
        assert getattr(found, name) == pytest.approx(want, rel=1e-5)


SPREADS = [
    ("hard", 18, 3, 0.004, 0.150),
    ("soft", 21, 6, 0.003, 0.05),
    ("acc_bias", 12, 3, 0.03, 0.5),
    ("gyro_bias", 9, 3, np.radians(0.3), np.radians(10.0)),
]


@pytest.mark.parametrize(("name", "row", "count", "low", "high"), SPREADS)
def test_the_spread_of_a_constant_is_its_mean_square_with_half_a_prior(
    name: str, row: int, count: int, low: float, high: float
) -> None:
    begun = PriorSpreads()
    own, s0 = slice(row, row + count), float(getattr(begun, name))
    x, first, spread = np.zeros(39), np.zeros(39), np.zeros(39)
    sizes = s0 * (1.5 + np.arange(count))
    x[own], first[own] = 0.75 * sizes, 0.25 * sizes
    spread[own] = (2.0 * s0) ** 2
    spread[row] = -1e-3
    found = calibration.prior_of(passed(first=first, first_spread=spread), x, begun, begun)
    square = np.sum(sizes**2) + (count - 1) * (2.0 * s0) ** 2 + 0.5 * s0**2
    assert getattr(found, name) == pytest.approx(np.clip(np.sqrt(square / (count + 0.5)), low, high))
    assert low < getattr(found, name) < high
    for size, want in ((1e-9, low), (1e3, high)):
        x[own], first[own], spread[own] = size, 0.0, 1e-20
        prior = replace(begun, **{name: 1e-9})  # type: ignore[arg-type]
        assert getattr(calibration.prior_of(passed(first=first, first_spread=spread), x, begun, prior), name) == want
    unknown = calibration.prior_of(passed(first=first), x, replace(begun, **{name: 0.0123}), begun)  # type: ignore[arg-type]
    assert getattr(unknown, name) == 0.0123


def test_the_spread_of_the_declination_is_how_far_the_field_was_turned() -> None:
    """Of a level field of 0.25 G that points 36.87 deg east what moves across counts, what moves along does not."""
    begun = PriorSpreads()
    along, across = np.array([0.8, 0.6]), np.array([-0.6, 0.8])
    x, first, spread = np.zeros(39), np.zeros(39), np.zeros(39)
    x[15:18] = [0.2, 0.15, 0.4]
    first[15:17] = 0.02 * along + 0.005 * across
    spread[15:18] = [3e-5, 5e-5, 1.0]
    found = calibration.prior_of(passed(first=first, first_spread=spread), x, begun, begun)
    square = (0.005**2 + 0.36 * 3e-5 + 0.64 * 5e-5) / 0.25**2
    want = np.sqrt((square + 0.5 * np.radians(0.6) ** 2) / 1.5)
    assert np.radians(0.6) < want < np.radians(3.0)
    assert found.declination == pytest.approx(want)
    for size, limit in ((0.0, 0.6), (1.0, 3.0)):
        first[15:17] = size * across
        spread[15:18] = 0.0
        found = calibration.prior_of(passed(first=first), x, begun, begun)
        assert found.declination == pytest.approx(np.radians(limit))
    x[15:18] = 0.0
    assert calibration.prior_of(passed(first=first), x, begun, begun).declination == begun.declination


def test_a_delay_moves_by_its_state_as_far_as_its_prior_lets_it() -> None:
    """At 0.20 s, 0.08 s from the usual 0.12 s; a quarter of the prior's variance is left."""
    tuned = replace(FIRST_LEVELS, gnss_delay=0.20, mag_delay=0.04)
    first, spread = np.zeros(39), np.zeros(39)
    first[31:33], spread[31:33] = [0.015, -0.007], [0.25 * 0.08**2, 0.5 * 0.03**2]
    found = calibration.delays_by_state(passed(first=first, first_spread=spread), tuned)
    assert found.gnss_delay == pytest.approx(0.12 + 0.08 * 0.75 + 0.015)
    assert found.mag_delay == pytest.approx(0.04 * 0.5 - 0.007)
    spread[31:33] *= 9.0
    found = calibration.delays_by_state(passed(first=first, first_spread=spread), tuned)
    assert (found.gnss_delay, found.mag_delay) == pytest.approx((0.135, -0.007))
    for sign in (1.0, -1.0):
        first[31:33] = 3.0 * sign
        found = calibration.delays_by_state(passed(first=first, first_spread=spread), tuned)
        assert (found.gnss_delay, found.mag_delay) == pytest.approx((0.6 * sign, 0.15 * sign))
    kept = calibration.delays_by_state(passed(first=first), tuned)
    assert (kept.gnss_delay, kept.mag_delay) == (0.20, 0.04)


class Likelihoods:
    """Stands for a runner whose likelihood is a function of the GNSS delay; keeps which delays it was asked for."""

    def __init__(self, of: Any) -> None:
        self.timetable, self.of, self.asked = self, of, list[float]()
        self.span: tuple[float, float] | None = None

    def scheduled(self, tuned: NoiseLevels, within: tuple[float, float]) -> float:
        self.span = within
        self.asked.append(tuned.gnss_delay)
        return tuned.gnss_delay

    def forward(self, tau: float, begin: StartState, par: np.ndarray) -> Any:
        assert (begin.P[31] == 0.0).all()
        assert (begin.P[:, 31] == 0.0).all()
        return SimpleNamespace(likelihood=self.of(tau))


def searched(of: Any, begun: float = 0.12, step: float = 0.03) -> tuple[float, Likelihoods]:
    fixes = Measurements(np.arange(2.0, 20.0, 0.2), np.zeros((90, 3)))
    inputs: Any = SimpleNamespace(sensed_at=np.arange(0.0, 25.0, 0.01), velocity=fixes, gravity=9.8)
    runner: Any = Likelihoods(of)
    begin = StartState(np.array([1.0, 0, 0, 0]), np.zeros(39), np.eye(39), "static")
    found = calibration.delay_by_likelihood(runner, inputs, replace(FIRST_LEVELS, gnss_delay=begun), begin, 2.5, step)
    assert begin.P[31, 31] == 1.0
    return found.gnss_delay, runner


@pytest.mark.parametrize("best", [0.107, 0.13, 0.215, 0.04])
def test_the_delay_is_the_top_of_the_likelihoods_parabola_with_its_prior(best: float) -> None:
    """Likelihood of 10 ms about ``best``, prior of 80 ms about 120 ms: the mean by their precisions."""
    found, runner = searched(lambda tau: -0.5 * ((tau - best) / 0.010) ** 2)
    a, b = 0.010**-2, 0.080**-2
    assert found == pytest.approx((a * best + b * 0.12) / (a + b), abs=1e-6)
    assert runner.span == pytest.approx((0.7, 24.99 - 0.7))
    assert len(runner.asked) == len(set(runner.asked))


def test_the_search_goes_six_steps_at_most_and_ends_between_the_longest_delays() -> None:
    found, runner = searched(lambda tau: 1e4 * tau)
    assert max(runner.asked) == pytest.approx(0.12 + 6 * 0.03)
    assert found == pytest.approx(0.12 + 6 * 0.03)
    for sign in (1.0, -1.0):
        assert searched(lambda tau, s=sign: 1e5 * s * tau, begun=0.59 * sign)[0] == pytest.approx(0.6 * sign)


def test_without_fixes_away_from_the_ends_no_delay_is_searched() -> None:
    inputs: Any = SimpleNamespace(sensed_at=np.arange(0.0, 25.0, 0.01), velocity=None, gravity=9.8)
    begin = StartState(np.array([1.0, 0, 0, 0]), np.zeros(39), np.eye(39), "static")
    runner: Any = None
    assert calibration.delay_by_likelihood(runner, inputs, FIRST_LEVELS, begin, 2.5, 0.03) is FIRST_LEVELS
    inputs.velocity = Measurements(np.array([0.1, 0.6, 24.4]), np.zeros((3, 3)))
    assert calibration.delay_by_likelihood(runner, inputs, FIRST_LEVELS, begin, 2.5, 0.03) is FIRST_LEVELS


def test_the_first_zero_rate_noise_is_that_of_successive_means_at_rest() -> None:
    """White noise of 0.02 rad/s at 100 Hz: means of 0.2 s have a root of 20 less."""
    rng = np.random.default_rng(5)
    n = 12_000
    t = np.arange(n) * 0.01
    own = {"sensed_at": t, "dt": np.full(n, 0.01), "gyr": 0.02 * rng.standard_normal((n, 3)), "acc": np.zeros((n, 3))}
    found = calibration.first_guess(SimpleNamespace(**own, rest=np.ones(n, np.int8)), FIRST_LEVELS)  # type: ignore[arg-type]
    assert found.r[6] == pytest.approx(0.02 / np.sqrt(20.0), rel=0.1)
    assert found.r[:6] == pytest.approx(FIRST_LEVELS.r[:6])
    assert (found.acc, found.acc_rest) == (3e-3, 6e-3)
    own["gyr"] = np.zeros((n, 3))
    quiet = calibration.first_guess(SimpleNamespace(**own, rest=np.ones(n, np.int8)), FIRST_LEVELS)  # type: ignore[arg-type]
    assert quiet.gyro == 1e-4
    assert quiet.r[6] == LEAST_R[6]
    moving = calibration.first_guess(SimpleNamespace(**own, rest=np.zeros(n, np.int8)), FIRST_LEVELS)  # type: ignore[arg-type]
    assert moving.r[6] == FIRST_LEVELS.r[6]
    for looks, known in ((5, False), (6, True)):
        own["gyr"] = 0.02 * rng.standard_normal((n, 3))
        rest = (t < 0.2 * (looks + 1) - 0.005).astype(np.int8)
        few = calibration.first_guess(SimpleNamespace(**own, rest=rest), FIRST_LEVELS)  # type: ignore[arg-type]
        assert (few.r[6] != FIRST_LEVELS.r[6]) == known
