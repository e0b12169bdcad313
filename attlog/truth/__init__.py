"""A truth that the user brings: motion capture, RTK, vision or another estimator, put on a log's clock and axes."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from attlog import formats
from attlog.base.errors import NotALog, UsageError
from attlog.flight import read
from attlog.flight.model import Attitude, FlightLog, Stream
from attlog.segments import gaps
from attlog.truth import request, trajectory
from attlog.truth.fit import aligned
from attlog.truth.request import TruthRequest, check
from attlog.truth.trajectory import Trajectory

__all__ = ["brought", "check"]

EXTERNAL = ("vehicle_mocap_odometry", "vehicle_visual_odometry", "vehicle_vision_attitude")
"""Attitudes of a PX4 log that others measured."""
DUAL_ANTENNA, LEAST = "gnss_yaw", 20
"""The heading of a receiver with two antennas, which goes with the smoother's tilt; so many make one."""


def brought(log: FlightLog, given: str) -> FlightLog:
    """A copy of the log with the truth that is ``given``: ``NAME[:offset=S,north=true,topic=T]``.

    NAME is a trajectory (TUM, EuRoC, a table with a header), another log or bag, a folder in which one bears the log's
    own name, a topic of the log, or ``gnss_yaw``, which is a heading alone (``true_heading`` of the copy). Clock, body
    and earth axes are found by gyro and gravity; ``truth.fit`` of the copy tells them. UsageError for what is not
    there, does not follow the gyro or turns too little; LogUnreadable and NotALog for files.
    """
    asked = request.parsed(given)
    path = asked.path
    if path is None and asked.name == DUAL_ANTENNA:
        return replace(log, true_heading=_dual_antenna(log))
    if path is None:
        return replace(log, truth=aligned(log, _of_topic(log, asked.name), asked, own_clock=True))
    if path.is_dir():
        path = _beside(path, log.path)
    return replace(log, truth=aligned(log, _of_file(path, asked), asked))


def _dual_antenna(log: FlightLog) -> Stream:
    """The heading of the first receiver with two antennas. UsageError without one."""
    for gnss in log.gnss:
        heading = gnss.heading
        if heading is not None and len(heading.t) >= LEAST:
            t, yaw = gaps.rising(heading.t, heading.x)
            return replace(heading, t=t, x=yaw)
    raise UsageError(f"--truth {DUAL_ANTENNA}: no receiver of {log.path.name} tells a heading of two antennas")


def _beside(folder: Path, log: Path) -> Path:
    """The file in a folder that bears the log's own name. UsageError where none or several do."""
    names = sorted(name for name in os.listdir(folder) if name.partition(".")[0] == log.name.partition(".")[0])
    if len(names) != 1:
        which = f"several named {log.stem}: {', '.join(names[:5])}" if names else f"none named {log.stem}.*"
        raise UsageError(f"--truth {folder}: a folder with a truth for each log, and {which}")
    return folder / names[0]


def _of_file(path: Path, asked: TruthRequest) -> Trajectory:
    """The trajectory of a file: of a log its pose, truth or onboard attitude, else of a text."""
    try:
        formats.recognise(path)
    except NotALog:
        return trajectory.read(path)
    other = read(path)
    if asked.topic or other.poses:
        return _of_topic(other, asked.topic)
    attitude = other.truth or other.onboard_attitude
    if attitude is None:
        raise UsageError(f"--truth {path}: holds no attitude")
    return _of_attitude(path.name, attitude, known_axes=True)


def _of_topic(log: FlightLog, topic: str) -> Trajectory:
    """A pose or an attitude of a log by its topic; the only one where none is named. UsageError for another."""
    external = {name: log.attitudes[name] for name in EXTERNAL if name in log.attitudes}
    poses = log.poses | external
    if not topic and len(poses) == 1:
        topic = next(iter(poses))
    if topic in poses:
        return _of_attitude(topic, poses[topic], known_axes=False)
    if topic in log.attitudes:
        return _of_attitude(topic, log.attitudes[topic], known_axes=True)
    antennas = [DUAL_ANTENNA] if any(gnss.yaw is not None for gnss in log.gnss) else []
    names = [*poses, *(name for name in log.attitudes if name not in poses), *antennas]
    known = ", ".join(names) or "no attitude at all"
    what = f"no file, and {log.path.name} has no topic {topic!r}" if topic else "name one of its topics with :topic="
    raise UsageError(f"--truth {topic or log.path.name}: {what}; it holds {known}")


def _of_attitude(name: str, attitude: Attitude, known_axes: bool) -> Trajectory:
    t = attitude.t if attitude.t_sample is None else attitude.t_sample
    return replace(trajectory.made(name, t, {"body to earth": attitude.q}, attitude.position), known_axes=known_axes)
