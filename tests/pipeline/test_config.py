"""A configuration: what each key takes, and everything that is wrong with one at once."""

from __future__ import annotations

import json
import math
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from attlog.core.errors import UsageError
from attlog.pipeline.config import Config
from attlog.pipeline.preparation import flight_of
from tests.conftest import SAMPLES
from tests.flight.calibrated_logs import OLD, ardupilot


@pytest.mark.parametrize(
    ("key", "given", "kept"),
    [
        ("imu", " 12 ", 12),
        ("imu", 4.0, 4),
        ("imu", "all", "all"),
        ("imu", "7", 7),
        ("system", 255, 255),
        ("declination", 3, 3.0),
        ("declination", "-180", -180.0),
        ("clock", "publication", "publication"),
        ("trim", "off", False),
        ("window", None, None),
        ("estimators", "gyro,mahony:kp=1", ["gyro", "mahony:kp=1"]),
        ("estimators", ("gyro",), ["gyro"]),
        ("reference", "onboard:AHR2", "onboard:AHR2"),
    ],
)
def test_a_value_is_kept_in_one_form(key: str, given: Any, kept: Any) -> None:
    found = getattr(Config.build({key: given}), key)
    assert found == kept
    assert type(found) is type(kept)


@pytest.mark.parametrize(
    ("key", "given", "says"),
    [
        ("imu", True, "imu: must be a number or 'all'"),
        ("imu", 1.5, "imu: must be a valid integer or 'all'"),
        ("imu", math.inf, "imu: must be a finite number or 'all'"),
        ("system", 256, "system: must be less than or equal to 255"),
        ("boot", -1, "boot: must be greater than or equal to 0"),
        ("score_from", math.nan, "score_from: must be a finite number"),
        ("input_delay", 10**400, "input_delay: must be a valid number or 'auto' or 'off'"),
        ("clock", "wall", r"clock: must be 'sample' or 'publication' \(got 'wall'\)"),
        ("trim", "perhaps", "trim: must be a valid boolean"),
        ("window", 3, "window: must be a valid string"),
        ("reference", "truth:ATT", "reference: must be auto, truth, smoother, onboard, onboard:NAME"),
        ("estimators", ["gyro", 3], r"estimators\[1\]: must be a valid string"),
    ],
)
def test_a_value_of_another_kind_is_refused_with_what_would_do(key: str, given: Any, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        Config.build({key: given})


def test_a_configuration_is_checked_when_it_is_changed() -> None:
    config = Config(estimators="gyro,mahony:kp=1")  # type: ignore[arg-type]
    assert config.estimators == ["gyro", "mahony:kp=1"]
    config.declination = "4.5"  # type: ignore[assignment]
    assert config.declination == 4.5
    with pytest.raises(UsageError, match="declination: must be less than or equal to 180 or 'auto'"):
        config.declination = 181.0
    with pytest.raises(UsageError, match="unknown key windw; did you mean window"):
        config.windw = "all"  # type: ignore[attr-defined]


def test_all_that_is_wrong_is_told_at_once() -> None:
    with pytest.raises(UsageError) as error:
        Config.build({"boot": -1, "clocks": "sample", "trim": "maybe"}, origin="f.toml")
    lines = str(error.value).splitlines()
    assert [line.split(":")[0] for line in lines] == ["f.toml"] * 3
    assert any(line.endswith("unknown key clocks; did you mean clock?") for line in lines)


def test_what_is_resolved_makes_the_same_configuration_again() -> None:
    config = Config.build({"imu": "all", "declination": -3, "trim": False, "estimators": "gyro"})
    assert Config.build(config.resolved()) == Config.trusted(config.resolved()) == config
    assert pickle.loads(pickle.dumps(config)) == config


@pytest.mark.slow
def test_options_without_a_file_reach_the_result(tmp_path: Path) -> None:
    log, out = str(SAMPLES / "px4_hover.ulg"), str(tmp_path)
    options = ["--estimators", "mahony:kp=0.5", "--reference", "onboard", "--gyro-bias", "none", "--imu", "all"]
    code = (
        "import sys\nfrom attlog.cli import main\n"
        f"sys.argv = {['attlog', 'analyze', log, '-o', out, *options]!r}\n"
        "main()\n"
    )
    subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    config = json.loads((tmp_path / "px4_hover.ulg.json").read_text())["config"]
    assert config["estimators"] == ["mahony:kp=0.5"]
    assert (config["reference"], config["gyro_bias"], config["imu"]) == ("onboard", "none", "all")


# What a configuration may still choose of a flight that was read before.


def test_all_units_and_those_that_were_read_can_be_asked_of_a_flight_and_no_others() -> None:
    log = ardupilot(OLD)
    log.imu = log.mag = 0
    for settings in ({"imu": "all"}, {"mag": 0}, {"boot": 0}, {}):
        assert flight_of(log, Config.build(settings)) is log
    for settings in ({"mag": 1}, {"mag": "none"}, {"boot": 1}, {"params": "x.param"}):
        with pytest.raises(UsageError, match="is chosen when the log is read"):
            flight_of(log, Config.build(settings))


@pytest.mark.parametrize(
    "named",
    [
        {"estimators": "evil.py"},
        {"estimators": ["gyro", "./evil.PY:gain=1"]},
        {"estimators": "gyro,evil.py,kp=3"},
        {"estimators": ["table.csv"]},
        {"truth": "/etc/passwd"},
        {"truth": "evil.py:offset=1"},
        {"params": "evil.py"},
    ],
)
def test_the_configuration_of_a_result_opens_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: dict[str, Any]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "evil.py").write_text("from pathlib import Path\nPath('ran').touch()\n")
    result = tmp_path / "result.json"
    result.write_text("\ufeff " + json.dumps({"schema": "attlog-result/7", "config": named}), encoding="utf-8")
    with pytest.raises(UsageError, match=r"is a result that .* because a result names it"):
        Config.load(result)
    assert not (tmp_path / "ran").exists()
    Config.load(result, **named)  # the caller trusts it
    result.write_text(json.dumps({"schema": "attlog-result/7", "config": {"truth": "vehicle_attitude_groundtruth"}}))
    assert Config.load(result).truth == "vehicle_attitude_groundtruth"
