"""By which way a run finds its start: limits from both sides, attitudes against scipy."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.estimators import Measurements
from attlog.estimators.filters.navigation import start
from attlog.estimators.filters.navigation.inputs import NoiseLevels
from attlog.estimators.filters.navigation.model import E

Array = np.ndarray
G = 9.8
TUNED = NoiseLevels(gnss_delay=0.0)
TRUTH = Rotation.from_euler("ZYX", [70.0, -20.0, 35.0], degrees=True)
FIELD = np.array([0.19, 0.07, 0.41])
T = np.arange(0.0, 9.5, 0.01)


def inputs(**given: Any) -> Any:
    """Samples at 100 Hz of a vehicle that hangs still at TRUTH; nothing says that it rests."""
    n = len(T)
    own = {
        "t": T,
        "sensed_at": T,
        "dt": np.full(n, 0.01),
        "gyr": np.zeros((n, 3)),
        "acc": np.tile(TRUTH.inv().apply([0.0, 0.0, -G]), (n, 1)),
        "still": np.zeros(n, bool),
        "velocity": None,
        "position": None,
        "baro": None,
        "mag": None,
        "field": None,
        "gravity": G,
    }
    return SimpleNamespace(**(own | given))


def compass() -> Measurements:
    t = np.arange(0.0, 6.0, 0.05)
    return Measurements(t, np.tile(TRUTH.inv().apply(FIELD), (len(t), 1)))


def fixes(speed: float, first: float = 0.0) -> Measurements:
    t = first + np.arange(0.0, 5.0, 0.2)
    return Measurements(t, np.tile([speed * 0.6, 0.0, speed * 0.8], (len(t), 1)))


def angle(q: np.ndarray, to: Rotation) -> float:
    return float(np.degrees((Rotation.from_quat(np.roll(q, -1)) * to.inv()).magnitude()))


def test_who_mostly_rests_in_the_first_two_seconds_starts_static_with_the_rate_of_rest() -> None:
    bias = np.array([0.01, -0.02, 0.03])
    for rested, how in ((1.1, "static"), (0.9, "quiet")):
        gyr = np.tile(bias, (len(T), 1))
        gyr[T > rested] = 0.02
        found, q, rate = start._attitude(inputs(still=rested + 0.001 >= T, gyr=gyr, mag=compass(), field=FIELD), TUNED)
        assert found == how
        assert rate == pytest.approx(bias if how == "static" else np.zeros(3))
        assert angle(q, TRUTH) < 1e-5
    still = np.ones(len(T), bool)
    short = {"t": T[:58], "sensed_at": T[:58], "still": still[:58]}
    assert start._attitude(inputs(still=still), TUNED)[0] == "static"
    assert start._attitude(inputs(**short, gyr=np.zeros((58, 3)), acc=inputs().acc[:58]), TUNED)[0] == "quiet"


def test_a_start_takes_velocity_and_place_of_a_fix_unless_it_stands() -> None:
    place = Measurements(np.array([1.0, 1.2]), np.array([[3.0, np.nan, 5.0], [9.0, 9.0, 9.0]]))
    own = inputs(velocity=fixes(0.5), position=place, gyr=np.zeros((len(T), 3)))
    found = start.start(own, TUNED)
    assert found.how == "quiet"
    assert found.x[3:9] == pytest.approx([0.3, 0.0, 0.4, 3.0, 0.0, 5.0])
    own.still = np.ones(len(T), bool)
    stands = start.start(own, TUNED)
    assert stands.x[3:9] == pytest.approx([0.0, 0.0, 0.0, 3.0, 0.0, 5.0])
    known = stands.copy()
    known.q, known.x = np.array([0.6, 0.0, 0.0, 0.8]), np.arange(39.0)
    again = start.start(own, TUNED, known)
    assert again.q == pytest.approx(known.q)
    assert again.x[3:9] == pytest.approx(np.arange(3.0, 9.0))
    assert (again.x[9:12] == stands.x[9:12]).all()
    late = Measurements(place.t + 1.1, place.x)
    assert (start.start(inputs(position=late), TUNED).x[6:9] == 0.0).all()


@pytest.mark.parametrize("degrees", [(70.0, -20.0, 35.0), (-160.0, 60.0, -120.0)])
def test_two_vectors_make_the_attitude_and_a_model_of_the_field_true_north(degrees: tuple[float, float, float]) -> None:
    truth = Rotation.from_euler("ZYX", degrees, degrees=True)
    force, field = truth.inv().apply([0.0, 0.0, -G]), truth.inv().apply(FIELD)
    assert angle(start.from_vectors(force, field, FIELD), truth) < 1e-5
    declination = np.degrees(np.arctan2(FIELD[1], FIELD[0]))
    magnetic = Rotation.from_euler("ZYX", [degrees[0] - declination, *degrees[1:]], degrees=True)
    assert angle(start.from_vectors(force, field, None), magnetic) < 1e-5
    level = Rotation.from_euler("ZYX", [0.0, *degrees[1:]], degrees=True)
    assert angle(start.from_vectors(force, None, FIELD), level) < 1e-5


def test_a_field_along_gravity_says_nothing_and_no_force_is_no_attitude() -> None:
    force = TRUTH.inv().apply([0.0, 0.0, -G])
    q = start.from_vectors(force, -2.0 * force, None)
    assert Rotation.from_quat(np.roll(q, -1)).apply(force) == pytest.approx([0.0, 0.0, -G])
    for axis in np.eye(3):
        q = start.from_vectors(-G * axis, axis, None)
        assert Rotation.from_quat(np.roll(q, -1)).apply(-G * axis) == pytest.approx([0.0, 0.0, -G])
    assert start.from_vectors(np.full(3, 1e-7), FIELD, FIELD) == pytest.approx([1.0, 0.0, 0.0, 0.0])


def turning(field: Array | None, gnss: bool = True) -> Any:
    """A vehicle that is accelerated to and fro while it yaws; truth at its first sample is TRUTH."""
    rate = np.array([0.1, -0.2, 0.3])
    attitude = TRUTH * Rotation.from_rotvec(np.outer(T, rate))
    accel = np.column_stack([3.0 * np.sin(1.5 * T), 2.0 * np.cos(1.1 * T), 1.0 * np.sin(0.7 * T)])
    velocity = np.vstack([np.zeros(3), np.cumsum(0.5 * (accel[1:] + accel[:-1]) * 0.01, axis=0)])
    acc = attitude.inv().apply(accel - [0.0, 0.0, G])
    acc[1:] = 0.5 * (acc[1:] + acc[:-1])
    mag = Measurements(T[::5], attitude.inv().apply(field)[::5]) if field is not None else None
    v = Measurements(T[::20], velocity[::20]) if gnss else None
    return inputs(gyr=np.tile(rate, (len(T), 1)), acc=acc, velocity=v, mag=mag)


@pytest.mark.parametrize("field", [None, np.array([0.2, 0.0, 0.41])])
def test_in_motion_gnss_and_the_gyro_show_attitude_and_north(field: Array | None) -> None:
    """With a compass as well, whose field nobody tells: its dip is that of the attitude by GNSS."""
    assert angle(start._in_motion(turning(field), TUNED), TRUTH) < 0.3


def test_in_motion_without_gnss_the_mean_force_of_two_seconds_is_down() -> None:
    own = turning(FIELD, gnss=False)
    steady = inputs(gyr=own.gyr, acc=(TRUTH * Rotation.from_rotvec(np.outer(T, own.gyr[0]))).inv().apply([0, 0, -G]))
    steady.acc[T > 2.02] = [0.0, 50.0, 0.0]
    steady.mag, steady.field = own.mag, FIELD
    # A sample holds the force of the interval before it, half a sample late: 0.1 deg.
    assert angle(start._in_motion(steady, TUNED), TRUTH) < 0.2


# With which field and turns a navigation filter starts: closed forms in every axis.


# How sure a run is as it begins: information matrices by numpy, derivatives by differences.

PHI, V, POS, BG, BA, EARTH, HARD, WANDER = (
    slice(a, a + 3) for a in (E.phi, E.v, E.pos, E.bg, E.ba, E.earth, E.hard, E.wander)
)
SOFT = slice(E.soft, E.soft + 6)
R = Rotation.from_euler("ZYX", [70.0, -20.0, 35.0], degrees=True)
COVARIANCE_FIELD = np.array([0.19, 0.07, 0.41])


def state() -> np.ndarray:
    x = np.zeros(39)
    x[EARTH] = COVARIANCE_FIELD
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
