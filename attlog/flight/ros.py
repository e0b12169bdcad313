"""Read bags of ROS 2 as a flight log: PX4's topics, or the sensor messages of a companion computer.

PX4's topics are read as those of a ULog. IMU messages of ROS are body forward-left-up, earth east-north-up (REP 103,
REP 145), stamped by their headers.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import median
from attlog.core.timestamps import Stamps
from attlog.flight.advice import VehicleSettings
from attlog.flight.builder import LogBuilder, Part, columns
from attlog.flight.compass import build_mag, choose_mag
from attlog.flight.gnss import build_gnss
from attlog.flight.imu import ImuCandidate, add_imus, best_per_unit, validate_candidate
from attlog.flight.model import FIX_3D, Array, Attitude, Firmware, FlightLog, Gnss, Mag, TimeLine
from attlog.flight.px4 import reader as px4
from attlog.flight.timestamps import read_stamps
from attlog.formats.table import Messages, Table

# Factors from forward-left-up to forward-right-down.
FLU = np.array([1.0, -1.0, -1.0])
# Topics of PX4's inertial data.
INERTIAL = ("sensor_combined", "vehicle_imu", "sensor_gyro")
# Types with an attitude and a position, and their fields.
POSE_TYPES = {
    "geometry_msgs/msg/PoseStamped": ("pose.orientation", "pose.position"),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose.pose.orientation", "pose.pose.position"),
    "geometry_msgs/msg/TransformStamped": ("transform.rotation", "transform.translation"),
    "nav_msgs/msg/Odometry": ("pose.pose.orientation", "pose.pose.position"),
}
IMU_TYPE, FIELD_TYPE, FIX_TYPE = "sensor_msgs/msg/Imu", "sensor_msgs/msg/MagneticField", "sensor_msgs/msg/NavSatFix"
STATE_TYPE, EXTENDED_STATE_TYPE = "mavros_msgs/msg/State", "mavros_msgs/msg/ExtendedState"
VELOCITY_TYPES = ("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/TwistWithCovarianceStamped")
# ``ExtendedState.landed_state`` of a vehicle on the ground; 0 is unknown.
ON_GROUND = 1
# Part of the names of topics with measurements before sensor fusion.
RAW_NAME = "raw"
# Topics with at least this share of the largest topic's records count as equally fast.
SAME_RATE_SHARE = 0.9
# Range of the earth's field, by which the unit is identified: REP 145 requires tesla, but drivers publish others.
EARTH_FIELD_RANGE_T = (1e-5, 2e-4)
FIELD_UNITS = {"tesla": 1.0, "microtesla": 1e-6, "gauss": 1e-4, "milligauss times 1000, an error of MAVROS": 1e-10}
# ``orientation_covariance`` of an IMU message without an orientation begins with this.
NO_ORIENTATION = -1.0


class BagBuilder(LogBuilder):
    """Builder of a flight log from ROS messages."""

    __slots__ = ()

    def stamps(self, table: Table) -> Stamps:
        """Return header stamps (n,) in us (time of measurement), or the recorder's if all are unset."""
        own = table["header.stamp.sec"].astype(np.int64) * 1_000_000 + table["header.stamp.nanosec"] // 1000
        return np.asarray(own if own.any() else table["log_time_ns"] // 1000, np.int64)


def read(messages: Messages, imu: int | None, mag: int | str | None) -> FlightLog:
    """Read the flight in a bag; ``imu`` and ``mag`` select units."""
    if any((name, 0) in messages.tables for name in INERTIAL):
        log = px4.read(messages, imu, mag)
        log.firmware = replace(log.firmware, name="PX4")
        builder = BagBuilder(messages, t0_us=log.t0_us - _ahead_us(messages))
        log.poses = poses(builder)
        log.problems += [p for p in builder.problems if p not in log.problems]
        return log
    builder = BagBuilder(messages)
    log, read_optional = builder.log, builder.read_optional
    log.firmware, log.settings = Firmware("ROS 2"), VehicleSettings("bag")
    candidates = best_per_unit(builder, read_optional("The inertial messages", partial(imu_candidates, builder), []))
    why = "the topic with most records, raw before fused" if len(candidates) > 1 else "the only one"
    add_imus(builder, candidates, 0, why, imu, lambda: 0)
    log.mags = read_optional("The magnetometer", partial(magnetometers, builder), [])
    log.mag = read_optional("The compass", partial(choose_mag, builder, 0, "the first one", mag), None)
    builder.read_parts(STREAMS)
    log.onboard = next(iter(log.attitudes), None)
    return log


def topics_of_type(builder: LogBuilder, *kinds: str) -> list[tuple[str, Table]]:
    """Return the topics of these types with their tables, fastest first and raw before fused ones."""
    types = builder.messages.info.get("types", {})
    found = [(name, table) for (name, _), table in builder.messages.items() if types.get(name) in kinds and len(table)]
    most = SAME_RATE_SHARE * max((len(table) for _, table in found), default=0)
    return sorted(found, key=lambda pair: (len(pair[1]) < most, RAW_NAME not in pair[0], -len(pair[1]), pair[0]))


def vectors(table: Table, name: str) -> Array:
    """Return a vector field (n, 3) in FRD, logged in FLU."""
    return np.asarray(columns(table, *(f"{name}.{axis}" for axis in "xyz")) * FLU)


def quaternions(table: Table, name: str) -> Array:
    """Return quaternions (n, 4), scalar first, as stored."""
    return columns(table, *(f"{name}.{axis}" for axis in "wxyz"))


def imu_candidates(builder: BagBuilder) -> list[ImuCandidate]:
    """Return each IMU topic as a unit, in the order of :func:`topics_of_type`."""
    found: list[ImuCandidate] = []
    for unit, (name, table) in enumerate(topics_of_type(builder, IMU_TYPE)):
        gyro, acc = vectors(table, "angular_velocity"), vectors(table, "linear_acceleration")
        one = validate_candidate(builder, ImuCandidate(unit, 0, builder.stamps(table), gyro, acc, name, "instant"))
        found += [one] if one is not None else []
    return found


def magnetometers(builder: BagBuilder) -> list[Mag]:
    """Return each magnetic topic in tesla; other units are detected and reported."""
    found = []
    for unit, (name, table) in enumerate(topics_of_type(builder, FIELD_TYPE)):
        field = vectors(table, "magnetic_field")
        usual = float(median(np.linalg.norm(field, axis=1)))
        low, high = EARTH_FIELD_RANGE_T
        word = next((word for word, factor in FIELD_UNITS.items() if low <= usual * factor <= high), "tesla")
        if word != "tesla":
            text = f"{name} holds {usual:.3g} where the earth's field is: read as {word}, not as tesla."
            builder.problem("mag_unit", "warning", text)
        found.append(build_mag(builder, unit, builder.stamps(table), field * FIELD_UNITS[word], name))
    return [mag for mag in found if mag is not None]


def state_line(builder: BagBuilder, kind: str, column: str, value: int) -> TimeLine | None:
    """Return over time whether a state equals ``value``; records with unknown landing state are left out."""
    for name, table in topics_of_type(builder, kind):
        state = table[column].astype(np.int64)
        known = state > 0 if kind == EXTENDED_STATE_TYPE else np.ones(len(state), bool)
        if known.any():
            return builder.time_line(builder.stamps(table)[known], (state[known] == value).tolist(), name)
    return None


def receivers(builder: BagBuilder) -> list[Gnss]:
    """Return the receivers, with velocity from a topic in the same namespace."""
    moving = topics_of_type(builder, *VELOCITY_TYPES)
    found = []
    for unit, (name, table) in enumerate(topics_of_type(builder, FIX_TYPE)):
        t_us = builder.stamps(table)
        velocity = np.full((len(table), 3), np.nan)
        beside = next((v for n, v in moving if n.rpartition("/")[0] == name.rpartition("/")[0]), None)
        if beside is not None:
            velocity = _velocity(builder, t_us, beside)
        known = table["position_covariance_type"] > 0
        accuracy = np.where(known[:, None], np.sqrt(np.maximum(table["position_covariance"], 0.0)), np.nan)
        receiver = build_gnss(
            builder,
            unit,
            t_us,
            name,
            place=columns(table, "latitude", "longitude", "altitude"),
            velocity=velocity,
            # any NavSatStatus of 0 or more
            fix=np.where(table["status.status"].astype(np.int64) >= 0, FIX_3D, 0),
            accuracy=(accuracy[:, 0], accuracy[:, 8], np.full(len(table), np.nan)),
        )
        found += [receiver] if receiver is not None else []
    return found


def _velocity(builder: BagBuilder, t_us: NDArray[np.int64], table: Table) -> Array:
    """Interpolate velocities of an east-north-up topic to stamps (n,) us, as (n, 3) north-east-down."""
    name = "twist.linear" if "twist.linear.x" in table else "twist.twist.linear"
    enu, at = columns(table, *(f"{name}.{axis}" for axis in "xyz")), builder.stamps(table)
    return np.column_stack([np.interp(t_us, at, x, np.nan, np.nan) for x in (enu[:, 1], enu[:, 0], -enu[:, 2])])


def attitudes(builder: BagBuilder) -> dict[str, Attitude]:
    """Return the orientation of each IMU topic that has one."""
    found: dict[str, Attitude] = {}
    for name, table in topics_of_type(builder, IMU_TYPE):
        q = quaternions(table, "orientation")
        if not np.ptp(q, axis=0).any() or float(median(table["orientation_covariance"][:, 0])) == NO_ORIENTATION:
            continue  # without orientation, or constant (unset, identity)
        ned = rotation.multiply(rotation.multiply(rotation.ENU, q), rotation.FLU)
        ned[~np.any(q != 0.0, axis=1)] = 0.0
        attitude = builder.attitude(builder.stamps(table), ned, name)
        if attitude is not None:
            found[name] = attitude
    return found


def poses(builder: BagBuilder) -> dict[str, Attitude]:
    """Return attitudes by motion capture, vision or another estimator by topic, in their own axes."""
    types = builder.messages.info.get("types", {})
    found: dict[str, Attitude] = {}
    for name, table in topics_of_type(builder, *POSE_TYPES):
        attitude = builder.read_optional(name, partial(_pose, builder, name, table, *POSE_TYPES[types[name]]), None)
        if attitude is not None:
            found[name] = attitude
    return found


def _pose(builder: BagBuilder, name: str, table: Table, orientation: str, position: str) -> Attitude | None:
    """Return an attitude with its position in the axes of the topic."""
    t_us = builder.stamps(table)
    attitude = builder.attitude(t_us, quaternions(table, orientation), name)
    if attitude is None:
        return None
    places = columns(table, *(f"{position}.{axis}" for axis in "xyz"))
    return replace(attitude, position=builder.positions(t_us, places, attitude.t))


def _ahead_us(messages: Messages) -> int:
    """Return the median offset in us from the recorder's to the autopilot's clock.

    It converts poses, which are stamped by the companion computer. The transport delay of some ms is included; the
    alignment by rates corrects it.
    """
    for name in INERTIAL:
        table = messages.tables.get((name, 0))
        if table is not None and len(table) and "timestamp" in table and "log_time_ns" in table:
            with suppress(ValueError):  # a stranger's definition, reported by the topic's reader
                return int(median(read_stamps(table, "timestamp") - read_stamps(table, "log_time_ns") // 1000))
    return 0


STREAMS = (
    Part("gnss", "GNSS", receivers),
    Part("attitudes", "The attitude", attitudes),
    Part("state.armed", "Arming", lambda builder: state_line(builder, STATE_TYPE, "armed", 1)),
    Part(
        "state.landed", "Landing", lambda builder: state_line(builder, EXTENDED_STATE_TYPE, "landed_state", ON_GROUND)
    ),
    Part("poses", "The poses", poses),
)
