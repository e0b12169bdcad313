"""Attitudes of ArduPilot logs: which record holds whose attitude, with or without the vehicle's trim.

ATT, ANG, AHR2 and the Euler records of the EKFs (EKF1, NKF1, XKF1) have AHRS_TRIM
taken out; the quaternion records (NKQ, XKQ) have not (ArduPilot
NavEKF3_core::getEulerAngles, and measured on a log with 0.96 deg of trim).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np

from attlog.core import rotation
from attlog.core.timestamps import Stamps
from attlog.flight import limits
from attlog.flight.ardupilot.imu import RecordClock, primary_core, unit_of_core, unit_tables
from attlog.flight.builder import LogBuilder, angle_quantisation_deg, columns
from attlog.flight.imu import longest_held
from attlog.flight.model import Array, Attitude, Imu, InnovationTest, Stream, TimeLine, covered_seconds
from attlog.formats.table import Messages, Table

YAW_RESET_EVENT = 62
MIN_ANG_SHARE = 0.95
"""ANG that covers less than this part of ATT's time is not the record to replace it."""
QUATERNION_COLUMNS = ("Q1", "Q2", "Q3", "Q4")
EULER_COLUMNS = ("Roll", "Pitch", "Yaw")
POSE_COLUMNS = ("R", "P", "Y")


def attitudes(builder: LogBuilder, clock: RecordClock, resets_us: list[int]) -> dict[str, Attitude]:
    """Every attitude of the log by its name in the comparison (``ATT``, ``XKQ.1``, ...)."""
    found: dict[str, Attitude] = {}
    for name, table, trimmed in attitude_tables(builder.messages):
        followed = resets_us if name in ("ATT", "ANG") or name.startswith(("XK", "NK", "EKF")) else ()
        attitude = builder.attempt(name, partial(read_attitude, builder, clock, table, name, trimmed, followed), None)
        if attitude is not None:
            found[name] = attitude
    return found


def attitude_tables(messages: Messages) -> Iterator[tuple[str, Table, bool]]:
    """(name, table, trim taken out) of every attitude record; old names NKQ2, XKF6 are cores of their family.

    XKF1 and NKF1 count only for cores without quaternion: they are the same attitude.
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
                if table is not None and core not in place:
                    place[core] = table
        for core, table in sorted(quaternion.items()):
            yield f"{family}Q.{core}", table, False
        for core, table in sorted(euler.items()):
            if core in quaternion:
                continue  # the same attitude, rounded to 0.01 deg
            yield f"{family}F1.{core}", table, True


def read_attitude(
    builder: LogBuilder, clock: RecordClock, table: Table, name: str, trimmed: bool, resets_us: list[int] | tuple[()]
) -> Attitude | None:
    """The attitude in one record type: its quaternion where it has one, else its Euler angles in degrees."""
    t = clock.of_samples(table)
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
    """Quaternions (n, 4) of Euler angles in degrees, zero where they are no angles, and the step of the angles."""
    with np.errstate(invalid="ignore"):
        good = (np.abs(angles) <= 720.0).all(axis=1)
    q = np.full((len(angles), 4), np.nan)
    q[good] = rotation.from_euler(*np.radians(angles[good]).T)
    return q, angle_quantisation_deg(angles[good][:, :2].ravel())


def reset_times(builder: LogBuilder, clock: RecordClock, lane_t: Stamps, lanes: list[int]) -> list[int]:
    """Boot times in us at which the attitude that flies stepped: lane switches, yaw resets, DCM to EKF."""
    messages, times = builder.messages, []
    changes = [int(lane_t[k]) for k in range(1, len(lanes)) if lanes[k] != lanes[k - 1]]
    if changes:
        often = "once" if len(changes) == 1 else f"{len(changes)} times"
        builder.problem(
            "lane_switch",
            "warning",
            f"The EKF changed its primary core {often}, first from {lanes[0]}; the attitude steps there.",
            count=len(changes),
        )
    times += changes
    events = messages.first("EV")
    if events is not None and "Id" in events:
        times += clock.of(events)[events["Id"].astype(np.int64) == YAW_RESET_EVENT].tolist()
    att = messages.first("ATT")
    if att is not None and "AEKF" in att:
        active = att["AEKF"].astype(np.int64)
        times += clock.of(att)[1:][np.diff(active) != 0].tolist()
    words = ("yaw align", "yaw reset", "lane switch", "in-flight yaw", "emergency yaw")
    times += [x.t_us for x in messages.texts if x.t_us is not None and any(w in x.text.lower() for w in words)]
    return sorted(times)


def simulated_attitude(builder: LogBuilder, clock: RecordClock) -> Attitude | None:
    """The simulator's attitude (SIM): its quaternion, else angles that are cut to 0.01 deg."""
    table = builder.messages.first("SIM")
    if table is None or clock.of_samples(table) is None:
        return None
    return read_attitude(builder, clock, table, "SIM", False, ())


