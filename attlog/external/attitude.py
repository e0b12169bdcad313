"""Attitudes from files and topics, aligned to a log's clock and axes, as truth or as estimate."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog import formats
from attlog.core import rotation, timestamps
from attlog.core.errors import NotALog, UsageError
from attlog.core.sorting import median
from attlog.estimators import Estimate
from attlog.external import axes, clock
from attlog.external.read import MIN_ATTITUDES, Trajectory, TruthRequest, make_trajectory, parse_truth, read_trajectory
from attlog.flight import read
from attlog.flight.model import Angles, Attitude, FlightLog, Imu, Stream, TruthFit
from attlog.segments import increments, model

Array = NDArray[np.float64]

# Interval over which the gyro's error is negligible: the difference of increments is the truth's noise.
NOISE_S = 0.1
# Step and shortest time of the integrated gyro that shows slow errors of heading. Its own error about a line grows with
# time: 0.12 to 0.25 deg in 90 s, 0.9 in 380 s of simulated flights with exact truth.
SLOW_STEP_S, MIN_SLOW_S = 0.2, 30.0
GYRO_WALK_RAD_S = math.radians(0.25) / 90.0
# Turn by the gyro within HELD_S of a repeated pose, above which the markers were lost: at rest it stays far below.
HELD_S, LOST_TURN_DEG = 0.25, 0.5
MAX_GLITCH_POSES = 2  # between two jumps
# Topics of a PX4 log with attitudes by motion capture or vision.
EXTERNAL_TOPICS = ("vehicle_mocap_odometry", "vehicle_visual_odometry", "vehicle_vision_attitude")
# Name of a dual-antenna heading as truth (the reference takes its tilt from the smoother); fewest headings.
DUAL_ANTENNA, MIN_HEADINGS = "gnss_yaw", 20


def attach_truth(log: FlightLog, given: str) -> FlightLog:
    """Return a copy of the log with a truth: ``NAME[:offset=S,north=true,topic=T]``.

    NAME is a trajectory (TUM, EuRoC, a table with a header), another log or bag, a folder with a file of the log's own
    name, a topic of the log, or ``gnss_yaw`` (``true_heading`` of the copy). ``truth.fit`` is the fit of clock and
    axes to gyro and gravity. UsageError if the truth is missing, does not follow the gyro or turns too little;
    LogUnreadable and NotALog for files.
    """
    asked = parse_truth(given)
    path = asked.path
    if path is None and asked.name == DUAL_ANTENNA:
        return replace(log, true_heading=_dual_antenna(log))
    if path is None:
        return replace(log, truth=align_truth(log, _topic_trajectory(log, asked.name), asked, own_clock=True))
    if path.is_dir():
        path = _file_named_as_log(path, log.path)
    return replace(log, truth=align_truth(log, _file_trajectory(path, asked), asked))


def _dual_antenna(log: FlightLog) -> Stream:
    """Return the heading of the first receiver with two antennas. UsageError without one."""
    for gnss in log.gnss:
        heading = gnss.heading
        if heading is not None and len(heading.t) >= MIN_HEADINGS:
            t, yaw = model.select_rising(heading.t, heading.x)
            return replace(heading, t=t, x=yaw)
    raise UsageError(f"--truth {DUAL_ANTENNA}: no receiver of {log.path.name} tells a heading of two antennas")


def _file_named_as_log(folder: Path, log: Path) -> Path:
    """Return the only file in a folder with the log's name up to its first dot, else UsageError."""
    names = sorted(name for name in os.listdir(folder) if name.partition(".")[0] == log.name.partition(".")[0])
    if len(names) != 1:
        which = f"several named {log.stem}: {', '.join(names[:5])}" if names else f"none named {log.stem}.*"
        raise UsageError(f"--truth {folder}: a folder with a truth for each log, and {which}")
    return folder / names[0]


def _file_trajectory(path: Path, asked: TruthRequest) -> Trajectory:
    """Return the trajectory of a text file, or of a log: its pose, truth or onboard attitude."""
    try:
        formats.recognise(path)
    except NotALog:
        return read_trajectory(path).with_inverses()
    other = read(path)
    if asked.topic or other.poses:
        return _topic_trajectory(other, asked.topic)
    attitude = other.truth or other.onboard_attitude
    if attitude is None:
        raise UsageError(f"--truth {path}: holds no attitude")
    return _attitude_trajectory(path.name, attitude, known_axes=True)


