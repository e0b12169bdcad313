"""Where jumps of the gyro bias are looked for, how large and how sure they are told: closed forms of one axis."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.estimators.filters.navigation.passes import jumps

OPENED = np.radians(3.0)


def shocks(lam: Any, Lam: Any) -> np.ndarray:
    """Scores (m, 12) of diagonal information."""
    lam, Lam = np.atleast_2d(lam), np.atleast_2d(Lam)
    out = np.zeros((len(lam), 12))
    out[:, :3] = lam
    out[:, [3, 7, 11]] = Lam
    return out


def test_gain_and_size_of_independent_axes_are_sums_of_their_own() -> None:
    lam, Lam = np.array([90.0, -200.0, 40.0]), np.array([9e3, 2e4, 1e3])
    gain, size = jumps.gains(shocks(lam, Lam))
    assert size[0] == pytest.approx(-lam / (Lam + OPENED**-2))
    want = 0.5 * lam**2 / (Lam + OPENED**-2) - 0.5 * np.log(1.0 + OPENED**2 * Lam)
    assert gain[0] == pytest.approx(want.sum())


def test_a_candidate_is_two_seconds_from_the_ends_and_other_jumps_and_above_0_2_deg_s() -> None:
    when = np.arange(0.0, 20.0, 0.25)

    def found(at: dict[float, float], known: tuple[float, ...] = ()) -> tuple[float, float]:
        lam = np.zeros((len(when), 3))
        for t, dps in at.items():
            lam[round(t / 0.25), 1] = -np.radians(dps) * (1e6 + OPENED**-2)
        told: Any = SimpleNamespace(shocks=shocks(lam, np.full_like(lam, 1e6)))
        return jumps.candidate(told, when, known)

    end = when[-1]
    assert found({1.75: 3.0, 2.25: 1.0, end - 2.25: 0.9, end - 1.75: 3.0})[0] == 2.25
    assert found({1.75: 3.0, end - 2.25: 0.9, end - 1.75: 3.0})[0] == end - 2.25
    assert found({10.0: 3.0, 12.25: 1.0}, (10.5,))[0] != 10.0
    assert found({8.25: 1.0, 8.75: 3.0, 12.25: 2.0, 12.75: 1.5}, (10.5,))[0] == 12.75
    gain = jumps.gains(shocks([0.0, -np.radians(0.21) * (1e6 + OPENED**-2), 0.0], [1e6] * 3))[0][0]
    assert found({9.0: 0.21}) == (9.0, pytest.approx(gain))
    assert found({9.0: 0.19}) == (0.0, 0.0)


def test_a_modelled_jump_is_told_by_the_scores_of_its_own_node() -> None:
    when = np.arange(0.0, 10.0, 0.5)
    jump = np.zeros(20)
    jump[[4, 12]] = OPENED
    lam, Lam = np.zeros((20, 3)), np.zeros((20, 3))
    lam[12], Lam[12] = [1.0, -2.0, 3.0], [0.1 / OPENED**2, 0.9 / OPENED**2, 1.1 / OPENED**2]
    found: Any = SimpleNamespace(schedule=SimpleNamespace(jump=jump), shocks=shocks(lam, Lam))
    first, second = jumps.modelled(found, when, (2.1, 5.9), (0.1, 0.2))
    assert (first.t, first.t_sigma, second.t, second.t_sigma) == (2.1, 0.1, 5.9, 0.2)
    assert first.sigma == pytest.approx(np.full(3, OPENED))
    assert second.size == pytest.approx(OPENED**2 * np.array([-1.0, 2.0, -3.0]))
    assert second.sigma == pytest.approx(OPENED * np.sqrt([0.9, 0.1, 0.0]))


@pytest.mark.parametrize(
    ("dps", "sigma", "counts", "believable"),
    [(0.19, 0.1, False, True), (0.21, 0.29, True, True), (9.9, 0.1, True, True), (10.1, 0.1, True, False)],
)
def test_jumps_count_from_0_2_and_are_believed_to_10_deg_s(
    dps: float, sigma: float, counts: bool, believable: bool
) -> None:
    size = np.radians(dps) * np.array([0.6, 0.0, -0.8])
    jump = jumps.Jump(1.0, 0.1, size, np.radians([0.01, sigma, 0.02]))
    assert (jump.counts, jump.believable) == (counts, believable)
    assert np.degrees(jump.rate) == pytest.approx(dps)
    unsure = jumps.Jump(1.0, 0.1, size, np.radians([0.01, 0.31, 0.02]))
    assert not unsure.believable


def test_each_of_two_times_moves_to_its_own_top_and_the_wider_side_is_its_sigma() -> None:
    """A likelihood that falls by 2 within 0.3 s before and 2.4 s after the first time; one with a far, flat side."""
    asked: list[float] = []

    def likelihood(times: tuple[float, ...]) -> float:
        a, b = times[0] - 10.4, times[1] - 19.0
        asked.append(b)
        return -2.0 * (a / (0.3 if a < 0.0 else 2.4)) ** 2 - (3.0 * b * b if b < 0.0 else 1e-3 * b)

    times, sigmas = jumps.placed((9.0, 20.0), likelihood)
    assert times == pytest.approx((10.4, 19.0), abs=0.051)
    assert sigmas[0] == pytest.approx(0.5 * 3.2)
    assert sigmas[1] == pytest.approx(0.5 * 0.05 * 2**10)
    assert 13.0 < max(asked) < 26.1


def test_runs_agree_within_three_joint_sigmas_and_a_tenth_of_a_deg_s() -> None:
    def one(t: float, dps: float, sigma: float) -> tuple[jumps.Jump, ...]:
        return (jumps.Jump(t, 0.1, np.radians([0.0, dps, 0.0]), np.radians([0.0, sigma, 0.0])),)

    base = one(5.0, 1.0, 0.03)
    limit = 3.0 * np.hypot(0.03, 0.04) + 0.1
    assert jumps.agree(base, one(5.0, 1.0 + 0.99 * limit, 0.04))
    assert not jumps.agree(base, one(5.0, 1.0 + 1.01 * limit, 0.04))
    assert not jumps.agree(base, one(5.0, 1.0 - 1.01 * limit, 0.04))
    assert jumps.agree(base, one(6.0, 9.0, 0.04))


def test_each_rest_of_two_seconds_shows_the_bias() -> None:
    """The first and last rest count, as means; one of 1.9 s is too short to tell."""
    t = 0.01 * np.arange(2000)
    still, gyr = np.zeros(2000, bool), np.ones((2000, 3))
    for begin, long, rate in ((0, 201, 0.0), (500, 300, 0.7), (900, 202, 0.03), (1500, 195, 0.5)):
        still[begin : begin + long] = True
        gyr[begin : begin + long] = rate * np.array([0.6, 0.0, -0.8])
    inputs: Any = SimpleNamespace(t=t, still=still, gyr=gyr)
    assert jumps.bias_change_dps(inputs) == pytest.approx(np.degrees(0.03))
    assert jumps.changed_at_rest(inputs)
    gyr[900:1102] = np.radians(0.49) * np.array([0.6, 0.0, -0.8])
    assert not jumps.changed_at_rest(inputs)
    still[1600:] = True
    gyr[1600:] = 0.0
    assert jumps.bias_change_dps(inputs) > 1.0