def vision_poses(builder: LogBuilder, clock: RecordClock) -> dict[str, Attitude]:
    """What a camera or motion capture measured (VISP: degrees; the vehicle takes CTimeMS for the time of measurement),
    but for records that it ignored (Ign)."""
    table = builder.messages.first("VISP")
    t = None if table is None else clock.of_samples(table)
    if table is None or t is None or not all(c in table for c in POSE_COLUMNS):
        return {}
    used = table["Ign"].astype(np.int64) == 0 if "Ign" in table else np.ones(len(t), bool)
    q, step = from_euler_deg(columns(table, *POSE_COLUMNS))
    sampled = 1000 * table["CTimeMS"].astype(np.int64) if "CTimeMS" in table else None
    counter = table["Rst"][used] if "Rst" in table else None
    own = None if sampled is None else sampled[used]
    found = builder.attitude(t[used], q[used], "VISP", t_sample_us=own, counter=counter, step_deg=step)
    return {} if found is None else {"VISP": found}


def attitude_setpoint(builder: LogBuilder, clock: RecordClock, flew: str | None) -> Attitude | None:
    """The attitude set-point (DesRoll, DesPitch, DesYaw) beside the attitude that ``flew``, else beside ANG or ATT."""
    desired = ("DesRoll", "DesPitch", "DesYaw")
    for name in ("ATT", "ANG") if flew == "ATT" else ("ANG", "ATT"):
        table = builder.messages.first(name)
        if table is None or not all(c in table for c in desired):
            continue
        if clock.of_samples(table) is None:
            return None
        q, step = from_euler_deg(columns(table, *desired))
        good = rotation.finite_rows(q)
        own = LogBuilder(builder.messages, t0_us=builder.t0_us)  # the stamps were reported with the attitude
        found = own.attitude(clock.of(table)[good], q[good], f"{name}.Des", has_trim=True, step_deg=step)
        builder.take_values(own)
        return found
    return None


def onboard_source(found: dict[str, Attitude], family: str, core: int | None) -> str | None:
    """The name of the attitude that flew: ANG > ATT > quaternion of the primary core > AHR2.

    ANG holds the values of ATT at loop rate, but a VTOL writes it in its hover modes
    only: it counts where it covers as much time as ATT, pauses left out, and is no slower.
    """
    names = ["ANG", "ATT", f"{family}Q.{core or 0}", f"{family}F1.{core or 0}", "EKF1", "AHR2", "DCM"]
    have = [n for n in names if n in found]
    if have[:2] == ["ANG", "ATT"]:
        ang, att = found["ANG"].t, found["ATT"].t
        if len(ang) < len(att) or covered_seconds(ang) < MIN_ANG_SHARE * covered_seconds(att):
            return "ATT"
    return have[0] if have else None


