"""What the readers tell of a compass beside its field, and of an accelerometer: ids, raw values, applied offsets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.flight import read
from attlog.flight.ardupilot import reader as ardupilot
from attlog.flight.px4 import reader as px4
from attlog.flight.px4.mags import RAW_RECORDS
from tests.flight.fake import gravity, messages, micros

N = 2000


def test_an_ardupilot_log_tells_device_and_offsets(samples: Path) -> None:
    log = read(samples / "copter_yaw_turns.bin")
    mag, table = log.mags[0], formats.open(samples / "copter_yaw_turns.bin")["MAG", 0]
    assert mag.device == "97539"
    assert mag.offsets is not None
    assert mag.offsets.x.shape == (1, 3)
    np.testing.assert_allclose(mag.offsets.x[0] * 1e7, [float(table[c][0]) for c in ("OfsX", "OfsY", "OfsZ")])


def test_offsets_are_told_at_each_change() -> None:
    t = micros(N, 50)
    columns = {"TimeUS": t, "I": np.zeros(N, np.uint8)}
    columns |= {f"Mag{a}": (300 + 100 * np.cos(np.arange(N) / 50)).astype(np.int16) for a in "XYZ"}
    columns |= {f"Ofs{a}": np.where(np.arange(N) < 700, 10, -20).astype(np.int16) for a in "XYZ"}
    imu = {"TimeUS": t, "I": np.zeros(N, np.uint8)}
    imu |= {f"Gyr{a}": np.full(N, 0.1, np.float32) for a in "XYZ"}
    imu |= {f"Acc{a}": np.full(N, v, np.float32) for a, v in zip("XYZ", (0, 0, -9.81), strict=True)}
    log = ardupilot.read(messages("dataflash", {("IMU", 0): imu, ("MAG", 0): columns}))
    offsets = log.mags[0].offsets
    assert offsets is not None
    np.testing.assert_allclose(offsets.t, [0.0, 14.0], atol=1e-6)
    np.testing.assert_allclose(offsets.x[:, 0] * 1e7, [10.0, -20.0])


def px4_log(selected: list[int], published_by: tuple[int, ...] = (42,)):
    t = micros(N, 200)
    combined = {"timestamp": t, "gyro_rad": np.full((N, 3), 0.01, np.float32), "accelerometer_m_s2": gravity(N)}
    combined |= {
        "gyro_integral_dt": np.full(N, 5000, np.uint32),
        "accelerometer_integral_dt": np.full(N, 5000, np.uint32),
    }
    published = {"timestamp": t, "device_id": np.resize(np.array(published_by, np.uint32), N)}
    published |= {"magnetometer_ga": np.random.default_rng(1).normal(0.3, 0.01, (N, 3)).astype(np.float32)}
    raw = {"timestamp": t, "device_id": np.full(N, 42, np.uint32)}
    raw |= {a: (0.1 * k + np.linspace(0.1, 0.2, N)).astype(np.float32) for k, a in enumerate("xyz")}
    other = raw | {"device_id": np.full(N, 43, np.uint32), "x": raw["x"] + 5}
    voted = {"timestamp": t[: len(selected)], "accel_device_id": np.array(selected, np.uint32)}
    voted |= {"gyro_device_id": np.full(len(selected), 3, np.uint32)}
    tables = {("sensor_combined", 0): combined, ("vehicle_magnetometer", 0): published, ("sensor_selection", 0): voted}
    return px4.read(messages("ulog", tables | {("sensor_mag", 0): other, ("sensor_mag", 1): raw}))


def test_a_px4_log_tells_some_raw_values_of_the_same_device() -> None:
    log = px4_log([7, 7])
    raw = log.mags[0].raw
    assert raw is not None
    assert raw.source == "sensor_mag:1"
    assert len(raw.t) <= RAW_RECORDS
    assert raw.t[-1] == pytest.approx((N - 1) / 200.0, abs=1e-3)
    np.testing.assert_allclose(raw.x[[0, -1], 0] * 1e4, [0.1, 0.2], atol=1e-6)


def test_two_compasses_that_take_turns_have_no_raw_values() -> None:
    assert px4_log([7, 7], (42, 42, 43)).mags[0].raw is None


def test_the_voted_accelerometer_has_an_id_where_it_stayed_the_same() -> None:
    assert px4_log([7, 7]).imus[0].acc_device == "7"
    assert px4_log([7, 8]).imus[0].acc_device is None