def _topic_trajectory(log: FlightLog, topic: str) -> Trajectory:
    """Return a pose or attitude of a log by its topic. UsageError for an unknown topic.

    An empty topic selects the only pose.
    """
    external = {name: log.attitudes[name] for name in EXTERNAL_TOPICS if name in log.attitudes}
    poses = log.poses | external
    if not topic and len(poses) == 1:
        topic = next(iter(poses))
    if topic in poses:
        return _attitude_trajectory(topic, poses[topic], known_axes=False)
    if topic in log.attitudes:
        return _attitude_trajectory(topic, log.attitudes[topic], known_axes=True)
    antennas = [DUAL_ANTENNA] if any(gnss.yaw is not None for gnss in log.gnss) else []
    names = [*poses, *(name for name in log.attitudes if name not in poses), *antennas]
    known = ", ".join(names) or "no attitude at all"
    what = f"no file, and {log.path.name} has no topic {topic!r}" if topic else "name one of its topics with :topic="
    raise UsageError(f"--truth {topic or log.path.name}: {what}; it holds {known}")


def _attitude_trajectory(name: str, attitude: Attitude, known_axes: bool) -> Trajectory:
    t = attitude.t if attitude.t_sample is None else attitude.t_sample
    return make_trajectory(name, t, {"": attitude.q}, attitude.position, known_axes)


def align_truth(log: FlightLog, trajectory: Trajectory, request: TruthRequest, own_clock: bool = False) -> Attitude:
    """Return the truth, FRD to NED on the log's clock, with its :class:`TruthFit`.

    ``own_clock``: the trajectory is on the log's clock except for a delay. UsageError if its rates disagree with the
    gyro, are too small, or fit several clock offsets.
    """
    imu = log.replay_imu
    if imu is None:
        raise UsageError(f"--truth {trajectory.name}: no IMU is replayed that it could be aligned with")
    moving = trajectory.select(~trajectory.held)
    found = clock.find_clock(moving if len(moving.t) >= MIN_ATTITUDES else trajectory, imu, request.offset, own_clock)
    timing, late = found.timing, imu.gyro.delay
    trajectory = trajectory.select(~_lost_poses(trajectory, found, imu))
    body = trajectory.readings[found.reading]
    t = trajectory.t + timing.offset + timing.drift * (trajectory.t - found.middle) - late
    inside = (t >= imu.gyro.t_best[0]) & (t <= imu.gyro.t_best[-1])
    turn = axes.snap_to_usual(rotation.from_matrix(timing.turn), timing.turn_sigma)
    t, q = t[inside], rotation.multiply(body[inside], rotation.conjugate(turn))  # the IMU's body to its world
    world = axes.fit_world(log, imu, t, q, trajectory, inside, request.north)
    q = rotation.multiply(world.turn, q)
    rates = found.rates
    noise = _noise(t, q, imu, rates.bias, late)
    heading_var, tilt_var = timing.turn_sigma[2] ** 2, float(np.sum(timing.turn_sigma[:2] ** 2))
    # a heading error of the mounting becomes a tilt error on a tilted body
    tilted = float(np.mean(rotation.tilt_angle(q) ** 2))
    jitter = timing.offset_sigma**2 * found.turning
    tilt = float(np.sum(noise[:2] ** 2)) + tilt_var + tilted * heading_var + world.sigma_tilt**2 + jitter
    heading = float(noise[2] ** 2) + jitter + (0.0 if world.north == "none" else heading_var)
    heading += _slow_heading(t, q, imu, rates.bias, late) ** 2
    fit = TruthFit(
        trajectory.name,
        timing.offset - late,
        timing.offset_sigma,
        1e6 * timing.drift,
        1e6 * timing.drift_sigma,
        _angles(turn),
        _angles(world.turn),
        rates.correlation,
        math.degrees(math.sqrt(rates.misfit)),
        rates.n,
        float(t[-1] - t[0]),
        math.degrees(math.sqrt(tilt)),
        math.degrees(math.sqrt(heading + world.sigma_heading**2)),
        world.north,
        found.reading or "body to earth",
        math.degrees(float(np.sqrt(np.sum(noise[:2] ** 2)))),
        math.degrees(float(noise[2])),
    )
    return Attitude(t, q, trajectory.name, fit=fit, normal=True)


def _lost_poses(trajectory: Trajectory, found: clock.BestClock, imu: Imu) -> NDArray[np.bool_]:
    """Mark poses (n,) repeated while the gyro turns, and single poses between two jumps."""
    t = trajectory.t + found.timing.offset + found.timing.drift * (trajectory.t - found.middle)
    part = np.cumsum(clock.jump_mask(t, trajectory.readings[found.reading], clock.fastest_rate(imu)))
    lost: NDArray[np.bool_] = np.bincount(part)[part] <= MAX_GLITCH_POSES
    gyro = increments.gyro_increments(imu)
    for run in model.segment_slices(trajectory.held, np.zeros(len(t), np.int64)):
        end = t[min(run.stop, len(t) - 1)]
        edges = np.append(np.arange(t[run.start - 1], end - 1e-6, HELD_S), end)
        turn = (gyro.mean_rates(edges[:-1], edges[1:]) - found.rates.bias) * np.diff(edges)[:, None]
        lost[run] |= not np.max(np.degrees(rotation.length(turn))) <= LOST_TURN_DEG
    return lost


