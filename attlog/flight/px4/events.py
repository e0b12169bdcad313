"""What PX4 reports of its estimator and of failsafes: ``estimator_status`` and ``vehicle_status``.

Test ratios above 1 are measurements that the EKF rejects. ``estimator_status`` holds roots, innovation over gate
and standard deviation, in all versions; low-passed since 1.16, where the heading's is called ``hdg_test_ratio``.
``estimator_innovation_test_ratios`` holds squares, of each axis; the largest is taken for aids that the former lacks.
Bits of ``filter_fault_flags``: ``msg/EstimatorStatus.msg``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.flight import physics
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.model import Array, InnovationTest, Problem, TimeLine
from attlog.flight.px4.gyro_bias import selected
from attlog.flight.px4.imus import stamps
from attlog.formats.base import Table

RATIOS = {
    "mag_test_ratio": "compass",
    "hdg_test_ratio": "compass",
    "vel_test_ratio": "velocity",
    "pos_test_ratio": "position",
    "hgt_test_ratio": "height",
    "tas_test_ratio": "airspeed",
}
FAULTS = (
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
LASTING, MOVED_FROM = 9, 0x010F0000
"""The first bits mean the same in all versions; from ``ver_sw_release`` 1.15 on bits 10 and 11 are BY_FORCE
(EKF/common.h, fault_status_u), and velocity and position have none."""
BY_FORCE = {10: "bad vertical acceleration", 11: "a clipping accelerometer"}


def report(builder: LogBuilder) -> None:
    """Add to the builder's problems what the autopilot says of its own estimator."""
    builder.attempt("estimator_status", lambda: _estimator(builder), None)
    builder.attempt("vehicle_status", lambda: _failsafe(builder), None)


def _estimator(builder: LogBuilder) -> None:
    table = builder.messages.tables.get(("estimator_status", 0))
    if table is None or len(table) < 2:
        return
    table = table.rows(builder.near(stamps(table)))
    t = builder.seconds(stamps(table))
    if "filter_fault_flags" in table:
        flags = table["filter_fault_flags"].astype(np.int64)
        if flags.any():
            bits = int(np.bitwise_or.reduce(flags))
            moved = _moved(builder)
            known = FAULTS[:LASTING] if moved else FAULTS
            failed = [name for k, name in enumerate(known) if bits >> k & 1]
            felt = [name for k, name in BY_FORCE.items() if moved and bits >> k & 1]
            if failed:
                _fault(builder, t, flags, 2 ** len(known) - 1, f"The EKF failed numerically: {', '.join(failed)}.")
            if felt:
                _fault(builder, t, flags, sum(1 << k for k in BY_FORCE), f"The EKF found {' and '.join(felt)}.")


def _fault(builder: LogBuilder, t: Array, flags: NDArray[np.int64], mask: int, text: str) -> None:
    """A problem with the first time at which a bit of the mask is set."""
    first = float(t[np.argmax(flags & mask != 0)])
    cause = "Sensors contradict each other or are stuck."
    builder.problems.append(Problem("ekf_fault", "warning", text, t=first, cause=cause))


def _moved(builder: LogBuilder) -> bool:
    """Whether the log's firmware has the bits of 1.15: by the flags' own names, else by its version."""
    named = builder.messages.tables.get(("estimator_status_flags", 0))
    if named is not None and "fs_bad_acc_vertical" in named:
        return "fs_bad_vel_n" not in named
    release = builder.messages.info.get("ver_sw_release")
    return isinstance(release, (int, np.integer)) and int(release) >= MOVED_FROM


def _failsafe(builder: LogBuilder) -> None:
    table = builder.messages.tables.get(("vehicle_status", 0))
    if table is None or "failsafe" not in table:
        return
    table = table.rows(builder.near(stamps(table)))
    on = table["failsafe"].astype(np.int64) != 0
    starts = np.flatnonzero(np.diff(on.astype(np.int8), prepend=0) == 1)
    if len(starts):
        first = float(builder.seconds(stamps(table))[starts[0]])
        builder.problems.append(
            Problem("failsafe", "warning", "The autopilot was in failsafe.", t=first, count=len(starts))
        )


SQUARED = {
    "compass": ("mag_field", "heading"),
    "velocity": ("gps_hvel", "gps_vvel"),
    "position": ("gps_hpos",),
    "height": ("baro_vpos", "gps_vpos"),
    "airspeed": ("airspeed",),
}
"""Columns of ``estimator_innovation_test_ratios`` by aid."""


def innovation_tests(builder: LogBuilder) -> list[InnovationTest]:
    """The test ratios of the instance that flew longest, one for each aid."""
    instance = selected(builder)
    found: dict[str, InnovationTest] = {}
    for name in ("estimator_status", "estimator_innovation_test_ratios"):
        table = builder.messages.tables.get((name, instance))
        if table is None or len(table) < 2:
            continue
        table = table.rows(builder.near(stamps(table)))
        t = builder.seconds(stamps(table))
        if name == "estimator_status":
            for column, aid in RATIOS.items():
                if column in table and aid not in found:
                    source = f"{name}:{instance}.{column}"
                    ratio = np.asarray(builder.within(table.value(column), physics.TEST_RATIO, source), np.float64)
                    found[aid] = InnovationTest(aid, t, ratio, source)
            continue
        for aid in SQUARED:
            if aid not in found and (squared := _largest(table, SQUARED[aid])) is not None:
                found[aid] = InnovationTest(aid, t, np.sqrt(squared), f"{name}:{instance}.{SQUARED[aid][0]}")
    return [found[aid] for aid in SQUARED if aid in found]


def _largest(table: Table, names: tuple[str, ...]) -> Array | None:
    """The largest squared ratio (n,) of some columns; NaN, None where there is none: axes not fused are infinite."""
    have = [name for name in names if name in table]
    if not have:
        return None
    x = columns(table, *have)
    possible = np.isfinite(x) & (x >= physics.TEST_RATIO.low) & (x <= physics.TEST_RATIO.high)
    largest = np.max(np.where(possible, x, -1.0), axis=1)
    return np.where(largest >= 0.0, largest, np.nan) if np.any(largest > 0.0) else None


def lane(builder: LogBuilder) -> TimeLine | None:
    """Which instance flew; None where there is no selector."""
    table = builder.messages.tables.get(("estimator_selector_status", 0))
    if table is None or "primary_instance" not in table:
        return None
    numbers = table["primary_instance"].astype(np.int64).tolist()
    return builder.time_line(stamps(table), numbers, "estimator_selector_status")