# ArduPilot's own EKF: the bias that it takes off the replayed gyro, test ratios of its aids, GNSS heading.
#
# GX, GY, GZ of XKF1 and NKF1 are deg/s in body axes (ArduPilot's list of log messages, and
# FMTU since 3.6), to be subtracted; IMU, GYR, IMT and RISI are logged before. EKF1 is left
# out: ArduPilot commit ac2e5f6 (October 2014) changed its unit from deg/min to deg/s under
# the same format, which no record of the time tells apart.
#
# SV, SP, SH, SM and SVT of XKF4 and NKF4, and of EKF4 before Copter 3.4, are the roots of the test ratios in
# hundredths
# in all eras; the format's scale takes these out ("c" in the FMT record). Above 1 the EKF rejects.
#
# XKY0 and NKY0 (EKF-GSF, #13603 of 2020, written while velocities are fused) hold the heading from true north that
# GNSS motion shows, YC, and its one sigma, YCS. Radians before 4.3; since (#20546, April 2022) YC is degrees 0
# to 360, and YCS, though labelled deg, is sqrt(degrees(variance)) of a variance in rad^2: the estimator starts at
# 2 pi / sqrt(10) rad, which is 114 deg, and such logs start at 15.04.

GYRO_BIAS_COLUMNS = ("GX", "GY", "GZ")
EKF_FAMILIES = {None: ("XK", "NK"), 2.0: ("NK",), 3.0: ("XK",)}
"""EKF families that may have flown, by AHRS_EKF_TYPE; with any other number no EKF of ArduPilot's did."""


def gyro_bias_stream(
    builder: LogBuilder, clock: RecordClock, values: dict[str, float], imu: Imu | None
) -> Stream | None:
    """Gyro bias (n, 3) in rad/s FRD to subtract from ``imu.gyro``; None where the log does not tell.

    It is that of the core that was primary longest, or of another one on the replayed unit.
    """
    ekf = values.get("AHRS_EKF_TYPE")
    family, t_us, lanes = primary_core(builder.messages, clock, ekf)
    allowed = EKF_FAMILIES.get(ekf, ())
    family = family or next((f for f in allowed if builder.messages.instances(f"{f}F1")), "")
    if imu is None or family not in allowed:
        return None
    first = longest_held(t_us, lanes) or 0
    mask = values.get("EK3_IMU_MASK" if family == "XK" else "EK2_IMU_MASK")
    found = bias_tables(builder.messages, family)
    for core in sorted(found, key=lambda c: (c != first, c)):
        if unit_of_core(core, mask, list(found)) == imu.index:
            table = found[core]
            bias = np.radians(columns(table, *GYRO_BIAS_COLUMNS))
            source = f"{table.name}:{core}"
            return builder.stream(clock.of(table), bias, "rad/s", source, frame="FRD", within=limits.GYRO_BIAS)
    return None


def bias_tables(messages: Messages, family: str) -> dict[int, Table]:
    """Records with the bias by core; before 4.0 the second core wrote NKF6 or XKF6."""
    found = unit_tables(messages, f"{family}F1")
    second = messages.first(f"{family}F6")
    if second is not None:
        found.setdefault(1, second)
    return {core: table for core, table in found.items() if all(c in table for c in GYRO_BIAS_COLUMNS)}


TEST_RATIO_COLUMNS = {"SM": "compass", "SV": "velocity", "SP": "position", "SH": "height", "SVT": "airspeed"}
COMPASS_AXIS_COLUMNS = ("SMX", "SMY", "SMZ")
"""Of the compass in EKF4."""


