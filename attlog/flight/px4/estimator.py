"""Read attitudes, estimator states and reported faults of PX4 logs.

``estimator_sensor_bias.gyro_bias`` (since 1.11): rad/s in body axes, to be subtracted from the calibrated gyro. Before,
``estimator_status.states[10..12]`` hold an angle per step of the filter, whose length is not logged.

``yaw_estimator_status`` (EKF-GSF, since 1.11): ``yaw_composite`` rad and ``yaw_variance`` rad^2 in all eras,
``timestamp_sample`` since 1.12, ``yaw_composite_valid`` since 1.14. Before, the EKF required a sigma below 15 deg
(EKFGSF_yaw_err_max).

Test ratios above 1 are rejections. ``estimator_status`` holds roots, innovation over gate and standard deviation, in
all versions; low-passed since 1.16, where the heading's is called ``hdg_test_ratio``.
``estimator_innovation_test_ratios`` holds squares of each axis. Bits of ``filter_fault_flags``:
``msg/EstimatorStatus.msg``.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.sorting import median
from attlog.flight import limits
from attlog.flight.advice import GENERAL_REMEDIES
from attlog.flight.builder import columns
from attlog.flight.imu import longest_held
from attlog.flight.model import Array, Attitude, InnovationTest, Problem, Stream, TimeLine
from attlog.flight.px4.imu import TopicBuilder, sample_stamps
from attlog.formats.table import Table

ATTITUDE_TOPICS = (
    "vehicle_attitude",
    "estimator_attitude",
    "vehicle_vision_attitude",
    "vehicle_visual_odometry",
    "vehicle_mocap_odometry",
)
# Topics with attitude and position by vision or motion capture.
POSE_TOPICS = ("vehicle_visual_odometry", "vehicle_mocap_odometry")
# Most instance changes that a problem lists.
MAX_LISTED_CHANGES = 5
SELECTOR = "estimator_selector_status"


# --- attitudes --------------------------------------------------------------------------------------------------


def attitudes(builder: TopicBuilder) -> dict[str, Attitude]:
    """Return every attitude: the published one, each EKF instance, vision and motion capture."""
    found: dict[str, Attitude] = {}
    switches = builder.read_optional(SELECTOR, partial(instance_changes, builder), ())
    for name in ATTITUDE_TOPICS:
        for i in builder.messages.instances(name):
            times = switches if name == "vehicle_attitude" else ()
            attitude = builder.read_optional(name, partial(read_attitude, builder, name, i, times), None)
            if attitude is None:
                continue
            if name in POSE_TOPICS:
                attitude.position = builder.read_optional(
                    name, partial(read_positions, builder, name, i, attitude), None
                )
            found[name if name != "estimator_attitude" and i == 0 else f"{name}.{i}"] = attitude
    return found


def read_positions(builder: TopicBuilder, name: str, instance: int, attitude: Attitude) -> Array | None:
    """Return positions (n, 3) m of a pose at the times of its attitude, in the pose's axes; None if not logged."""
    table = builder.messages[name, instance]
    names = ("position",) if "position" in table else ("x", "y", "z")
    if not all(column in table for column in names):
        return None
    return builder.positions(builder.stamps(table), columns(table, *names), attitude.t)


def read_attitude(
    builder: TopicBuilder, name: str, instance: int = 0, switches_us: tuple[int, ...] = ()
) -> Attitude | None:
    """Read an attitude topic, None if not logged; resets come from its counter and from instance switches."""
    table = builder.table(name, instance)
    if table is None or "q" not in table:
        return None
    return builder.attitude(
        builder.stamps(table),
        columns(table, "q"),
        name if instance == 0 and name != "estimator_attitude" else f"{name}:{instance}",
        t_sample_us=sample_stamps(table),
        counter=table["quat_reset_counter"] if "quat_reset_counter" in table else None,
        reset_times_us=switches_us,
    )


