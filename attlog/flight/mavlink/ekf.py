"""What telemetry tells of the onboard estimator: how far its aids were from what it expected.

ArduPilot's EKF_STATUS_REPORT carries the roots of the test ratios under the name of variances (AP_NavEKF3
``getVariances``), PX4's ESTIMATOR_STATUS those of ``estimator_status``: innovation over gate and standard deviation,
above 1 rejected.
"""

from __future__ import annotations

import numpy as np

from attlog.flight import physics
from attlog.flight.builder import LogBuilder
from attlog.flight.mavlink.clock import PacketClock
from attlog.flight.model import InnovationTest

COLUMNS = {
    "EKF_STATUS_REPORT": {
        "compass": "compass_variance",
        "velocity": "velocity_variance",
        "position": "pos_horiz_variance",
        "height": "pos_vert_variance",
        "airspeed": "airspeed_variance",
    },
    "ESTIMATOR_STATUS": {
        "compass": "mag_ratio",
        "velocity": "vel_ratio",
        "position": "pos_horiz_ratio",
        "height": "pos_vert_ratio",
        "airspeed": "tas_ratio",
    },
}


def innovation_tests(builder: LogBuilder, clock: PacketClock, instance: int) -> list[InnovationTest]:
    """The test ratios that were sent, one for each aid."""
    for name, by_aid in COLUMNS.items():
        table = builder.messages.tables.get((name, instance))
        if table is None or len(table) < 2:
            continue
        stamps = clock.of(table)
        near = builder.near(stamps)
        table, t = table.rows(near), builder.seconds(stamps[near])
        order = np.argsort(t, kind="stable")
        found = []
        for aid, column in by_aid.items():
            if column in table:
                ratio = np.asarray(table.value(column), np.float64)[order]
                possible = (ratio >= physics.TEST_RATIO.low) & (ratio <= physics.TEST_RATIO.high)
                found.append(InnovationTest(aid, t[order], np.where(possible, ratio, np.nan), f"{name}.{column}"))
        return found
    return []
