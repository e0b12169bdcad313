"""What a configuration is: the grammar, its names, and everything that is wrong at once."""

from __future__ import annotations

import re

import pytest

from attlog.base.errors import UsageError
from attlog.compare.configurations.configuration import labels, parse

FULL = (
    "mahony@xu-0.6:ki=0.01,lowpass=20,notch=80/20,rpm_notch=20/2,rate=50,mag=on,mag_rate=10,latency=5,"
    "gyro_offset=0.1/-0.2/0,acc_scale=1.01,imu_rotation=0/0/90,params=new.param"
)


@pytest.mark.parametrize("text", ["mahony", "mahony:kp=0.3", "vqf:lowpass=20", FULL])
def test_a_configuration_writes_itself_as_it_was_read(text: str) -> None:
    assert parse(text).text == text
    assert parse(parse(text).text) == parse(text)


def test_gains_and_settings_are_told_apart_by_name() -> None:
    c = parse("mahony:kp=0.3,lowpass=20,mag=off,gyro_offset=1/2/-3")
    assert dict(c.row.params) == {"kp": 0.3}
    assert dict(c.before) == {"lowpass": (20.0,), "mag": "off", "gyro_offset": (1.0, 2.0, -3.0)}


def test_a_value_may_bear_its_own_unit() -> None:
    assert parse("mahony:kp=0.3 1/s,lowpass=20Hz,latency=5 ms,acc_offset=0/0/0.1 m/s^2") == parse(
        "mahony:kp=0.3,lowpass=20,latency=5,acc_offset=0/0/0.1", "mahony:kp=0.3,lowpass=20,latency=5,acc_offset=0/0/0.1"
    )


def test_everything_wrong_is_told_at_once_with_what_was_meant() -> None:
    with pytest.raises(UsageError) as error:
        parse("mahony:kpp=0.3,lowpas=20,latency=10s,kp=3Hz,rate=x,notch=80,kp")
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
        parse(text)


@pytest.mark.parametrize(
    ("text", "told"),
    [("mahoni", "there is no estimator mahoni; did you mean mahony?"), ("vqf:mag=of", "mag=of: give on or off")],
)
def test_what_is_meant_is_suggested(text: str, told: str) -> None:
    with pytest.raises(UsageError, match=re.escape(told)):
        parse(text)


def test_labels_leave_out_what_is_the_same() -> None:
    assert list(labels([parse("mahony:kp=0.3"), parse("mahony:kp=0.6")]).values()) == ["kp 0.3", "kp 0.6"]
    both = [parse("mahony:kp=0.3,lowpass=20"), parse("mahony:kp=0.6,lowpass=20")]
    assert list(labels(both).values()) == ["kp 0.3", "kp 0.6"]
    assert list(labels([parse("mahony"), parse("mahony:lowpass=20")]).values()) == ["mahony", "low-pass 20 Hz"]
    assert list(labels([parse("mahony:kp=1"), parse("vqf")]).values()) == ["mahony kp 1", "vqf"]
    assert list(labels([parse("mahony", "mine"), parse("mahony:kp=1")]).values()) == ["mine", "kp 1"]


def test_one_value_is_changed_and_the_rest_stays() -> None:
    c = parse("mahony:kp=0.3,lowpass=20")
    assert c.with_value("kp", 1.5).text == "mahony:kp=1.5,lowpass=20"
    assert c.with_value("lowpass", "40").text == "mahony:kp=0.3,lowpass=40"
    with pytest.raises(UsageError, match="did you mean"):
        c.with_value("lowpas", 3)


def test_a_preset_is_a_part_of_what_a_configuration_of_another_filter_is_called() -> None:
    found = labels([parse("mahony@xu-0.6"), parse("mekf"), parse("mahony:ki=0.01")])
    assert list(found.values()) == ["mahony@xu-0.6", "mekf", "mahony ki 0.01"]
    alike = labels([parse("mahony:ki=0.01"), parse("mahony:ki=0.02")])
    assert list(alike.values()) == ["ki 0.01", "ki 0.02"]