def instance_changes(builder: TopicBuilder) -> tuple[int, ...]:
    """Return boot times in us of changes of the primary EKF instance, and report them."""
    table = builder.table(SELECTOR)
    if table is None or "primary_instance" not in table:
        return ()
    t, primary = builder.stamps(table), table["primary_instance"].astype(np.int64)
    at = np.flatnonzero(np.diff(primary)) + 1
    if "last_instance_change" in table:
        changed = table["last_instance_change"].astype(np.int64)
        t = np.where(changed > 0, changed, t)
    if len(at):
        changes = ", ".join(f"from {primary[i - 1]} to {primary[i]}" for i in at[:MAX_LISTED_CHANGES])
        rest = f" and {len(at) - MAX_LISTED_CHANGES} more" if len(at) > MAX_LISTED_CHANGES else ""
        times = "once" if len(at) == 1 else f"{len(at)} times"
        text = f"The EKF switched lanes {times} ({changes}{rest}): the onboard attitude steps there."
        builder.problem("estimator_instance_changed", "note", text, count=len(at))
    return tuple(int(t[i]) for i in at)


def attitude_setpoint(builder: TopicBuilder) -> Attitude | None:
    """Return the attitude set-point; old versions log Euler angles in addition to or instead of ``q_d``."""
    table = builder.table("vehicle_attitude_setpoint")
    if table is None:
        return None
    q = columns(table, "q_d") if "q_d" in table else np.zeros((len(table), 4))
    unset = ~(np.abs(np.sum(q**2, axis=1) - 1.0) < 0.1)
    if unset.any() and "roll_body" in table:
        euler = columns(table, "roll_body", "pitch_body", "yaw_body")
        q = np.where(unset[:, None], rotation.from_euler(*euler.T), q)
        unset = ~rotation.finite_rows(q)
    if unset.all():
        return None
    return builder.attitude(builder.stamps(table)[~unset], q[~unset], "vehicle_attitude_setpoint")


# --- instances and biases ---------------------------------------------------------------------------------------


def selected_instance(builder: TopicBuilder) -> int:
    """Return the estimator instance that flew longest, 0 without a selector."""
    table = builder.table(SELECTOR)
    if table is None or "primary_instance" not in table:
        return 0
    return longest_held(builder.stamps(table), table["primary_instance"].astype(np.int64).tolist()) or 0


def selected_instance_line(builder: TopicBuilder) -> TimeLine | None:
    """Return the primary instance over time, None without a selector."""
    table = builder.table(SELECTOR)
    if table is None or "primary_instance" not in table:
        return None
    return builder.time_line(builder.stamps(table), table["primary_instance"].astype(np.int64).tolist(), SELECTOR)


def gyro_bias_stream(builder: TopicBuilder) -> Stream | None:
    """Return the onboard bias (n, 3) rad/s to subtract from the replayed gyro, None if not logged.

    Among the instances on the replayed gyro, the one that flew longest is preferred. None for
    ``vehicle_angular_velocity``, which is already corrected, and for an uncalibrated gyro.
    """
    imu = builder.log.replay_imu
    found = {i: t for i, t in builder.topics("estimator_sensor_bias").items() if "gyro_bias" in t}
    if imu is None or not imu.calibrated or imu.gyro.source.startswith("vehicle_angular_velocity"):
        return None
    first = selected_instance(builder)
    for i in sorted(found, key=lambda i: (i != first, i)):
        if is_on_sensor(found[i], "gyro_device_id", imu.device):
            source = f"estimator_sensor_bias:{i}"
            return builder.column_stream(found[i], ("gyro_bias",), "rad/s", source, limits.GYRO_BIAS, frame="FRD")
    return None


def is_on_sensor(table: Table, column: str, device: str | None) -> bool:
    """Return whether an EKF instance uses the sensor ``device`` by its id in ``column``, True if an id is missing."""
    if device in (None, "", "0") or column not in table:
        return True
    ids = table[column]
    return not ids.any() or str(int(median(ids[ids > 0]))) == device


def acc_bias_stream(builder: TopicBuilder) -> Stream | None:
    """Return the accelerometer bias (n, 3) in m/s^2 (since 1.11), None where no instance runs on the unit replayed.

    Among several the instance that flew longest is preferred.
    """
    name, imu = "estimator_sensor_bias", builder.log.replay_imu
    found = {i: t for i, t in builder.topics(name).items() if "accel_bias" in t}
    first = selected_instance(builder)
    for i in sorted(found, key=lambda i: (i != first, i)):
        if imu is None or is_on_sensor(found[i], "accel_device_id", imu.acc_device):
            return builder.column_stream(found[i], ("accel_bias",), "m/s^2", name, limits.ACC_BIAS, frame="FRD")
    return None


