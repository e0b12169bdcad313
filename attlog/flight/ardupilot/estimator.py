"""Read the attitudes of ArduPilot logs and the states of its EKF.

AHRS_TRIM is removed from ATT, ANG, AHR2 and the Euler records of the EKFs (EKF1, NKF1, XKF1), but not from the
quaternion records NKQ and XKQ (NavEKF3_core::getEulerAngles, and measured on a log with 0.96 deg of trim).

GX, GY, GZ of XKF1 and NKF1 are deg/s in body axes (ArduPilot's list of log messages; FMTU since 3.6), to be subtracted;
IMU, GYR, IMT and RISI are logged before. EKF1 is left out: commit ac2e5f6 (October 2014) changed its unit from deg/min
to deg/s under the same format.

SV, SP, SH, SM and SVT of XKF4 and NKF4, and of EKF4 before Copter 3.4, are the roots of the test ratios in hundredths;
the format's scale takes these out ("c" in the FMT record). Above 1 the EKF rejects.

XKY0 and NKY0 (EKF-GSF, #13603 of 2020, written while velocities are fused) hold the heading from true north by GNSS
motion, YC, and its sigma, YCS. Both are radians before 4.3. Since (#20546, April 2022) YC is degrees 0 to 360, and YCS,
though labelled deg, is sqrt(degrees(variance)) of a variance in rad^2: the estimator starts at 2 pi / sqrt(10) rad,
which is 114 deg, and such logs start at 15.04.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from attlog.core import rotation
from attlog.core.sorting import median
from attlog.flight import limits
from attlog.flight.ardupilot.imu import DataflashBuilder, primary_core, unit_of_core
from attlog.flight.builder import angle_step_deg, columns, from_euler
from attlog.flight.imu import longest_held
from attlog.flight.model import Array, Attitude, InnovationTest, Stream, TimeLine, covered_seconds
from attlog.formats.table import Messages, Table

# EV id of a yaw reset.
YAW_RESET_EVENT = 62
# ANG replaces ATT where it covers at least this share of its time.
MIN_ANG_SHARE = 0.95
QUATERNION_COLUMNS = ("Q1", "Q2", "Q3", "Q4")
EULER_COLUMNS = ("Roll", "Pitch", "Yaw")
POSE_COLUMNS = ("R", "P", "Y")
SETPOINT_COLUMNS = ("DesRoll", "DesPitch", "DesYaw")
# Parts of messages that report a step of the attitude.
RESET_WORDS = ("yaw align", "yaw reset", "lane switch", "in-flight yaw", "emergency yaw")


# --- attitudes --------------------------------------------------------------------------------------------------


def attitudes(builder: DataflashBuilder) -> dict[str, Attitude]:
    """Return every attitude of the log by its name in the comparison (``ATT``, ``XKQ.1``, ...)."""
    resets = builder.read_optional("Resets", partial(reset_times, builder), [])
    found: dict[str, Attitude] = {}
    for name, table, trimmed in attitude_tables(builder.messages):
        followed = resets if name in ("ATT", "ANG") or name.startswith(("XK", "NK", "EKF")) else []
        attitude = builder.read_optional(name, partial(read_attitude, builder, table, name, trimmed, followed), None)
        if attitude is not None:
            found[name] = attitude
    return found


def attitude_tables(messages: Messages) -> Iterator[tuple[str, Table, bool]]:
    """Yield name, table and whether AHRS_TRIM is removed, for every attitude record.

    Old names such as NKQ2 and XKF6 become cores of their family. XKF1 and NKF1 repeat the quaternion record rounded to
    0.01 deg, and are used only for cores without one.
    """
    for name in ("ANG", "ATT", "AHR2", "DCM", "EKF1"):
        table = messages.first(name)
        if table is not None:
            yield name, table, True
    for family in ("XK", "NK"):
        quaternion: dict[int, Table] = {i: messages[f"{family}Q", i] for i in messages.instances(f"{family}Q")}
        euler: dict[int, Table] = {i: messages[f"{family}F1", i] for i in messages.instances(f"{family}F1")}
        for core, (q_name, e_name) in enumerate(((f"{family}Q1", ""), (f"{family}Q2", f"{family}F6"))):
            for place, name in ((quaternion, q_name), (euler, e_name)):
                table = messages.first(name) if name else None
                if table is not None:
                    place.setdefault(core, table)
        for core, table in sorted(quaternion.items()):
            yield f"{family}Q.{core}", table, False
        for core, table in sorted(euler.items()):
            if core not in quaternion:
                yield f"{family}F1.{core}", table, True


def read_attitude(
    builder: DataflashBuilder, table: Table, name: str, trimmed: bool, resets_us: list[int]
) -> Attitude | None:
    """Read the attitude of a table: its quaternion, else its Euler angles in degrees."""
    t = builder.clock.of_samples(table)
    if t is None:
        return None
    step = 0.0
    if all(c in table for c in QUATERNION_COLUMNS):
        q = columns(table, *QUATERNION_COLUMNS)
    elif all(c in table for c in EULER_COLUMNS):
        q, step = from_euler_deg(columns(table, *EULER_COLUMNS))
    else:
        return None
    return builder.attitude(t, q, name, reset_times_us=resets_us, has_trim=trimmed, step_deg=step)


def from_euler_deg(angles: Array) -> tuple[Array, float]:
    """Return quaternions (n, 4) of Euler angles in degrees, NaN if impossible, and the angles' quantisation."""
    q = from_euler(np.radians(angles), math.radians(limits.EULER_DEG.high))
    return q, angle_step_deg(angles[rotation.finite_rows(q)][:, :2].ravel())


