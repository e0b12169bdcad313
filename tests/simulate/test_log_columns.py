"""What the columns of simulated logs hold, in their units: a flight of random numbers, formulas beside it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.simulate.flight import BaroStream, BatteryStream, GnssStream, ImuStream, Onboard, RpmStream
from attlog.simulate.logs import ardupilot, mavlink, px4, records
from attlog.simulate.logs.px4 import px4_parameters

N = 40
T = 0.1 * np.arange(N)
RNG = np.random.default_rng(8)
TURNS = Rotation.random(N, RNG)
LATE_TURNS = Rotation.random(N, RNG)
Q, Q_WANTED = np.roll(TURNS.as_quat(), 1, axis=1), np.roll(LATE_TURNS.as_quat(), 1, axis=1)


def x(*shape: int) -> np.ndarray:
    return RNG.normal(size=(N, *shape))


def onboard() -> Onboard:
    return Onboard(T, Q, 0.1 * x(3), Q_WANTED, x(3), RNG.uniform(0, 1, N), x(3), RNG.uniform(0, 1, (N, 4)))


def imu(sampling: Any = "instant", rate: float = 10.0) -> ImuStream:
    n = round((N - 1) * 0.1 * rate) + 1
    t = np.arange(n) / rate
    gyro, acc = RNG.normal(size=(n, 3)), RNG.normal(size=(n, 3))
    dt = RNG.uniform(0.5, 1.0, n) / rate
    return ImuStream(1, sampling, rate, (0, 0), t, t, dt, gyro, acc, 20.0 + t, np.ones((n, 2), int), gyro, acc)


def gnss() -> GnssStream:
    fix = np.full(N, 3)
    fix[:5] = fix[20:25] = 0
    return GnssStream(
        0, 10.0, T, T - 0.03, 47.0 + x(), 8.0 + x(), 500.0 + x(), x(3), 10.0 * x(3), np.abs(x()), np.abs(x()),
        np.abs(x()), fix, np.arange(N) % 15, 1.7e9 + T,
    )  # fmt: skip


def flight(**given: Any) -> Any:
    scenario = SimpleNamespace(
        logging=SimpleNamespace(imu_hz=0, setpoint_hz=0, attitude_hz=0, motors_hz=0, truth_hz=0),
        place=SimpleNamespace(alt_m=480.0, unix_time=1.7e9),
        sensors=SimpleNamespace(battery=SimpleNamespace(capacity_ah=5.0, resistance_ohm=0.02)),
        vehicle=SimpleNamespace(hover_command=lambda gravity: 0.05 * gravity, arm_m=0.3),
        loop=SimpleNamespace(rate_hz=400.0),
    )
    truth = SimpleNamespace(t=T, q=Q, w=x(3), p=10.0 * x(3), v=x(3), a=x(3), wind=x(3))
    own: dict[str, Any] = {"scenario": scenario, "truth": truth, "imus": [imu()], "mags": [], "gnss": [], "baro": []}
    own |= {"onboard": onboard(), "battery": None, "rpm": None, "gravity": 9.8, "seconds": T[-1]}
    return SimpleNamespace(**(own | given))


def packets(part: Any, of: Any) -> dict[str, Any]:
    return {name: columns for name, _, columns in part(of)}


def degrees(turns: Rotation) -> np.ndarray:
    """Roll, pitch, heading (3, n)."""
    return turns.as_euler("ZYX", degrees=True)[:, ::-1].T


def test_a_dataflash_log_holds_angles_biases_heights_and_motors_of_the_vehicle_itself() -> None:
    baro = BaroStream(0, 10.0, T, T, 1e5 + x(), 500.0 + np.arange(N) ** 1.5, 20.0 + T)
    of = flight(baro=[baro])
    found = {name: columns for (name, _), columns in ardupilot._onboard(of)}
    (roll, pitch, yaw), wanted = degrees(TURNS), degrees(LATE_TURNS)
    att, board = found["ATT"], of.onboard
    assert (att["Roll"], att["Pitch"], att["Yaw"]) == (
        pytest.approx(roll),
        pytest.approx(pitch),
        pytest.approx(yaw % 360.0),
    )
    assert att["DesRoll"] == pytest.approx(wanted[0])
    assert att["DesPitch"] == pytest.approx(wanted[1])
    assert att["DesYaw"] == pytest.approx(wanted[2] % 360.0)
    for k, axis in enumerate("XYZ"):
        assert found["XKF1"][f"G{axis}"] == pytest.approx(np.degrees(board.bias[:, k]))
    for k in range(4):
        assert found["RCOU"][f"C{k + 1}"] == pytest.approx(1150.0 + 800.0 * board.motors[:, k])
        assert found["XKQ"][f"Q{k + 1}"] == pytest.approx(Q[:, k])
    assert found["CTUN"]["BAlt"] == pytest.approx(baro.height - np.median(baro.height[:10]))
    assert np.unique(found["CTUN"]["ThH"]) == pytest.approx([0.49])
    assert ardupilot._cut(np.array([-400.0, 400.0, 5.0])).tolist() == [-327.68, 327.67, 5.0]
    without = {name: columns for (name, _), columns in ardupilot._onboard(flight(truth=of.truth, onboard=board))}
    assert without["CTUN"]["BAlt"] == pytest.approx(-of.truth.p[:, 2])


def test_battery_energy_charge_and_what_is_left_are_sums_of_the_current() -> None:
    battery = BatteryStream(T, 12.0 + x(), 20.0 + x(), 0.15 * np.arange(N))
    rpm = RpmStream(T, 5000.0 + x(4))
    found = {key: columns for key, columns in ardupilot._sensors(flight(battery=battery, rpm=rpm))}
    bat = found["BAT", 0]
    assert bat["EnrgTot"] == pytest.approx(np.cumsum(battery.voltage * battery.current * np.r_[0, np.diff(T)]) / 3600.0)
    assert bat["VoltR"] == pytest.approx(battery.voltage + 0.02 * battery.current)
    assert bat["CurrTot"] == pytest.approx(1e3 * battery.used)
    assert bat["RemPct"] == pytest.approx(np.maximum(100.0 - 20.0 * battery.used, 0.0))
    assert [np.asarray(found["ESC", k]["RPM"])[7] for k in range(4)] == pytest.approx(rpm.rpm[7])
    status = packets(mavlink._slow, flight(battery=battery, rpm=rpm))["SYS_STATUS"]
    k = np.arange(0, N, 2)
    assert status["voltage_battery"] == pytest.approx(1e3 * battery.voltage[k])
    assert status["current_battery"] == pytest.approx(1e2 * battery.current[k])
    assert status["battery_remaining"] == pytest.approx(np.maximum(100.0 - 20.0 * battery.used[k], 0.0))


def test_receivers_send_course_and_speed_over_ground_and_while_lost_the_last_place() -> None:
    of = gnss()
    has = of.fix > 0
    last = np.array([max([i for i in range(k + 1) if has[i]], default=-1) for k in range(N)])
    lat = np.where(last < 0, 0.0, of.lat[last])
    course = np.degrees(np.arctan2(of.vel[:, 1], of.vel[:, 0])) % 360.0
    speed = np.hypot(of.vel[:, 0], of.vel[:, 1])
    (_, gps), (_, gpa) = ardupilot._receiver(of)
    assert gps["Lat"] == pytest.approx(lat)
    assert gps["Spd"] == pytest.approx(np.where(has, speed, 0.0))
    assert np.asarray(gps["GCrs"])[has] == pytest.approx(course[has])
    assert gps["VZ"] == pytest.approx(np.where(has, of.vel[:, 2], 0.0))
    assert np.asarray(gps["Status"]).tolist() == np.where(has, 3, 1).tolist()
    assert gps["HDop"] == pytest.approx(np.where(has, 0.9, 99.99))
    assert gpa["VDop"] == pytest.approx(np.where(has, 1.2, 99.99))
    assert gpa["Delta"] == pytest.approx(np.r_[0.0, np.full(N - 1, 100.0)])
    assert (gpa["HAcc"], gpa["VAcc"], gpa["SAcc"]) == tuple(pytest.approx(v) for v in (of.h_acc, of.v_acc, of.s_acc))
    sent = packets(mavlink._receivers, flight(gnss=[of, of]))
    raw = sent["GPS_RAW_INT"]
    assert raw["lat"] == pytest.approx(1e7 * lat)
    assert raw["vel"] == pytest.approx(np.where(has, 100.0 * speed, 65535))
    assert raw["cog"] == pytest.approx(np.where(has, np.rint(100.0 * course) % 36000, 65535))
    assert raw["eph"].tolist() == np.where(has, 90, 65535).tolist()
    assert raw["epv"].tolist() == np.where(has, 120, 65535).tolist()
    assert raw["fix_type"].tolist() == np.where(has, 3, 1).tolist()
    assert (raw["h_acc"], raw["v_acc"], raw["vel_acc"]) == tuple(
        pytest.approx(1e3 * v) for v in (of.h_acc, of.v_acc, of.s_acc)
    )
    assert not {"eph", "epv"} & set(sent["GPS2_RAW"])
    place = sent["GLOBAL_POSITION_INT"]
    assert place["relative_alt"] == pytest.approx(1e3 * (of.alt[has] - 480.0))
    assert (place["vx"], place["vy"], place["vz"]) == tuple(pytest.approx(100.0 * v) for v in of.vel[has].T)
    assert place["hdg"] == pytest.approx(np.rint(100.0 * (degrees(TURNS)[2][has] % 360.0)) % 36000)


def test_a_link_sends_attitudes_at_25_and_10_hz_and_what_the_pilot_sees_at_5() -> None:
    of = flight()
    sent, board = packets(mavlink._onboard, of), of.onboard
    roll, pitch, yaw = np.radians(degrees(TURNS))
    angles = sent["ATTITUDE"]
    assert (angles["roll"], angles["pitch"], angles["yaw"]) == tuple(pytest.approx(v) for v in (roll, pitch, yaw))
    rates = (of.imus[0].gyro - board.bias).T
    for name in ("ATTITUDE", "ATTITUDE_QUATERNION"):
        for k, speed in enumerate(("rollspeed", "pitchspeed", "yawspeed")):
            assert sent[name][speed] == pytest.approx(rates[k])
    assert sent["ATTITUDE"]["time_boot_ms"].tolist() == [5000 + 100 * k for k in range(N)]
    for k, axis in enumerate(("roll", "pitch", "yaw")):
        assert sent["ATTITUDE_TARGET"][f"body_{axis}_rate"] == pytest.approx(board.rate_setpoint[:, k])
    assert sent["ATTITUDE_TARGET"]["thrust"] == pytest.approx(board.thrust_setpoint)
    seen, k = packets(mavlink._slow, of)["VFR_HUD"], np.arange(0, N, 2)
    assert seen["groundspeed"] == pytest.approx(np.hypot(of.truth.v[k, 0], of.truth.v[k, 1]))
    assert seen["climb"] == pytest.approx(-of.truth.v[k, 2])
    assert seen["alt"] == pytest.approx(480.0 - of.truth.p[k, 2])
    assert seen["throttle"] == pytest.approx(100.0 * board.thrust_setpoint[k])
    assert seen["heading"] == pytest.approx(np.rint(np.degrees(yaw[k])) % 360.0)
    many = np.arange(0.0, 1.0, 0.005)
    assert [len(records.logged_samples(many, hz)) for hz in (50.0, 25.0, 10.0, 5.0, 1.0, 0.0)] == [
        50,
        25,
        10,
        5,
        1,
        200,
    ]


# Numbers that firmwares give to modes, and their defaults of parameters, in simulated logs.

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
    assert px4.TESLA_PER_GAUSS == 1e-4


def flown(**given: Any) -> Any:
    gains = {"angle_kp": 1.0, "yaw_angle_kp": 2.0, "rate_kp": 3.0, "rate_ki": 4.0, "rate_kd": 5.0}
    control = SimpleNamespace(**gains, yaw_rate_kp=6.0, yaw_rate_ki=7.0)
    loop, vehicle = SimpleNamespace(rate_hz=800.0, substeps=2), SimpleNamespace(arm_m=0.2)
    compass = SimpleNamespace(is_external=False)
    sensors = SimpleNamespace(mag=[compass, compass])
    scenario = SimpleNamespace(controller=control, loop=loop, vehicle=vehicle, sensors=sensors)
    unit = SimpleNamespace(sampling="interval", rate_hz=250.0, lowpass_hz=(20.0, 10.0))
    own = {"scenario": scenario, "imus": [unit, unit], "mags": [], "declination_deg": 12.0}
    return SimpleNamespace(**(own | given))


def test_px4s_parameters_are_the_gains_that_flew_beside_its_defaults() -> None:
    found = px4_parameters(flown())
    values = {p.name: p.value for p in found if not p.is_default}
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
    values = {p.name: p.value for p in px4_parameters(flown(imus=[raw], mags=[1])) if not p.is_default}
    assert [values[f"CAL_ACC0_{axis}OFF"] for axis in "XYZ"] == list(px4.OFFSETS["ACC"])
    assert (values["SYS_HAS_MAG"], values["CAL_MAG0_PRIO"]) == (1, 75)


def test_copters_parameters_are_the_gains_that_flew() -> None:
    values = {p.name: p.value for p in ardupilot.copter_parameters(flown())}
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
        raw = {p.name: p.value for p in ardupilot.copter_parameters(flown(imus=[unit], mags=[1, 2]))}
        assert raw["INS_RAW_LOG_OPT"] == option
        assert bool(int(raw["LOG_BITMASK"]) & 1 << 19) == (option > 0.0)
        assert [raw[f"COMPASS_USE{n}"] for n in ("", "2", "3")] == [1.0, 1.0, 0.0]
