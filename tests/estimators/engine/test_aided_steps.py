"""Steps with aids: which event reaches which step, and a filter that is better for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.base import rotation
from attlog.base.errors import PluginError
from attlog.estimators import Aids, Measurements, get
from attlog.estimators.engine.batch import estimate_batch, kernel

G = 9.80665

RECORDER = '''"""Turns with the gyro and writes down what it is handed."""
import numpy as np
from attlog.estimators import Parameter
from attlog.estimators.aids import AIRSPEED, ALT, AT_REST, BARO, LAT, POS_V_ACC, VEL_ACC, VEL_D
from attlog.estimators.engine.vectors import turn
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


AIDS = Aids(
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
    seen = attlog.estimate(str(recorder), t, np.zeros((7, 3)), aids=AIDS).aux["seen"]
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


def test_left_out_samples_do_not_shift_the_events(recorder: Path) -> None:
    t = np.arange(60) / 100.0
    gyr = np.zeros((60, 3))
    gyr[[5, 20]] = np.nan
    e = attlog.estimate(str(recorder), t, gyr, aids=Aids(position=Measurements([0.2, 0.4], [[1.0, 0, 0], [2.0, 0, 0]])))
    new = np.flatnonzero(np.isfinite(e.aux["seen"][1:, 0])) + 1
    assert e.t[new] == pytest.approx([0.21, 0.4])


def test_a_batch_with_aids_equals_runs_one_by_one(recorder: Path) -> None:
    estimator = get(str(recorder))
    t = np.arange(200) / 100.0
    gyr = np.tile([0.1, 0.2, 1.0], (200, 1))
    assert kernel(estimator, {}, "float64") is None
    batch = estimate_batch(estimator, [{"scale": 1.0}, {"scale": 0.5}], t, gyr, aids=AIDS, every=3)
    for one, scale in zip(batch, (1.0, 0.5), strict=True):
        alone = attlog.estimate(estimator, t, gyr, aids=AIDS, every=3, scale=scale)
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
from attlog.estimators.engine.vectors import gravity_error, turn
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
    acc = np.tile([2.0, 0.0, -G], (2000, 1))
    fixes = np.arange(0.0, 20.0, 0.2)
    velocity = np.outer(2.0 * fixes, [1.0, 0.0, 0.0])
    level = [1.0, 0.0, 0.0, 0.0]
    pitch = []
    for aids in (None, Aids(velocity=Measurements(fixes, velocity))):
        e = attlog.estimate(str(file), t, np.zeros((2000, 3)), acc, aids=aids, q0=level)
        pitch.append(float(np.degrees(rotation.to_euler(e.q[-1])[1])))
    assert pitch[0] == pytest.approx(np.degrees(np.arctan2(2.0, G)), abs=0.1)
    assert pitch[1] == pytest.approx(0.0, abs=0.1)