def reset_times(builder: DataflashBuilder) -> list[int]:
    """Return boot times in us of lane switches, yaw resets and changes from DCM to EKF; report lane switches."""
    messages = builder.messages
    _, lane_t, lanes = primary_core(builder)
    times = [int(lane_t[k]) for k in range(1, len(lanes)) if lanes[k] != lanes[k - 1]]
    if times:
        often = "once" if len(times) == 1 else f"{len(times)} times"
        text = f"The EKF switched its primary lane {often}, first from {lanes[0]}; the attitude steps there."
        builder.problem("lane_switch", "warning", text, count=len(times))
    events = messages.first("EV")
    if events is not None and "Id" in events:
        times += builder.stamps(events)[events["Id"].astype(np.int64) == YAW_RESET_EVENT].tolist()
    att = messages.first("ATT")
    if att is not None and "AEKF" in att:
        times += builder.stamps(att)[1:][np.diff(att["AEKF"].astype(np.int64)) != 0].tolist()
    times += [x.t_us for x in messages.texts if x.t_us is not None and any(w in x.text.lower() for w in RESET_WORDS)]
    return sorted(times)


def simulated_attitude(builder: DataflashBuilder) -> Attitude | None:
    """Return the simulator's attitude (SIM): its quaternion, else its angles in steps of 0.01 deg."""
    table = builder.sampled("SIM")
    return None if table is None else read_attitude(builder, table, "SIM", False, [])


def vision_poses(builder: DataflashBuilder) -> dict[str, Attitude]:
    """Return the attitude of vision or motion capture (VISP, degrees), without ignored records (Ign).

    The time of measurement is CTimeMS, as on board.
    """
    table = builder.sampled("VISP", *POSE_COLUMNS)
    if table is None:
        return {}
    used = table["Ign"].astype(np.int64) == 0 if "Ign" in table else np.ones(len(table), bool)
    q, step = from_euler_deg(columns(table, *POSE_COLUMNS))
    sampled = 1000 * table["CTimeMS"].astype(np.int64)[used] if "CTimeMS" in table else None
    counter = table["Rst"][used] if "Rst" in table else None
    t = builder.stamps(table)[used]
    found = builder.attitude(t, q[used], "VISP", t_sample_us=sampled, counter=counter, step_deg=step)
    return {} if found is None else {"VISP": found}


def attitude_setpoint(builder: DataflashBuilder) -> Attitude | None:
    """Return the attitude set-point from ATT if that flew, else from ANG or ATT."""
    for name in ("ATT", "ANG") if builder.log.onboard == "ATT" else ("ANG", "ATT"):
        table = builder.sampled(name, *SETPOINT_COLUMNS)
        if table is None:
            continue
        q, step = from_euler_deg(columns(table, *SETPOINT_COLUMNS))
        good = rotation.finite_rows(q)
        own = builder.quiet()  # stamps are reported with the attitude
        found = own.attitude(builder.stamps(table)[good], q[good], f"{name}.Des", has_trim=True, step_deg=step)
        builder.add_value_problems(own)
        return found
    return None


