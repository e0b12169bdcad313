"""By which way a run finds its start: limits from both sides, attitudes against scipy."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.core import rotation
from attlog.estimators import Measurements
from attlog.estimators.filters.navigation import start
from attlog.estimators.filters.navigation.inputs import NoiseLevels, PriorSpreads, RunningMean

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


@pytest.mark.parametrize(
    ("dps", "more", "speed", "first", "how"),
    [
        (2.9, 0.0, 0.0, 0.0, "quiet"),
        (3.1, 0.0, 0.0, 0.0, "motion"),
        (0.0, 0.39, 0.0, 0.0, "quiet"),
        (0.0, 0.41, 0.0, 0.0, "motion"),
        (0.0, -0.41, 0.0, 0.0, "motion"),
        (0.0, 0.0, 0.99, 0.0, "quiet"),
        (0.0, 0.0, 1.01, 0.0, "motion"),
        (0.0, 0.0, 9.0, 1.9, "motion"),
        (0.0, 0.0, 9.0, 2.1, "quiet"),
    ],
)
def test_quiet_is_below_3_deg_s_within_0_4_of_g_and_slower_than_1_m_s(
    dps: float, more: float, speed: float, first: float, how: str
) -> None:
    """Of the first 0.6 s and of a fix in the first 2 s; what comes later says nothing."""
    own = inputs(velocity=fixes(speed, first))
    own.gyr[T <= 0.6] = np.radians(dps) * np.array([0.6, 0.0, 0.8])
    own.gyr[T > 0.601] = 0.0 if dps > 3.0 else 1.0
    own.acc = own.acc * (1.0 + more / G)
    assert start._attitude(own, TUNED)[0] == how


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


def test_a_level_start_means_the_field_of_its_own_samples_or_of_the_compass_first_0_6_s() -> None:
    first, other = TRUTH.inv().apply(FIELD), np.array([9.0, 9.0, 9.0])
    for begin, counted in ((0.0, 1.0), (3.0, 3.6)):
        t = begin + np.arange(0.0, 3.0, 0.05)
        x = np.where((t <= counted + 1e-9)[:, None], first, other)
        samples = T <= 1.001
        q = start._level(inputs(mag=Measurements(t, x), field=FIELD), samples)
        assert angle(q, TRUTH) < 1e-5


def test_pairs_of_fixes_are_0_9_to_2_1_s_apart_and_lose_gravity() -> None:
    t = np.array([0.0, 0.5, 1.0, 2.0, 2.5, 4.0])
    x = np.random.default_rng(2).normal(size=(6, 3))
    x[4] = np.nan
    some = SimpleNamespace(t=t + 0.3, x=x)
    force = RunningMean(T, np.column_stack([T, 2.0 * T, -T]))
    tuned = NoiseLevels(gnss_delay=0.3)
    earth, body = start._pairs(inputs(velocity=some), tuned, force, 3.9)
    # Fix 5 comes after the end, fix 4 has no number; of the others these are as far apart:
    want = [(0, 2), (0, 3), (1, 3), (2, 3)]
    assert len(earth) == len(want)
    for k, (i, j) in enumerate(want):
        span = t[j] - t[i]
        assert earth[k] == pytest.approx(x[j] - x[i] - [0.0, 0.0, G * span])
        mean = 0.5 * (t[i] + t[j])
        assert body[k] == pytest.approx(np.array([1.0, 2.0, -1.0]) * span * mean, rel=0.02)
    assert len(start._pairs(inputs(), tuned, force, 3.9)[0]) == 0


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


def test_in_motion_a_compass_with_a_model_weighs_as_twenty_pairs() -> None:
    """Of a model turned by 40 deg as much is believed as scipy finds with these weights for Wahba's problem."""
    own = turning(FIELD)
    own.field = Rotation.from_euler("z", 40.0, degrees=True).apply(FIELD)
    q = Rotation.from_rotvec(np.outer(T, own.gyr[0]))
    force, v = RunningMean(T, q.apply(own.acc)), own.velocity
    pairs = [
        (i, j) for i in range(len(v.t)) for j in range(i, len(v.t)) if 0.9 <= v.t[j] - v.t[i] <= 2.1 and v.t[j] <= 8.0
    ]
    i, j = np.array(pairs).T
    span = (v.t[j] - v.t[i])[:, None]
    want = np.vstack([v.x[j] - v.x[i] - span * [0.0, 0.0, G], own.field])
    felt = np.vstack([span * force.mean(v.t[i], v.t[j]), TRUTH.inv().apply(FIELD)])
    wahba, _ = Rotation.align_vectors(want, felt, weights=np.r_[np.ones(len(i)), 20.0 * len(i)])
    late = inputs(**(vars(own) | {"mag": Measurements(own.mag.t + 0.5, own.mag.x)}))
    assert angle(start._in_motion(late, NoiseLevels(gnss_delay=0.0, mag_delay=0.5)), wahba) < 0.5
    assert (wahba * TRUTH.inv()).magnitude() > np.radians(1.0)
    assert angle(start._in_motion(own, TUNED), wahba) < 0.1


