"""Which gyro bias does PX4's own estimator take off the gyro that is replayed?

``estimator_sensor_bias.gyro_bias`` (since 1.11): rad/s in body axes, to be subtracted
from the calibrated gyro. Before, ``estimator_status.states[10..12]`` holds an angle per
step of the filter; the length of that step is not logged, so no rate follows from it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.flight import limits
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.imu import longest_held
from attlog.flight.model import Array, Imu, InnovationTest, Problem, Stream, TimeLine
from attlog.flight.px4.imu import sample_stamps, topic_stamps
from attlog.formats.table import Table

GYRO_BIAS_TOPIC = "estimator_sensor_bias"


def gyro_bias_stream(builder: LogBuilder, imu: Imu | None) -> Stream | None:
    """Gyro bias (n, 3) in rad/s FRD to subtract from ``imu.gyro``; None where the log does not tell.

    It is that of the instance selected longest, or of another one on the replayed gyro.
    ``vehicle_angular_velocity`` has the estimator's bias taken off already, and a gyro
    without its calibration is not the one that the estimator corrects: None.
    """
    messages = builder.messages
    found = {
        i: messages[GYRO_BIAS_TOPIC, i]
        for i in messages.instances(GYRO_BIAS_TOPIC)
        if "gyro_bias" in messages[GYRO_BIAS_TOPIC, i]
    }
    if imu is None or not imu.calibrated or imu.gyro.source.startswith("vehicle_angular_velocity"):
        return None
    first = selected_instance(builder)
    for i in sorted(found, key=lambda i: (i != first, i)):
        if on_same_gyro(found[i], imu):
            table = found[i]
            return builder.stream(
                topic_stamps(table),
                columns(table, "gyro_bias"),
                "rad/s",
                f"{GYRO_BIAS_TOPIC}:{i}",
                frame="FRD",
                within=limits.GYRO_BIAS,
            )
    return None


def selected_instance(builder: LogBuilder) -> int:
    """The estimator instance that flew longest, 0 where there is no selector."""
    table = builder.messages.tables.get(("estimator_selector_status", 0))
    if table is None or "primary_instance" not in table:
        return 0
    return longest_held(topic_stamps(table), table["primary_instance"].astype(np.int64).tolist()) or 0


def on_same_gyro(table: Table, imu: Imu) -> bool:
    """Whether an instance runs on the replayed gyro, as far as both tell their device."""
    if imu.device in (None, "", "0") or "gyro_device_id" not in table:
        return True
    ids = table["gyro_device_id"]
    return not ids.any() or str(int(np.median(ids[ids > 0]))) == imu.device


# The heading that PX4 finds from GNSS motion without a compass: ``yaw_estimator_status`` (EKF-GSF, since 1.11).
#
# ``yaw_composite`` rad and ``yaw_variance`` rad^2 in all eras; ``timestamp_sample`` since 1.12,
# ``yaw_composite_valid`` since 1.14. Before, the EKF itself asked for one sigma below 15 deg (EKFGSF_yaw_err_max).

YAW_TOPIC = "yaw_estimator_status"
MAX_YAW_SIGMA_RAD = 0.262


def yaw_estimator_stream(builder: LogBuilder) -> Stream | None:
    """Heading and its one sigma (n, 2) in rad where the estimator calls it valid; None where the log does not tell."""
    messages = builder.messages
    names = ("yaw_composite", "yaw_variance")
    found = [i for i in messages.instances(YAW_TOPIC) if all(name in messages[YAW_TOPIC, i] for name in names)]
    if not found:
        return None
    instance = min(found, key=lambda i: (i != selected_instance(builder), i))
    table = messages[YAW_TOPIC, instance]
    yaw, variance = columns(table, *names).T
    sigma = np.sqrt(np.where(variance > 0.0, variance, np.nan))
    valid = sigma < MAX_YAW_SIGMA_RAD
    if "yaw_composite_valid" in table:
        valid &= table["yaw_composite_valid"] != 0
    if not valid.any():
        return None
    sampled = sample_stamps(table)
    return builder.stream(
        topic_stamps(table)[valid],
        np.column_stack([yaw, sigma])[valid],
        "rad",
        f"{YAW_TOPIC}:{instance}",
        frame="NED",
        within=limits.ESTIMATED_YAW,
        t_sample_us=None if sampled is None else sampled[valid],
    )


# What PX4 reports of its estimator and of failsafes: ``estimator_status`` and ``vehicle_status``.
#
# Test ratios above 1 are measurements that the EKF rejects. ``estimator_status`` holds roots, innovation over gate
# and standard deviation, in all versions; low-passed since 1.16, where the heading's is called ``hdg_test_ratio``.
# ``estimator_innovation_test_ratios`` holds squares, of each axis; the largest is taken for aids that the former
# lacks.
# Bits of ``filter_fault_flags``: ``msg/EstimatorStatus.msg``.

TEST_RATIO_COLUMNS = {
    "mag_test_ratio": "compass",
    "hdg_test_ratio": "compass",
    "vel_test_ratio": "velocity",
    "pos_test_ratio": "position",
    "hgt_test_ratio": "height",
    "tas_test_ratio": "airspeed",
}
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
"""Fusions that failed numerically, by bit, to PX4 1.14; later bits are no failures of fusion."""
STABLE_FAULT_BITS, MOVED_FAULTS_RELEASE = 9, 0x010F0000
"""The first bits mean the same in all versions; from ``ver_sw_release`` 1.15 on bits 10 and 11 are BY_FORCE
(EKF/common.h, fault_status_u), and velocity and position have none."""
FORCE_FAULTS = {10: "bad vertical acceleration", 11: "a clipping accelerometer"}


def report_estimator(builder: LogBuilder) -> None:
    """Add to the builder's problems what the autopilot says of its own estimator."""
    builder.attempt("estimator_status", lambda: _report_faults(builder), None)
    builder.attempt("vehicle_status", lambda: _report_failsafe(builder), None)


