"""Bags of ROS 2: PX4's topics, or the sensor messages of a companion computer, as a flight."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.flight import compass, gnss
from attlog.flight import imu as inertial
from attlog.flight.advice import BagLogging
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.model import Array, Attitude, Firmware, FlightLog, Gnss, Mag, TimeLine
from attlog.flight.px4 import reader as px4
from attlog.formats.table import Messages, Table

# A bag as a FlightLog. PX4's topics are read as of a ULog; IMU messages of ROS are body forward-left-up, earth
# east-north-up (REP 103, REP 145), stamped by their headers.

FLU = np.array([1.0, -1.0, -1.0])
"""Vectors forward-left-up times this are forward-right-down."""
INERTIAL = ("sensor_combined", "vehicle_imu", "sensor_gyro")
POSE_TYPES = {
    "geometry_msgs/msg/PoseStamped": ("pose.orientation", "pose.position"),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose.pose.orientation", "pose.pose.position"),
    "geometry_msgs/msg/TransformStamped": ("transform.rotation", "transform.translation"),
    "nav_msgs/msg/Odometry": ("pose.pose.orientation", "pose.pose.position"),
}
"""Types that hold an attitude and a position which somebody measured or estimated, and where."""
IMU_TYPE, FIELD_TYPE, FIX_TYPE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField", "sensor_msgs/msg/NavSatFix"
STATE_TYPE, EXTENDED_STATE_TYPE = "mavros_msgs/msg/State", "mavros_msgs/msg/ExtendedState"
ON_GROUND = 1
"""What ``ExtendedState.landed_state`` says of a vehicle at rest; 0 is unknown."""
VELOCITY_TYPES = ("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/TwistWithCovarianceStamped")
FIX_3D = 3
"""A 3D fix, of whatever augmentation: what NavSatStatus calls 0 and more."""
RAW_NAME = "raw"
"""In a topic's name: measured and not yet fused."""
SAME_RATE_SHARE = 0.9
"""Topics with so many of the records that the largest has are alike in rate."""
EARTH_FIELD_RANGE_T = (1e-5, 2e-4)
FIELD_UNITS = {"tesla": 1.0, "microtesla": 1e-6, "gauss": 1e-4, "milligauss times 1000, an error of MAVROS": 1e-10}
"""REP 145 asks for tesla; drivers write others, which differ by more than the earth's field varies (``EARTH_T``)."""
OTHER_CLOCK_US = 3_600_000_000
"""Stamps so far from the recorder's time are of another clock."""


def read(messages: Messages, imu: int | None, mag: int | str | None) -> FlightLog:
    """The flight in a bag; ``imu`` and ``mag`` ask for a unit."""
    if any((name, 0) in messages.tables for name in INERTIAL):
        log = px4.read(messages, imu, mag)
        log.firmware = Firmware("PX4", log.firmware.version, log.firmware.git, log.firmware.board)
        builder = LogBuilder(messages, t0_us=log.t0_us - _ahead_us(messages))
    else:
        builder = LogBuilder(messages)
        log = _of_sensors(builder, messages, imu, mag)
    log.poses = poses(builder)
    log.problems += [p for p in builder.problems if p not in log.problems]
    return log


