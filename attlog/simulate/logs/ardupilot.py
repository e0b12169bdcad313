"""A flight as ArduPilot logs one: records, parameters and texts of a DataFlash log as of Copter 4.6.

Columns, letters, units and multipliers are from the FMT and FMTU records of ArduPilot's own simulator; ESC:
libraries/AP_ESC_Telem/LogStructure.h. A unit that measures instants becomes IMU, above 500 Hz GYR and ACC with IMU at
the rate of the loop, as with LOG_BITMASK's bit 19. One that measures means becomes IMT (increments, Copter 4.0 to 4.3),
and IMU at the middle of each interval. XKF1, XKQ and XKF4 hold the estimator in the loop: attitude and gyro bias;
values that only ArduPilot's EKF has are NaN or 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.earth import TESLA_PER_MILLIGAUSS
from attlog.core.rotation import rotate_inverse, to_euler
from attlog.core.sorting import median
from attlog.flight.ardupilot.vehicle import ARMED_EVENT, DISARMED_EVENT, LANDED_EVENT, NOT_LANDED_EVENT
from attlog.flight.timestamps import GPS_EPOCH_S, LEAP_SECONDS
from attlog.formats import MessageLayout, ParamChange, Recording, Text
from attlog.formats.recording import Columns, Key
from attlog.simulate.environment import geodetic
from attlog.simulate.flight import Flight, GnssStream, ImuStream
from attlog.simulate.logs.records import (
    START_US,
    held_values,
    last_before,
    logged_samples,
    measured_rates,
    micros,
    number_modes,
    place_while_lost,
    since_start,
    texts,
    vibration,
)

# Columns behind TimeUS, their letters, units and multipliers.
RECORDS = {
    "IMU": ("I GyrX GyrY GyrZ AccX AccY AccZ EG EA T GH AH GHz AHz", "BffffffIIfBBHH", "#EEEooo--O--zz",
            "-000000-----00"),
    "IMT": ("I DelT DelvT DelaT DelAX DelAY DelAZ DelVX DelVY DelVZ", "Bfffffffff", "#sssrrrnnn", "-000000000"),
    "GYR": ("I SampleUS GyrX GyrY GyrZ", "BQfff", "#sEEE", "-F000"),
    "ACC": ("I SampleUS AccX AccY AccZ", "BQfff", "#sooo", "-F000"),
    "VIBE": ("IMU VibeX VibeY VibeZ Clip", "BfffI", "#ooo-", "-000-"),
    "MAG": ("I MagX MagY MagZ OfsX OfsY OfsZ MOX MOY MOZ Health S", "BhhhhhhhhhBI", "#GGGGGGGGG-s", "-CCCCCCCCC-F"),
    "BARO": ("I Alt AltAMSL Press Temp CRt SMS Offset GndTemp Health", "BfffcfIffB", "#mmPOnsmO-", "-000B0C?0-"),
    "GPS": ("I Status GMS GWk NSats HDop Lat Lng Alt Spd GCrs VZ Yaw U", "BBIHBcLLeffffB", "#-s-S-DUmnhnh-",
            "--C-0BGGB000--"),
    "GPA": ("I VDop HAcc VAcc SAcc YAcc VV SMS Delta Und RTCMFU RTCMFD", "BCCCCfBIHfHH", "#-mmnd-ssm--",
            "-BBBB0-CC0--"),
    "BAT": ("Inst Volt VoltR Curr CurrTot EnrgTot Temp Res RemPct H SH", "BfffffcfBBB", "#vvAaXOw%-%", "-000C0?0000"),
    "ESC": ("Instance RPM RawRPM Volt Curr Temp CTot MotTemp Err", "Bffffcfcf", "#qqvAOaO%", "-00--BCB-"),
    "ATT": ("DesRoll Roll DesPitch Pitch DesYaw Yaw AEKF", "ffffffB", "ddddhh-", "000000-"),
    "RATE": ("RDes R ROut PDes P POut YDes Y YOut ADes A AOut AOutSlew", "fffffffffffff", "kk-kk-kk-oo--",
             "?????????BB--"),
    "CTUN": ("ThI ABst ThO ThH DAlt Alt BAlt DSAlt SAlt TAlt DCRt CRt", "ffffffefffhh", "----mmmmmmnn", "----00B000BB"),
    "RCOU": ("C1 C2 C3 C4", "HHHH", "YYYY", "----"),
    "XKF1": ("C Roll Pitch Yaw VN VE VD dPD PN PE PD GX GY GZ OH", "BccCfffffffccce", "#ddhnnnnmmmkkkm",
             "-BBB0000000BBBB"),
    "XKQ": ("C Q1 Q2 Q3 Q4", "Bffff", "#????", "-????"),
    "XKF4": ("C SV SP SH SM SVT errRP OFN OFE FS TS SS GPS PI", "BcccccfffHBIHb", "#------mm-----", "-------??-----"),
    "SIM": ("Roll Pitch Yaw Alt Lat Lng Q1 Q2 Q3 Q4", "ccCfLLffff", "ddhmDU----", "BBB0GG0000"),
    "SIM2": ("PN PE PD VN VE VD As ASpdU UFC", "dddfffffI", "?????????", "?????????"),
    "MODE": ("Mode ModeNum Rsn", "MBB", "---", "---"),
    "EV": ("Id", "B", "-", "-"),
    "ARM": ("ArmState ArmChecks Forced Method", "BIBB", "----", "----"),
    "VER": ("BT BST Maj Min Pat FWT GH FWS APJ BU FV", "BHBBBBIZHBB", "-----------", "-----------"),
}

LAYOUTS = {
    name: MessageLayout("Q" + letters, "s" + units, "F" + mults) for name, (_, letters, units, mults) in RECORDS.items()
}


def message(name: str, instance: int, t_us: NDArray[np.uint64], **values: Any) -> tuple[Key, Columns]:
    """Return key and columns of a record; ``values`` are arrays or one value for all, 0 by default.

    Columns of the letters c C e E L are the printed numbers. KeyError for unknown columns.
    """
    columns: dict[str, NDArray[Any]] = {"TimeUS": t_us}
    for column in RECORDS[name][0].split():
        given = np.asarray(values.pop(column, b"" if (name, column) == ("VER", "FWS") else 0))
        columns[column] = np.ascontiguousarray(np.broadcast_to(given, t_us.shape))
    if values:
        raise KeyError(f"{name} has no column {', '.join(values)}")
    return (name, instance), columns


Array = NDArray[np.float64]
# Copter's mode numbers, the same in MODE and the heartbeat.
MODES = {"STABILIZE": 0, "ACRO": 1, "ALTCTL": 2, "ALT_HOLD": 2, "AUTO": 3, "MISSION": 3, "GUIDED": 4, "OFFBOARD": 4,
         "POSCTL": 5, "LOITER": 5, "RTL": 6, "LAND": 9, "HOLD": 17, "TAKEOFF": 4}
BANNER = "ArduCopter V4.6.0-simulated"
# A faster unit is logged in GYR and ACC.
RAW_HZ = 500.0
PWM_MIN, PWM_MAX = 1000, 2000
# Shares of the output range at no and at full thrust of an armed motor, the firmware's defaults.
SPIN_MIN, SPIN_MAX = 0.15, 0.95
# Offsets of an external compass, which its calibration subtracted.
CALIBRATED_MG = (30, -45, 20)
SLOW_HZ, VIBE_HZ, EKF_HZ = 10.0, 10.0, 10.0
_NAN = float("nan")


def dataflash_recording(flight: Flight) -> Recording:
    """Return the flight as the records of a DataFlash log."""
    flight = since_start(flight)
    messages: dict[Key, Columns] = {}
    for part in (_inertial, _sensors, _states, _onboard, _truth):
        messages |= dict(part(flight))
    messages = {key: columns for key, columns in messages.items() if len(columns["TimeUS"])}
    banner = [Text(BANNER, 6, START_US), Text("Frame: QUAD/X", 6, START_US), *texts(flight, START_US)]
    names = {name for name, _ in messages}
    layouts = {n: x for n, x in LAYOUTS.items() if n in names}
    return Recording(messages, copter_parameters(flight), banner, {}, START_US, layouts)


def _inertial(flight: Flight) -> Iterator[tuple[Key, Columns]]:
    """Return samples and vibration of every unit."""
    for imu in flight.imus:
        k, i = logged_samples(imu.t_sample, flight.scenario.logging.imu_hz), imu.instance
        instants = imu.t_sample
        if imu.sampling == "interval":
            yield _increments(imu, k)
            instants = imu.t_sample - 0.5 * imu.dt
        elif imu.rate_hz > RAW_HZ:
            for name, x in (("GYR", imu.gyro[k]), ("ACC", imu.acc[k])):
                axes = dict(zip((f"{name.title()}{axis}" for axis in "XYZ"), x.T, strict=True))
                yield message(name, i, micros(imu.t[k]), I=i, SampleUS=micros(imu.t_sample[k]), **axes)
            k = logged_samples(imu.t_sample, flight.scenario.logging.imu_hz or flight.scenario.loop.rate_hz)
        (gx, gy, gz), (ax, ay, az), rate = imu.gyro[k].T, imu.acc[k].T, round(imu.rate_hz)
        yield message("IMU", i, micros(instants[k]), I=i, GyrX=gx, GyrY=gy, GyrZ=gz, AccX=ax, AccY=ay, AccZ=az,
                      T=imu.temperature[k], GH=1, AH=1, GHz=rate, AHz=rate)
        k = logged_samples(imu.t, VIBE_HZ)
        x, y, z = vibration(imu)[k].T
        clips = np.cumsum(imu.clipped[:, 1])[k]
        yield message("VIBE", i, micros(imu.t[k]), IMU=i, VibeX=x, VibeY=y, VibeZ=z, Clip=clips)


def _increments(imu: ImuStream, k: NDArray[np.int64]) -> tuple[Key, Columns]:
    """Return IMT with increments of the stored interval: the rates come back as they were."""
    dt = imu.dt[k].astype(np.float32).astype(np.float64)
    (ax, ay, az), (vx, vy, vz) = (imu.gyro[k] * dt[:, None]).T, (imu.acc[k] * dt[:, None]).T
    return message("IMT", imu.instance, micros(imu.t_sample[k]), I=imu.instance, DelT=dt, DelvT=dt, DelaT=dt,
                   DelAX=ax, DelAY=ay, DelAZ=az, DelVX=vx, DelVY=vy, DelVZ=vz)


def _sensors(flight: Flight) -> Iterator[tuple[Key, Columns]]:
    """Return compasses, barometers, receivers, battery and rotor speeds."""
    for mag in flight.mags:
        x, y, z = (mag.field / TESLA_PER_MILLIGAUSS).T
        sampled = micros(mag.t_sample) & np.uint64(0xFFFFFFFF)
        own = CALIBRATED_MG if flight.scenario.sensors.mag[mag.instance].is_external else (0, 0, 0)
        yield message("MAG", mag.instance, micros(mag.t), I=mag.instance, MagX=x, MagY=y, MagZ=z, OfsX=own[0],
                      OfsY=own[1], OfsZ=own[2], Health=1, S=sampled)
    for baro in flight.baro:
        ground = float(median(baro.height[:10])) if len(baro.height) else 0.0
        yield message("BARO", baro.instance, micros(baro.t), I=baro.instance, Alt=baro.height - ground,
                      AltAMSL=baro.height, Press=baro.pressure, Temp=baro.temperature,
                      SMS=micros(baro.t_sample) // np.uint64(1000), GndTemp=baro.temperature[0] if len(baro.t) else 0.0,
                      Health=1)
    for gnss in flight.gnss:
        yield from _receiver(gnss)
    if flight.battery is not None:
        b, whole = flight.battery, flight.scenario.sensors.battery
        energy = np.cumsum(b.voltage * b.current * np.diff(b.t, prepend=b.t[:1])) / 3600.0
        left = np.clip(100.0 * (1.0 - b.used / whole.capacity_ah), 0.0, 100.0)
        yield message("BAT", 0, micros(b.t), Volt=b.voltage, VoltR=b.voltage + b.current * whole.resistance_ohm,
                      Curr=b.current, CurrTot=b.used * 1e3, EnrgTot=energy, Res=whole.resistance_ohm, RemPct=left, H=1)
    if flight.rpm is not None:
        for k, rpm in enumerate(flight.rpm.rpm.T):
            yield message("ESC", k, micros(flight.rpm.t), Instance=k, RPM=rpm, RawRPM=rpm)


def _receiver(gnss: GnssStream) -> Iterator[tuple[Key, Columns]]:
    """Return GPS and GPA of one receiver."""
    t, has = micros(gnss.t), gnss.fix > 0
    lat, lon, alt, vel = place_while_lost(gnss)
    week, milliseconds = gps_time(gnss.utc)
    course = np.degrees(np.arctan2(vel[:, 1], vel[:, 0])) % 360.0
    yield message("GPS", gnss.instance, t, I=gnss.instance, Status=np.where(has, gnss.fix, 1),
                  GMS=np.where(has, milliseconds, 0), GWk=np.where(has, week, 0), NSats=gnss.satellites,
                  HDop=np.where(has, 0.9, 99.99), Lat=lat, Lng=lon, Alt=alt, Spd=np.hypot(vel[:, 0], vel[:, 1]),
                  GCrs=course, VZ=vel[:, 2], U=gnss.instance == 0)
    yield message("GPA", gnss.instance, t, I=gnss.instance, VDop=np.where(has, 1.2, 99.99), HAcc=gnss.h_acc,
                  VAcc=gnss.v_acc, SAcc=gnss.s_acc, VV=has, SMS=micros(gnss.t_sample) // np.uint64(1000),
                  Delta=np.minimum(np.diff(gnss.t, prepend=gnss.t[:1]) * 1e3, 65535))


def gps_time(unix: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return GPS week (n,) and milliseconds of the week (n,) at Unix times (n,) [s]."""
    leap = np.zeros(len(unix))
    for start, seconds in LEAP_SECONDS:
        leap = np.where(unix >= start, seconds, leap)
    whole = np.rint((unix - GPS_EPOCH_S + leap) * 1e3).astype(np.int64)
    return whole // 604_800_000, whole % 604_800_000


