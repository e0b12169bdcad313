"""What parameters of ArduPilot and PX4 mean, for those that attlog reads, checks or proposes.

Filters that flew describe their own. Sources of the rest: the parameter references of ardupilot.org and docs.px4.io.
"""

from __future__ import annotations

import re

# Where firmware documents all of its parameters.
REFERENCES = {
    "ArduPilot": "https://ardupilot.org/copter/docs/parameters.html",
    "PX4": "https://docs.px4.io/main/en/advanced_config/parameter_reference.html",
}
# Filters whose registry entries describe parameters of firmware.
FILTERS = {"PX4": ("px4_ekf2", "px4_q"), "ArduPilot": ("ap_ekf3", "ap_dcm")}
# Firmware, pattern of the whole name, unit, meaning.
MEANINGS: tuple[tuple[str, str, str, str], ...] = (
    ("ArduPilot", r"COMPASS_OFS[23]?_[XYZ]", "mGauss", "hard-iron offset added to the field of the compass"),
    ("ArduPilot", r"COMPASS_(DIA|ODI)[23]?_[XYZ]", "", "soft-iron matrix of the compass: diagonal, off-diagonal"),
    ("ArduPilot", r"COMPASS_SCALE[23]?", "", "factor on the field of the compass; 0 is none"),
    ("ArduPilot", r"COMPASS_MOT[23]?_[XYZ]", "mGauss", "field of the motors per ampere or at full throttle"),
    ("ArduPilot", r"COMPASS_MOTCT", "", "motor compensation: 0 off, 1 by throttle, 2 by current"),
    ("ArduPilot", r"COMPASS_ORIENT[23]?", "", "rotation of an external compass, number of ROTATION_*"),
    ("ArduPilot", r"COMPASS_EXTERN(AL|[23])?", "", "0 on the board, 1 external, 2 forced external"),
    ("ArduPilot", r"COMPASS_USE[23]?", "", "1: the heading is taken from this compass"),
    ("ArduPilot", r"COMPASS_PRIO[123]_ID", "", "device in this place of the order of compasses"),
    ("ArduPilot", r"COMPASS_DEC", "rad", "declination, positive east; COMPASS_AUTODEC 1 looks it up"),
    ("ArduPilot", r"COMPASS_AUTODEC", "", "1: declination from the map, once there is a position"),
    ("ArduPilot", r"COMPASS_LEARN", "", "offsets learnt in flight: 0 never, 2 by the EKF, 3 in flight"),
    ("ArduPilot", r"INS_ACC[23]?OFFS_[XYZ]", "m/s^2", "offset subtracted from the accelerometer"),
    ("ArduPilot", r"INS_ACC[23]?SCAL_[XYZ]", "", "factor on the accelerometer after its offset"),
    ("ArduPilot", r"INS_GYR[23]?OFFS_[XYZ]", "rad/s", "bias subtracted from the gyro, found as it starts"),
    ("ArduPilot", r"INS_GYR_CAL", "", "gyro calibration: 0 never, 1 at each start"),
    ("ArduPilot", r"INS_GYRO_FILTER|INS_ACCEL_FILTER", "Hz", "cut-off of the low-pass filter of the samples"),
    ("ArduPilot", r"INS_HNT(CH|C2)_ENABLE", "", "1: harmonic notch filter on the gyro"),
    ("ArduPilot", r"INS_HNT(CH|C2)_MODE", "", "notch follows 0 nothing, 1 throttle, 2 RPM, 3 ESC telemetry, 4 FFT"),
    ("ArduPilot", r"INS_HNT(CH|C2)_(FREQ|BW)", "Hz", "centre (at the reference) and width of the notch"),
    ("ArduPilot", r"INS_HNT(CH|C2)_REF", "", "throttle or factor at which the centre is INS_HNTCH_FREQ"),
    ("ArduPilot", r"INS_HNT(CH|C2)_HMNCS", "bits", "harmonics that get a notch: 1 first, 2 second, 4 third"),
    ("ArduPilot", r"INS_LOG_BAT_(MASK|OPT|CNT|LGIN|LGCT)", "", "batches of raw IMU samples in the log (ISBH, ISBD)"),
    (
        "ArduPilot",
        r"INS_RAW_LOG_OPT",
        "bits",
        "IMU samples at the sensor's rate in the log: 1 first, 2 all, 4 filtered, 8 both",
    ),
    ("ArduPilot", r"INS_FAST_SAMPLE", "bits", "IMUs sampled faster than 1 kHz"),
    ("ArduPilot", r"INS_TCAL[123]_ENABLE", "", "temperature calibration: 0 off, 1 on, 2 learning at the next start"),
    ("ArduPilot", r"AHRS_EKF_TYPE", "", "attitude in use: 0 DCM, 2 EKF2, 3 EKF3, 11 external"),
    ("ArduPilot", r"AHRS_ORIENTATION", "", "mounting of the autopilot, number of ROTATION_*"),
    ("ArduPilot", r"AHRS_TRIM_[XYZ]", "rad", "mounting error of the autopilot against the frame"),
    ("ArduPilot", r"EK[23]_ENABLE", "", "1: this EKF runs"),
    ("ArduPilot", r"EK[23]_IMU_MASK", "bits", "IMUs that get a lane of the EKF"),
    ("ArduPilot", r"EK3_SRC[123]_YAW", "", "heading: 0 none, 1 compass, 2 GNSS, 3 GNSS or compass, 6 external, 8 GSF"),
    (
        "ArduPilot",
        r"EK3_SRC[123]_(POS|VEL)(XY|Z)",
        "",
        "source of position or velocity: 0 none, 1 baro (height), 3 GNSS, 6 external",
    ),
    ("ArduPilot", r"EK3_AFFINITY", "bits", "a lane has sensors of its own: 1 GNSS, 2 barometer, 4 compass, 8 airspeed"),
    ("ArduPilot", r"EK2_\w+", "", "setting of EKF2, the filter before EKF3; attlog does not run it again"),
    (
        "ArduPilot",
        r"GPS[12]?_TYPE2?",
        "",
        "driver of the receiver: 0 none, 1 automatic, 9 DroneCAN, 17 and 18 moving baseline",
    ),
    (
        "ArduPilot",
        r"GPS[12]?_(POS[12]?|MB[12]?_OFS)_[XYZ]",
        "m",
        "antenna from the centre of gravity, or of a moving baseline",
    ),
    ("ArduPilot", r"GPS[12]?_DELAY_MS2?", "ms", "delay of the receiver; 0: that of its driver"),
    ("ArduPilot", r"LOG_BITMASK", "bits", "groups of messages in the log; the bits differ between vehicles"),
    (
        "ArduPilot",
        r"LOG_DISARMED",
        "",
        "log while disarmed: 0 no, 1 yes, 2 and 3 not on USB or deleted without a flight",
    ),
    ("ArduPilot", r"LOG_REPLAY", "", "1: everything that runs the EKF again"),
    ("ArduPilot", r"LOG_(FILE|MAV|BLK)_RATEMAX", "Hz", "most records a second of streaming messages; 0 all"),
    ("ArduPilot", r"SCHED_LOOP_RATE", "Hz", "rate of the main loop, and of the attitude in use"),
    ("ArduPilot", r"ARMING_CHECK|ARMING_SKIPCHK", "bits", "checks before arming: in use, or skipped (4.7 and later)"),
    (
        "ArduPilot",
        r"BATT\d?_(LOW|CRT|ARM)_VOLT",
        "V",
        "voltage of the low or critical failsafe, or least to arm; 0 none",
    ),
    (
        "ArduPilot",
        r"BATT\d?_(LOW|CRT|ARM)_MAH",
        "mAh",
        "capacity left of the low or critical failsafe, or least to arm",
    ),
    ("ArduPilot", r"BATT\d?_FS_(LOW|CRT)_ACT", "", "action of the failsafe: 0 warning only, 1 land, 2 return (copter)"),
    ("ArduPilot", r"BATT\d?_CAPACITY", "mAh", "capacity of the full battery"),
    ("ArduPilot", r"BATT\d?_MONITOR", "", "how battery voltage and current are measured; 0 not at all"),
    ("ArduPilot", r"FS_THR_ENABLE", "", "radio failsafe: 0 off, other numbers choose the action"),
    ("ArduPilot", r"FS_THR_VALUE", "us", "throttle below this means that the radio is lost"),
    ("ArduPilot", r"FS_GCS_ENABLE", "", "failsafe without heartbeat of the ground station; 0 off"),
    ("ArduPilot", r"FS_EKF_ACTION", "", "action of the EKF failsafe: 0 report, 1 land, 2 alt-hold, 3 land always"),
    ("ArduPilot", r"FS_EKF_THRESH", "", "test ratio of compass and velocity above which the EKF has failed"),
    ("ArduPilot", r"FS_CRASH_CHECK", "", "1: motors stop after a crash was detected"),
    ("ArduPilot", r"FS_VIBE_ENABLE", "", "1: the height holds on without accelerometer in strong vibration"),
    ("ArduPilot", r"MOT_THST_HOVER", "", "throttle in hover, learnt where MOT_HOVER_LEARN is 1 or 2"),
    ("ArduPilot", r"MOT_THST_EXPO", "", "curvature of thrust over throttle: 0 linear, 1 square"),
    ("ArduPilot", r"MOT_SPIN_(ARM|MIN|MAX)", "", "output of motors armed, least and largest in flight, 0 to 1"),
    ("ArduPilot", r"MOT_BAT_VOLT_(MAX|MIN)", "V", "voltages between which thrust is kept constant"),
    ("ArduPilot", r"FRAME_CLASS", "", "frame: 1 quad, 2 hexa, 3 octa, 4 octa quad, 5 Y6, 6 helicopter, 7 tri"),
    ("ArduPilot", r"FRAME_TYPE", "", "arrangement of motors: 0 plus, 1 X, 2 V, 3 H"),
    ("ArduPilot", r"ATC_RAT_(RLL|PIT|YAW)_[PID]", "", "gain of the rate controller"),
    (
        "ArduPilot",
        r"ATC_RAT_(RLL|PIT|YAW)_FLT[TED]",
        "Hz",
        "low-pass of target, error or derivative of the rate controller",
    ),
    ("ArduPilot", r"ATC_ANG_(RLL|PIT|YAW)_P", "1/s", "gain of the angle controller"),
    ("ArduPilot", r"ATC_THR_MIX_(MAN|MIN|MAX)", "", "how far attitude wins over throttle where motors saturate"),
    ("PX4", r"CAL_MAG\d_[XYZ]OFF", "gauss", "hard-iron offset subtracted from the magnetometer"),
    ("PX4", r"CAL_MAG\d_[XYZ](SCALE|ODIAG)", "", "soft-iron matrix of the magnetometer"),
    ("PX4", r"CAL_MAG\d_[XYZ]COMP", "gauss", "field of the motors per kA of current, or at full thrust"),
    ("PX4", r"CAL_MAG_COMP_TYP", "", "motor compensation: 0 off, 1 thrust, 2 and 3 current of battery 0, 1"),
    ("PX4", r"CAL_MAG\d_ROT", "", "rotation of an external magnetometer; -1: on the board"),
    ("PX4", r"CAL_(MAG|ACC|GYRO)\d_PRIO", "", "priority of the sensor: 0 disabled, 50 default, 100 first"),
    ("PX4", r"CAL_ACC\d_[XYZ]OFF", "m/s^2", "offset subtracted from the accelerometer"),
    ("PX4", r"CAL_ACC\d_[XYZ]SCALE", "", "factor on the accelerometer after its offset"),
    ("PX4", r"CAL_GYRO\d_[XYZ]OFF", "rad/s", "bias subtracted from the gyro"),
    ("PX4", r"SENS_BOARD_ROT", "", "mounting of the autopilot, number of ROTATION_*"),
    ("PX4", r"SENS_BOARD_[XYZ]_OFF", "deg", "mounting error of the autopilot after SENS_BOARD_ROT"),
    ("PX4", r"SENS_GPS\d_DELAY", "ms", "delay of this receiver against the IMU"),
    (
        "PX4",
        r"IMU_(GYRO|ACCEL|DGYRO)_CUTOFF",
        "Hz",
        "cut-off of the low-pass on gyro, accelerometer, or angular acceleration",
    ),
    ("PX4", r"IMU_GYRO_NF\d?_(FRQ|FREQ|BW)", "Hz", "centre or width of a fixed notch on the gyro; 0 off"),
    ("PX4", r"IMU_GYRO_DNF_EN", "bits", "dynamic notch: 1 by ESC speeds, 2 by FFT"),
    ("PX4", r"IMU_GYRO_DNF_BW", "Hz", "width of the dynamic notch"),
    ("PX4", r"IMU_GYRO_RATEMAX", "Hz", "highest rate of the gyro for control"),
    ("PX4", r"IMU_INTEG_RATE", "Hz", "rate at which IMU samples are integrated for the estimator"),
    ("PX4", r"EKF2_EN", "", "1: EKF2 runs"),
    ("PX4", r"EKF2_MULTI_(IMU|MAG)", "", "number of IMUs or magnetometers with an EKF each"),
    ("PX4", r"EKF2_IMU_POS_[XYZ]", "m", "IMU from the centre of the body"),
    ("PX4", r"EKF2_(OF|RNG|EV)_(CTRL|DELAY)", "", "optical flow, rangefinder or vision: in use, or its delay in ms"),
    ("PX4", r"EKF2_GPS_CHECK", "bits", "checks before GNSS is used"),
    (
        "PX4",
        r"SYS_MC_EST_GROUP",
        "",
        "estimator of older versions: 1 local position and attitude Q, 2 EKF2, 3 attitude Q alone",
    ),
    ("PX4", r"SYS_HAS_(MAG|BARO|GPS)", "", "sensors that the vehicle must have; 0 none"),
    (
        "PX4",
        r"SDLOG_PROFILE",
        "bits",
        "topics in the log: 1 default, 2 estimator replay, 4 thermal, 16 high rate, 32 debug, 64 all sensors",
    ),
    ("PX4", r"SDLOG_MODE", "", "log from: -1 never, 0 arming to disarming, 1 boot to disarming, 2 boot to shutdown"),
    ("PX4", r"BAT_(LOW|CRIT|EMERGEN)_THR", "", "charge left, 0 to 1, of the warning, failsafe or emergency"),
    ("PX4", r"COM_LOW_BAT_ACT", "", "low battery: 0 warning, 2 land, 3 return at critical and land at emergency level"),
    ("PX4", r"BAT\d?_N_CELLS", "", "cells of the battery in series"),
    ("PX4", r"BAT\d?_CAPACITY", "mAh", "capacity of the full battery; -1 unknown"),
    ("PX4", r"COM_RC_LOSS_T", "s", "time without radio until it counts as lost"),
    (
        "PX4",
        r"NAV_(RCL|DLL)_ACT",
        "",
        "action without radio or data link: 0 none, 1 hold, 2 return, 3 land, 5 terminate, 6 disarm",
    ),
    ("PX4", r"CBRK_\w+", "", "a safety check that is off where it holds its special number"),
    ("PX4", r"MPC_THR_HOVER", "", "thrust in hover, where MPC_USE_HTE is 0 or nothing was learnt"),
    ("PX4", r"MC_(ROLL|PITCH|YAW)RATE_[PIDK]", "", "gain of the rate controller"),
    ("PX4", r"MC_(ROLL|PITCH|YAW)_P", "1/s", "gain of the angle controller"),
    ("PX4", r"CA_ROTOR\d+_P[XYZ]", "m", "place of a rotor from the centre of gravity"),
    ("PX4", r"CA_ROTOR\d+_KM", "", "moment of a rotor; its sign is the direction of rotation"),
)


def meaning(name: str, firmware: str = "") -> dict[str, str] | None:
    """Return firmware, unit, meaning and reference page of a parameter, None for one that attlog does not know.

    ``firmware``: that of the log, empty for either.
    """
    for known, page in REFERENCES.items():
        if firmware in ("", known) and (found := _meaning(name, known)) is not None:
            unit, text = found
            return {"of": known, "unit": unit or "none", "meaning": text, "reference": page}
    return None


def _meaning(name: str, firmware: str) -> tuple[str, str] | None:
    from attlog import estimators

    for estimator in FILTERS[firmware]:
        for parameter in estimators.parse(estimator).estimator.parameters:
            if parameter.name == name and re.fullmatch(r"[A-Z][A-Z0-9_]+", name):
                return parameter.unit, parameter.meaning
    rows = (row for row in MEANINGS if row[0] == firmware and re.fullmatch(row[1], name))
    return next(((unit, text) for _, _, unit, text in rows), None)
