"""Parameters that a log tells: where they come from, what overrides them, what is wrong with a bad ``from_log``."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

import attlog
from attlog.base import rotation
from attlog.base.errors import PluginError
from attlog.estimators import LogFacts, LogInfo, get, parse
from tests.conftest import few

PLUGIN = '''"""A filter whose gain is a parameter of the log."""
import numpy as np
from attlog.estimators import Parameter
from attlog.estimators.engine.vectors import gravity_error, turn
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
def plugin(tmp_path: Path) -> Path:
    file = tmp_path / "mine.py"
    file.write_text(PLUGIN)
    return file


def test_a_log_gives_values_where_neither_preset_nor_option_does(plugin: Path) -> None:
    plain, firm, asked = (parse(f"{plugin}{tail}") for tail in ("", "@firm", "@firm:kp=3,declination=1"))
    assert plain.resolved()["kp"] == (0.5, "default")
    assert plain.resolved(FACTS)["kp"] == (2.0, "log")
    assert plain.resolved(FACTS)["ki"] == (0.1, "log")
    assert plain.resolved(FACTS)["init"] == ("average", "default")
    assert firm.resolved(FACTS)["kp"] == (5.0, "preset")
    assert asked.resolved(FACTS)["kp"] == (3.0, "option")
    assert asked.resolved(FACTS)["declination"] == (1.0, "option")


def test_what_the_user_set_in_the_firmware_s_terms_overrides_the_log(plugin: Path) -> None:
    what_if = LogFacts({"W_ACC": 2.0}, FACTS.info, {"W_ACC": 0.5})
    assert parse(str(plugin)).resolved(what_if)["kp"] == (0.5, "file")
    assert parse(str(plugin)).resolved(what_if)["ki"] == (0.1, "log")
    assert parse(str(plugin)).resolved(LogFacts({"W_ACC": 2.0}, FACTS.info, {"W_ACC": 2.0}))["kp"] == (2.0, "log")
    assert parse(str(plugin)).resolved(LogFacts({}, FACTS.info, {"W_ACC": 0.5}))["kp"] == (0.5, "file")
    assert parse(f"{plugin}@firm").resolved(what_if)["kp"] == (5.0, "preset")
    assert parse(f"{plugin}:kp=3").resolved(what_if)["kp"] == (3.0, "option")


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


def test_a_filter_may_take_another_declination_from_the_log(plugin: Path) -> None:
    plugin.write_text(PLUGIN.replace("    return values", "    return {'declination': -3.0}"))
    assert parse(str(plugin)).resolved(FACTS)["declination"] == (-3.0, "log")


def test_estimate_runs_with_what_the_log_tells() -> None:
    t = np.arange(300) / 100.0
    q = rotation.from_euler(0 * t, 0 * t, 0.4 * t)
    x = np.tile([0, 0, 0.4], (300, 1)), np.tile([0, 0, -9.80665], (300, 1)), rotation.rotate_inverse(q, [20.0, 0, 40.0])
    told = attlog.estimate("mahony", t, *x, log=FACTS)
    assert np.array_equal(told.q, attlog.estimate("mahony", t, *x, declination=7.0).q)
    assert not np.array_equal(told.q, attlog.estimate("mahony", t, *x).q)


def test_a_log_without_the_parameter_leaves_the_default(plugin: Path) -> None:
    assert parse(str(plugin)).resolved(LogFacts({"OTHER": 1.0}, LogInfo()))["kp"] == (0.5, "default")


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
def test_a_from_log_that_fails_is_told(plugin: Path, find: str, put: str, words: str) -> None:
    plugin.write_text(PLUGIN.replace(find, put))
    facts = LogFacts(MappingProxyType({} if "KeyError" in words else {"W_ACC": 2.0}), LogInfo())
    with pytest.raises(PluginError) as failed:
        parse(str(plugin)).resolved(facts)
    assert words in str(failed.value)
    assert "mine" in str(failed.value)


def test_a_value_that_is_overridden_does_not_have_to_be_in_range(plugin: Path) -> None:
    facts = LogFacts({"W_ACC": 1e9}, LogInfo())
    assert parse(f"{plugin}:kp=1").resolved(facts)["kp"] == (1.0, "option")


def test_a_from_log_that_takes_something_else_is_refused(plugin: Path) -> None:
    plugin.write_text(PLUGIN.replace("from_log(params, info)", "from_log(params)"))
    with pytest.raises(PluginError, match="from_log must take params, info"):
        get(str(plugin))