def _states(flight: Flight) -> Iterator[tuple[Key, Columns]]:
    """Return modes, arming and events at their changes, the version once."""
    board = flight.onboard
    times, names = _unzipped(board.mode)
    numbers = np.array(number_modes(names, MODES, "ArduCopter"))
    yield message("MODE", 0, times, Mode=numbers, ModeNum=numbers, Rsn=1)
    times, armed = _unzipped(board.armed)
    states = np.array(armed, bool)
    yield message("ARM", 0, times, ArmState=states)
    events = [(t, ARMED_EVENT if value else DISARMED_EVENT) for t, value in board.armed[1:]]
    events += [(t, LANDED_EVENT if value else NOT_LANDED_EVENT) for t, value in board.landed[1:]]
    times, ids = _unzipped(sorted(events))
    yield message("EV", 0, times, Id=np.array(ids))
    start = micros(np.zeros(1))
    yield message("VER", 0, start, BT=3, Maj=4, Min=6, FWS=BANNER.encode(), BU=2, FV=2)


def _unzipped(line: list[tuple[float, Any]]) -> tuple[NDArray[np.uint64], list[Any]]:
    return micros(np.array([t for t, _ in line], np.float64)), [value for _, value in line]


def _onboard(flight: Flight) -> Iterator[tuple[Key, Columns]]:
    """Return estimates and set-points."""
    board, logging = flight.onboard, flight.scenario.logging
    if len(board.t) == 0:
        return
    k = logged_samples(board.t, logging.attitude_hz)
    t = micros(board.t[k])
    roll, pitch, yaw = _degrees(board.q[k])
    wanted = _degrees(board.q_setpoint[k]) if len(board.q_setpoint) else (_NAN, _NAN, _NAN)
    yield message("ATT", 0, t, DesRoll=wanted[0], Roll=roll, DesPitch=wanted[1], Pitch=pitch, DesYaw=wanted[2], Yaw=yaw,
                  AEKF=3)
    q = board.q[k].T
    yield message("XKQ", 0, t, Q1=q[0], Q2=q[1], Q3=q[2], Q4=q[3])
    k = logged_samples(board.t, EKF_HZ)
    t = micros(board.t[k])
    roll, pitch, yaw = _degrees(board.q[k])
    bias = np.degrees(board.bias[k]).T if len(board.bias) else np.zeros((3, len(k)))
    unknown = {name: _NAN for name in ("VN", "VE", "VD", "dPD", "PN", "PE", "PD")}
    yield message("XKF1", 0, t, Roll=_cut(roll), Pitch=_cut(pitch), Yaw=yaw, GX=_cut(bias[0]), GY=_cut(bias[1]),
                  GZ=_cut(bias[2]), **unknown)
    yield message("XKF4", 0, t, errRP=_NAN, OFN=_NAN, OFE=_NAN)
    if len(board.rate_setpoint):
        yield _rate(flight)
    if len(board.thrust_setpoint):
        k = logged_samples(board.t, SLOW_HZ)
        up = -flight.truth.p[last_before(flight.truth.t, board.t[k]), 2]
        thrust = board.thrust_setpoint[k]
        hover = flight.scenario.vehicle.hover_command(flight.gravity)
        yield message("CTUN", 0, micros(board.t[k]), ThI=thrust, ThO=thrust, ThH=hover, DAlt=_NAN, Alt=_NAN, DSAlt=_NAN,
                      BAlt=_baro_height(flight, board.t[k], up))
    if len(board.motors):
        k = logged_samples(board.t, logging.motors_hz)
        pwm = output_pwm(board.motors[k])
        yield message("RCOU", 0, micros(board.t[k]), C1=pwm[:, 0], C2=pwm[:, 1], C3=pwm[:, 2], C4=pwm[:, 3])


