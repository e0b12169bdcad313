"""Samples of a log's signals for the page: the extremes of buckets, within a budget."""

from __future__ import annotations

from typing import Literal

import numpy as np

from attlog.flight.model import FlightLog
from attlog.flight.signals import Signal, Signals
from attlog.metrics.trace import Trace, envelope

Selection = Literal["none", "standard", "all"]
# Samples of all signals; the page reduces them further where they take too many bytes.
MAX_SAMPLES = 1_000_000
# Messages of a modem, which has a number of its own.
RADIO = ("RADIO", "RADIO_STATUS")
# Messages that people look at, of all firmwares: motion, set-points, supply.
STANDARD = frozenset(
    """
    ACC AETR AHR2 ARSP ASPD ATT BARO BAR2 BAT BAT2 BCL CTUN CURR CUR2 DSF EDT2 EKF1 EKF3 EKF4 ESC ESCX FTN1 GPA GPS
    GPS2 GYR HYGR IMU IMU2 IMU3 LAND LGR MAG MAG2 MAG3 MCU MODE MOTB NKF1 NKF3 NKF4 NTUN OF PIDA PIDN PIDE PIDP PIDR
    PIDS PIDY PL PM POS POWR PSC PSCD PSCE PSCN QTUN RAD RATE RCIN RCOU RCO2 RFND RPM RSSI SIM SONR STAT STER SURF
    TECS TEMP TERR THR TUN VIBE VISO VISP WENC WIND XKF1 XKF3 XKF4 XKQ
    actuator_controls_0 actuator_controls_1 actuator_motors actuator_outputs actuator_servos airspeed
    airspeed_validated airspeed_wind battery_status cpuload differential_pressure distance_sensor ekf2_innovations
    esc_status estimator_innovation_test_ratios estimator_local_position estimator_sensor_bias estimator_status
    failsafe_flags hover_thrust_estimate input_rc landing_gear logger_status manual_control_setpoint optical_flow
    position_setpoint_triplet radio_status rc_channels rpm sensor_accel sensor_baro sensor_combined sensor_gps
    sensor_gyro sensor_mag system_power takeoff_status tecs_status telemetry_status trajectory_setpoint
    vehicle_acceleration vehicle_air_data vehicle_angular_acceleration vehicle_angular_velocity vehicle_attitude
    vehicle_attitude_setpoint vehicle_global_position vehicle_gps_position vehicle_imu_status vehicle_land_detected
    vehicle_local_position vehicle_local_position_setpoint vehicle_magnetometer vehicle_rates_setpoint
    vehicle_status vehicle_thrust_setpoint vehicle_torque_setpoint vehicle_visual_odometry wheel_encoders wind
    wind_estimate
    AHRS AHRS2 ALTITUDE ATTITUDE ATTITUDE_QUATERNION ATTITUDE_TARGET BATTERY_STATUS DISTANCE_SENSOR
    EKF_STATUS_REPORT ESC_STATUS ESC_TELEMETRY_1_TO_4 ESC_TELEMETRY_5_TO_8 ESTIMATOR_STATUS EXTENDED_SYS_STATE
    GLOBAL_POSITION_INT GPS2_RAW GPS_RAW_INT HEARTBEAT HIGHRES_IMU HWSTATUS LOCAL_POSITION_NED MANUAL_CONTROL
    MCU_STATUS MEMINFO NAV_CONTROLLER_OUTPUT OPTICAL_FLOW POSITION_TARGET_GLOBAL_INT POSITION_TARGET_LOCAL_NED
    POWER_STATUS RADIO RADIO_STATUS RANGEFINDER RAW_IMU RC_CHANNELS RC_CHANNELS_RAW RC_CHANNELS_SCALED RPM
    SCALED_IMU SCALED_IMU2 SCALED_IMU3 SCALED_PRESSURE SCALED_PRESSURE2 SCALED_PRESSURE3 SERVO_OUTPUT_RAW SYS_STATUS
    VFR_HUD VIBRATION VISION_POSITION_ESTIMATE WIND
    """.split()
)


def signal_traces(log: FlightLog, selection: Selection) -> list[Trace]:
    """Return a trace for each message of a log, with its numeric fields as columns.

    ``figure``: ``signal``, ``key``: the message as in the names of its signals. Messages that are not selected have no
    samples. Fields without any finite value are left out. Empty for ``none`` and for a log that was closed.
    """
    if selection == "none" or log.messages is None:
        return []
    signals = Signals(log)
    groups: dict[str, list[Signal]] = {}
    for signal in signals.all:
        groups.setdefault(signal.name.removesuffix(f".{signal.field}"), []).append(signal)
    everything = selection == "all" or log.format == "ros"
    chosen = {key for key, fields in groups.items() if everything or _is_standard(fields[0], signals.own)}
    keep = samples_each([field.n for key in chosen for field in groups[key]], MAX_SAMPLES)
    found = [
        _thinned(signals, key, fields, keep) if key in chosen else _named(key, fields) for key, fields in groups.items()
    ]
    signals.release()
    return [trace for trace in found if trace.columns]


def _is_standard(signal: Signal, own: int | None) -> bool:
    """Return whether the signal's message belongs to the standard ones, of the vehicle or its radio."""
    ours = own in (None, signal.instance) or signal.message in RADIO
    return ours and signal.message in STANDARD


def samples_each(counts: list[int], total: int) -> int:
    """Return the largest number of samples per signal with which ``counts`` stay within ``total``."""
    left = total
    for place, count in enumerate(sorted(counts)):
        share = left // (len(counts) - place)
        if count > share:
            return share
        left -= count
    return max(counts, default=0)


def _thinned(signals: Signals, key: str, fields: list[Signal], keep: int) -> Trace:
    """Return the fields of a message with at most ``keep`` samples each."""
    n, times, columns = 0, np.zeros(0), {}
    for signal in fields:
        t, y = signals.read(signal)
        if not np.isfinite(y).any():
            continue
        n = len(t)
        times, thinned = envelope(t, y[:, None], keep)
        columns[signal.field] = thinned[:, 0]
    signals.messages[fields[0].message, fields[0].instance].forget()
    units = {signal.field: signal.unit for signal in fields if signal.unit and signal.field in columns}
    return Trace("signal", "", times, columns, key, n / max(len(times), 1), {"records": float(n)}, units)


def _named(key: str, fields: list[Signal]) -> Trace:
    nothing = np.zeros(0)
    return Trace("signal", "", nothing, {signal.field: nothing for signal in fields}, key)