def _noise(t: Array, q: Array, imu: Imu, bias: Array, late: float) -> Array:
    """Return the white noise (3,) rad of an attitude about body axes.

    Estimated from its increments minus those of the gyro (median absolute deviation, two attitudes an increment).
    """
    rates = clock.attitude_rates(t + late, q, NOISE_S)
    span = (rates.end - rates.start)[:, None]
    off = (rates.rate - increments.gyro_increments(imu).mean_rates(rates.start, rates.end) + bias) * span
    off = off[rotation.finite_rows(off)]
    size = median(np.abs(off - median(off, axis=0)), axis=0) * 1.4826
    return np.asarray(size / math.sqrt(2.0))


def _slow_heading(t: Array, q: Array, imu: Imu, bias: Array, late: float) -> float:
    """Return the slow heading error of an attitude, rad, beyond that of the gyro.

    Root mean square of its heading less the integrated gyro's, about a line (bias of the gyro, steady drift) and a
    share of the turn (scale). A steady drift stays unknown.
    """
    grid = np.arange(t[0], t[-1], SLOW_STEP_S)
    jumps = np.cumsum(clock.jump_mask(t, q, clock.fastest_rate(imu)).astype(np.int64))
    poses, _ = rotation.slerp_in_segments(t, q, model.merge_numbers(model.number_segments(t), jumps), grid)
    gyro = increments.gyro_increments(imu)
    turn = rotation.relative_rotvecs(poses[:-1], poses[1:])
    known = gyro.known(grid[:-1] + late, grid[1:] + late) & rotation.finite_rows(turn)
    if np.count_nonzero(known) * SLOW_STEP_S < MIN_SLOW_S:
        return 0.0
    off = turn - gyro.between(grid[:-1] + late, grid[1:] + late) + bias * SLOW_STEP_S
    level = poses[:-1][known]
    error, heading = (np.cumsum(rotation.rotate(level, x[known])[:, 2]) for x in (off, turn))
    along = grid[1:][known] - grid[0]
    columns = np.column_stack([np.ones(len(along)), along, heading])
    left = error - columns @ np.linalg.lstsq(columns, error, rcond=None)[0]
    own = GYRO_WALK_RAD_S * float(along[-1])
    return math.sqrt(max(float(np.mean(left**2)) - own**2, 0.0))


def _angles(q: NDArray[np.float64]) -> Angles:
    roll, pitch, yaw = (float(x) for x in np.degrees(rotation.to_euler(np.atleast_2d(q))[0]))
    return roll, pitch, yaw


def read_attitude(path: Path, log: FlightLog, imu: Imu, asked: Mapping[str, float | str]) -> Estimate:
    """Return the attitude of a file as an estimate, FRD to NED on the log's clock.

    ``asked``: offset, frame and angles (:mod:`attlog.estimators.registry`). ``quality``: clock, frame, and agreement
    with gyro and gravity. LogUnreadable if the file cannot be opened. UsageError if it holds no attitudes, does not
    overlap the log, or disagrees with gyro or gravity in every convention.
    """
    file = read_trajectory(path, str(asked.get("angles", "auto")))
    found: list[tuple[clock.FileClock, axes.Frame]] = []
    refused: list[UsageError] = []
    for on in clock.file_clocks(file, log, float(asked.get("offset") or 0.0)):
        readings = {name: q[on.inside] for name, q in file.readings.items()}
        try:
            frames = axes.possible_frames(readings, str(asked.get("frame", "auto")))
            found.append((on, axes.choose_frame(path, on.t[on.inside], frames, imu)))
        except UsageError as error:
            refused.append(error)
    if not found:
        raise refused[0]
    on, frame = min(found, key=lambda one: np.inf if one[1].rate_difference is None else one[1].rate_difference)
    t = on.t[on.inside]
    if len(t) < MIN_ATTITUDES:
        raise UsageError(f"{path}: {len(t)} usable attitudes within the log; {MIN_ATTITUDES} are needed")
    segment = model.number_segments(t, max(timestamps.MAX_BRIDGED_GAP_S, timestamps.gap_limit_of_times(t)))
    quality: dict[str, float | str] = {"clock": on.name, "frame": frame.name, **frame.quality}
    skipped = {"nan": file.left_out} if file.left_out else {}
    return Estimate(t, frame.q, segment=segment, skipped=skipped, quality=quality)