def _report_faults(builder: LogBuilder) -> None:
    table = builder.messages.tables.get(("estimator_status", 0))
    if table is None or len(table) < 2:
        return
    table = table.rows(builder.near(topic_stamps(table)))
    t = builder.seconds(topic_stamps(table))
    if "filter_fault_flags" in table:
        flags = table["filter_fault_flags"].astype(np.int64)
        if flags.any():
            bits = int(np.bitwise_or.reduce(flags))
            moved = _has_moved_faults(builder)
            known = FUSION_FAULTS[:STABLE_FAULT_BITS] if moved else FUSION_FAULTS
            failed = [name for k, name in enumerate(known) if bits >> k & 1]
            felt = [name for k, name in FORCE_FAULTS.items() if moved and bits >> k & 1]
            if failed:
                _add_fault(builder, t, flags, 2 ** len(known) - 1, f"The EKF failed numerically: {', '.join(failed)}.")
            if felt:
                _add_fault(builder, t, flags, sum(1 << k for k in FORCE_FAULTS), f"The EKF found {' and '.join(felt)}.")


def _add_fault(builder: LogBuilder, t: Array, flags: NDArray[np.int64], mask: int, text: str) -> None:
    """A problem with the first time at which a bit of the mask is set."""
    first = float(t[np.argmax(flags & mask != 0)])
    cause = "Sensors contradict each other or are stuck."
    builder.problems.append(Problem("ekf_fault", "warning", text, t=first, cause=cause))


def _has_moved_faults(builder: LogBuilder) -> bool:
    """Whether the log's firmware has the bits of 1.15: by the flags' own names, else by its version."""
    named = builder.messages.tables.get(("estimator_status_flags", 0))
    if named is not None and "fs_bad_acc_vertical" in named:
        return "fs_bad_vel_n" not in named
    release = builder.messages.info.get("ver_sw_release")
    return isinstance(release, (int, np.integer)) and int(release) >= MOVED_FAULTS_RELEASE


def _report_failsafe(builder: LogBuilder) -> None:
    table = builder.messages.tables.get(("vehicle_status", 0))
    if table is None or "failsafe" not in table:
        return
    table = table.rows(builder.near(topic_stamps(table)))
    on = table["failsafe"].astype(np.int64) != 0
    starts = np.flatnonzero(np.diff(on.astype(np.int8), prepend=0) == 1)
    if len(starts):
        first = float(builder.seconds(topic_stamps(table))[starts[0]])
        builder.problems.append(
            Problem("failsafe", "warning", "The autopilot was in failsafe.", t=first, count=len(starts))
        )


SQUARED_RATIO_COLUMNS = {
    "compass": ("mag_field", "heading"),
    "velocity": ("gps_hvel", "gps_vvel"),
    "position": ("gps_hpos",),
    "height": ("baro_vpos", "gps_vpos"),
    "airspeed": ("airspeed",),
}
"""Columns of ``estimator_innovation_test_ratios`` by aid."""


def innovation_tests(builder: LogBuilder) -> list[InnovationTest]:
    """The test ratios of the instance that flew longest, one for each aid."""
    instance = selected_instance(builder)
    found: dict[str, InnovationTest] = {}
    for name in ("estimator_status", "estimator_innovation_test_ratios"):
        table = builder.messages.tables.get((name, instance))
        if table is None or len(table) < 2:
            continue
        table = table.rows(builder.near(topic_stamps(table)))
        t = builder.seconds(topic_stamps(table))
        if name == "estimator_status":
            for column, aid in TEST_RATIO_COLUMNS.items():
                if column in table and aid not in found:
                    source = f"{name}:{instance}.{column}"
                    ratio = np.asarray(builder.within(table.value(column), limits.TEST_RATIO, source), np.float64)
                    found[aid] = InnovationTest(aid, t, ratio, source)
            continue
        for aid in SQUARED_RATIO_COLUMNS:
            if aid not in found and (squared := _largest_ratio(table, SQUARED_RATIO_COLUMNS[aid])) is not None:
                found[aid] = InnovationTest(
                    aid, t, np.sqrt(squared), f"{name}:{instance}.{SQUARED_RATIO_COLUMNS[aid][0]}"
                )
    return [found[aid] for aid in SQUARED_RATIO_COLUMNS if aid in found]


def _largest_ratio(table: Table, names: tuple[str, ...]) -> Array | None:
    """The largest squared ratio (n,) of some columns; NaN, None where there is none: axes not fused are infinite."""
    have = [name for name in names if name in table]
    if not have:
        return None
    x = columns(table, *have)
    possible = np.isfinite(x) & (x >= limits.TEST_RATIO.low) & (x <= limits.TEST_RATIO.high)
    largest = np.max(np.where(possible, x, -1.0), axis=1)
    return np.where(largest >= 0.0, largest, np.nan) if np.any(largest > 0.0) else None


def selected_instance_line(builder: LogBuilder) -> TimeLine | None:
    """Which instance flew; None where there is no selector."""
    table = builder.messages.tables.get(("estimator_selector_status", 0))
    if table is None or "primary_instance" not in table:
        return None
    numbers = table["primary_instance"].astype(np.int64).tolist()
    return builder.time_line(topic_stamps(table), numbers, "estimator_selector_status")
