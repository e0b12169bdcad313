"""What PX4 reports of its estimator and of failsafes: ``estimator_status`` and ``vehicle_status``.

Test ratios above 1 are measurements that the EKF rejects, whether a version logs the
ratio or its square root. Bits of ``filter_fault_flags``: ``msg/EstimatorStatus.msg``.
"""

from __future__ import annotations

import numpy as np

from attlog.flight import physics
from attlog.flight.builder import LogBuilder
from attlog.flight.model import InnovationTest, Problem
from attlog.flight.px4.gyro_bias import selected
from attlog.flight.px4.imus import stamps

RATIOS = {
    "mag_test_ratio": "compass",
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
"""Fusions that failed numerically, by bit; later versions add bits that are no failures of fusion."""


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
            bits = np.bitwise_or.reduce(flags)
            names = [n for k, n in enumerate(FAULTS) if bits >> k & 1]
            if names:
                builder.problems.append(
                    Problem(
                        "ekf_fault",
                        "warning",
                        f"The EKF failed numerically: {', '.join(names)}.",
                        t=float(t[np.argmax(flags != 0)]),
                        cause="Sensors contradict each other or are stuck.",
                    )
                )


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


def innovation_tests(builder: LogBuilder) -> list[InnovationTest]:
    """The test ratios of the instance that flew longest, one for each aid."""
    instance = selected(builder)
    table = builder.messages.tables.get(("estimator_status", instance))
    if table is None or len(table) < 2:
        return []
    table = table.rows(builder.near(stamps(table)))
    t = builder.seconds(stamps(table))
    found = []
    for column, aid in RATIOS.items():
        if column in table:
            source = f"estimator_status:{instance}.{column}"
            ratio = np.asarray(builder.within(table.value(column), physics.TEST_RATIO, source), np.float64)
            found.append(InnovationTest(aid, t, ratio, source))
    return found