def height_stream(builder: TopicBuilder) -> Stream | None:
    """Return the estimator's valid height (n, 1) in m above its origin."""
    return _local_position(builder, "z_valid", ("z",), limits.ESTIMATED_HEIGHT)


def speed_stream(builder: TopicBuilder) -> Stream | None:
    """Return the estimator's valid speed (n, 1) over ground in m/s."""
    return _local_position(builder, "v_xy_valid", ("vx", "vy"), limits.ESTIMATED_SPEED)


def _local_position(
    builder: TopicBuilder, valid: str, names: tuple[str, ...], quantity: limits.Quantity
) -> Stream | None:
    """Return the valid height, or the length of a velocity, of the local position."""
    name = "vehicle_local_position"
    table = builder.table(name)
    if table is None or not all(column in table for column in names):
        return None
    x = columns(table, *names)
    x = -x[:, 0] if len(names) == 1 else rotation.length(x)
    x = np.where(table[valid] != 0, x, np.nan) if valid in table else x
    return builder.quiet().stream(builder.stamps(table), x, quantity.unit, name, within=quantity, allow_nan=True)


# EKFGSF_yaw_err_max, the largest sigma that EKF2 accepts.
MAX_YAW_SIGMA_RAD = 0.262


def yaw_estimator_stream(builder: TopicBuilder) -> Stream | None:
    """Return EKF-GSF's valid headings from GNSS motion with their sigma (n, 2) in rad, None without any."""
    names = ("yaw_composite", "yaw_variance")
    found = {i: t for i, t in builder.topics("yaw_estimator_status").items() if all(name in t for name in names)}
    if not found:
        return None
    instance = min(found, key=lambda i: (i != selected_instance(builder), i))
    table = found[instance]
    yaw, variance = columns(table, *names).T
    sigma = np.sqrt(np.where(variance > 0.0, variance, np.nan))
    valid = sigma < MAX_YAW_SIGMA_RAD
    if "yaw_composite_valid" in table:
        valid &= table["yaw_composite_valid"] != 0
    if not valid.any():
        return None
    sampled = sample_stamps(table)
    return builder.stream(
        builder.stamps(table)[valid],
        np.column_stack([yaw, sigma])[valid],
        "rad",
        f"yaw_estimator_status:{instance}",
        frame="NED",
        within=limits.ESTIMATED_YAW,
        t_sample_us=None if sampled is None else sampled[valid],
    )


# --- test ratios and reports ------------------------------------------------------------------------------------

TEST_RATIO_COLUMNS = {
    "mag_test_ratio": "compass",
    "hdg_test_ratio": "compass",
    "vel_test_ratio": "velocity",
    "pos_test_ratio": "position",
    "hgt_test_ratio": "height",
    "tas_test_ratio": "airspeed",
}
# Columns of ``estimator_innovation_test_ratios`` by aid.
SQUARED_RATIO_COLUMNS = {
    "compass": ("mag_field", "heading"),
    "velocity": ("gps_hvel", "gps_vvel"),
    "position": ("gps_hpos",),
    "height": ("baro_vpos", "gps_vpos"),
    "airspeed": ("airspeed",),
}
# Fusions with numerical failures, by bit of ``filter_fault_flags`` up to PX4 1.14.
FUSION_FAULTS = (
    "compass x",
    "compass y",
    "compass z",
    "compass heading",
    "declination",
    "airspeed",
    "sideslip",
    "optical flow x",
    "optical flow y",
    "velocity north",
    "velocity east",
    "velocity down",
    "position north",
    "position east",
    "position down",
    "accelerometer bias",
)
# The first bits are equal in all versions. Since ``ver_sw_release`` 1.15 bits 10 and 11 are FORCE_FAULTS (EKF/common.h,
# fault_status_u), and there are no bits for velocity and position.
STABLE_FAULT_BITS, MOVED_FAULTS_RELEASE = 9, 0x010F0000
FORCE_FAULTS = {10: "bad vertical acceleration", 11: "a clipping accelerometer"}
FORCE_FAULT_CAUSE = "Vibration that the accelerometer clips or rectifies, or a sensor that is stuck."


