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
from attlog.estimators.filters.navigation.inputs import MIN_R, NoiseLevels, prepare_inputs
from attlog.estimators.filters.navigation.model import E
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
    assert (found.r >= MIN_R).all()
    assert found.gyro == tuned.gyro


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
        assert (begin.P[E.gnss_delay] == 0.0).all()
        assert (begin.P[:, E.gnss_delay] == 0.0).all()
        return SimpleNamespace(likelihood=self.of(tau))


def searched(of: Any, begun: float = 0.12, step: float = 0.03) -> tuple[float, Likelihoods]:
    fixes = Measurements(np.arange(2.0, 20.0, 0.2), np.zeros((90, 3)))
    inputs: Any = SimpleNamespace(sensed_at=np.arange(0.0, 25.0, 0.01), velocity=fixes, gravity=9.8)
    runner: Any = Likelihoods(of)
    begin = StartState(np.array([1.0, 0, 0, 0]), np.zeros(39), np.eye(39), "static")
    found = calibration.delay_by_likelihood(runner, inputs, replace(FIRST_LEVELS, gnss_delay=begun), begin, 2.5, step)
    assert begin.P[E.gnss_delay, E.gnss_delay] == 1.0
    return found.gnss_delay, runner


@pytest.mark.parametrize("best", [0.107, 0.13, 0.215, 0.04])
def test_the_delay_is_the_top_of_the_likelihoods_parabola_with_its_prior(best: float) -> None:
    """Likelihood of 10 ms about ``best``, prior of 80 ms about 120 ms: the mean by their precisions."""
    found, runner = searched(lambda tau: -0.5 * ((tau - best) / 0.010) ** 2)
    a, b = 0.010**-2, 0.080**-2
    assert found == pytest.approx((a * best + b * 0.12) / (a + b), abs=1e-6)
    assert runner.span == pytest.approx((0.7, 24.99 - 0.7))
    assert len(runner.asked) == len(set(runner.asked))