def onboard_source(found: dict[str, Attitude], family: str, core: int | None) -> str | None:
    """Return the name of the attitude that flew: ANG, ATT, quaternion of the primary core, AHR2, in this order.

    ANG is ATT at loop rate, but a VTOL logs it in hover modes only. It is chosen if it covers MIN_ANG_SHARE of ATT's
    time without pauses and has at least as many records.
    """
    names = ["ANG", "ATT", f"{family}Q.{core or 0}", f"{family}F1.{core or 0}", "EKF1", "AHR2", "DCM"]
    have = [n for n in names if n in found]
    if have[:2] == ["ANG", "ATT"]:
        ang, att = found["ANG"].t, found["ATT"].t
        if len(ang) < len(att) or covered_seconds(ang) < MIN_ANG_SHARE * covered_seconds(att):
            return "ATT"
    return have[0] if have else None


# --- states of the EKF ------------------------------------------------------------------------------------------

GYRO_BIAS_COLUMNS, ACC_BIAS_COLUMNS = ("GX", "GY", "GZ"), ("AX", "AY", "AZ")
# EKF families that may have flown, by AHRS_EKF_TYPE (None: not logged); none with any other value.
EKF_FAMILIES = {None: ("XK", "NK"), 2.0: ("NK",), 3.0: ("XK",)}
TEST_RATIO_COLUMNS = {"SM": "compass", "SV": "velocity", "SP": "position", "SH": "height", "SVT": "airspeed"}
# Test ratios of the compass by axis in EKF4.
COMPASS_AXIS_COLUMNS = ("SMX", "SMY", "SMZ")
# GSF_YAW_ACCURACY_THRESHOLD_DEG of both EKFs.
MAX_YAW_SIGMA_RAD = math.radians(15.0)
# Just above ``sqrt(degrees(variance))`` at the start of the estimator (15.04); a larger ``YCS`` is in degrees.
MAX_YAW_SIGMA_ROOT = 15.1


def gyro_bias_stream(builder: DataflashBuilder) -> Stream | None:
    """Return the onboard bias (n, 3) rad/s to subtract from the replayed gyro, None if not logged.

    Among the cores on the replayed unit, the one that was primary longest is preferred.
    """
    imu, ekf = builder.log.replay_imu, builder.values.get("AHRS_EKF_TYPE")
    family, t_us, lanes = primary_core(builder)
    allowed = EKF_FAMILIES.get(ekf, ())
    family = family or next((f for f in allowed if builder.messages.instances(f"{f}F1")), "")
    if imu is None or family not in allowed:
        return None
    first = longest_held(t_us, lanes) or 0
    found = bias_tables(builder, family)
    for core in sorted(found, key=lambda c: (c != first, c)):
        if unit_of_core(builder, family, core, list(found)) == imu.index:
            bias, source = np.radians(columns(found[core], *GYRO_BIAS_COLUMNS)), f"{found[core].name}:{core}"
            stamps, within = builder.stamps(found[core]), limits.GYRO_BIAS
            return builder.stream(stamps, bias, "rad/s", source, frame="FRD", within=within)
    return None


def bias_tables(builder: DataflashBuilder, family: str) -> dict[int, Table]:
    """Return the tables with gyro biases by core; before 4.0 the second core wrote NKF6 or XKF6."""
    found = builder.units(f"{family}F1")
    second = builder.messages.first(f"{family}F6")
    if second is not None:
        found.setdefault(1, second)
    return {core: table for core, table in found.items() if all(c in table for c in GYRO_BIAS_COLUMNS)}


def acc_bias_stream(builder: DataflashBuilder) -> Stream | None:
    """Return EKF3's accelerometer bias (n, 3) in m/s^2, by the primary core where that runs on the replayed unit.

    None where no core does.
    """
    status, imu, tables = builder.messages.first("XKF4"), builder.log.replay_imu, builder.units("XKF2")
    first = int(median(status["PI"])) if status is not None and "PI" in status and len(status) else 0
    for core in sorted(tables, key=lambda c: (c != first, c)):
        if imu is None or unit_of_core(builder, "XK", core, list(tables)) == imu.index:
            return builder.column_stream(tables[core], ACC_BIAS_COLUMNS, "m/s^2", "XKF2", limits.ACC_BIAS, frame="FRD")
    return None