def output_pwm(motors: Array) -> Array:
    """Return the outputs [us] of commands, 0 to 1; a motor that is off gets the lowest."""
    share = np.where(motors > 0.0, SPIN_MIN + (SPIN_MAX - SPIN_MIN) * np.clip(motors, 0.0, 1.0), 0.0)
    return PWM_MIN + (PWM_MAX - PWM_MIN) * share


def _rate(flight: Flight) -> tuple[Key, Columns]:
    """Return wanted and measured body rates [deg/s] and the controller's output."""
    board = flight.onboard
    k = logged_samples(board.t, flight.scenario.logging.setpoint_hz)
    wanted, measured = np.degrees(board.rate_setpoint[k]).T, np.degrees(measured_rates(flight, board.t[k])).T
    out = board.torque_setpoint[k].T if len(board.torque_setpoint) else np.zeros((3, len(k)))
    thrust = board.thrust_setpoint[k] if len(board.thrust_setpoint) else 0.0
    return message("RATE", 0, micros(board.t[k]), RDes=wanted[0], R=measured[0], ROut=out[0], PDes=wanted[1],
                  P=measured[1], POut=out[1], YDes=wanted[2], Y=measured[2], YOut=out[2], AOut=thrust)


def _baro_height(flight: Flight, at: Array, otherwise: Array) -> Array:
    if not flight.baro or not len(flight.baro[0].t):
        return otherwise
    baro = flight.baro[0]
    return baro.height[last_before(baro.t, at)] - float(median(baro.height[:10]))


