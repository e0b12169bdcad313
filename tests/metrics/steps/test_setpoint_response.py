"""The response to a step of the set-point from records in closed form: a first-order lag behind a delay."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.metrics.steps import setpoint_response as response

STEP = 0.02
T = STEP * np.arange(6000)
DELAY, LAG = 0.06, 0.1


def flown(gain: float = 1.0, seed: int = 1) -> response.NormalEquations:
    """Set-points that jump every half second, other ones for each axis, and what follows them."""
    rng = np.random.default_rng(seed)
    wanted = np.repeat(rng.normal(size=(240, 2)) * [10.0, 6.0], 25, axis=0)
    after = np.arange(0.0, 3.0, STEP)
    impulse = np.where(after >= DELAY, np.exp(-(after - DELAY) / LAG), 0.0)
    impulse /= impulse.sum()
    follows = np.column_stack([np.convolve(x, impulse)[: len(x)] for x in wanted.T])
    blocks = response.blocks_of([(T, wanted, gain * follows)])
    assert blocks is not None
    return blocks


def test_the_response_is_that_of_the_filter_behind_its_delay_and_ends_at_one() -> None:
    t, step = response.response(flown())
    exact = np.where(t >= DELAY, 1.0 - np.exp(-(t - DELAY + 0.5 * STEP) / LAG), 0.0)
    np.testing.assert_allclose(step, exact, atol=0.04)
    assert np.mean(step[t >= 0.8]) == pytest.approx(1.0)
    half, rise, peak, settled = response.features(t, step)
    assert half == pytest.approx(DELAY + LAG * np.log(2.0) - 0.5 * STEP, abs=0.01)
    assert rise == pytest.approx(LAG * np.log(9.0), abs=0.015)
    assert peak == pytest.approx(1.0, abs=0.02)
    assert settled == pytest.approx(DELAY + LAG * np.log(20.0) - 0.5 * STEP, abs=0.03)


@pytest.mark.parametrize(("gain", "known"), [(0.25, True), (0.15, False), (-1.0, False)])
def test_what_follows_a_fifth_of_its_set_point_or_less_has_no_response(gain: float, known: bool) -> None:
    _, step = response.response(flown(gain))
    assert bool(np.isfinite(step).all()) is known
    assert bool(np.isfinite(response.features(T[: len(step)], step)).all()) is known


def test_blocks_count_both_axes_and_a_choice_of_them_is_their_part() -> None:
    blocks = flown()
    assert set(blocks.axis.tolist()) == {0, 1}
    pitch = blocks.only(blocks.axis == 1)
    assert len(pitch.yy) == np.count_nonzero(blocks.axis == 1)
    np.testing.assert_array_equal(pitch.xx, blocks.xx[blocks.axis == 1])
    still = np.zeros((len(T), 2))
    assert response.blocks_of([(T, still, still)]) is None
    assert response.blocks_of([]) is None


def test_features_of_straight_lines_are_read_between_samples() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    half, rise, peak, settled = response.features(t, np.array([0.0, 0.4, 1.2, 1.0, 1.0]))
    assert (half, peak) == (pytest.approx(1.0 + 0.1 / 0.8), 1.2)
    assert rise == pytest.approx(1.0 + 0.5 / 0.8 - 0.25)
    assert settled == pytest.approx(2.0 + 0.15 / 0.2)
    assert response.features(t, np.array([0.0, 0.4, 0.7, 0.8, 0.9]))[3] == 4.0
    assert np.isnan(response.features(t, np.array([0.0, 0.1, 0.2, 0.3, 0.4]))[0])
    assert np.isnan(response.features(t, np.full(5, np.nan))).all()
