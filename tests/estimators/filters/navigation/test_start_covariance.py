"""How sure a run is as it begins: information matrices by numpy, derivatives by differences."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.estimators.filters.navigation import start
from attlog.estimators.filters.navigation.settings import NoiseLevels, PriorSpreads

PHI, V, POS, BG, BA, EARTH, HARD, WANDER = (slice(a, a + 3) for a in (0, 3, 6, 9, 12, 15, 18, 27))
SOFT = slice(21, 27)
ARM, SCALE = slice(33, 36), slice(36, 39)
BARO_BIAS, GNSS_DELAY, MAG_DELAY = 30, 31, 32
GRAVITY = 9.8
PRIOR = PriorSpreads(
    gyro_bias_rest=0.011,
    gyro_bias=0.023,
    acc_bias=0.17,
    declination=0.031,
    field_size=0.019,
    hard=0.013,
    soft=0.007,
    arm=0.043,
    scale=0.0053,
    gnss_delay=0.083,
    mag_delay=0.037,
    wander=1.3,
    baro=4.7,
)
TUNED = NoiseLevels(prior=PRIOR)
R = Rotation.from_euler("ZYX", [70.0, -20.0, 35.0], degrees=True)
FIELD = np.array([0.19, 0.07, 0.41])


def inputs(gnss: str = "", baro: bool = False, mag: bool = False, field: bool = True) -> Any:
    return SimpleNamespace(
        velocity="velocity" in gnss or None,
        position="position" in gnss or None,
        baro=baro or None,
        mag=mag or None,
        field=FIELD if field else None,
        gravity=GRAVITY,
    )


def state() -> np.ndarray:
    x = np.zeros(39)
    x[EARTH] = FIELD
    x[SOFT] = [0.02, -0.03, 0.04, 0.01, -0.015, 0.025]
    x[HARD] = [0.01, -0.02, 0.03]
    return x


def measured(phi: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The field that a compass with soft and hard iron shows: (I + S) R^T exp(-phi) M + h."""
    xx, yy, zz, xy, xz, yz = x[SOFT]
    soft = np.eye(3) + np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return soft @ (Rotation.from_rotvec(phi) * R).inv().apply(x[EARTH]) + x[HARD]


def test_the_rows_of_a_field_sample_are_the_derivatives_of_what_a_compass_shows() -> None:
    x, want = state(), np.zeros((3, 39))
    for k in range(39):
        for sign in (1.0, -1.0):
            d = np.zeros(39)
            d[k] = sign * 1e-5
            want[:, k] += sign * measured(d[:3], np.where(np.arange(39) < 3, 0.0, x + d)) / 2e-5
    np.testing.assert_allclose(start.field_matrix(R.as_matrix(), x), want, atol=1e-9)


CASES: list[tuple[start.How, dict[str, Any], bool, dict[str, float]]] = [
    ("static", {"gnss": "velocity position", "baro": True, "mag": True}, True, {"v": 0.05, "p": 5.0, "bg": 0.011}),
    ("quiet", {"gnss": "velocity", "mag": True}, True, {"v": 1.0, "p": 5.0, "bg": 0.023}),
    ("motion", {"gnss": "position", "baro": True}, False, {"v": 5.0, "p": 20.0, "bg": 0.023}),
    ("motion", {"mag": True}, False, {"v": 1.0, "p": 5.0, "bg": 0.023}),
]


@pytest.mark.parametrize(("how", "given", "near", "own"), CASES)
def test_the_start_is_the_priors_and_one_sample_of_gravity_and_field(
    how: start.How, given: dict[str, Any], near: bool, own: dict[str, float]
) -> None:
    """Information adds up: inverse of the priors' covariance and H^T H / sigma^2 of both sensors."""
    found = start.covariance(inputs(**given), TUNED, np.roll(R.as_quat(), 1), state(), how, near)
    mag, gnss = given.get("mag", False), bool(given.get("gnss"))
    sd = np.zeros(39)
    sd[PHI] = np.radians([30.0, 30.0, 30.0 if mag else 60.0])
    sd[V], sd[POS], sd[BG], sd[BA], sd[SCALE] = own["v"], own["p"], own["bg"], 0.17, 0.0053
    if gnss:
        sd[ARM], sd[GNSS_DELAY] = 0.043, 0.083
        sd[WANDER] = 1.3 if "position" in given["gnss"] else 0.0
    if given.get("baro"):
        sd[BARO_BIAS] = 4.7
    P = np.diag(sd**2)
    if mag:
        sd[HARD], sd[SOFT], sd[MAG_DELAY], sd[EARTH] = 0.013, 0.007, 0.037, 1.0
        P = np.diag(sd**2)
        along, across = 0.019 * np.linalg.norm(FIELD), 0.031 * np.hypot(*FIELD[:2])
        turn = Rotation.from_euler("z", np.arctan2(FIELD[1], FIELD[0])).as_matrix()
        P[EARTH, EARTH] = turn @ np.diag([along, across, along]) ** 2 @ turn.T
    H = np.zeros((3, 39))
    for k in range(3):
        step = 1e-6 * np.eye(3)[k]
        H[:, k] = [
            (x - y) / 2e-6
            for x, y in zip(
                (Rotation.from_rotvec(step) * R).inv().apply([0, 0, -GRAVITY]),
                (Rotation.from_rotvec(-step) * R).inv().apply([0, 0, -GRAVITY]),
                strict=True,
            )
        ]
    H[:, BA] = np.eye(3)
    there = sd > 0.0
    noise = {"static": (0.05, 0.003), "quiet": (0.5, 0.010), "motion": (0.7, 0.030)}[how]
    information = np.linalg.inv(P[np.ix_(there, there)]) + H[:, there].T @ H[:, there] / noise[0] ** 2
    if mag:
        rows = start.field_matrix(R.as_matrix(), state())[:, there]
        information += rows.T @ rows / noise[1] ** 2
    np.testing.assert_allclose(found[np.ix_(there, there)], np.linalg.inv(information), rtol=1e-5, atol=1e-9)
    assert (found[~there] == 0.0).all()
    assert (found[:, ~there] == 0.0).all()


@pytest.mark.parametrize(
    ("field", "gnss", "along", "across"),
    [
        (True, "velocity", 0.019, 0.031),
        (False, "velocity", 0.1, np.hypot(0.031, np.radians(15.0))),
        (False, "", 0.1, 0.031),
    ],
)
def test_a_field_of_no_model_is_known_to_a_tenth_and_its_declination_to_15_deg(
    field: bool, gnss: str, along: float, across: float
) -> None:
    found = start._field_spread(inputs(gnss, mag=True, field=field), TUNED, FIELD, bool(gnss))
    level = np.hypot(*FIELD[:2])
    n, e = np.array([FIELD[0], FIELD[1], 0.0]) / level, np.array([-FIELD[1], FIELD[0], 0.0]) / level
    size = np.linalg.norm(FIELD)
    assert n @ found @ n == pytest.approx((along * size) ** 2)
    assert e @ found @ e == pytest.approx((across * level) ** 2)
    assert found[2, 2] == pytest.approx((along * size) ** 2)
    assert n @ found @ e == pytest.approx(0.0, abs=1e-15)


def test_a_vertical_field_has_no_direction() -> None:
    found = start._field_spread(inputs(mag=True), TUNED, np.array([0.0, 0.0, 0.5]), False)
    np.testing.assert_allclose(found, np.diag([0.0095, 0.0, 0.0095]) ** 2, atol=1e-15)
