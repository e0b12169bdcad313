"""ArduPilot's own EKF: the bias that it takes off the replayed gyro, test ratios of its aids, GNSS heading.

GX, GY, GZ of XKF1 and NKF1 are deg/s in body axes (ArduPilot's list of log messages, and
FMTU since 3.6), to be subtracted; IMU, GYR, IMT and RISI are logged before. EKF1 is left
out: ArduPilot commit ac2e5f6 (October 2014) changed its unit from deg/min to deg/s under
the same format, which no record of the time tells apart.

SV, SP, SH, SM and SVT of XKF4 and NKF4, and of EKF4 before Copter 3.4, are the roots of the test ratios in hundredths
in all eras; the format's scale takes these out ("c" in the FMT record). Above 1 the EKF rejects.

XKY0 and NKY0 (EKF-GSF, #13603 of 2020, written while velocities are fused) hold the heading from true north that
GNSS motion shows, YC, and its one sigma, YCS. Radians before 4.3; since (#20546, April 2022) YC is degrees 0
to 360, and YCS, though labelled deg, is sqrt(degrees(variance)) of a variance in rad^2: the estimator starts at
2 pi / sqrt(10) rad, which is 114 deg, and such logs start at 15.04.
"""

from __future__ import annotations

import math

import numpy as np

from attlog.flight import physics
from attlog.flight.ardupilot.clock import Clock
from attlog.flight.ardupilot.imus import primary_core, unit_of_core, units
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.inertial import longest_held
from attlog.flight.model import Array, Imu, InnovationTest, Stream, TimeLine
from attlog.formats.base import Messages, Table

COLUMNS = ("GX", "GY", "GZ")
FAMILIES = {None: ("XK", "NK"), 2.0: ("NK",), 3.0: ("XK",)}
"""EKF families that may have flown, by AHRS_EKF_TYPE; with any other number no EKF of ArduPilot's did."""


def gyro_bias(builder: LogBuilder, clock: Clock, values: dict[str, float], imu: Imu | None) -> Stream | None:
    """Gyro bias (n, 3) in rad/s FRD to subtract from ``imu.gyro``; None where the log does not tell.

    It is that of the core that was primary longest, or of another one on the replayed unit.
    """
    ekf = values.get("AHRS_EKF_TYPE")
    family, t_us, lanes = primary_core(builder.messages, clock, ekf)
    allowed = FAMILIES.get(ekf, ())
    family = family or next((f for f in allowed if builder.messages.instances(f"{f}F1")), "")
    if imu is None or family not in allowed:
        return None
    first = longest_held(t_us, lanes) or 0
    mask = values.get("EK3_IMU_MASK" if family == "XK" else "EK2_IMU_MASK")
    found = cores(builder.messages, family)
    for core in sorted(found, key=lambda c: (c != first, c)):
        if unit_of_core(core, mask, list(found)) == imu.index:
            table = found[core]
            bias = np.radians(columns(table, *COLUMNS))
            source = f"{table.name}:{core}"
            return builder.stream(clock.of(table), bias, "rad/s", source, frame="FRD", within=physics.GYRO_BIAS)
    return None


def cores(messages: Messages, family: str) -> dict[int, Table]:
    """Records with the bias by core; before 4.0 the second core wrote NKF6 or XKF6."""
    found = units(messages, f"{family}F1")
    second = messages.first(f"{family}F6")
    if second is not None:
        found.setdefault(1, second)
    return {core: table for core, table in found.items() if all(c in table for c in COLUMNS)}


RATIOS = {"SM": "compass", "SV": "velocity", "SP": "position", "SH": "height", "SVT": "airspeed"}
BY_AXIS = ("SMX", "SMY", "SMZ")
"""Of the compass in EKF4."""


