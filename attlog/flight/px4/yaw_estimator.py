"""The heading that PX4 finds from GNSS motion without a compass: ``yaw_estimator_status`` (EKF-GSF, since 1.11).

``yaw_composite`` rad and ``yaw_variance`` rad^2 in all eras; ``timestamp_sample`` since 1.12,
``yaw_composite_valid`` since 1.14. Before, the EKF itself asked for one sigma below 15 deg (EKFGSF_yaw_err_max).
"""

from __future__ import annotations

import numpy as np

from attlog.flight import physics
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.model import Stream
from attlog.flight.px4.gyro_bias import selected
from attlog.flight.px4.imus import sample_stamps, stamps

TOPIC = "yaw_estimator_status"
MOST_SIGMA_RAD = 0.262


def yaw_estimator(builder: LogBuilder) -> Stream | None:
    """Heading and its one sigma (n, 2) in rad where the estimator calls it valid; None where the log does not tell."""
    messages = builder.messages
    names = ("yaw_composite", "yaw_variance")
    found = [i for i in messages.instances(TOPIC) if all(name in messages[TOPIC, i] for name in names)]
    if not found:
        return None
    instance = min(found, key=lambda i: (i != selected(builder), i))
    table = messages[TOPIC, instance]
    yaw, variance = columns(table, *names).T
    sigma = np.sqrt(np.where(variance > 0.0, variance, np.nan))
    valid = sigma < MOST_SIGMA_RAD
    if "yaw_composite_valid" in table:
        valid &= table["yaw_composite_valid"] != 0
    if not valid.any():
        return None
    sampled = sample_stamps(table)
    return builder.stream(
        stamps(table)[valid],
        np.column_stack([yaw, sigma])[valid],
        "rad",
        f"{TOPIC}:{instance}",
        frame="NED",
        within=physics.ESTIMATED_YAW,
        t_sample_us=None if sampled is None else sampled[valid],
    )
