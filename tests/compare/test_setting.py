"""What a configuration is: the grammar, its names, and everything that is wrong at once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from attlog.compare.setting import labels, parse_configuration
from attlog.compare.setting_words import read_configurations
from attlog.core.errors import LogUnreadable, UsageError

FULL = (
    "mahony@xu-0.6:ki=0.01,lowpass=20,notch=80/20,rpm_notch=20/2,rate=50,mag=on,mag_rate=10,latency=5,"
    "gyro_offset=0.1/-0.2/0,acc_scale=1.01,imu_rotation=0/0/90,params=new.param"
)


@pytest.mark.parametrize("text", ["mahony", "mahony:kp=0.3", "vqf:lowpass=20", FULL])
def test_a_configuration_writes_itself_as_it_was_read(text: str) -> None:
    assert parse_configuration(text).text == text
    assert parse_configuration(parse_configuration(text).text) == parse_configuration(text)


def test_gains_and_settings_are_told_apart_by_name() -> None:
    c = parse_configuration("mahony:kp=0.3,lowpass=20,mag=off,gyro_offset=1/2/-3")
    assert dict(c.row.params) == {"kp": 0.3}
    assert dict(c.before) == {"lowpass": (20.0,), "mag": "off", "gyro_offset": (1.0, 2.0, -3.0)}


def test_a_value_may_bear_its_own_unit() -> None:
    assert parse_configuration(
        "mahony:kp=0.3 1/s,lowpass=20Hz,latency=5 ms,acc_offset=0/0/0.1 m/s^2"
    ) == parse_configuration(
        "mahony:kp=0.3,lowpass=20,latency=5,acc_offset=0/0/0.1", "mahony:kp=0.3,lowpass=20,latency=5,acc_offset=0/0/0.1"
    )


def test_everything_wrong_is_told_at_once_with_what_was_meant() -> None:
    with pytest.raises(UsageError) as error:
        parse_configuration("mahony:kpp=0.3,lowpas=20,latency=10s,kp=3Hz,rate=x,notch=80,kp")
    told = str(error.value).splitlines()
    assert len(told) == 7
    for part in (
        "kp is not NAME=VALUE",
        "no parameter kpp, and no setting before a filter is called so; did you mean kp?",
        "did you mean lowpass?",
        "latency is given in ms, not in s",
        "kp is given in 1/s, not in Hz",
        "rate='x': of the wrong type; give A [Hz]",
        "notch=80: 1 numbers; give A/B [Hz]",
    ):
        assert sum(part in line for line in told) == 1, part
    assert error.value.exit_code == 2


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("mahony:rate=50,pick=50", "rate and pick exclude each other"),
        ("mahony:lowpass=50,gyro_lowpass=20", "lowpass and gyro_lowpass exclude each other"),
        ("mahony:mag=off,mag_rate=5", "there is no magnetometer with mag=off"),
        ("mahony:latency=-5", "out of range"),
        ("mahony:kp=1e9", "out of range"),
    ],
)
def test_what_cannot_be_is_refused(text: str, why: str) -> None:
    with pytest.raises(UsageError, match=why):
        parse_configuration(text)


@pytest.mark.parametrize(
    ("text", "told"),
    [("mahoni", "there is no estimator mahoni; did you mean mahony?"), ("vqf:mag=of", "mag=of: give on or off")],
)
def test_what_is_meant_is_suggested(text: str, told: str) -> None:
    with pytest.raises(UsageError, match=re.escape(told)):
        parse_configuration(text)


def test_labels_leave_out_what_is_the_same() -> None:
    assert list(labels([parse_configuration("mahony:kp=0.3"), parse_configuration("mahony:kp=0.6")]).values()) == [
        "kp 0.3",
        "kp 0.6",
    ]
    both = [parse_configuration("mahony:kp=0.3,lowpass=20"), parse_configuration("mahony:kp=0.6,lowpass=20")]
    assert list(labels(both).values()) == ["kp 0.3", "kp 0.6"]
    assert list(labels([parse_configuration("mahony"), parse_configuration("mahony:lowpass=20")]).values()) == [
        "mahony",
        "low-pass 20 Hz",
    ]
    assert list(labels([parse_configuration("mahony:kp=1"), parse_configuration("vqf")]).values()) == [
        "mahony kp 1",
        "vqf",
    ]
    assert list(labels([parse_configuration("mahony", "mine"), parse_configuration("mahony:kp=1")]).values()) == [
        "mine",
        "kp 1",
    ]


def test_one_value_is_changed_and_the_rest_stays() -> None:
    c = parse_configuration("mahony:kp=0.3,lowpass=20")
    assert c.with_value("kp", 1.5).text == "mahony:kp=1.5,lowpass=20"
    assert c.with_value("lowpass", "40").text == "mahony:kp=0.3,lowpass=40"
    with pytest.raises(UsageError, match="did you mean"):
        c.with_value("lowpas", 3)


def test_a_preset_is_a_part_of_what_a_configuration_of_another_filter_is_called() -> None:
    found = labels(
        [parse_configuration("mahony@xu-0.6"), parse_configuration("mekf"), parse_configuration("mahony:ki=0.01")]
    )
    assert list(found.values()) == ["mahony@xu-0.6", "mekf", "mahony ki 0.01"]
    alike = labels([parse_configuration("mahony:ki=0.01"), parse_configuration("mahony:ki=0.02")])
    assert list(alike.values()) == ["ki 0.01", "ki 0.02"]


# Configurations in a TOML file: read, and everything wrong at once with its line.

GOOD = """metrics = ["tilt_rmse_deg", "lag_ms"]
reference = "truth"

