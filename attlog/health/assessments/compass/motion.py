"""May the attitude by motion alone judge a compass? It shares nothing with any compass, and must know its heading.

A smoother that was given the compass believes part of what is wrong with it: by 79 mG where one without it erred by 9
to 22. Its heading comes from GNSS acceleration: a vehicle that stands still in the air shows none, whatever the
smoother claims (85 to 132 deg wrong at a sigma of 1.8 to 5 deg).
"""

from __future__ import annotations

import numpy as np

from attlog.base import rotation
from attlog.estimators.evidence.gnss_heading import velocity_steps
from attlog.flight.model import FlightLog
from attlog.health.assessments.compass.samples import air_spans
from attlog.health.assessments.model import HealthCase, MotionAttitude
from attlog.reference import declination
from attlog.segments.spans import inside

LEAST_S = 30.0
"""Seconds of flight in which the heading is known to 5 deg."""
LEAST_M_S2 = 0.25
"""Horizontal acceleration (rms of changes of velocity over 1 s) that shows a heading."""
FLY = "Fly forward, stop hard, turn and repeat for a minute."
DELAY_S = 0.1
"""GNSS velocity is about so late; the rms of accelerations hardly depends on it."""


def why_none(case: HealthCase) -> str:
    """Why no attitude can judge the compasses of this log, with what would help; empty where one can."""
    if case.segments is None:
        return "No inertial unit of this log can be replayed, so nothing judges the compass."
    flown = air_spans(case.segments)
    if not flown:
        return "The log holds no flight in which the compass can be judged."
    if declination.model(case.log) is None:
        return "The log holds no position, so the earth's field is unknown."
    motion = case.motion
    if motion is None:
        return "Without GNSS velocity nothing but the compass shows the heading."
    air = inside(motion.t, flown)
    if not air.any() or not np.isfinite(motion.sigma_heading[air]).any():
        return "No attitude by motion covers the flight."
    if np.min(motion.sigma_heading[air]) >= np.pi:
        why = str(motion.quality.get("heading_why", "something contradicts it"))
        return f"Motion shows no heading that can be trusted: {why}."
    moved = acceleration(case.log, motion, case)
    if not moved >= LEAST_M_S2:
        return f"Horizontal acceleration of {moved:.2f} m/s^2 shows no heading ({LEAST_M_S2} needed). {FLY}"
    return ""


def acceleration(log: FlightLog, motion: MotionAttitude, case: HealthCase) -> float:
    """Horizontal acceleration in the air, rms in m/s^2: by GNSS or by the force, whichever shows less.

    GNSS alone takes its noise for acceleration, the force alone the errors of its tilt, which change slowly: the mean
    of every 30 s goes.
    """
    assert case.segments is not None
    imu = log.replay_imu
    receiver = next((r for r in log.gnss if np.isfinite(r.vel_ned).any()), None)
    if imu is None or receiver is None:
        return 0.0
    flown = air_spans(case.segments)
    near = inside(imu.acc.t_best, [(a - 2.0, b + 2.0) for a, b in flown])
    t, acc = imu.acc.t_best[near], imu.acc.x[near]
    q, _ = rotation.interpolated(motion.t, motion.q, motion.segment, t)
    steps = velocity_steps(t, acc, q, receiver.t, receiver.vel_ned, np.array(flown))
    if not len(steps.t0):
        return 0.0
    force = steps.force[int(np.argmin(np.abs(steps.delays - DELAY_S)))]
    _, number = np.unique(steps.t0 // 30.0, return_inverse=True)
    count = np.bincount(number)
    force = force - ((np.bincount(number, force.real) + 1j * np.bincount(number, force.imag)) / count)[number]
    seconds = np.maximum(steps.t1 - steps.t0, 0.1)
    return float(min(np.sqrt(np.mean(np.abs(x / seconds) ** 2)) for x in (steps.gnss, force)))