def innovation_tests(builder: LogBuilder, clock: RecordClock, values: dict[str, float]) -> list[InnovationTest]:
    """The ratios of the core that was primary longest, one for each aid; none where another estimator flew."""
    table, source = flown_ratio_table(builder, clock, values.get("AHRS_EKF_TYPE"))
    if table is None or len(table) < 2:
        return []
    stamps = clock.of(table)
    near = builder.near(stamps)
    table, t = table.rows(near), builder.seconds(stamps[near])
    found = []
    for column, aid in TEST_RATIO_COLUMNS.items():
        name = f"{source}.{column}"
        if column in table:
            ratio = table.value(column)
        elif column == "SM" and all(c in table for c in COMPASS_AXIS_COLUMNS):
            ratio = np.max([table.value(c) for c in COMPASS_AXIS_COLUMNS], axis=0)
        else:
            continue
        # an int16 in hundredths wraps above 327, which tells nothing but that it was large
        possible = (ratio >= limits.TEST_RATIO.low) & (ratio <= limits.TEST_RATIO.high)
        found.append(InnovationTest(aid, t, np.where(possible, ratio, np.nan), name))
    return found


def flown_ratio_table(builder: LogBuilder, clock: RecordClock, ekf: float | None) -> tuple[Table | None, str]:
    """The records of the core that flew, with their name; before 4.0 the second core wrote NKF9 or XKF9."""
    messages = builder.messages
    family, t_us, cores = primary_core(messages, clock, ekf)
    if not family:
        return (messages.first("EKF4"), "EKF4") if ekf is None else (None, "")
    if family not in EKF_FAMILIES.get(ekf, ()):
        return None, ""
    core = longest_held(t_us, cores) or 0
    table = unit_tables(messages, f"{family}F4").get(core)
    if table is None and core == 1:
        return messages.first(f"{family}F9"), f"{family}F9"
    return table, f"{family}F4:{core}"


def primary_core_line(builder: LogBuilder, clock: RecordClock, values: dict[str, float]) -> TimeLine | None:
    """Which core flew; None where another estimator did or the log does not tell."""
    ekf = values.get("AHRS_EKF_TYPE")
    family, t_us, cores = primary_core(builder.messages, clock, ekf)
    return builder.time_line(t_us, cores, f"{family}F4.PI") if family in EKF_FAMILIES.get(ekf, ()) else None


MAX_YAW_SIGMA_RAD = math.radians(15.0)
"""GSF_YAW_ACCURACY_THRESHOLD_DEG of both EKFs."""
MAX_YAW_SIGMA_ROOT = 15.1
"""Just above what ``sqrt(degrees(variance))`` is at the start; a larger ``YCS`` is degrees."""


def yaw_estimator_stream(builder: LogBuilder, clock: RecordClock, values: dict[str, float]) -> Stream | None:
    """Heading and its one sigma (n, 2) in rad where the EKF would use it; None where the log does not tell.

    It is that of the core that was primary longest, or of the first that has one.
    """
    family, t_us, lanes = primary_core(builder.messages, clock, values.get("AHRS_EKF_TYPE"))
    first = longest_held(t_us, lanes) or 0
    for name in sorted(EKF_FAMILIES[None], key=lambda f: f != family):
        found = {c: t for c, t in unit_tables(builder.messages, f"{name}Y0").items() if "YC" in t and "YCS" in t}
        for core in sorted(found, key=lambda c: (c != first, c)):
            table = found[core]
            yaw, sigma = heading_and_sigma(table)
            valid = (sigma > 0.0) & (sigma < MAX_YAW_SIGMA_RAD)
            if not valid.any():
                continue
            x, source = np.column_stack([yaw, sigma])[valid], f"{table.name}:{core}"
            within = limits.ESTIMATED_YAW
            return builder.stream(clock.of(table)[valid], x, "rad", source, frame="NED", within=within)
    return None


def heading_and_sigma(table: Table) -> tuple[Array, Array]:
    """Heading and one sigma (n,) in rad of the records of any era."""
    yaw, sigma = table.value("YC"), table.value("YCS")
    unit = table.fields["YC"].unit
    if unit == "rad" or (unit is None and not np.any(np.abs(yaw) > 2.0 * math.pi)):
        return yaw, sigma
    if np.any(sigma > MAX_YAW_SIGMA_ROOT):
        return np.radians(yaw), np.radians(sigma)
    return np.radians(yaw), np.sqrt(np.radians(sigma**2))
