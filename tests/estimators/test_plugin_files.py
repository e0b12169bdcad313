"""Whole-run estimators: what they are told of the samples, and what they say of themselves."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

import attlog
from attlog.core import rotation
from attlog.core.errors import PluginError
from attlog.estimators import Aids, Estimate, LogFacts, LogInfo, Measurements, estimate, get, parse, place
from attlog.estimators.run import joined_aux
from attlog.testing import still
from tests.conftest import few

WHOLE_RUN_PLUGIN = '''"""Says what it was told."""
import numpy as np
from attlog.estimators import Estimate
SOURCE = "test"
NEEDS = {"gyro", "acc"}
USES = {"mag"}

def run(t, gyr, acc, mag, aids, params):
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    said = {"sampling": aids.sampling, "seconds": float(t[-1] - t[0])}
    if aids.mag is not None:
        times = aids.mag.t
        said |= {"fields": len(times), "first_field": times[0], "on_imu": float(np.isin(times, t).mean())}
    return Estimate(t=t, q=q, quality=said)
'''


@pytest.fixture
def whole_run_plugin(tmp_path: Path) -> str:
    file = tmp_path / "says.py"
    file.write_text(WHOLE_RUN_PLUGIN)
    return str(file)


@pytest.mark.parametrize("sampling", few(["interval", "instant"], 1))
def test_a_whole_run_knows_how_its_samples_were_taken(whole_run_plugin: str, sampling: str) -> None:
    m = still(2.0)
    assert estimate(whole_run_plugin, m.t, m.gyr, m.acc, sampling=sampling, aids=Aids()).quality["sampling"] == sampling


def test_the_longest_segment_speaks_for_the_run(whole_run_plugin: str) -> None:
    m = still(20.0)
    kept = m.part(np.r_[0:300, 900:2000])
    quality = estimate(whole_run_plugin, kept.t, kept.gyr, kept.acc).quality
    assert quality["seconds"] == pytest.approx(10.99)


@pytest.mark.slow
def test_what_a_run_says_of_itself_stands_in_the_result(whole_run_plugin: str, tmp_path: Path) -> None:
    log = Path(__file__).parents[2] / "sample_logs" / "px4_steps.ulg"
    result = attlog.analyze(log, {"estimators": [whole_run_plugin]})
    file = tmp_path / "result.json"
    file.write_text(result.to_json())
    row = next(r for r in attlog.Result.load(file).estimators if r.name == "says")
    assert row.quality["sampling"] == "interval"
    field = attlog.read(log).mags[0].field
    assert row.quality["fields"] == pytest.approx(np.unique(field.t_best).size, abs=2)  # not outside the IMU's time
    assert row.quality["on_imu"] < 0.5  # at the log's own times, not at the IMU's


def test_a_magnetometer_comes_at_its_own_times_where_they_are_known(whole_run_plugin: str) -> None:
    m = still(2.0)
    slow = np.full_like(m.mag, np.nan)
    slow[3::10] = m.mag[3::10]
    rows = estimate(whole_run_plugin, m.t, m.gyr, m.acc, slow).quality
    assert (rows["fields"], rows["first_field"], rows["on_imu"]) == (20, pytest.approx(0.03), 1.0)
    own = Aids(mag=Measurements(np.arange(0.004, 1.9, 0.1), np.tile(m.mag[0], (19, 1))))
    for mag in (slow, None):
        told = estimate(whole_run_plugin, m.t, m.gyr, m.acc, mag, aids=own).quality
        assert (told["fields"], told["first_field"], told["on_imu"]) == (19, pytest.approx(0.004), 0.0)
    assert "fields" not in estimate(whole_run_plugin, m.t, m.gyr, m.acc).quality


def test_the_times_of_a_magnetometer_stand_in_for_its_rows() -> None:
    """Of a filter that steps, each sample goes to the first IMU sample from its time on."""
    m = still(2.0, yaw=0.5)
    times = np.arange(0.004, 1.9, 0.1)
    field = np.tile(m.mag[0], (19, 1))
    own = estimate("mekf", m.t, m.gyr, m.acc, aids=Aids(mag=Measurements(times, field)))
    assert np.array_equal(own.q, estimate("mekf", m.t, m.gyr, m.acc, place(m.t, times, field)).q)


def test_what_only_some_segments_tell_is_missing_in_the_others() -> None:
    def told(n: int, **aux: int) -> Estimate:
        t = np.arange(n) * 0.01
        q = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        return Estimate(t=t, q=q, aux={name: np.full((n, k), 1.0) for name, k in aux.items()})

    found = joined_aux([told(3, velocity=2), told(2), told(4, height=1, velocity=2)])
    assert list(found) == ["velocity", "height"]
    np.testing.assert_array_equal(np.isfinite(found["velocity"][:, 0]), [1, 1, 1, 0, 0, 1, 1, 1, 1])
    np.testing.assert_array_equal(np.isfinite(found["height"][:, 0]), [0, 0, 0, 0, 0, 1, 1, 1, 1])
    assert joined_aux([]) == {}


# Parameters that a log tells: where they come from, what overrides them, what is wrong with a bad ``from_log``.

FROM_LOG_PLUGIN = '''"""A filter whose gain is a parameter of the log."""
import numpy as np
from attlog.estimators import Parameter
from attlog.estimators.vectors import gravity_error, turn
SOURCE = "test"
USES = {"mag"}
PARAMETERS = (Parameter("kp", 0.5, "1/s", 0, 10, "gain", "test"), Parameter("ki", 0.0, "1/s^2", 0, 1, "gain", "test"))
PRESETS = {"firm": {"kp": 5.0}}

def from_log(params, info):
    values = {"kp": params["W_ACC"]} if "W_ACC" in params else {}
    if info.gyro_noise is not None:
        values["ki"] = 10.0 * info.gyro_noise
    return values

def start(params, acc, mag, q0):
    return q0

def step(state, params, dt, gyr, acc, mag):
    x, y, z = gravity_error(state, acc, 1.0)
    k = params[0]
    turn(state, gyr[0] + k * x, gyr[1] + k * y, gyr[2] + k * z, dt, 0.0)
'''
FACTS = LogFacts({"W_ACC": 2.0}, LogInfo(declination_deg=7.0, mag_rate_hz=10.0, gyro_noise=0.01))


@pytest.fixture
def from_log_plugin(tmp_path: Path) -> Path:
    file = tmp_path / "mine.py"
    file.write_text(FROM_LOG_PLUGIN)
    return file


def test_a_log_gives_values_where_neither_preset_nor_option_does(from_log_plugin: Path) -> None:
    plain, firm, asked = (parse(f"{from_log_plugin}{tail}") for tail in ("", "@firm", "@firm:kp=3,declination=1"))
    assert plain.resolved()["kp"] == (0.5, "default")
    assert plain.resolved(FACTS)["kp"] == (2.0, "log")
    assert plain.resolved(FACTS)["ki"] == (0.1, "log")
    assert plain.resolved(FACTS)["init"] == ("average", "default")
    assert firm.resolved(FACTS)["kp"] == (5.0, "preset")
    assert asked.resolved(FACTS)["kp"] == (3.0, "option")
    assert asked.resolved(FACTS)["declination"] == (1.0, "option")


def test_what_the_user_set_in_the_firmware_s_terms_overrides_the_log(from_log_plugin: Path) -> None:
    what_if = LogFacts({"W_ACC": 2.0}, FACTS.info, {"W_ACC": 0.5})
    assert parse(str(from_log_plugin)).resolved(what_if)["kp"] == (0.5, "file")
    assert parse(str(from_log_plugin)).resolved(what_if)["ki"] == (0.1, "log")
    assert parse(str(from_log_plugin)).resolved(LogFacts({"W_ACC": 2.0}, FACTS.info, {"W_ACC": 2.0}))["kp"] == (
        2.0,
        "log",
    )
    assert parse(str(from_log_plugin)).resolved(LogFacts({}, FACTS.info, {"W_ACC": 0.5}))["kp"] == (0.5, "file")
    assert parse(f"{from_log_plugin}@firm").resolved(what_if)["kp"] == (5.0, "preset")
    assert parse(f"{from_log_plugin}:kp=3").resolved(what_if)["kp"] == (3.0, "option")


@pytest.mark.parametrize(
    ("info", "wanted"),
    [
        (LogInfo(declination_deg=7.0, mag_rate_hz=10.0), (7.0, "log")),
        (LogInfo(declination_deg=None, mag_rate_hz=10.0), (0.0, "default")),
        (LogInfo(declination_deg=7.0, mag_rate_hz=None), (0.0, "default")),
    ],
)
def test_the_declination_of_every_filter_with_a_field_comes_from_the_log(
    info: LogInfo, wanted: tuple[float, str]
) -> None:
    for name in ("mahony", "ekf12", "vqf"):
        assert get(name).resolve(log=LogFacts({}, info))["declination"] == wanted


def test_a_filter_may_take_another_declination_from_the_log(from_log_plugin: Path) -> None:
    from_log_plugin.write_text(FROM_LOG_PLUGIN.replace("    return values", "    return {'declination': -3.0}"))
    assert parse(str(from_log_plugin)).resolved(FACTS)["declination"] == (-3.0, "log")


def test_estimate_runs_with_what_the_log_tells() -> None:
    t = np.arange(300) / 100.0
    q = rotation.from_euler(0 * t, 0 * t, 0.4 * t)
    x = np.tile([0, 0, 0.4], (300, 1)), np.tile([0, 0, -9.80665], (300, 1)), rotation.rotate_inverse(q, [20.0, 0, 40.0])
    told = attlog.estimate("mahony", t, *x, log=FACTS)
    assert np.array_equal(told.q, attlog.estimate("mahony", t, *x, declination=7.0).q)
    assert not np.array_equal(told.q, attlog.estimate("mahony", t, *x).q)


@pytest.mark.parametrize(
    ("find", "put", "words"),
    few(
        [
            ('if "W_ACC" in params else {}', "", "line 11: KeyError"),
            ('"kp": params', '"kpp": params', "did you mean kp"),
            ('params["W_ACC"]', "1e9", "out of range"),
            ('params["W_ACC"]', 'params.pop("W_ACC")', "line 11: AttributeError"),
        ],
        1,
    ),
)
def test_a_from_log_that_fails_is_told(from_log_plugin: Path, find: str, put: str, words: str) -> None:
    from_log_plugin.write_text(FROM_LOG_PLUGIN.replace(find, put))
    facts = LogFacts(MappingProxyType({} if "KeyError" in words else {"W_ACC": 2.0}), LogInfo())
    with pytest.raises(PluginError) as failed:
        parse(str(from_log_plugin)).resolved(facts)
    assert words in str(failed.value)
    assert "mine" in str(failed.value)


def test_a_from_log_that_takes_something_else_is_refused(from_log_plugin: Path) -> None:
    from_log_plugin.write_text(FROM_LOG_PLUGIN.replace("from_log(params, info)", "from_log(params)"))
    with pytest.raises(PluginError, match="from_log must take params, info"):
        get(str(from_log_plugin))
