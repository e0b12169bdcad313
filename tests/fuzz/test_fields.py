"""Each field that is read, with each value: the list is whole, a number gives the same log, and attlog takes it."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.formats.base import Messages
from tests.conftest import SAMPLES, few
from tests.fuzz import campaign, fields
from tests.fuzz.campaign import Trial, run

LOGS = ("px4_hover.ulg", "copter_yaw_turns.bin", "copter_steps_stabilize.tlog")
STRIDE = 401
"""Every so manieth number in the suite; ``make fuzz`` draws from all of them."""


@functools.cache
def opened(name: str) -> tuple[Messages, list[fields.Read]]:
    messages = formats.open(SAMPLES / name)
    return messages, fields.read_fields(messages)


GYROS = (("sensor_combined", "gyro_rad"), ("IMU", "GyrX"), ("RAW_IMU", "xgyro"))


@pytest.mark.parametrize(("name", "gyro"), list(zip(LOGS, GYROS, strict=True)))
def test_the_list_holds_what_a_flight_is_read_from(name: str, gyro: tuple[str, str]) -> None:
    read = opened(name)[1]
    assert gyro in [(message, field) for (message, _), field in read]
    assert len(read) == len(set(read)) > 50


def test_a_number_changes_one_field_and_leaves_the_others() -> None:
    messages, read = opened("copter_yaw_turns.bin")
    number = read.index((("IMU", 0), "GyrX")) * len(fields.VALUES) + list(fields.VALUES).index("nan")
    assert fields.name(read, number) == "IMU:0.GyrX nan"
    broken = fields.swept(messages, number, read)
    assert np.isnan(broken["IMU", 0]["GyrX"]).all()
    np.testing.assert_array_equal(broken["IMU", 0]["GyrY"], messages["IMU", 0]["GyrY"])
    assert np.isnan(broken["IMU", 0].rows(slice(10, 20))["GyrX"]).all()


@pytest.mark.parametrize("kind", ["u1", "i4", "u8", "f4", "f8"])
def test_every_value_changes_a_field_of_any_type(kind: str) -> None:
    x = np.arange(9, 1, -1).astype(kind)
    for value, change in fields.VALUES.items():
        with np.errstate(all="ignore"):
            changed = change(x)
        assert (changed.dtype, changed.shape) == (x.dtype, x.shape), value
        assert not np.array_equal(changed, x), value


@pytest.mark.slow
@pytest.mark.parametrize("name", few(LOGS, 1))
def test_fields_as_no_sensor_gives_them_end_as_documented(name: str, tmp_path: Path) -> None:
    campaign.warm()
    read = opened(name)[1]
    faults = []
    for number in range(LOGS.index(name), fields.count(read), STRIDE):
        trial = Trial(SAMPLES / name, "fields", number, "analyze")
        faults += [f"{fields.name(read, number)}: {fault}" for fault in run(trial, tmp_path).faults]
    assert faults == []