def _of_sensors(builder: LogBuilder, messages: Messages, imu: int | None, mag: int | str | None) -> FlightLog:
    """The flight in messages of sensors."""
    logging = BagLogging()
    found = builder.attempt("The inertial messages", lambda: imu_candidates(builder), [])
    chosen = inertial.best_per_unit(builder, found)
    why = "the topic with most records, raw before fused" if len(chosen) > 1 else "the only one"
    position = inertial.choose_imu(builder, chosen, 0, why, imu, logging)
    if chosen:
        builder.t0_us = int(chosen[0 if position is None else position].t_us[0])
    log = FlightLog(messages.path, messages.format, messages.size, builder.t0_us, Firmware("ROS 2"), "")
    log.logging = logging
    log.imus = [inertial.build_imu(builder, c) for c in chosen]
    log.imu = position
    flying = None if position is None else log.imus[position]
    log.mags = builder.attempt("The magnetometer", lambda: magnetometers(builder), [])
    log.mag = builder.attempt(
        "The compass", lambda: compass.choose_mag(builder, log.mags, flying, 0, "the first one", mag, logging), None
    )
    log.gnss = builder.attempt("GNSS", lambda: read_receivers(builder), [])
    log.attitudes = builder.attempt("The attitude", lambda: attitudes(builder), {})
    log.onboard = next(iter(log.attitudes), None)
    log.state.armed = builder.attempt("Arming", lambda: state_line(builder, STATE_TYPE, "armed", 1), None)
    log.state.landed = builder.attempt(
        "Landing", lambda: state_line(builder, EXTENDED_STATE_TYPE, "landed_state", ON_GROUND), None
    )
    log.problems, log.choices = builder.problems, builder.choices
    return log


def topics_of_type(messages: Messages, *kinds: str) -> list[tuple[str, Table]]:
    """Topics of these types with their tables: those with most records first, of alike ones the raw data."""
    types = messages.info.get("types", {})
    found = [(name, table) for (name, _), table in messages.items() if types.get(name) in kinds and len(table)]
    most = SAME_RATE_SHARE * max((len(table) for _, table in found), default=0)
    return sorted(found, key=lambda pair: (len(pair[1]) < most, RAW_NAME not in pair[0], -len(pair[1]), pair[0]))


