"""Numbers that firmwares give to modes, and their defaults of parameters, in simulated logs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from attlog.simulate.logs import ardupilot, mavlink, px4
from attlog.simulate.logs.px4_parameters import parameters

MAVLINK_NAMES = {"ALT_HOLD": "ALT_HOLD", "ALTCTL": "ALT_HOLD", "MISSION": "AUTO", "OFFBOARD": "GUIDED"}
MAVLINK_NAMES |= {"POSCTL": "LOITER", "HOLD": "BRAKE", "TAKEOFF": "GUIDED"}


def test_copters_mode_numbers_are_those_of_the_ground_stations_table() -> None:
    mavutil = pytest.importorskip("pymavlink.mavutil")
    numbers = {name: number for number, name in mavutil.mode_mapping_acm.items()}
    assert ardupilot.MODES == {mode: numbers[MAVLINK_NAMES.get(mode, mode)] for mode in ardupilot.MODES}


def test_px4s_mode_numbers_are_those_of_vehicle_status() -> None:
    """PX4 1.16, msg/versioned/VehicleStatus.msg: NAVIGATION_STATE_*."""
    stated = {"ALTCTL": 1, "POSCTL": 2, "MISSION": 3, "HOLD": 4, "RTL": 5, "ACRO": 10, "OFFBOARD": 14}
    stated |= {"STABILIZE": 15, "TAKEOFF": 17, "LAND": 18}
    alike = {"ALT_HOLD": "ALTCTL", "LOITER": "POSCTL", "GUIDED": "OFFBOARD", "AUTO": "MISSION"}
    assert {mode: stated[alike.get(mode, mode)] for mode in px4.MODES} == px4.MODES
    assert px4.RELEASE == 0x0110_00FF
    assert px4.GAUSS == 1e-4


def test_units_and_flags_of_telemetry_are_those_of_mavlink_common() -> None:
    """MAV_MODE_FLAG: 128 armed, 1 custom mode; MAV_LANDED_STATE: 1 on ground, 2 in air; mG of standard gravity."""
    assert (mavlink.ARMED_FLAG, mavlink.CUSTOM_MODE, mavlink.ON_GROUND, mavlink.IN_AIR) == (128, 1, 1, 2)
    assert (mavlink.MILLI_G, mavlink.MILLIGAUSS) == (9.80665e-3, 1e-7)
    assert (ardupilot.PWM_MIN, ardupilot.PWM_MAX, ardupilot.MILLIGAUSS) == (1000, 2000, 1e-7)


PX4_DEFAULTS: dict[str, float] = {
    # PX4 1.16, parameter reference.
    "MC_ROLL_P": 6.5,
    "MC_PITCH_P": 6.5,
    "MC_YAW_P": 2.8,
    "MC_ROLLRATE_P": 0.15,
    "MC_ROLLRATE_I": 0.2,
    "MC_ROLLRATE_D": 0.003,
    "MC_PITCHRATE_P": 0.15,
    "MC_PITCHRATE_I": 0.2,
    "MC_PITCHRATE_D": 0.003,
    "MC_YAWRATE_P": 0.2,
    "MC_YAWRATE_I": 0.1,
    "IMU_INTEG_RATE": 200,
    "IMU_GYRO_RATEMAX": 400,
    "SDLOG_PROFILE": 1,
    "SDLOG_MODE": 0,
    "SYS_HAS_MAG": 1,
    "SYS_AUTOSTART": 0,
    "EKF2_MAG_DECL": 0.0,
    "EKF2_DECL_TYPE": 3,
}


def flown(**given: Any) -> Any:
    gains = {"angle_kp": 1.0, "yaw_angle_kp": 2.0, "rate_kp": 3.0, "rate_ki": 4.0, "rate_kd": 5.0}
    control = SimpleNamespace(**gains, yaw_rate_kp=6.0, yaw_rate_ki=7.0)
    scenario = SimpleNamespace(controller=control, loop=SimpleNamespace(rate_hz=800.0, substeps=2))
    unit = SimpleNamespace(sampling="interval", rate_hz=250.0, lowpass_hz=(20.0, 10.0))
    own = {"scenario": scenario, "imus": [unit, unit], "mags": [], "declination_deg": 12.0}
    return SimpleNamespace(**(own | given))


def test_px4s_parameters_are_the_gains_that_flew_beside_its_defaults() -> None:
    found = parameters(flown())
    values = {p.name: p.value for p in found if not p.is_default}
    defaults = {p.name: p.value for p in found if p.is_default}
    assert {name: value for name, value in PX4_DEFAULTS.items() if values[name] != value} == {
        name: value for name, value in defaults.items() if not name.startswith("CAL_")
    }
    for axis in ("ROLL", "PITCH"):
        rate = [values[f"MC_{axis}RATE_{x}"] for x in "PID"]
        assert (values[f"MC_{axis}_P"], *rate) == (1.0, 3.0, 4.0, 5.0)
    assert (values["MC_YAW_P"], values["MC_YAWRATE_P"], values["MC_YAWRATE_I"]) == (2.0, 6.0, 7.0)
    assert (values["IMU_INTEG_RATE"], values["IMU_GYRO_RATEMAX"], values["SYS_HAS_MAG"]) == (250, 800, 0)
    assert values["EKF2_MAG_DECL"] == 12.0
    assert (values["CAL_GYRO0_PRIO"], values["CAL_GYRO1_PRIO"]) == (75, 50)
    assert values["CAL_GYRO0_ID"] != values["CAL_GYRO1_ID"]
    assert not {"CAL_GYRO2_ID", "CAL_MAG0_ID", "CAL_GYRO0_XOFF"} & set(values)
    raw = SimpleNamespace(sampling="instant", rate_hz=250.0)
    values = {p.name: p.value for p in parameters(flown(imus=[raw], mags=[1])) if not p.is_default}
    assert [values[f"CAL_ACC0_{axis}OFF"] for axis in "XYZ"] == list(px4.OFFSETS["ACC"])
    assert (values["SYS_HAS_MAG"], values["CAL_MAG0_PRIO"]) == (1, 75)


def test_copters_parameters_are_the_gains_that_flew() -> None:
    values = {p.name: p.value for p in ardupilot.parameters(flown())}
    for axis in ("RLL", "PIT"):
        rate = [values[f"ATC_RAT_{axis}_{x}"] for x in "PID"]
        assert (values[f"ATC_ANG_{axis}_P"], *rate) == (1.0, 3.0, 4.0, 5.0)
    assert (values["ATC_ANG_YAW_P"], values["ATC_RAT_YAW_P"], values["ATC_RAT_YAW_I"]) == (2.0, 6.0, 7.0)
    assert (values["SCHED_LOOP_RATE"], values["SIM_RATE_HZ"]) == (800.0, 1600.0)
    assert (values["INS_GYRO_FILTER"], values["INS_ACCEL_FILTER"]) == (20.0, 10.0)
    assert values["COMPASS_DEC"] == pytest.approx(0.20943951)
    assert (values["COMPASS_ENABLE"], values["COMPASS_USE"], values["INS_RAW_LOG_OPT"]) == (0.0, 0.0, 0.0)
    assert [values[f"SERVO{k}_FUNCTION"] for k in (1, 2, 3, 4)] == [33.0, 34.0, 35.0, 36.0]
    assert (values["FRAME_CLASS"], values["FRAME_TYPE"]) == (1.0, 1.0)
    for rate, lowpass, option in ((501.0, 20.0, 5.0), (501.0, 0.0, 1.0), (500.0, 20.0, 0.0)):
        unit = SimpleNamespace(sampling="instant", rate_hz=rate, lowpass_hz=(lowpass, 0.0))
        raw = {p.name: p.value for p in ardupilot.parameters(flown(imus=[unit], mags=[1, 2]))}
        assert raw["INS_RAW_LOG_OPT"] == option
        assert bool(int(raw["LOG_BITMASK"]) & 1 << 19) == (option > 0.0)
        assert [raw[f"COMPASS_USE{n}"] for n in ("", "2", "3")] == [1.0, 1.0, 0.0]
