"""What PX4 reports of its estimator and of failsafes: ``estimator_status`` and ``vehicle_status``.

Test ratios above 1 are measurements that the EKF rejects, whether a version logs the
ratio or its square root. Bits of ``filter_fault_flags``: ``msg/EstimatorStatus.msg``.
"""

from __future__ import annotations

import numpy as np

from attlog.flight import physics
from attlog.flight.builder import LogBuilder
from attlog.flight.model import Problem
from attlog.flight.px4.imus import stamps

REJECTED_S = 1.0
"""Rejected for this long without a break: single outliers are what the test is for."""
RATIOS = {
    "mag_test_ratio": ("compass", "A disturbed or badly calibrated compass, or a wrong heading."),
    "vel_test_ratio": ("velocity", "Bad GNSS, vibration, or a wrong attitude."),
    "pos_test_ratio": ("horizontal position", "Bad GNSS, vibration, or a wrong attitude."),
    "hgt_test_ratio": ("height", "A drifting barometer or vibration."),
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
    for column, (what, cause) in RATIOS.items():
        if column not in table:
            continue
        ratio = builder.within(table.value(column), physics.TEST_RATIO, f"estimator_status.{column}")
        spans = _longer(t, ratio > 1.0, REJECTED_S)
        if spans:
            seconds = sum(b - a for a, b in spans)
            worst = float(np.nanmax(ratio[ratio > 1.0]))
            text = f"The EKF rejected its {what} for {seconds:.0f} s in all, by up to {worst:.1f} times its limit"
            builder.problems.append(
                Problem(
                    f"rejected_{column.partition('_')[0]}",
                    "warning",
                    f"{text} ({column}).",
                    t=spans[0][0],
                    count=len(spans),
                    value=round(worst, 2),
                    unit="",
                    cause=cause,
                )
            )
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


def _longer(t: np.ndarray, bad: np.ndarray, least: float) -> list[tuple[float, float]]:
    """Spans (t0, t1) in s of consecutive bad records (n,) that last at least so long."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], bad.astype(np.int8), [0]])))
    pairs = [(float(t[a]), float(t[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return [(a, b) for a, b in pairs if b - a >= least]
