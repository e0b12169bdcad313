"""Signals by name against the columns that were written, on the clock of the flight."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import attlog
from attlog import formats
from attlog.core.errors import UsageError
from attlog.flight.signals import Signals
from attlog.formats import MessageLayout, Recording

START_US, N = 5_000_000, 200
T_US = START_US + 20_000 * np.arange(N, dtype=np.uint64)


def imu() -> dict[str, Any]:
    still = np.zeros(N)
    return {"TimeUS": T_US, "I": np.zeros(N, np.uint8)} | {
        f"{s}{a}": still - 9.8 * (s + a == "AccZ") for s in ("Gyr", "Acc") for a in "XYZ"
    }


def dataflash(folder: Path) -> Signals:
    at = T_US[10::10]
    tables: dict[tuple[str, int], Any] = {("IMU", 0): imu()}
    for k in (0, 1):
        volt = 12.0 - 0.1 * np.arange(len(at)) - k
        tables["BAT", k] = {"TimeUS": at + np.uint64(3), "Inst": np.full(len(at), k, np.uint8), "Volt": volt}
    path = folder / "two_batteries.bin"
    formats.write(path, Recording(tables, layouts={"BAT": MessageLayout("QBf", "s#v", "F-0")}))
    return Signals(attlog.read(path))


def test_a_signal_is_the_written_column_on_the_clock_of_the_flight(tmp_path: Path) -> None:
    signals = dataflash(tmp_path)
    t, volt = signals.read("BAT[1].Volt")
    np.testing.assert_allclose(t, 0.2 * (1 + np.arange(len(t))) + 3e-6, atol=1e-9)
    np.testing.assert_allclose(volt, 11.0 - 0.1 * np.arange(len(t)), atol=1e-5)


def test_instances_are_named_and_the_bare_name_is_the_first(tmp_path: Path) -> None:
    signals = dataflash(tmp_path)
    names = {signal.name: signal for signal in signals.all}
    assert {"BAT[0].Volt", "BAT[1].Volt", "IMU.GyrX"} <= set(names)
    assert names["BAT[0].Volt"].unit == "V"
    assert names["IMU.GyrX"].n == N
    assert (signals.read("BAT.Volt")[1] == signals.read("BAT[0].Volt")[1]).all()


def test_clocks_and_definitions_are_no_signals(tmp_path: Path) -> None:
    names = {signal.name for signal in dataflash(tmp_path).all}
    assert not {name for name in names if name.startswith(("FMT", "UNIT")) or name.endswith("TimeUS")}


def test_an_unknown_name_is_refused_with_similar_ones(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"BAT\[0\]\.Volt"):
        dataflash(tmp_path).read("BAT[0].Vlt")


def test_elements_of_arrays_are_signals_and_px4_names_carry_units(tmp_path: Path) -> None:
    q = np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32), (N, 1))
    q[:, 2] = 0.001 * np.arange(N)
    volt = np.linspace(16.0, 15.0, N, dtype=np.float32)
    tables: dict[tuple[str, int], Any] = {
        ("vehicle_attitude", 0): {"timestamp": T_US, "q": q},
        ("battery_status", 0): {"timestamp": T_US, "voltage_v": volt},
        ("sensor_combined", 0): {"timestamp": T_US, "gyro_rad": np.ones((N, 3), np.float32)},
        ("vehicle_gps_position", 0): {"timestamp": T_US, "noise_per_ms": np.ones(N, np.int32)},
        ("actuator_motors", 0): {"timestamp": T_US, "timestamp_sample": T_US, "control": q},
    }
    path = tmp_path / "attitude.ulg"
    formats.write(path, Recording(tables))
    signals = Signals(attlog.read(path))
    t, y = signals.read("vehicle_attitude.q[2]")
    assert np.allclose(y, q[:, 2])
    assert (np.diff(t) > 0).all()
    assert signals.unit("battery_status.voltage_v") == "V"
    assert signals.unit("sensor_combined.gyro_rad[0]") == "rad/s"  # a rate, by the message's definition
    assert signals.unit("vehicle_gps_position.noise_per_ms") == ""  # a count of the receiver
    assert not signals.has("actuator_motors.timestamp_sample")
    assert not signals.has("vehicle_attitude.q[4]")


def test_records_that_go_back_in_time_are_left_out(tmp_path: Path) -> None:
    at = T_US[::10].copy()
    at[7] = at[2]
    tables: dict[tuple[str, int], Any] = {("IMU", 0): imu(), ("CTUN", 0): {"TimeUS": at, "Alt": np.arange(20.0)}}
    formats.write(tmp_path / "back.bin", Recording(tables))
    t, y = Signals(attlog.read(tmp_path / "back.bin")).read("CTUN.Alt")
    assert (np.diff(t) > 0).all()
    assert len(y) == 19