def _degrees(q: Array) -> tuple[Array, Array, Array]:
    """Return roll, pitch and heading (0 to 360) in degrees."""
    roll, pitch, yaw = np.degrees(to_euler(q)).T
    return roll, pitch, yaw % 360.0


def _cut(degrees: Array) -> Array:
    """Clip to what two bytes of hundredths hold."""
    return np.clip(degrees, -327.68, 327.67)


def _truth(flight: Flight) -> Iterator[tuple[Key, Columns]]:
    """Return the true motion: SIM, SIM2."""
    truth = flight.truth
    k = logged_samples(truth.t, flight.scenario.logging.truth_hz)
    t, q = micros(truth.t[k]), truth.q[k].T
    roll, pitch, yaw = _degrees(truth.q[k])
    lat, lon, alt = geodetic(flight.scenario, truth.p[k])
    yield message("SIM", 0, t, Roll=roll, Pitch=pitch, Yaw=yaw, Alt=alt, Lat=lat, Lng=lon, Q1=q[0], Q2=q[1], Q3=q[2],
                  Q4=q[3])
    (pn, pe, pd), (vn, ve, vd) = truth.p[k].T, truth.v[k].T
    through_air = rotate_inverse(truth.q[k], truth.v[k] - truth.wind[k])
    speed = np.sqrt(np.sum(through_air**2, axis=1))
    yield message("SIM2", 0, t, PN=pn, PE=pe, PD=pd, VN=vn, VE=ve, VD=vd, As=speed)