[[configuration]]
estimator = "mahony@xu-0.6"

[[configuration]]
name = "slow and quiet"
estimator = "mahony"
kp = 0.3
lowpass = 20
mag = false
gyro_offset = [0.1, 0, -0.2]
"""
BAD = """metrics = ["tilt_rmse"]
refrence = "truth"
window = 3

[[configuration]]
name = "a"
estimator = "mahoni"

[[configuration]]
estimator = "mahony"
kpp = 0.3
kp = "3 Hz"
lowpas = 20
rate = "x"
latency = true

[[configuration]]
filter = "vqf"

[[configuration]]
estimator = "vqf"

[[configuration]]
estimator = "vqf"
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "filters.toml"
    path.write_text(text)
    return path


def test_a_file_means_what_the_command_line_means(tmp_path: Path) -> None:
    found = read_configurations(write(tmp_path, GOOD))
    assert found.metrics == ["tilt_rmse_deg", "lag_ms"]
    assert found.options == {"reference": "truth"}
    assert found.configurations == [
        parse_configuration("mahony@xu-0.6"),
        parse_configuration("mahony:kp=0.3,lowpass=20,mag=off,gyro_offset=0.1/0/-0.2", "slow and quiet"),
    ]


def test_everything_wrong_is_told_at_once_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(UsageError) as error:
        read_configurations(write(tmp_path, BAD))
    told = {line.removeprefix(f"{tmp_path}/filters.toml") for line in str(error.value).splitlines()}
    for begin, part in (
        (", line 1: ", "there is no metric tilt_rmse; did you mean tilt_rmse_deg?"),
        (", line 2: ", "unknown key refrence; did you mean reference?"),
        (", line 3: ", "window: must be a valid string (got 3)"),
        (", line 7: configuration 1: ", "there is no estimator mahoni; did you mean mahony?"),
        (
            ", line 11: configuration 2: ",
            "no parameter kpp, and no setting before a filter is called so; did you mean kp?",
        ),
        (", line 12: configuration 2: ", "kp is given in 1/s, not in Hz"),
        (", line 13: configuration 2: ", "did you mean lowpass?"),
        (", line 14: configuration 2: ", "rate='x': of the wrong type; give A [Hz]"),
        (", line 15: configuration 2: ", "latency=True: of the wrong type; give A [ms]"),
        (", line 18: configuration 3: ", "has no estimator; did you mean estimator?"),
        (", line 23: configuration 5: ", "vqf is there twice"),
    ):
        assert any(line.startswith(begin) and line.endswith(part) for line in told), (begin, part, told)
    assert len(told) == 11
    assert error.value.exit_code == 2


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[[configuration]", "not valid TOML"),
        ("", "holds no [[configuration]]"),
        ("configuration = 3", "holds no [[configuration]]"),
        ("[configuration]\nestimator = 'vqf'", "holds no [[configuration]]"),
        (
            "metrics = 'lag_ms'\n[[configuration]]\nestimator = 'vqf'",
            "metrics: of the wrong type; give a list of names",
        ),
        ("[[configuration]]\nestimator = 'vqf'\nname = 3", "name=3: of the wrong type; give a text"),
        ("[[configuration]]\nestimator = 'mahony'\nrate = 50\npick = 50", "rate and pick exclude each other"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path: Path, text: str, why: str) -> None:
    with pytest.raises(UsageError) as error:
        read_configurations(write(tmp_path, text))
    assert why in str(error.value)


def test_a_file_that_is_not_there_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(LogUnreadable):
        read_configurations(tmp_path / "none.toml")