def innovation_tests(builder: LogBuilder, clock: Clock, values: dict[str, float]) -> list[InnovationTest]:
    """The ratios of the core that was primary longest, one for each aid; none where another estimator flew."""
    table, source = flown(builder, clock, values.get("AHRS_EKF_TYPE"))
    if table is None or len(table) < 2:
        return []
    stamps = clock.of(table)
    near = builder.near(stamps)
    table, t = table.rows(near), builder.seconds(stamps[near])
    found = []
    for column, aid in RATIOS.items():
        name = f"{source}.{column}"
        if column in table:
            ratio = table.value(column)
        elif column == "SM" and all(c in table for c in BY_AXIS):
            ratio = np.max([table.value(c) for c in BY_AXIS], axis=0)
        else:
            continue
        # an int16 in hundredths wraps above 327, which tells nothing but that it was large
        possible = (ratio >= physics.TEST_RATIO.low) & (ratio <= physics.TEST_RATIO.high)
        found.append(InnovationTest(aid, t, np.where(possible, ratio, np.nan), name))
    return found


def flown(builder: LogBuilder, clock: Clock, ekf: float | None) -> tuple[Table | None, str]:
    """The records of the core that flew, with their name; before 4.0 the second core wrote NKF9 or XKF9."""
    messages = builder.messages
    family, t_us, cores = primary_core(messages, clock, ekf)
    if not family:
        return (messages.first("EKF4"), "EKF4") if ekf is None else (None, "")
    if family not in FAMILIES.get(ekf, ()):
        return None, ""
    core = longest_held(t_us, cores) or 0
    table = units(messages, f"{family}F4").get(core)
    if table is None and core == 1:
        return messages.first(f"{family}F9"), f"{family}F9"
    return table, f"{family}F4:{core}"


def lane(builder: LogBuilder, clock: Clock, values: dict[str, float]) -> TimeLine | None:
    """Which core flew; None where another estimator did or the log does not tell."""
    ekf = values.get("AHRS_EKF_TYPE")
    family, t_us, cores = primary_core(builder.messages, clock, ekf)
    return builder.time_line(t_us, cores, f"{family}F4.PI") if family in FAMILIES.get(ekf, ()) else None


MOST_SIGMA_RAD = math.radians(15.0)
"""GSF_YAW_ACCURACY_THRESHOLD_DEG of both EKFs."""
LARGEST_ROOT = 15.1
"""Just above what ``sqrt(degrees(variance))`` is at the start; a larger ``YCS`` is degrees."""


def yaw_estimator(builder: LogBuilder, clock: Clock, values: dict[str, float]) -> Stream | None:
    """Heading and its one sigma (n, 2) in rad where the EKF would use it; None where the log does not tell.

    It is that of the core that was primary longest, or of the first that has one.
    """
    family, t_us, lanes = primary_core(builder.messages, clock, values.get("AHRS_EKF_TYPE"))
    first = longest_held(t_us, lanes) or 0
    for name in sorted(FAMILIES[None], key=lambda f: f != family):
        found = {c: t for c, t in units(builder.messages, f"{name}Y0").items() if "YC" in t and "YCS" in t}
        for core in sorted(found, key=lambda c: (c != first, c)):
            table = found[core]
            yaw, sigma = radians(table)
            valid = (sigma > 0.0) & (sigma < MOST_SIGMA_RAD)
            if not valid.any():
                continue
            x, source = np.column_stack([yaw, sigma])[valid], f"{table.name}:{core}"
            within = physics.ESTIMATED_YAW
            return builder.stream(clock.of(table)[valid], x, "rad", source, frame="NED", within=within)
    return None


def radians(table: Table) -> tuple[Array, Array]:
    """Heading and one sigma (n,) in rad of the records of any era."""
    yaw, sigma = table.value("YC"), table.value("YCS")
    unit = table.fields["YC"].unit
    if unit == "rad" or (unit is None and not np.any(np.abs(yaw) > 2.0 * math.pi)):
        return yaw, sigma
    if np.any(sigma > LARGEST_ROOT):
        return np.radians(yaw), np.radians(sigma)
    return np.radians(yaw), np.sqrt(np.radians(sigma**2))
