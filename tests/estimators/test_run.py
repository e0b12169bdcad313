"""The shared loop: time, gaps, bad samples and slow magnetometers, judged by motion whose attitude is known."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.core import rotation
from attlog.core.errors import PluginError, UsageError
from attlog.estimators import Aids, Measurements, get, place
from attlog.estimators.aids import VEL_D, VEL_N, aid_rows
from attlog.estimators.aids import Aids as aids_Aids
from attlog.estimators.aids import Measurements as aids_Measurements
from attlog.estimators.batch import estimate_batch

RATE = 250.0
G = 9.80665
FIELD = np.array([20.0, 0.0, 40.0])


def turning(seconds: float = 20.0, rate_deg_s: float = 40.0, rate: float = RATE) -> dict[str, Any]:
    """A level turn at constant rate with exact sensors: t, gyr, acc, mag and the true q."""
    t = np.arange(int(seconds * rate)) / rate
    w = np.radians(rate_deg_s)
    q = rotation.from_euler(np.zeros_like(t), np.zeros_like(t), w * t)
    gyr = np.tile([0.0, 0.0, w], (len(t), 1))
    return {
        "t": t,
        "gyr": gyr,
        "acc": np.tile([0, 0, -G], (len(t), 1)),
        "mag": rotation.rotate_inverse(q, FIELD),
        "q": q,
    }


def run(name: str, x: dict[str, Any], **options: Any) -> attlog.estimators.Estimate:
    return attlog.estimate(name, x["t"], x["gyr"], x["acc"], x["mag"], **options)


def error_deg(e: attlog.estimators.Estimate, x: dict[str, Any]) -> np.ndarray:
    truth = x["q"][np.searchsorted(x["t"], e.t)]
    return np.rad2deg(rotation.total_angle(rotation.earth_error(e.q, truth)))


def test_a_turn_is_followed_exactly() -> None:
    x = turning()
    assert error_deg(run("gyro", x), x).max() < 1e-9
    assert error_deg(run("mahony:ki=0", x), x).max() < 0.2


def test_interval_and_instant_sampling_integrate_a_changing_rate_as_they_should() -> None:
    """Each rule is exact for its own kind of sample; with the other one the attitude is half a sample off."""
    t = np.arange(2000) / RATE
    angle = 1.2 * np.sin(2.0 * t)
    q = rotation.from_euler(angle, 0 * t, 0 * t)
    at = 2.4 * np.cos(2.0 * t)
    mean = np.diff(angle, prepend=2 * angle[0] - angle[1]) * RATE
    acc = rotation.rotate_inverse(q, [0, 0, -G])
    errors = {}
    for samples, rates in (("instant", at), ("interval", mean)):
        gyr = np.stack([rates, 0 * t, 0 * t], axis=1)
        for rule in ("instant", "interval"):
            e = attlog.estimate("gyro", t, gyr, acc, q0=q[0], sampling=rule)
            errors[samples, rule] = np.rad2deg(rotation.total_angle(rotation.earth_error(e.q, q))).max()
    assert errors["instant", "instant"] < 1e-3
    assert errors["interval", "interval"] < 1e-9
    assert errors["instant", "interval"] > 0.2
    assert errors["interval", "instant"] > 0.2


def test_input_is_never_changed_and_any_array_like_is_taken() -> None:
    x = turning(2.0)
    before = {k: v.copy() for k, v in x.items()}
    for v in x.values():
        v.flags.writeable = False
    want = run("mahony", x)
    assert all(np.array_equal(before[k], x[k]) for k in x)
    lists = {k: v.tolist() for k, v in x.items()}
    assert np.array_equal(run("mahony", lists).q, want.q)
    single = run("mahony", {k: v.astype(np.float32) for k, v in x.items()} | {"t": x["t"]})
    assert np.abs(single.q - want.q).max() < 1e-5
    writable = {k: v.copy() for k, v in x.items()}
    for name in ("mahony", "ekf12", "vqf", "eskf"):  # ours are given the arrays themselves
        run(name, writable)
        assert all(np.array_equal(before[k], writable[k]) for k in x), name
    strided = {k: np.repeat(v, 2, axis=0)[::2] for k, v in x.items()}
    assert np.array_equal(run("mahony", strided).q, want.q)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t": np.zeros((4, 1))}, "t must have shape"),
        ({"gyr": np.zeros((5, 3))}, "gyr must have shape (4, 3)"),
        ({"acc": np.zeros((4, 2))}, "acc must have shape (4, 3)"),
        ({"mag": np.zeros(4)}, "mag must have shape (4, 3)"),
        ({"gyr": [["a"] * 3] * 4}, "arrays of numbers"),
        ({"dt": np.zeros(3)}, "dt must have shape"),
        ({"sampling": "mean"}, "sampling=mean"),
        ({"q0": [0, 0, 0, 0]}, "q0 must be"),
        ({"every": 0}, "every=0"),
        ({"kp": -1}, "out of range"),
        ({"kp": "much"}, "not a number"),
        ({"integrator": "exat"}, "did you mean exact"),
        ({"kpp": 1}, "did you mean kp"),
    ],
)
def test_wrong_calls_are_refused_in_words(change: dict[str, Any], words: str) -> None:
    call: dict[str, Any] = {"t": np.arange(4.0), "gyr": np.zeros((4, 3)), "acc": np.ones((4, 3)), "mag": None}
    with pytest.raises(UsageError) as told:
        attlog.estimate("mahony", **(call | change))
    assert words in str(told.value)


def test_a_missing_sensor_is_refused_where_it_is_needed() -> None:
    with pytest.raises(UsageError, match="accel_mag needs mag"):
        attlog.estimate("accel_mag", np.arange(4.0), np.zeros((4, 3)), np.ones((4, 3)))


def test_bad_samples_are_left_out_counted_and_do_not_disturb() -> None:
    x = turning()
    x["gyr"][700] = np.nan
    x["gyr"][900] = 1e6
    x["t"][1100] = np.nan
    x["t"][1300] = x["t"][1299]
    x["acc"][1500] = [np.nan, 0, 0]
    x["acc"][1600:1610] = 0.0
    x["acc"][1700] = 1e7
    x["mag"][1800] = 0.0
    e = run("mahony:ki=0", x)
    assert e.skipped == {"nan": 3, "saturated": 2, "time_not_rising": 1, "zero_vector": 11}
    assert len(e.t) == len(x["t"]) - 4
    assert np.isfinite(e.q).all()
    truth = rotation.from_euler(0 * e.t, 0 * e.t, np.radians(40.0) * e.t)
    assert np.rad2deg(rotation.total_angle(rotation.earth_error(e.q, truth))).max() < 0.3


def test_times_that_jump_cost_only_the_samples_that_are_wrong() -> None:
    """One stamp far in the future, one in the past, one swapped pair: four samples of 5000 are not used."""
    x = turning()
    x["t"][1000] += 3000.0
    x["t"][2000] -= 3000.0
    x["t"][[3000, 3001]] = x["t"][[3001, 3000]]
    e = run("gyro", x)
    assert e.skipped == {"time_not_rising": 3}
    assert np.all(np.diff(e.t) > 0)


def test_a_short_gap_is_bridged_with_the_neighbours_mean_rate() -> None:
    """A linearly rising rate: the mean of both neighbours is the mean over the gap."""
    t = np.arange(1000) / RATE
    rate = 0.5 * t
    q = rotation.from_euler(0 * t, 0 * t, 0.25 * t**2)
    middle = rate - 0.25 / RATE
    keep = np.r_[0:400, 500:1000]
    gyr = np.stack([0 * t, 0 * t, middle], axis=1)[keep]
    e = attlog.estimate("gyro", t[keep], gyr, np.tile([0, 0, -G], (900, 1)))
    assert e.skipped == {"gap_bridged": 1}
    assert np.unique(e.segment).tolist() == [0]
    assert np.rad2deg(rotation.total_angle(rotation.earth_error(e.q, q[keep]))).max() < 0.06
    assert 0.25 * (t[500] - t[400]) > np.radians(5)


def test_after_a_long_gap_the_filter_starts_anew() -> None:
    x = turning(10.0, rate_deg_s=0.0)
    keep = np.r_[0:1000, 1500:2500]
    x = {k: v[keep] for k, v in x.items()}
    x["mag"][1000:] = rotation.rotate_inverse(rotation.from_euler(0, 0, 2.0), FIELD)
    e = run("mahony", x)
    assert e.skipped == {"restart": 1}
    assert e.segment is not None
    assert e.segment.tolist() == [0] * 1000 + [1] * 1000
    assert np.allclose(rotation.to_euler(e.q[[999, 1000]])[:, 2], [0.0, 2.0], atol=1e-9)


def test_increments_turn_by_their_own_integration_time() -> None:
    """Stamps that jitter do not matter where each sample tells how long it integrated."""
    x = turning()
    rng = np.random.default_rng(3)
    stamps = x["t"] + rng.uniform(0, 1e-3, len(x["t"]))
    jitter = attlog.estimate("gyro", stamps, x["gyr"], x["acc"], q0=x["q"][0])
    exact = attlog.estimate("gyro", stamps, x["gyr"], x["acc"], q0=x["q"][0], dt=np.full(len(stamps), 1 / RATE))
    wander = [np.rad2deg(rotation.total_angle(rotation.earth_error(e.q, x["q"]))).max() for e in (jitter, exact)]
    assert wander[1] < 1e-9 < 0.02 < wander[0]


@pytest.mark.parametrize("rate_hz", [2.0, 10.0, 50.0])
def test_a_slow_magnetometer_serves_as_well_as_a_fast_one(rate_hz: float) -> None:
    """Yaw turns to and fro; samples of 2 Hz, propagated with the gyro, cost under 10 % of heading accuracy."""
    t = np.arange(int(60 * RATE)) / RATE
    yaw = 1.5 * np.sin(1.1 * t)
    q = rotation.from_euler(0 * t, 0 * t, yaw)
    rng = np.random.default_rng(5)
    gyr = np.stack([0 * t, 0 * t, np.diff(yaw, prepend=0) * RATE], axis=1) + np.radians([0.3, -0.2, 0.5])
    acc = np.tile([0, 0, -G], (len(t), 1)) + rng.normal(0, 0.05, (len(t), 3))
    fast = rotation.rotate_inverse(q, FIELD)
    when = np.arange(0.001, 60, 1 / rate_hz)
    slow = place(t, when, rotation.rotate_inverse(rotation.slerp(t, q, np.minimum(when, t[-1])), FIELD))
    rmse = []
    for mag in (fast, slow):
        e = attlog.estimate("mahony@xu-0.6", t, gyr, acc, mag)
        rmse.append(np.sqrt(np.mean(rotation.heading_angle(rotation.earth_error(e.q, q))[2500:] ** 2)))
    assert rmse[1] < 1.1 * rmse[0]


def test_a_magnetometer_that_stops_is_missing_after_one_and_a_half_periods() -> None:
    x = turning(20.0)
    x["mag"][np.arange(len(x["t"])) % 25 != 0] = np.nan
    x["mag"][2500:] = np.nan
    x["gyr"][2500:, 2] += np.radians(1.0)
    drift = error_deg(run("mahony:ki=0", x), x)
    assert drift[2500] < 0.3
    assert drift[-1] == pytest.approx(10.0, abs=0.4)


def test_place_puts_each_sample_on_the_next_imu_time() -> None:
    got = place([0.0, 1.0, 2.0, 3.0], [0.0, 0.5, 0.9, 2.0, 9.0, np.nan], np.arange(18.0).reshape(6, 3))
    assert np.array_equal(np.isnan(got[:, 0]), [False, False, False, True])
    assert got[:3, 0].tolist() == [0.0, 6.0, 9.0]
    with pytest.raises(UsageError, match="place needs"):
        place([0.0], [0.0, 1.0], np.zeros((1, 3)))


def test_the_start_averages_when_quiet_and_takes_the_first_sample_when_not() -> None:
    rng = np.random.default_rng(1)
    x = turning(4.0, rate_deg_s=0.0)
    x["acc"] += rng.normal(0, 1.0, x["acc"].shape)
    first, average = (error_deg(run("mahony", x, init=i), x)[0] for i in ("first", "average"))
    assert average < 1.5 < first
    moving = turning(4.0, rate_deg_s=90.0)
    assert error_deg(run("mahony", moving), moving)[0] < 1e-6


@pytest.mark.parametrize("name", ["gyro", "complementary", "mahony"])
def test_heading_starts_at_zero_without_magnetometer_whatever_the_declination(name: str) -> None:
    x = turning(2.0, rate_deg_s=0.0)
    e = attlog.estimate(name, x["t"], x["gyr"], x["acc"], declination=30.0)
    assert np.abs(rotation.to_euler(e.q)).max() < 1e-9


@pytest.mark.parametrize("name", ["gyro", "accel_mag", "complementary", "mahony"])
def test_a_positive_declination_turns_the_heading_east(name: str) -> None:
    x = turning(2.0)
    magnetic, true = run(name, x), run(name, x, declination=10.0)
    turned = np.rad2deg(rotation.heading_angle(rotation.earth_error(true.q, magnetic.q)))
    assert np.allclose(turned, 10.0)


@pytest.mark.parametrize("name", ["mahony", "vqf", "smoother"])
def test_every_keeps_each_nth_output_of_every_run(name: str) -> None:
    x = turning(4.0)
    keep = np.r_[0:301, 700:1000]
    x = {k: v[keep] for k, v in x.items()}
    whole, some = run(name, x), run(name, x, every=7)
    rows = np.r_[np.arange(0, 301, 7), np.arange(301, 601, 7)]
    assert np.array_equal(some.q, whole.q[rows])
    assert np.array_equal(some.t, whole.t[rows])
    assert np.array_equal(some.segment, whole.segment[rows])
    assert all(np.array_equal(some.aux[key], x[rows]) for key, x in whole.aux.items())


@pytest.mark.parametrize("n", [0, 1, 2])
def test_next_to_no_samples_give_next_to_no_attitudes(n: int) -> None:
    e = attlog.estimate("mahony", np.arange(n) * 0.1, np.zeros((n, 3)), np.tile([0, 0, -G], (n, 1)))
    assert e.q.shape == (n, 4)
    nothing = attlog.estimate("mahony", np.full(n, np.nan), np.zeros((n, 3)), np.zeros((n, 3)))
    assert nothing.q.shape == (0, 4)


def test_a_cleared_jit_gives_the_same_attitude(monkeypatch: pytest.MonkeyPatch) -> None:
    """The compiled kernel and its plain Python twin agree to the bit."""
    x = turning(2.0)
    x["mag"][np.arange(len(x["t"])) % 20 != 0] = np.nan
    for name in ("gyro", "accel_mag", "complementary@fan", "mahony"):
        compiled = run(name, x)
        with monkeypatch.context() as patch:
            patch.setenv("ATTLOG_NO_JIT", "1")
            assert np.abs(run(name, x).q - compiled.q).max() < 1e-12, name


# A magnetometer that is thinned to 2 Hz costs little heading: the loop turns its last vector on with the gyro.


# Steps with aids: which event reaches which step, and a filter that is better for them.

STANDARD_GRAVITY = 9.80665

RECORDER = '''"""Turns with the gyro and writes down what it is handed."""
import numpy as np
from attlog.estimators import Parameter
from attlog.estimators.aids import AIRSPEED, ALT, AT_REST, BARO, LAT, POS_V_ACC, VEL_ACC, VEL_D
from attlog.estimators.vectors import turn
SOURCE = "test"
NEEDS = {"gyro"}
USES = {"gnss", "baro", "at_rest"}
STATE = {"q": 4, "seen": 8, "calls": 1, "fixes": 1}
PARAMETERS = (Parameter("scale", 1.0, "1", 0, 2, "of the gyro", "test"),)

def start(params, acc, mag, q0):
    state = np.zeros(14)
    state[0:4] = q0
    return state

def step(state, params, dt, gyr, acc, mag, aid):
    k = params[0]
    turn(state, k * gyr[0], k * gyr[1], k * gyr[2], dt, 0.0)
    state[4] = aid[LAT]
    state[5] = aid[ALT]
    state[6] = aid[POS_V_ACC]
    state[7] = aid[VEL_D]
    state[8] = aid[VEL_ACC]
    state[9] = aid[BARO]
    state[10] = aid[AIRSPEED]
    state[11] = aid[AT_REST]
    state[12] += 1.0
    if aid[LAT] == aid[LAT]:
        state[13] += 1.0
'''


@pytest.fixture
def recorder(tmp_path: Path) -> Path:
    file = tmp_path / "recorder.py"
    file.write_text(RECORDER)
    return file


RECORDED_AIDS = Aids(
    position=Measurements([0.005, 0.02, 0.035, 0.038, 9.0], np.arange(15.0).reshape(5, 3), np.full((5, 2), 0.5)),
    velocity=Measurements([0.035], [[1.0, 2.0, 3.0]], [0.1]),
    baro=Measurements([-1.0, 0.05], [7.0, 8.0]),
    airspeed=Measurements([0.02], [12.0]),
    at_rest=[[0.0, 0.03]],
)


@pytest.mark.parametrize("plain", [False, True])
def test_each_event_reaches_the_first_step_at_or_after_it_once(
    recorder: Path, plain: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if plain:
        monkeypatch.setenv("ATTLOG_NO_JIT", "1")
    t = np.arange(7) / 100.0
    seen = attlog.estimate(str(recorder), t, np.zeros((7, 3)), aids=RECORDED_AIDS).aux["seen"]
    nan = np.nan
    lat, alt, v_acc, down, vel_acc, baro, airspeed, rest = seen.T
    assert np.array_equal(lat, [0, 0, 3, nan, 9, nan, nan], equal_nan=True)  # of two in one step the newest
    assert np.array_equal(alt[[1, 2, 4]], [2, 5, 11])
    assert np.array_equal(v_acc[[1, 3]], [0.5, nan], equal_nan=True)
    assert np.array_equal(down, [0, nan, nan, nan, 3, nan, nan], equal_nan=True)
    assert np.array_equal(vel_acc[[3, 4]], [nan, 0.1], equal_nan=True)
    assert np.array_equal(baro, [0, nan, nan, nan, nan, 8, nan], equal_nan=True)  # what came before the start is past
    assert np.array_equal(airspeed, [0, *6 * [nan]], equal_nan=True)  # USES does not name it
    assert np.array_equal(rest, [0, 1, 1, 1, 0, 0, 0])


def test_without_aids_all_is_unknown(recorder: Path) -> None:
    seen = attlog.estimate(str(recorder), np.arange(4) / 100.0, np.zeros((4, 3))).aux["seen"]
    assert np.isnan(seen[1:]).all()


def test_a_step_in_parts_gets_an_event_once_and_rest_in_each(recorder: Path) -> None:
    """150 deg in one sample is three parts."""
    t = np.arange(4) * 0.5
    gyr = np.tile([0, 0, np.radians(300.0)], (4, 1))
    aids = Aids(position=Measurements([0.4, 0.9], np.ones((2, 3))), at_rest=[[0.0, 9.0]])
    aux = attlog.estimate(str(recorder), t, gyr, aids=aids).aux
    assert aux["calls"][:, 0].tolist() == [0, 3, 6, 9]
    assert aux["fixes"][:, 0].tolist() == [0, 1, 2, 2]
    assert aux["seen"][1:, 7].tolist() == [1, 1, 1]


@pytest.mark.slow
def test_what_arrives_in_a_gap_is_left_out(recorder: Path) -> None:
    t = np.r_[np.arange(100), np.arange(300, 400)] / 100.0
    fixes = np.array([0.5, 1.5, 2.5, 3.005])
    e = attlog.estimate(str(recorder), t, np.zeros((200, 3)), aids=Aids(position=Measurements(fixes, np.ones((4, 3)))))
    assert e.skipped == {"restart": 1}
    assert e.aux["fixes"][[99, 199], 0].tolist() == [1.0, 1.0]


def test_a_batch_with_aids_equals_runs_one_by_one(recorder: Path) -> None:
    estimator = get(str(recorder))
    t = np.arange(200) / 100.0
    gyr = np.tile([0.1, 0.2, 1.0], (200, 1))
    batch = estimate_batch(estimator, [{"scale": 1.0}, {"scale": 0.5}], t, gyr, aids=RECORDED_AIDS, every=3)
    for one, scale in zip(batch, (1.0, 0.5), strict=True):
        alone = attlog.estimate(estimator, t, gyr, aids=RECORDED_AIDS, every=3, scale=scale)
        assert np.array_equal(one.q, alone.q)
        assert np.array_equal(one.aux["seen"], alone.aux["seen"], equal_nan=True)


@pytest.mark.parametrize(
    ("find", "put", "words"),
    [
        (", mag, aid)", ", mag)", "step must take state, params, dt, gyr, acc, mag, aid; aid is there because"),
        ('"gnss", "baro", "at_rest"', '"mag"', "step must take state, params, dt, gyr, acc, mag"),
        ('"gnss", ', '"gps", ', "USES may name"),
        ('NEEDS = {"gyro"}', 'NEEDS = {"gyro", "baro"}', "NEEDS may name gyro, acc, mag and gnss, not baro"),
    ],
)
def test_a_step_that_does_not_fit_its_uses_is_told(recorder: Path, find: str, put: str, words: str) -> None:
    recorder.write_text(RECORDER.replace(find, put))
    with pytest.raises(PluginError) as failed:
        get(str(recorder))
    assert words in str(failed.value)


ACCELERATED = '''"""Takes the acceleration that GNSS shows out of the accelerometer."""
import numpy as np
from attlog.estimators.aids import VEL_D, VEL_E, VEL_N
from attlog.estimators.vectors import gravity_error, turn
SOURCE = "test"
USES = {"gnss"}
STATE = {"q": 4, "_velocity": 3, "_acceleration": 3, "_age": 1, "_force": 3}

def start(params, acc, mag, q0):
    state = np.zeros(14)
    state[0:4] = q0
    state[10] = -1.0
    return state

def step(state, params, dt, gyr, acc, mag, aid):
    if state[10] >= 0.0:
        state[10] += dt
    if aid[VEL_N] == aid[VEL_N]:
        for i in range(3):
            if state[10] > 0.0:
                state[7 + i] = (aid[VEL_N + i] - state[4 + i]) / state[10]
            state[4 + i] = aid[VEL_N + i]
        state[10] = 0.0
    w, x, y, z = state[0], state[1], state[2], state[3]
    n, e, d = state[7], state[8], state[9]
    state[11] = acc[0] - ((1 - 2 * (y * y + z * z)) * n + 2 * (x * y + w * z) * e + 2 * (x * z - w * y) * d)
    state[12] = acc[1] - (2 * (x * y - w * z) * n + (1 - 2 * (x * x + z * z)) * e + 2 * (y * z + w * x) * d)
    state[13] = acc[2] - (2 * (x * z + w * y) * n + 2 * (y * z - w * x) * e + (1 - 2 * (x * x + y * y)) * d)
    gx, gy, gz = gravity_error(state, state[11:14], 1.0)
    turn(state, gyr[0] + gx, gyr[1] + gy, gyr[2] + gz, dt, 0.0)
'''


def test_a_filter_with_gnss_velocity_is_right_in_a_long_acceleration(tmp_path: Path) -> None:
    """2 m/s^2 north for 20 s, level: without aids the filter takes it for atan(2/g) = 11.5 deg of pitch."""
    file = tmp_path / "accelerated.py"
    file.write_text(ACCELERATED)
    t = np.arange(2000) / 100.0
    acc = np.tile([2.0, 0.0, -STANDARD_GRAVITY], (2000, 1))
    fixes = np.arange(0.0, 20.0, 0.2)
    velocity = np.outer(2.0 * fixes, [1.0, 0.0, 0.0])
    level = [1.0, 0.0, 0.0, 0.0]
    pitch = []
    for aids in (None, Aids(velocity=Measurements(fixes, velocity))):
        e = attlog.estimate(str(file), t, np.zeros((2000, 3)), acc, aids=aids, q0=level)
        pitch.append(float(np.degrees(rotation.to_euler(e.q[-1])[1])))
    assert pitch[0] == pytest.approx(np.degrees(np.arctan2(2.0, STANDARD_GRAVITY)), abs=0.1)
    assert pitch[1] == pytest.approx(0.0, abs=0.1)


# Aids as a step gets them: in the axes that it knows.


@pytest.mark.parametrize("declination_deg", [0.0, 12.0, -30.0, 90.0])
def test_a_velocity_is_turned_to_magnetic_north_that_lies_east_of_true_north(declination_deg: float) -> None:
    """What flies along a course has that course less the declination by a compass; vertical speed stays."""
    course = np.radians([0.0, 90.0, 200.0])
    velocity = np.column_stack([5.0 * np.cos(course), 5.0 * np.sin(course), [1.0, -2.0, 0.5]])
    estimator: Any = SimpleNamespace(uses={"gnss"})
    aids = aids_Aids(velocity=aids_Measurements(np.array([1.0, 2.0, 3.0]), velocity, np.full(3, 0.1)))
    found = aid_rows(estimator, aids, np.arange(0.0, 4.0, 0.5), np.radians(declination_deg))
    told = found.table[found.row[[2, 4, 6]], VEL_N : VEL_D + 1]
    by_compass = course - np.radians(declination_deg)
    assert told[:, 0] == pytest.approx(5.0 * np.cos(by_compass))
    assert told[:, 1] == pytest.approx(5.0 * np.sin(by_compass))
    assert told[:, 2].tolist() == [1.0, -2.0, 0.5]
