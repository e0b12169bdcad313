"""Lines of the figures of flight data against the columns of made logs: sign, unit, era, clock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.core.errors import UsageError
from attlog.flight import panels, read_messages
from attlog.flight.ardupilot.panels import ROWS as ARDUPILOT
from attlog.flight.mavlink import PANEL_ROWS
from attlog.flight.panels import PANELS, PanelLine, panel_lines
from attlog.flight.px4.panels import ROWS as PX4
from attlog.flight.signals import Signals
from attlog.formats.table import Field, Messages, ParamChange
from attlog.pipeline import extraction
from tests.flight import fake

N, RATE = 100, 50.0
RAMP = np.arange(N) / N


def lines(messages: Messages) -> dict[tuple[str, str], PanelLine]:
    """The lines of a made log by panel and label."""
    log = read_messages(messages, None, None, None)
    assert not [p for p in log.problems if p.code == "part_failed"]
    return {(line.panel, line.label): line for line in panel_lines(log)}


def dataflash(tables: dict[tuple[str, int], Any], units: dict[str, str] | None = None, **params: float) -> Messages:
    """An ArduPilot log with an IMU; ``units`` of columns."""
    imu = {f"{s}{a}": np.zeros(N) - 9.8 * (s + a == "AccZ") for s in ("Gyr", "Acc") for a in "XYZ"}
    whole = {("IMU", 0): {"TimeUS": fake.micros(N, RATE), **imu}} | {
        key: {"TimeUS": fake.micros(N, RATE), **columns} for key, columns in tables.items()
    }
    made = fake.messages("dataflash", whole, params)
    for table in made.values():
        for column in set(table.fields) & set(units or {}):
            old = table.fields[column]
            table.fields[column] = Field(column, old.dtype, (units or {})[column], old.scale)
    return made


def ulog(tables: dict[tuple[str, int], Any]) -> Messages:
    """A PX4 log with an IMU and an attitude."""
    t = fake.micros(N, RATE)
    whole: dict[tuple[str, int], Any] = {
        ("sensor_combined", 0): {
            "timestamp": t,
            "gyro_rad": np.zeros((N, 3), np.float32),
            "accelerometer_m_s2": fake.gravity(N),
        },
        ("vehicle_attitude", 0): {"timestamp": t, "q": fake.level(N)},
    }
    return fake.messages("ulog", whole | {key: {"timestamp": t, **columns} for key, columns in tables.items()})


@pytest.mark.parametrize("rows", [ARDUPILOT, PX4, PANEL_ROWS])
def test_every_row_belongs_to_a_panel(rows: panels.PanelRows) -> None:
    assert set(rows) <= set(PANELS)


def test_a_climb_is_positive_upwards_from_velocities_down() -> None:
    found = lines(dataflash({("XKF1", 0): {"VD": -2.0 - RAMP, "VN": RAMP, "VE": RAMP}}))
    assert found["climb", "onboard"].y == pytest.approx(2.0 + RAMP)
    found = lines(ulog({("vehicle_local_position_setpoint", 0): {"vz": -1.0 - RAMP, "z": -5.0 - RAMP}}))
    assert found["climb", "set-point"].y == pytest.approx(1.0 + RAMP)
    assert found["height", "set-point"].y == pytest.approx(5.0 + RAMP)


@pytest.mark.parametrize(("unit", "stored"), [("cm/s", 250.0), ("m/s", 2.5), (None, 250.0)])
def test_the_unit_of_the_log_counts_and_without_one_that_of_the_era(unit: str | None, stored: float) -> None:
    made = dataflash({("CTUN", 0): {"CRt": stored + 0.0 * RAMP}}, {} if unit is None else {"CRt": unit})
    assert lines(made)["climb", "onboard"].y == pytest.approx(2.5)


def test_a_speed_is_the_length_of_its_vector() -> None:
    found = lines(dataflash({("NKF1", 0): {"VN": 3.0 + 0 * RAMP, "VE": 4.0 + 0 * RAMP}}))
    assert found["speed", "onboard"].y == pytest.approx(5.0)


def test_sticks_are_on_the_channels_that_rcmap_gives_them() -> None:
    channels = {f"C{k}": 1000.0 + 10 * k + RAMP for k in range(1, 5)}
    found = lines(dataflash({("RCIN", 0): channels}, RCMAP_THROTTLE=1.0, RCMAP_ROLL=3.0))
    assert found["stick_pulses", "throttle"].y[0] == 1010.0
    assert found["stick_pulses", "roll"].y[0] == 1030.0
    assert found["stick_pulses", "yaw"].y[0] == 1040.0


@pytest.mark.parametrize(
    ("software", "wanted"),
    [
        (40.0, {"pitch": 1010.0, "roll": 1020.0, "throttle": 1030.0, "yaw": 1040.0}),
        (20.0, {"steering": 1010.0, "throttle": 1030.0, "lateral": 1040.0}),
    ],
)
def test_a_submarine_and_a_rover_read_channels_of_their_own(software: float, wanted: dict[str, float]) -> None:
    channels = {f"C{k}": 1000.0 + 10 * k + RAMP for k in range(1, 5)}
    found = lines(dataflash({("RCIN", 0): channels}, RCMAP_PITCH=2.0, SYSID_SW_TYPE=software))
    assert {label: line.y[0] for (panel, label), line in found.items() if panel == "stick_pulses"} == wanted


def test_every_battery_is_a_line_and_a_missing_one_is_none() -> None:
    tables = {("BAT", k): {"Volt": 12.0 + k + RAMP, "Curr": 0.0 * RAMP, "CurrTot": 0.0 * RAMP} for k in (0, 1)}
    found = lines(dataflash(tables))
    assert found["volts", "battery"].y[0] == 12.0
    assert found["volts", "battery 2"].y[0] == 13.0
    assert not [key for key in found if key[0] in ("amperes", "used")]


def test_numbers_of_dshot_are_no_pulses() -> None:
    columns = {"output": np.column_stack([300.0 + 100 * RAMP, 1500.0 + 400 * RAMP])}
    found = lines(ulog({("actuator_outputs", 0): columns}))
    assert ("commands", "output 1") in found
    assert ("outputs", "output 2") in found


def test_the_percentages_of_px4_are_shares_in_the_log() -> None:
    found = lines(ulog({("cpuload", 0): {"load": 0.4 + 0 * RAMP, "ram_usage": 0.5 + 0 * RAMP}}))
    assert found["load", "CPU"].y == pytest.approx(40.0)


def test_the_receiver_is_in_percent_and_unknown_signals_are_left_out() -> None:
    signal = np.where(np.arange(N) < 10, -1, 60)
    found = lines(ulog({("input_rc", 0): {"rssi": signal, "link_quality": signal}}))
    assert np.nanmin(found["link", "receiver signal"].y) == 60.0
    assert np.isnan(found["link", "receiver link quality"].y[:10]).all()
    found = lines(dataflash({("RSSI", 0): {"RXRSSI": 0.5 + 0.2 * RAMP}}))
    assert found["link", "receiver signal"].y == pytest.approx(50.0 + 20.0 * RAMP)


OWN = 1 * 256 + 1


def telemetry(tables: dict[str, Any]) -> Messages:
    """A tlog of an ArduPilot vehicle with its attitude."""
    beat = {"type": 2, "autopilot": 3, "base_mode": 81, "custom_mode": 0, "system_status": 4, "mavlink_version": 3}
    angles = {k: 0.01 * RAMP for k in ("roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed")}
    at = {"time_boot_ms": np.arange(N, dtype=np.uint32) * 20 + 1000}
    whole = {"HEARTBEAT": {k: np.full(N, v) for k, v in beat.items()}, "ATTITUDE": at | angles} | tables
    made = {(name, OWN): {"_t_us": fake.micros(N, RATE)} | columns for name, columns in whole.items()}
    systems = {"systems": {1: {"autopilot": 3, "component": 1}}, "system": 1}
    return fake.messages("tlog", made, [ParamChange("A", 1.0)], info=systems)


def batteries(first: int = 0) -> Messages:
    """Telemetry of two batteries by turns: 12 V falling in three cells, and 24 V as one number."""
    second = np.arange(N) % 2 == 1
    volts = np.full((N, 10), 65535, np.uint16)
    volts[~second, :3] = (4000 - 100 * RAMP[~second, None]).astype(np.uint16)
    volts[second, 0] = 24000
    used = np.where(second, 900 + np.arange(N), 100 + np.arange(N))
    return telemetry(
        {"BATTERY_STATUS": {"id": first + second.astype(np.uint8), "voltages": volts, "current_consumed": used}}
    )


def test_batteries_of_one_message_are_lines_of_their_own() -> None:
    found = lines(batteries())
    assert found["volts", "battery"].y == pytest.approx(12.0 - 0.3 * RAMP[::2], abs=0.004)
    assert found["volts", "battery 2"].y == pytest.approx(24.0)
    for label in ("battery", "battery 2"):
        assert np.all(np.diff(found["used", label].y) > 0.0)
    assert found["used", "battery 2"].y[0] == 901.0


def test_signals_of_a_message_that_serves_several_sensors_are_named_by_sensor() -> None:
    log = read_messages(batteries(first=3), None, None, None)
    signals = Signals(log)
    names = {signal.name: signal.n for signal in signals.all if signal.message == "BATTERY_STATUS"}
    assert names["BATTERY_STATUS[id=3].current_consumed"] == N // 2
    assert "BATTERY_STATUS.current_consumed" not in names
    assert signals.read("BATTERY_STATUS[id=4].current_consumed")[1][0] == 901.0
    assert signals.read("BATTERY_STATUS[257,id=4].current_consumed")[1][0] == 901.0
    assert signals.read("BATTERY_STATUS.current_consumed")[1][0] == 100.0  # the first
    with pytest.raises(UsageError, match=r"BATTERY_STATUS\[id=4\]"):
        signals.read("BATTERY_STATUS[id=5].current_consumed")


def test_one_sensor_of_a_message_can_be_extracted(tmp_path: Path) -> None:
    log = read_messages(batteries(), None, None, None)
    log.path = tmp_path / "two.tlog"
    log.path.write_bytes(bytes(100_000))
    (second,) = extraction.messages(log, ["BATTERY_STATUS[id=1].current_consumed"])
    assert second.name == "BATTERY_STATUS_id_1"
    assert list(second.columns) == ["time_s", "current_consumed"]
    assert second.columns["current_consumed"].tolist() == list(range(901, 1000, 2))
    (whole,) = extraction.messages(log, ["BATTERY_STATUS"])
    assert len(whole.columns["id"]) == N
    with pytest.raises(UsageError, match="no id=7 of BATTERY_STATUS; it has id=0, id=1"):
        list(extraction.messages(log, ["BATTERY_STATUS[id=7]"]))


def test_names_that_cannot_be_typed_are_no_sensors() -> None:
    values = {"name": np.array([b"a", b"b", b"../x", b"[c]"] * (N // 4)), "value": RAMP}
    signals = Signals(read_messages(telemetry({"NAMED_VALUE_FLOAT": values}), None, None, None))
    names = {signal.name for signal in signals.all if signal.message == "NAMED_VALUE_FLOAT"}
    assert names == {"NAMED_VALUE_FLOAT[name=a].value", "NAMED_VALUE_FLOAT[name=b].value"}


def test_unset_numbers_of_telemetry_are_missing() -> None:
    pulses = np.where(np.arange(N) % 2 == 0, 65535, 1500 + np.arange(N))
    at = {"time_boot_ms": np.arange(N, dtype=np.uint32) * 20 + 1000}
    found = lines(telemetry({"RC_CHANNELS": at | {"chan1_raw": pulses}}))
    roll = found["stick_pulses", "roll"].y
    assert np.isnan(roll[::2]).all()
    assert np.nanmax(roll) < 1700
    assert found["roll_rate", "onboard"].y[-1] == pytest.approx(np.degrees(0.01 * RAMP[-1]))
