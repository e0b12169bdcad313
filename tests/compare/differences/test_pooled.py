"""Pooling over logs against published worked examples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats  # type: ignore[import-untyped]

from attlog.compare.differences import pooled


def test_hartung_and_knapps_interval_is_that_of_the_published_example() -> None:
    """IntHout, Ioannidis & Borm 2014 (BMC Med Res Methodol 14:25), first example, appendix 3, with its weights."""
    mean, error = pooled.hartung_knapp([-0.04, -0.07, -0.31, -1.36, -0.54], [24.0, 22.2, 21.3, 15.5, 17.0])
    assert mean == pytest.approx(-0.3938, abs=5e-5)
    assert error == pytest.approx(0.2254, abs=5e-5)
    half = stats.t.ppf(0.975, 4) * error
    assert (mean - half, mean + half) == pytest.approx((-1.0195, 0.2319), abs=2e-4)


def bcg() -> tuple[np.ndarray, np.ndarray]:
    """Log risk ratios and variances of 13 trials of a vaccine (Colditz et al. 1994)."""
    table = np.array(
        [
            [4, 119, 11, 128],
            [6, 300, 29, 274],
            [3, 228, 11, 209],
            [62, 13536, 248, 12619],
            [33, 5036, 47, 5761],
            [180, 1361, 372, 1079],
            [8, 2537, 10, 619],
            [505, 87886, 499, 87892],
            [29, 7470, 45, 7232],
            [17, 1699, 65, 1600],
            [186, 50448, 141, 27197],
            [5, 2493, 3, 2338],
            [27, 16886, 29, 17825],
        ],
        float,
    )
    a, b, c, d = table.T
    return np.log(a / (a + b) / (c / (c + d))), 1 / a - 1 / (a + b) + 1 / c - 1 / (c + d)


def test_tau_and_the_mean_are_dersimonian_and_lairds_of_the_published_example() -> None:
    """Viechtbauer 2010 (J Stat Softw 36(3)), the vaccine trials: tau^2 0.3088, I^2 92.12 %, mean -0.7141."""
    y, variance = bcg()
    tau2, i2 = pooled.between(y, variance)
    assert tau2 == pytest.approx(0.3088, abs=5e-5)
    assert i2 == pytest.approx(92.12, abs=5e-3)
    found = pooled.pool(list(y), list(np.sqrt(variance)))
    assert found.value == pytest.approx(-0.7141, abs=5e-5)
    assert (found.better, found.worse, found.logs) == (11, 2, 13)


def test_logs_that_agree_too_well_do_not_make_the_interval_narrower_than_their_own_errors() -> None:
    found = pooled.pool([0.1, 0.1001, 0.0999], [0.05, 0.05, 0.05])
    assert found.ci95 is not None
    assert 0.5 * (found.ci95[1] - found.ci95[0]) == pytest.approx(stats.t.ppf(0.975, 2) * 0.05 / np.sqrt(3), rel=1e-6)


def test_no_difference_on_any_log_is_none_at_all() -> None:
    found = pooled.pool([0.0, 0.0, 0.0], [0.1, 0.2, None])
    assert (found.value, found.ci95, found.p, found.same) == (0.0, (0.0, 0.0), 1.0, 3)


def test_one_log_keeps_its_own_interval() -> None:
    found = pooled.pool([-0.2], [0.05], alone=((-0.3, -0.1), 0.001))
    assert (found.value, found.ci95, found.p, found.better) == (-0.2, (-0.3, -0.1), 0.001, 1)


def test_a_log_without_an_error_makes_all_weigh_the_same() -> None:
    y = [1.0, 2.0, 4.0]
    found = pooled.pool(y, [0.1, None, 0.2])
    wanted = stats.t.interval(0.95, 2, np.mean(y), stats.sem(y))
    assert found.ci95 == pytest.approx(wanted)
    assert found.p == pytest.approx(stats.ttest_1samp(y, 0.0).pvalue)


def test_the_pooled_interval_covers_the_mean_of_all_logs() -> None:
    """Unequal errors, true scatter: 95 % over 1000 draws of nine logs, between 93 and 98."""
    rng, inside = np.random.default_rng(5), 0
    for _ in range(1000):
        errors = rng.uniform(0.02, 0.2, 9)
        y = -0.3 + rng.normal(0.0, 0.1, 9) + rng.normal(0.0, 1.0, 9) * errors
        ci95 = pooled.pool(list(y), list(errors)).ci95
        assert ci95 is not None
        inside += ci95[0] <= -0.3 <= ci95[1]
    assert 930 <= inside <= 980


def test_an_error_of_zero_weighs_no_more_than_the_smallest_that_is_known() -> None:
    assert pooled.pool([-1.0, 0.4, 0.9], [0.0, 0.5, 0.8]) == pooled.pool([-1.0, 0.4, 0.9], [0.5, 0.5, 0.8])
