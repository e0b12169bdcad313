"""Does the onboard estimator take so much off the accelerometer that its attitude is tilted by it?"""

from __future__ import annotations

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Array, FlightLog
from attlog.health.model import Check
from attlog.health.sensors.accelerometer import of_imu
from attlog.health.sensors.stillness import degrees_between
from attlog.segments.model import Segments

G = 9.80665
LIMITS_DEG = (1.0, 3.0)
"""A horizontal bias of 0.17 m/s^2 tilts the level by 1 deg, 0.5 m/s^2 by 3 deg."""
EXPLAINS = 0.5
"""It explains a tilt difference at rest where it leaves less than half of it."""


def checks(log: FlightLog, segments: Segments) -> list[Check]:
    """The tilt that the estimated accelerometer bias makes, and whether gravity at rest confirms or refutes it."""
    stream = log.acc_bias
    if stream is None:
        return []
    bias = np.median(stream.x, axis=0)
    tilt = float(np.degrees(np.arctan2(np.hypot(bias[0], bias[1]), G)))
    worst = "xy"[int(np.argmax(np.abs(bias[:2])))]
    size = float(bias["xy".index(worst)])
    least, most = LIMITS_DEG
    limit = f"ok up to {least:.0f} deg of tilt, where gravity at rest does not show it up to {most:.0f}; fault above"
    text = (
        f"The onboard estimator subtracts {size:+.2f} m/s^2 from the accelerometer's {worst}: {tilt:.1f} deg of tilt."
    )
    both = differences(log, segments, bias) if tilt > LIMITS_DEG[0] else None
    seen = []
    if both is not None and both[1] < EXPLAINS * both[0]:
        plain, corrected = both
        seen = [f"It explains {plain - corrected:.1f} of {plain:.1f} deg between {log.onboard} and gravity at rest."]
    verdict = "fault" if tilt > LIMITS_DEG[1] else "warning" if seen else "ok"
    return [Check("accelerometer bias", verdict, text, round(size, 3), "m/s^2", limit, evidence=seen)]


def differences(log: FlightLog, segments: Segments, bias: Array) -> tuple[float, float] | None:
    """Median angle in deg at rest between the attitude's up and the force: as measured, and without the bias."""
    imu, onboard = log.replay_imu, log.onboard_attitude
    if imu is None or onboard is None:
        return None
    rest = segments.mask(imu.acc.t, "rest")
    q = rotation.slerp(onboard.t, of_imu(log, onboard), imu.acc.t[rest])
    known = rotation.finite(q)
    if known.sum() < 10:
        return None
    up = rotation.rotate_inverse(q[known], np.array([0.0, 0.0, -1.0]))
    found = []
    for force in (imu.acc.x[rest][known], imu.acc.x[rest][known] - bias):
        found.append(float(np.median(degrees_between(force / np.sqrt(np.sum(force**2, axis=1, keepdims=True)), up))))
    return found[0], found[1]