def stamps(table: Table) -> NDArray[np.int64]:
    """Header stamps (n,) in us, when the data were measured; where none is set, when they were recorded."""
    own = table["header.stamp.sec"].astype(np.int64) * 1_000_000 + table["header.stamp.nanosec"] // 1000
    return np.asarray(own if own.any() else table["log_time_ns"] // 1000, np.int64)


def vectors(table: Table, name: str) -> Array:
    """A vector (n, 3) in forward-right-down."""
    return np.asarray(columns(table, *(f"{name}.{axis}" for axis in "xyz")) * FLU)


def quaternions(table: Table, name: str) -> Array:
    """Quaternions (n, 4), scalar first, as stored."""
    return columns(table, *(f"{name}.{axis}" for axis in "wxyz"))


def imu_candidates(builder: LogBuilder) -> list[inertial.ImuCandidate]:
    """Each IMU topic as a unit; of one driver's data before and after fusion the first is taken."""
    found: list[inertial.ImuCandidate] = []
    for unit, (name, table) in enumerate(topics_of_type(builder.messages, IMU_TYPE)):
        one = inertial.validate_candidate(
            builder,
            inertial.ImuCandidate(
                unit,
                0,
                stamps(table),
                vectors(table, "angular_velocity"),
                vectors(table, "linear_acceleration"),
                name,
                "instant",
            ),
        )
        found += [one] if one is not None else []
    return found


def magnetometers(builder: LogBuilder) -> list[Mag]:
    """Each magnetic topic, in tesla."""
    found = []
    for unit, (name, table) in enumerate(topics_of_type(builder.messages, FIELD_TYPE)):
        field = vectors(table, "magnetic_field")
        usual = float(np.median(np.linalg.norm(field, axis=1)))
        fits = (
            word
            for word, factor in FIELD_UNITS.items()
            if EARTH_FIELD_RANGE_T[0] <= usual * factor <= EARTH_FIELD_RANGE_T[1]
        )
        word = next(fits, "tesla")
        if word != "tesla":
            text = f"{name} holds {usual:.3g} where the earth's field is: read as {word}, not as tesla."
            builder.problem("mag_unit", "warning", text)
        found.append(compass.build_mag(builder, unit, stamps(table), field * FIELD_UNITS[word], name))
    return [mag for mag in found if mag is not None]


def state_line(builder: LogBuilder, kind: str, column: str, value: int) -> TimeLine | None:
    """Whether a state has a value, over time; None where nobody tells it. 0 of landing is unknown."""
    for name, table in topics_of_type(builder.messages, kind):
        told = table[column].astype(np.int64)
        known = told > 0 if kind == EXTENDED_STATE_TYPE else np.ones(len(told), bool)
        if known.any():
            return builder.time_line(stamps(table)[known], (told[known] == value).tolist(), name)
    return None


def read_receivers(builder: LogBuilder) -> list[Gnss]:
    """Fixes, with the velocity of a topic beside them."""
    moving = topics_of_type(builder.messages, *VELOCITY_TYPES)
    found = []
    for unit, (name, table) in enumerate(topics_of_type(builder.messages, FIX_TYPE)):
        t_us = stamps(table)
        velocity = np.full((len(table), 3), np.nan)
        beside = next((v for n, v in moving if n.rpartition("/")[0] == name.rpartition("/")[0]), None)
        if beside is not None:
            velocity = _velocity(t_us, beside)
        known = table["position_covariance_type"] > 0
        accuracy = np.where(known[:, None], np.sqrt(np.maximum(table["position_covariance"], 0.0)), np.nan)
        one = gnss.build_gnss(
            builder,
            unit,
            t_us,
            name,
            place=columns(table, "latitude", "longitude", "altitude"),
            velocity=velocity,
            fix=np.where(table["status.status"].astype(np.int64) >= 0, FIX_3D, 0),
            accuracy=(accuracy[:, 0], accuracy[:, 8], np.full(len(table), np.nan)),
        )
        found += [one] if one is not None else []
    return found


def _velocity(t_us: NDArray[np.int64], table: Table) -> Array:
    """Velocities (n, 3) NED at stamps (n,) us, of a topic in east-north-up."""
    name = "twist.linear" if "twist.linear.x" in table else "twist.twist.linear"
    enu, at = columns(table, *(f"{name}.{axis}" for axis in "xyz")), stamps(table)
    return np.column_stack([np.interp(t_us, at, x, np.nan, np.nan) for x in (enu[:, 1], enu[:, 0], -enu[:, 2])])


def attitudes(builder: LogBuilder) -> dict[str, Attitude]:
    """The orientation of each IMU topic that has one (REP 145: its covariance does not begin with -1)."""
    found: dict[str, Attitude] = {}
    for name, table in topics_of_type(builder.messages, IMU_TYPE):
        q = quaternions(table, "orientation")
        if not np.ptp(q, axis=0).any() or float(np.median(table["orientation_covariance"][:, 0])) == -1.0:
            continue  # unset and the identity are no attitude either
        ned = rotation.multiply(rotation.multiply(rotation.ENU, q), rotation.FLU)
        ned[~np.any(q != 0.0, axis=1)] = 0.0
        attitude = builder.attitude(stamps(table), ned, name)
        if attitude is not None:
            found[name] = attitude
    return found


def poses(builder: LogBuilder) -> dict[str, Attitude]:
    """Attitudes that others measured or estimated, by topic, in axes of their own."""
    types = builder.messages.info.get("types", {})
    found: dict[str, Attitude] = {}
    for name, table in topics_of_type(builder.messages, *POSE_TYPES):
        attitude = builder.attempt(name, partial(_pose, builder, name, table, *POSE_TYPES[types[name]]), None)
        if attitude is not None:
            found[name] = attitude
    return found


def _pose(builder: LogBuilder, name: str, table: Table, orientation: str, position: str) -> Attitude | None:
    """An attitude with its position, as stored."""
    t_us = stamps(table)
    attitude = builder.attitude(t_us, quaternions(table, orientation), name)
    if attitude is None:
        return None
    places = columns(table, *(f"{position}.{axis}" for axis in "xyz"))
    return replace(attitude, position=builder.positions(t_us, places, attitude.t))


def _ahead_us(messages: Messages) -> int:
    """How far the autopilot's clock is ahead of the recorder's in us: of its fastest topic, the median.

    Poses are stamped by the companion's clock; messages need some ms from there to here, which the rates tell later.
    """
    for name in INERTIAL:
        table = messages.tables.get((name, 0))
        if table is not None and len(table):
            return int(np.median(table["timestamp"].astype(np.int64) - table["log_time_ns"] // 1000))
    return 0