def innovation_tests(builder: TopicBuilder) -> list[InnovationTest]:
    """Return the test ratios of the instance that flew longest, one for each aid."""
    instance = selected_instance(builder)
    found: dict[str, InnovationTest] = {}
    for name in ("estimator_status", "estimator_innovation_test_ratios"):
        table = builder.table(name, instance)
        if table is None or len(table) < 2:
            continue
        table, t = builder.near_rows(table)
        if name == "estimator_status":
            for column, aid in TEST_RATIO_COLUMNS.items():
                if column in table and aid not in found:
                    source = f"{name}:{instance}.{column}"
                    ratio = np.asarray(builder.within(table.value(column), limits.TEST_RATIO, source), np.float64)
                    found[aid] = InnovationTest(aid, t, ratio, source)
            continue
        for aid, names in SQUARED_RATIO_COLUMNS.items():
            if aid not in found and (squared := _largest_ratio(table, names)) is not None:
                found[aid] = InnovationTest(aid, t, np.sqrt(squared), f"{name}:{instance}.{names[0]}")
    return [found[aid] for aid in SQUARED_RATIO_COLUMNS if aid in found]


def _largest_ratio(table: Table, names: tuple[str, ...]) -> Array | None:
    """Return the largest squared ratio (n,) of some columns, NaN without a finite one (axes not fused).

    None if no column is logged or all are zero.
    """
    have = [name for name in names if name in table]
    if not have:
        return None
    x = columns(table, *have)
    possible = np.isfinite(x) & ~limits.TEST_RATIO.outside(x)
    largest = np.max(np.where(possible, x, -1.0), axis=1)
    return np.where(largest >= 0.0, largest, np.nan) if np.any(largest > 0.0) else None


def report_faults(builder: TopicBuilder) -> None:
    """Report failed fusions and accelerometer faults, at their first time."""
    table = builder.table("estimator_status")
    if table is None or len(table) < 2:
        return
    table, t = builder.near_rows(table)
    if "filter_fault_flags" not in table:
        return
    flags = table["filter_fault_flags"].astype(np.int64)
    bits = int(np.bitwise_or.reduce(flags)) if len(flags) else 0
    moved = _has_moved_faults(builder)
    known = FUSION_FAULTS[:STABLE_FAULT_BITS] if moved else FUSION_FAULTS
    failed = [name for k, name in enumerate(known) if bits >> k & 1]
    forces = [name for k, name in FORCE_FAULTS.items() if moved and bits >> k & 1]
    if failed:
        text = f"The EKF failed numerically: {', '.join(failed)}."
        _add_fault(builder, t, flags, 2 ** len(known) - 1, text, "Sensors contradict each other or are stuck.")
    if forces:
        text, mask = f"The EKF found {' and '.join(forces)}.", sum(1 << k for k in FORCE_FAULTS)
        _add_fault(builder, t, flags, mask, text, FORCE_FAULT_CAUSE, GENERAL_REMEDIES["vibration"])


def _add_fault(
    builder: TopicBuilder, t: Array, flags: NDArray[np.int64], mask: int, text: str, cause: str, remedy: str = ""
) -> None:
    """Add a problem at the first time at which a bit of the mask is set."""
    first = float(t[np.argmax(flags & mask != 0)])
    builder.problems.append(Problem("ekf_fault", "warning", text, t=first, cause=cause, remedy=remedy))


def _has_moved_faults(builder: TopicBuilder) -> bool:
    """Return whether fault bits are those of 1.15, by names of logged flags, else by version."""
    named = builder.table("estimator_status_flags")
    if named is not None and "fs_bad_acc_vertical" in named:
        return "fs_bad_vel_n" not in named
    release = builder.messages.info.get("ver_sw_release")
    return isinstance(release, (int, np.integer)) and int(release) >= MOVED_FAULTS_RELEASE


def report_failsafe(builder: TopicBuilder) -> None:
    """Report failsafes, at the first one's time."""
    table = builder.table("vehicle_status")
    if table is None or "failsafe" not in table:
        return
    table, t = builder.near_rows(table)
    on = table["failsafe"].astype(np.int64) != 0
    starts = np.flatnonzero(np.diff(on.astype(np.int8), prepend=0) == 1)
    if len(starts):
        builder.problem("failsafe", "warning", "The autopilot was in failsafe.", float(t[starts[0]]), None, len(starts))
