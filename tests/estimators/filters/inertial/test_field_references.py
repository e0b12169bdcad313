"""How `mekf` calibrates a field, and when it takes a new one for the earth's: by numpy and from both sides."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.estimators.filters.inertial import compass
from attlog.estimators.filters.inertial import layout as at

RAD = math.pi / 180.0


def steady(psi: float = 0.0, rate_dps: float = 30.0, known: float = 0.0) -> np.ndarray:
    """A field of 0.3 level and 0.4 down that stays at heading ``psi`` while the body turns."""
    state = np.zeros(1000)
    state[at.T], state[at.TURNED] = 0.5, 0.5 * (rate_dps * RAD) ** 2
    field = [0.3 * math.cos(psi), 0.3 * math.sin(psi), 0.4]
    state[at.HL : at.HL + 3] = state[at.HC : at.HC + 3] = field
    state[at.P + 2 * (at.N + 1)] = known
    return state


def looked(state: np.ndarray, seconds: float, good: bool = False) -> bool:
    """What is said after so long, in steps of half a second."""
    told = good
    for _ in range(round(seconds / 0.5)):
        told = compass.candidate(state, np.zeros(23), 0.5, 0.9, 0.1, good)
    return told


def test_a_field_that_stays_for_ten_seconds_of_turning_becomes_the_reference() -> None:
    state = steady()
    assert not looked(state, 9.5)
    assert state[at.NORM] == 0.0
    assert looked(state, 0.5)
    assert (state[at.NORM], state[at.DIP]) == pytest.approx((0.5, math.atan2(0.4, 0.3)))
    assert state[at.UNDISTURBED] == 0.5
    assert state[at.CLOCK] == 0.0
    known = steady()
    assert looked(known, 10.0, good=True)
    assert known[at.NORM] == 0.0


@pytest.mark.parametrize(("rate", "counts"), [(20.5, True), (19.5, False)])
def test_it_must_turn_by_20_degrees_per_second(rate: float, counts: bool) -> None:
    state = steady(rate_dps=rate)
    looked(state, 12.0)
    assert (state[at.NORM] > 0.0) == counts


@pytest.mark.parametrize(("off", "stays"), [(0.17, True), (0.19, False)])
@pytest.mark.parametrize("axis", range(3))
def test_a_field_that_moves_by_18_percent_begins_anew(off: float, stays: bool, axis: int) -> None:
    state = steady()
    looked(state, 5.0)
    state[at.HL + axis] += off * 0.5
    compass.candidate(state, np.zeros(23), 0.5, 0.9, 0.1, False)
    assert (state[at.CLOCK] > 0.0) == stays
    follow = 1.0 - math.exp(-0.5 / 15.0) if stays else 1.0
    assert state[at.HC + axis] == pytest.approx([0.3, 0.0, 0.4][axis] + follow * off * 0.5)


@pytest.mark.parametrize(
    ("deg", "known_deg", "opens"),
    [(15.5, 0.0, False), (16.5, 0.0, True), (-16.5, 0.0, True), (19.5, 3.0, False), (20.5, 3.0, True)],
)
def test_a_heading_that_a_steady_field_contradicts_by_four_sigmas_is_opened(
    deg: float, known_deg: float, opens: bool
) -> None:
    """Sigma is that of the heading and four degrees."""
    known = (known_deg * RAD) ** 2
    state = steady(deg * RAD, known=known)
    looked(state, 10.0, good=True)
    assert state[at.P + 2 * (at.N + 1)] == pytest.approx(known + (deg * RAD) ** 2 * opens)


def test_after_a_disturbance_a_field_must_be_sound_for_half_a_second() -> None:
    state = np.zeros(1000)
    state[at.T], state[at.H_SINCE] = 0.125, 0.125
    for _ in range(160):
        compass.trust(state, np.zeros(23), 0.3, 0.0, 0.4)
    assert compass.trust(state, np.zeros(23), 0.39, 0.0, 0.52) == 0.0
    weights = [compass.trust(state, np.zeros(23), 0.3, 0.0, 0.4) for _ in range(6)]
    assert weights == [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("offset", "known", "odd"), [(0.30, 0.002, 1.0), (0.02, 0.002, 1.0), (0.30, 0.0004, 1.0), (0.30, 0.0004, 30.0)]
)
def test_offset_and_delay_are_a_kalman_filters_and_the_offset_counts_beyond_four_sigmas(
    offset: float, known: float, odd: float
) -> None:
    """A component beyond three sigmas counts as if its noise were as large."""
    random = np.random.default_rng(3)
    R = Rotation.from_euler("ZYX", [40.0, -20.0, 10.0], degrees=True).as_matrix()
    rate, T, since = np.array([0.3, -0.5, 0.7]), 0.025, 0.1
    earth, o, tau = np.array([0.5, 0.1, 0.8]), offset * np.array([0.6, 0.0, -0.8]), 0.012
    P = np.diag([1e-3] * 3 + [known] * 3 + [2e-4])
    root = 1e-3 * random.normal(size=(7, 7))
    P = P + root @ root.T
    state, params = np.zeros(1000), np.zeros(23)
    state[at.T], state[at.H_SINCE], state[at.UNIT] = T, since, 2.0
    state[at.TURNED] = T * 0.14**2
    state[at.A : at.A + 9] = T * R.ravel()
    # R diag(w) dt, whose rows sum to R w.
    state[at.B : at.B + 27] = 0.0
    for k in range(3):
        for j in range(3):
            state[at.B + 9 * k + 4 * j] = T * R[k, j] * rate[j]
    state[at.CAL : at.CAL + 7] = x = np.r_[earth, o, tau]
    state[at.CAL_P : at.CAL_P + 49] = P.ravel()
    late = np.cross(R @ rate, earth)
    seen = 2.0 * (earth + R @ o + tau * late) + odd * np.array([0.02, -0.03, 0.01])
    found = compass.calibrated(state, params, *seen)
    P[:3, :3] += 0.01**2 * 0.4 * since * np.eye(3)
    noise = 0.023**2 * 0.6 / since
    for i in range(3):
        h = np.r_[np.eye(3)[i], R[i], late[i]]
        z, c = seen[i] / 2.0 - h @ x, P @ h
        spread, limit = noise, 9.0 * (h @ c + 0.023**2)
        spread *= max(z * z / limit, 1.0)
        s = h @ c + spread
        x, P = x + c * z / s, P - np.outer(c, c) / s
    assert state[at.CAL : at.CAL + 7] == pytest.approx(x)
    assert state[at.CAL_P : at.CAL_P + 49].reshape(7, 7) == pytest.approx(P)
    share = max(1.0 - 16.0 * np.trace(P[3:6, 3:6]) / np.sum(x[3:6] ** 2), 0.0)
    assert found == pytest.approx(seen - 2.0 * (share * R @ x[3:6] + x[6] * late))