def innovation_tests(builder: DataflashBuilder) -> list[InnovationTest]:
    """Return the test ratios of the core that was primary longest, empty if no EKF flew."""
    table, source = flown_ratio_table(builder)
    if table is None or len(table) < 2:
        return []
    table, t = builder.near_rows(table)
    found = []
    for column, aid in TEST_RATIO_COLUMNS.items():
        if column in table:
            ratio = table.value(column)
        elif column == "SM" and all(c in table for c in COMPASS_AXIS_COLUMNS):
            ratio = np.max([table.value(c) for c in COMPASS_AXIS_COLUMNS], axis=0)
        else:
            continue
        # An int16 in hundredths overflows above 327: such a ratio is set to NaN.
        impossible = limits.TEST_RATIO.outside(ratio)
        found.append(InnovationTest(aid, t, np.where(impossible, np.nan, ratio), f"{source}.{column}"))
    return found


def flown_ratio_table(builder: DataflashBuilder) -> tuple[Table | None, str]:
    """Return the table with the flown core's test ratios, and its name."""
    messages, ekf = builder.messages, builder.values.get("AHRS_EKF_TYPE")
    family, t_us, cores = primary_core(builder)
    if not family:
        return (messages.first("EKF4"), "EKF4") if ekf is None else (None, "")
    if family not in EKF_FAMILIES.get(ekf, ()):
        return None, ""
    core = longest_held(t_us, cores) or 0
    table = builder.units(f"{family}F4").get(core)
    if table is None and core == 1:
        return messages.first(f"{family}F9"), f"{family}F9"
    return table, f"{family}F4:{core}"


def primary_core_line(builder: DataflashBuilder) -> TimeLine | None:
    """Return the primary core over time, None if no EKF flew."""
    family, t_us, cores = primary_core(builder)
    if family not in EKF_FAMILIES.get(builder.values.get("AHRS_EKF_TYPE"), ()):
        return None
    return builder.time_line(t_us, cores, f"{family}F4.PI")


def yaw_estimator_stream(builder: DataflashBuilder) -> Stream | None:
    """Return EKF-GSF's heading from GNSS motion and its sigma (n, 2) in rad, None if not logged.

    Only records below the sigma at which the EKF uses them. Preferred is the core that was primary longest.
    """
    family, t_us, lanes = primary_core(builder)
    first = longest_held(t_us, lanes) or 0
    for name in sorted(EKF_FAMILIES[None], key=lambda f: f != family):
        found = {c: t for c, t in builder.units(f"{name}Y0").items() if "YC" in t and "YCS" in t}
        for core in sorted(found, key=lambda c: (c != first, c)):
            yaw, sigma = heading_and_sigma(found[core])
            valid = (sigma > 0.0) & (sigma < MAX_YAW_SIGMA_RAD)
            if valid.any():
                x, source = np.column_stack([yaw, sigma])[valid], f"{found[core].name}:{core}"
                stamps, within = builder.stamps(found[core])[valid], limits.ESTIMATED_YAW
                return builder.stream(stamps, x, "rad", source, frame="NED", within=within)
    return None


def heading_and_sigma(table: Table) -> tuple[Array, Array]:
    """Return heading and sigma (n,) in rad of XKY0 or NKY0 records of any version."""
    yaw, sigma = table.value("YC"), table.value("YCS")
    unit = table.fields["YC"].unit
    if unit == "rad" or (unit is None and not np.any(np.abs(yaw) > 2.0 * math.pi)):
        return yaw, sigma
    if np.any(sigma > MAX_YAW_SIGMA_ROOT):
        return np.radians(yaw), np.radians(sigma)
    return np.radians(yaw), np.sqrt(np.radians(sigma**2))


def height_stream(builder: DataflashBuilder) -> Stream | None:
    """Return the estimator's height (n, 1) in m above home (POS.RelHomeAlt)."""
    own = builder.quiet()
    return own.column_stream(builder.table("POS"), ("RelHomeAlt",), "m", "POS", limits.ESTIMATED_HEIGHT)