def test_in_motion_eight_seconds_count_and_three_pairs_are_enough() -> None:
    own = turning(None)
    own.acc[T > 8.02] += [5.0, -9.0, 7.0]
    assert angle(start._in_motion(own, TUNED), TRUTH) < 0.3
    # Fixes 1 s apart from 2 s on: three make two pairs of 1 s and one of 2 s, two make one.
    few = Measurements(own.velocity.t[10:25:5], own.velocity.x[10:25:5])
    assert len(start._pairs(inputs(velocity=few), TUNED, RunningMean(T, own.acc), 8.0)[0]) == 3
    three = start._in_motion(inputs(gyr=own.gyr, acc=own.acc, velocity=few), TUNED)
    assert angle(three, TRUTH) < 5.0


def test_in_motion_without_gnss_the_mean_force_of_two_seconds_is_down() -> None:
    own = turning(FIELD, gnss=False)
    steady = inputs(gyr=own.gyr, acc=(TRUTH * Rotation.from_rotvec(np.outer(T, own.gyr[0]))).inv().apply([0, 0, -G]))
    steady.acc[T > 2.02] = [0.0, 50.0, 0.0]
    steady.mag, steady.field = own.mag, FIELD
    # A sample holds the force of the interval before it, half a sample late: 0.1 deg.
    assert angle(start._in_motion(steady, TUNED), TRUTH) < 0.2


# With which field and turns a navigation filter starts: closed forms in every axis.


@pytest.mark.parametrize("count", [1, 10, 40])
def test_without_a_model_the_field_is_that_of_the_first_samples_and_points_to_magnetic_north(count: int) -> None:
    """Of forty samples the first twenty-five count."""
    q = rotation.from_euler(0.3, -0.2, 1.9)
    earth = np.array([0.15, -0.13, 0.41])
    seen = np.tile(rotation.rotate_inverse(q, earth), (count, 1))
    seen[25:] *= 9.0
    mag = SimpleNamespace(t=np.arange(float(count)), x=seen)
    inputs: Any = SimpleNamespace(field=None, mag=mag)
    np.testing.assert_allclose(start._field(inputs, q), [np.hypot(0.15, 0.13), 0.0, 0.41], atol=1e-12)
    inputs.field = (0.2, 0.01, 0.4)
    np.testing.assert_array_equal(start._field(inputs, q), [0.2, 0.01, 0.4])
    np.testing.assert_array_equal(start._field(SimpleNamespace(field=None, mag=None), q), np.zeros(3))  # type: ignore[arg-type]


def test_turns_by_the_gyro_follow_each_other_from_the_first_sample_on() -> None:
    rng = np.random.default_rng(3)
    gyr, dt = rng.normal(size=(30, 3)) * [3.0, 1.0, 2.0], rng.uniform(0.01, 0.05, 30)
    found = start.turned_by_gyro(gyr, dt)
    q = Rotation.identity()
    np.testing.assert_allclose(np.abs(found[0]), [1.0, 0.0, 0.0, 0.0], atol=1e-12)
    for k in range(1, 30):
        q = q * Rotation.from_rotvec(gyr[k] * dt[k])
        assert abs(found[k] @ np.roll(q.as_quat(), 1)) == pytest.approx(1.0, abs=1e-12)


# How sure a run is as it begins: information matrices by numpy, derivatives by differences.

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
COVARIANCE_LEVELS = NoiseLevels(prior=PRIOR)
R = Rotation.from_euler("ZYX", [70.0, -20.0, 35.0], degrees=True)
COVARIANCE_FIELD = np.array([0.19, 0.07, 0.41])


def covariance_inputs(gnss: str = "", baro: bool = False, mag: bool = False, field: bool = True) -> Any:
    return SimpleNamespace(
        velocity="velocity" in gnss or None,
        position="position" in gnss or None,
        baro=baro or None,
        mag=mag or None,
        field=COVARIANCE_FIELD if field else None,
        gravity=GRAVITY,
    )


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
    found = start.covariance(covariance_inputs(**given), COVARIANCE_LEVELS, np.roll(R.as_quat(), 1), state(), how, near)
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
        along, across = 0.019 * np.linalg.norm(COVARIANCE_FIELD), 0.031 * np.hypot(*COVARIANCE_FIELD[:2])
        turn = Rotation.from_euler("z", np.arctan2(COVARIANCE_FIELD[1], COVARIANCE_FIELD[0])).as_matrix()
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
    found = start._field_spread(
        covariance_inputs(gnss, mag=True, field=field), COVARIANCE_LEVELS, COVARIANCE_FIELD, bool(gnss)
    )
    level = np.hypot(*COVARIANCE_FIELD[:2])
    n, e = (
        np.array([COVARIANCE_FIELD[0], COVARIANCE_FIELD[1], 0.0]) / level,
        np.array([-COVARIANCE_FIELD[1], COVARIANCE_FIELD[0], 0.0]) / level,
    )
    size = np.linalg.norm(COVARIANCE_FIELD)
    assert n @ found @ n == pytest.approx((along * size) ** 2)
    assert e @ found @ e == pytest.approx((across * level) ** 2)
    assert found[2, 2] == pytest.approx((along * size) ** 2)
    assert n @ found @ e == pytest.approx(0.0, abs=1e-15)


def test_a_vertical_field_has_no_direction() -> None:
    found = start._field_spread(covariance_inputs(mag=True), COVARIANCE_LEVELS, np.array([0.0, 0.0, 0.5]), False)
    np.testing.assert_allclose(found, np.diag([0.0095, 0.0, 0.0095]) ** 2, atol=1e-15)