def copter_parameters(flight: Flight) -> list[ParamChange]:
    """Return Copter's parameters as far as the scenario and readers of the log need them."""
    control, loop = flight.scenario.controller, flight.scenario.loop
    imu = flight.imus[0]
    raw = imu.sampling == "instant" and imu.rate_hz > RAW_HZ
    gyro_cut, acc_cut = imu.lowpass_hz
    values: dict[str, float] = {
        "FRAME_CLASS": 1,
        "FRAME_TYPE": 1,
        "SCHED_LOOP_RATE": round(loop.rate_hz),
        "AHRS_ORIENTATION": 0,
        "AHRS_TRIM_X": 0.0,
        "AHRS_TRIM_Y": 0.0,
        "AHRS_TRIM_Z": 0.0,
        "AHRS_EKF_TYPE": 3,
        "EK3_ENABLE": 1,
        "EK3_IMU_MASK": 1,
        "COMPASS_ENABLE": int(bool(flight.mags)),
        "COMPASS_DEC": np.radians(flight.declination_deg),
        "COMPASS_AUTODEC": 0,
        "COMPASS_LEARN": 0,
        "INS_GYRO_FILTER": gyro_cut,
        "INS_ACCEL_FILTER": acc_cut,
        "INS_RAW_LOG_OPT": (1 | 4 * (gyro_cut > 0)) if raw else 0,
        "LOG_BITMASK": 176126 | 1 << 0 | 1 << 7 | (1 << 19) * raw,
        "LOG_DISARMED": 1,
        "MOT_PWM_MIN": PWM_MIN,
        "MOT_PWM_MAX": PWM_MAX,
        "MOT_SPIN_MIN": SPIN_MIN,
        "MOT_SPIN_MAX": SPIN_MAX,
        "ATC_ANG_RLL_P": control.angle_kp,
        "ATC_ANG_PIT_P": control.angle_kp,
        "ATC_ANG_YAW_P": control.yaw_angle_kp,
        "ATC_RAT_RLL_P": control.rate_kp,
        "ATC_RAT_RLL_I": control.rate_ki,
        "ATC_RAT_RLL_D": control.rate_kd,
        "ATC_RAT_PIT_P": control.rate_kp,
        "ATC_RAT_PIT_I": control.rate_ki,
        "ATC_RAT_PIT_D": control.rate_kd,
        "ATC_RAT_YAW_P": control.yaw_rate_kp,
        "ATC_RAT_YAW_I": control.yaw_rate_ki,
        "SIM_RATE_HZ": round(loop.rate_hz * loop.substeps),
    }
    values |= {f"COMPASS_USE{n or ''}": int(k < len(flight.mags)) for k, n in enumerate((0, 2, 3))}
    for k, mag in enumerate(flight.scenario.sensors.mag[:3]):
        if not mag.is_external:
            continue
        end = f"{k + 1}" if k else ""
        calibrated = {"OFS": CALIBRATED_MG, "DIA": (1.0, 1.0, 1.0), "ODI": (0.0, 0.0, 0.0)}
        for name, axes in calibrated.items():
            values |= {f"COMPASS_{name}{end}_{axis}": value for axis, value in zip("XYZ", axes, strict=True)}
        values |= {f"COMPASS_ORIENT{end}": mag.orientation, f"COMPASS_EXTERN{end}" if k else "COMPASS_EXTERNAL": 1}
    values |= {f"SERVO{k + 1}_FUNCTION": 33 + k for k in range(4)}
    return [ParamChange(name, float(value)) for name, value in sorted(values.items())]


def held_numbers(line: list[tuple[float, str]], at: Array) -> NDArray[np.int64]:
    """Return Copter's mode numbers (n,) at times ``at`` (n,) s."""
    return np.array(number_modes(held_values(line, at), MODES, "ArduCopter"), np.int64)
