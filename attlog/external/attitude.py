"""A trajectory put on the log's clock and axes, with what the fit leaves open; refused where the gyro disagrees."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog import formats
from attlog.core import rotation, timestamps
from attlog.core.errors import NotALog, UsageError
from attlog.estimators import Estimate
from attlog.external import axes, clock, request
from attlog.external import read as columns
from attlog.external import read as trajectory
from attlog.external.clock import RateFit, TruthClock
from attlog.external.read import Trajectory
from attlog.external.request import TruthRequest, check_truth
from attlog.flight import read
from attlog.flight.model import Angles, Attitude, FlightLog, Imu, Stream, TruthFit
from attlog.flight.model import Array as model_Array
from attlog.segments import increments, model

__all__ = ["attach_truth", "check_truth"]


# Rates of one flight correlate above the first; another offset's misfit must not be as good within the second.
MIN_CORRELATION, MIN_RIVAL_MISFIT = 0.9, 0.93
# Rates over the shorter tell most, over the longer a noisy truth still tells a slow flight.
SPANS_S, MIN_RATES = (clock.SPAN_S, 0.3), 30
# Of one flight rates over so long correlate even under a noisy truth; those of two that look alike still do not.
LONG_S = 1.6
# A turn between the bodies that is less sure is not known.
MAX_TURN_SIGMA_DEG = 4.0
# Another reading than the usual must leave less than this share of what the usual one leaves.
MAX_READING_MISFIT = 0.9
# How far the clock may lie from a given offset, and that of a topic from the log's own.
AROUND_S, SAME_CLOCK_S = 0.5, 1.0
# In so short a time a gyro is exact: what the truth turns otherwise is its noise.
NOISE_S = 0.1


@dataclass(frozen=True, slots=True)
class ClockFit:
    """One ``reading`` of a trajectory as ``q`` (n, 4), the ``offset`` s near which it fits, and how well."""

    reading: str
    q: model_Array
    span: float
    offset: float
    rates: RateFit


@dataclass(frozen=True, slots=True)
class BestClock:
    """The reading that fits, with its clock about ``middle``; ``turning`` is its mean square rate in (rad/s)^2."""

    reading: str
    q: model_Array
    timing: TruthClock
    middle: float
    rates: RateFit
    turning: float


def align_truth(log: FlightLog, trajectory: Trajectory, request: TruthRequest, own_clock: bool = False) -> Attitude:
    """The truth as an attitude body FRD to earth NED on the log's clock, with its :class:`TruthFit`.

    ``own_clock``: its times are the log's but for a delay. UsageError, with what to do, where its rates are not the
    gyro's, turn too little to tell, or fit several clocks.
    """
    imu = log.replay_imu
    if imu is None:
        raise UsageError(f"--truth {trajectory.name}: no IMU is replayed that it could be aligned with")
    found = _best_clock(trajectory, imu, request, own_clock)
    timing, late = found.timing, imu.gyro.delay
    t = trajectory.t + timing.offset + timing.drift * (trajectory.t - found.middle) - late
    inside = (t >= imu.gyro.t_best[0]) & (t <= imu.gyro.t_best[-1])
    turn = axes.snap_to_usual(rotation.from_matrix(timing.turn), timing.turn_sigma)
    t, q = t[inside], rotation.multiply(found.q[inside], rotation.conjugate(turn))  # the IMU's body to its world
    world = _fit_world(log, imu, t, q, trajectory, inside, request.north)
    q = rotation.multiply(world.turn, q)
    rates = found.rates
    noise = _noise(t, q, imu, rates.bias, late)
    heading_var, tilt_var = timing.turn_sigma[2] ** 2, float(np.sum(timing.turn_sigma[:2] ** 2))
    tilted = float(np.mean(rotation.tilt_angle(q) ** 2))  # a body turned about its vertical tilts a tilted one
    jitter = timing.offset_sigma**2 * found.turning
    tilt = float(np.sum(noise[:2] ** 2)) + tilt_var + tilted * heading_var + world.sigma_tilt**2 + jitter
    heading = float(noise[2] ** 2) + jitter + (0.0 if world.north == "nobody" else heading_var)
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
        found.reading,
    )
    return Attitude(t, q, trajectory.name, fit=fit, normal=True)


@dataclass(frozen=True, slots=True)
class WorldFit:
    """The turn (4,) from a truth's world to NED, its sigmas in rad, and whose north it has."""

    turn: model_Array
    sigma_tilt: float
    sigma_heading: float
    north: Literal["file", "gnss", "nobody"]


def _fit_world(
    log: FlightLog,
    imu: Imu,
    t: model_Array,
    q: model_Array,
    trajectory: Trajectory,
    inside: NDArray[np.bool_],
    keeps_north: bool,
) -> WorldFit:
    """How the world of attitudes ``q`` (n, 4), FRD to that world, lies in NED; velocities take motion out."""
    if trajectory.known_axes:
        return WorldFit(np.array([1.0, 0.0, 0.0, 0.0]), 0.0, 0.0, "file")
    velocity = None if trajectory.position is None else axes.velocity_from_position(t, trajectory.position[inside])
    down = axes.fit_vertical(imu, t, q, velocity)
    if down is None:
        raise UsageError(f"--truth {trajectory.name}: too little force in common to tell its vertical")
    north = None

    def turned(level: model_Array) -> float:
        return 0.0 if keeps_north else north.heading if north else _onto_onboard(log, t, rotation.multiply(level, q))

    level = axes.level_world(down.down)
    if velocity is not None and not keeps_north:
        north = axes.north_by_gnss(log, t, rotation.rotate(level, velocity))
    elif velocity is None and (moving := axes.gnss_velocity(log, t)) is not None:
        to_ned = rotation.multiply(_about_down(turned(level)), level)
        better = axes.fit_vertical(imu, t, q, rotation.rotate(rotation.conjugate(to_ned), moving))
        down = better if better is not None and better.sigma < down.sigma else down
    level = axes.level_world(down.down, axes.SIGNIFICANT_SIGMAS * down.sigma)
    left = rotation.rotate(level, down.down)
    sigma = max(down.sigma, float(np.arctan2(np.hypot(left[0], left[1]), left[2])))
    turn = rotation.multiply(_about_down(turned(level)), level)
    whose: Literal["file", "gnss", "nobody"] = "file" if keeps_north else "gnss" if north else "nobody"
    return WorldFit(turn, sigma, north.sigma if north else 0.0, whose)


def _about_down(angle: float) -> model_Array:
    return rotation.from_rotvec([0.0, 0.0, angle])


def _best_clock(trajectory: Trajectory, imu: Imu, request: TruthRequest, own_clock: bool) -> BestClock:
    """The reading and the clock that fit best. UsageError where none fits, or two do."""
    gyro, name = increments.gyro_increments(imu), trajectory.name
    around = request.offset if request.offset is not None else 0.0 if own_clock else None
    within = AROUND_S if request.offset is not None else SAME_CLOCK_S
    tried: list[ClockFit] = []
    for span in SPANS_S:
        for words, q in trajectory.quaternions.items():
            rates = clock.attitude_rates(trajectory.t, q, span)
            if len(rates.start) < MIN_RATES:
                continue
            for offset in clock.clock_candidates(rates, gyro, around, within):
                fine = clock.refine_offset(rates, gyro, offset)
                if fine is not None:
                    tried.append(ClockFit(words, q, span, *fine))
        if any(c.rates.correlation >= MIN_CORRELATION for c in tried):
            break
    if not tried:
        raise UsageError(f"--truth {name}: shares no 10 s with the log's gyro; give :offset=SECONDS if you know it")
    usual = next(iter(trajectory.quaternions))
    best = min(
        tried,
        key=lambda c: (1.0 - max(c.rates.correlation, 0.0) ** 2) / (1.0 if c.reading == usual else MAX_READING_MISFIT),
    )
    slow = clock.fit_turn(
        clock.attitude_rates(trajectory.t, best.q, LONG_S).at_most(clock.MAX_INTERVALS), gyro, best.offset
    )
    if max(best.rates.correlation, 0.0 if slow is None else slow.correlation) < MIN_CORRELATION:
        turns = math.degrees(
            float(np.sqrt(np.mean(np.var(imu.gyro.x[rotation.finite_rows(imu.gyro.x)], axis=0).sum())))
        )
        raise UsageError(
            f"--truth {name}: its rates do not follow the gyro (correlation {best.rates.correlation:.2f}, "
            f"{MIN_CORRELATION} needed; the log turns by {turns:.0f} deg/s RMS): is it of this flight?"
        )
    rival = next(
        (c for c in tried if abs(c.offset - best.offset) > 0.1 and c.rates.correlation > MIN_CORRELATION), None
    )
    if rival is not None and rival.rates.misfit * MIN_RIVAL_MISFIT < best.rates.misfit:
        raise UsageError(
            f"--truth {name}: fits at {best.offset:.2f} s as well as at {rival.offset:.2f} s; give :offset=SECONDS"
        )
    return _clock_with_drift(trajectory, best, gyro)


def _clock_with_drift(trajectory: Trajectory, best: ClockFit, gyro: increments.GyroIncrements) -> BestClock:
    """The clock with its drift. UsageError where the turn between the bodies stays unknown."""
    rates = clock.attitude_rates(trajectory.t, best.q, best.span)
    shared = gyro.known(rates.start + best.offset, rates.end + best.offset)
    rates = rates.select(shared)
    middle = float(np.mean(rates.start))
    timing = clock.fit_clock(rates, gyro, best.offset, middle, best.rates)
    sigma = 90.0 if timing is None else float(np.degrees(np.max(timing.turn_sigma)))
    if timing is None or sigma > MAX_TURN_SIGMA_DEG:
        raise UsageError(
            f"--truth {trajectory.name}: the flight turns about too few axes to tell how it is mounted "
            f"(sigma {sigma:.0f} deg)"
        )
    moved = rates.at_most(clock.MAX_INTERVALS).shifted(timing.offset, timing.drift, middle)
    turning = float(np.mean(np.sum(rates.rate**2, axis=1)))
    return BestClock(best.reading, best.q, timing, middle, clock.fit_turn(moved, gyro) or best.rates, turning)


def _noise(t: model_Array, q: model_Array, imu: Imu, bias: model_Array, late: float) -> model_Array:
    """White noise (3,) rad of an attitude about body axes: half the square of what it turns otherwise than the gyro."""
    rates = clock.attitude_rates(t + late, q, NOISE_S)
    gyro = increments.gyro_increments(imu)
    known = gyro.known(rates.start, rates.end)
    span = (rates.end - rates.start)[known]
    seen = gyro.between(rates.start[known], rates.end[known]) - bias * span[:, None]
    off = rates.rate[known] * span[:, None] - seen
    size = np.median(np.abs(off - np.median(off, axis=0)), axis=0) * 1.4826
    return np.asarray(size / math.sqrt(2.0))


def _onto_onboard(log: FlightLog, t: model_Array, q: model_Array) -> float:
    """The heading in rad that turns a levelled attitude onto the onboard one in the mean: figures lie on each other."""
    onboard = log.onboard_attitude
    if onboard is None:
        return 0.0
    other = rotation.slerp(t, q, onboard.t)
    good = rotation.finite_rows(other) & rotation.finite_rows(onboard.q)
    if not good.any():
        return 0.0
    off = rotation.heading_angle(rotation.earth_error(onboard.q[good], other[good]))
    return float(np.angle(np.mean(np.exp(1j * off))))


def _angles(q: NDArray[np.float64]) -> Angles:
    roll, pitch, yaw = (float(x) for x in np.degrees(rotation.to_euler(np.atleast_2d(q))[0]))
    return roll, pitch, yaw


# A truth that the user brings: motion capture, RTK, vision or another estimator, put on a log's clock and axes.

# Attitudes of a PX4 log that others measured.
EXTERNAL_TOPICS = ("vehicle_mocap_odometry", "vehicle_visual_odometry", "vehicle_vision_attitude")
# The heading of a receiver with two antennas, which goes with the smoother's tilt; so many make one.
DUAL_ANTENNA, MIN_HEADINGS = "gnss_yaw", 20


def attach_truth(log: FlightLog, given: str) -> FlightLog:
    """A copy of the log with the truth that is ``given``: ``NAME[:offset=S,north=true,topic=T]``.

    NAME is a trajectory (TUM, EuRoC, a table with a header), another log or bag, a folder in which one bears the log's
    own name, a topic of the log, or ``gnss_yaw``, which is a heading alone (``true_heading`` of the copy). Clock, body
    and earth axes are found by gyro and gravity; ``truth.fit`` of the copy tells them. UsageError for what is not
    there, does not follow the gyro or turns too little; LogUnreadable and NotALog for files.
    """
    asked = request.parse_truth(given)
    path = asked.path
    if path is None and asked.name == DUAL_ANTENNA:
        return replace(log, true_heading=_dual_antenna(log))
    if path is None:
        return replace(log, truth=align_truth(log, _topic_trajectory(log, asked.name), asked, own_clock=True))
    if path.is_dir():
        path = _file_named_as_log(path, log.path)
    return replace(log, truth=align_truth(log, _file_trajectory(path, asked), asked))


def _dual_antenna(log: FlightLog) -> Stream:
    """The heading of the first receiver with two antennas. UsageError without one."""
    for gnss in log.gnss:
        heading = gnss.heading
        if heading is not None and len(heading.t) >= MIN_HEADINGS:
            t, yaw = model.select_rising(heading.t, heading.x)
            return replace(heading, t=t, x=yaw)
    raise UsageError(f"--truth {DUAL_ANTENNA}: no receiver of {log.path.name} tells a heading of two antennas")


def _file_named_as_log(folder: Path, log: Path) -> Path:
    """The file in a folder that bears the log's own name. UsageError where none or several do."""
    names = sorted(name for name in os.listdir(folder) if name.partition(".")[0] == log.name.partition(".")[0])
    if len(names) != 1:
        which = f"several named {log.stem}: {', '.join(names[:5])}" if names else f"none named {log.stem}.*"
        raise UsageError(f"--truth {folder}: a folder with a truth for each log, and {which}")
    return folder / names[0]


def _file_trajectory(path: Path, asked: TruthRequest) -> Trajectory:
    """The trajectory of a file: of a log its pose, truth or onboard attitude, else of a text."""
    try:
        formats.recognise(path)
    except NotALog:
        return trajectory.read_trajectory(path)
    other = read(path)
    if asked.topic or other.poses:
        return _topic_trajectory(other, asked.topic)
    attitude = other.truth or other.onboard_attitude
    if attitude is None:
        raise UsageError(f"--truth {path}: holds no attitude")
    return _attitude_trajectory(path.name, attitude, known_axes=True)


def _topic_trajectory(log: FlightLog, topic: str) -> Trajectory:
    """A pose or an attitude of a log by its topic; the only one where none is named. UsageError for another."""
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
    return replace(
        trajectory.make_trajectory(name, t, {"body to earth": attitude.q}, attitude.position), known_axes=known_axes
    )


# An attitude that somebody computed elsewhere, read from a CSV file and put on the log's clock and axes by physics.

Array = NDArray[np.float64]
# Attitudes that make a row.
MIN_ROW_ATTITUDES = 10


def read_attitude(path: Path, log: FlightLog, imu: Imu, asked: Mapping[str, float | str]) -> Estimate:
    """The attitude of a file as an estimate on the log's clock, body FRD to earth NED.

    ``asked`` are the parameters of :mod:`attlog.estimators.registry`. ``quality`` says what was found: clock, frame,
    how well gyro and gravity agree. LogUnreadable if the file cannot be opened; UsageError, with what to do, for
    columns that are not there, a file that does not overlap the log, and axes that physics contradicts.
    """
    table = columns.read_columns(path)
    readings: list[tuple[str, Array, axes.FrameFit]] = []
    refused: list[UsageError] = []
    for t, rows, said in clock.times_on_log(path, table, log, float(asked.get("offset") or 0.0)):
        candidates = axes.frame_candidates(
            table, rows, str(asked.get("frame", "auto")), str(asked.get("angles", "auto"))
        )
        try:
            readings.append((said, t, axes.choose_frame(path, t, candidates, imu)))
        except UsageError as error:
            refused.append(error)
    if not readings:
        raise refused[0]
    said, t, found = min(readings, key=lambda r: r[2].apart)
    q = rotation.normalize(found.q)
    good = np.isfinite(q).all(axis=1)
    if good.sum() < MIN_ROW_ATTITUDES:
        raise UsageError(f"{path}: {int(good.sum())} usable attitudes within the log; {MIN_ROW_ATTITUDES} are needed")
    t, q = t[good], q[good]
    quality: dict[str, float | str] = {"clock": said, "frame": found.name, **found.quality}
    broken = np.concatenate(
        [[0], np.cumsum(np.diff(t) > max(timestamps.MAX_BRIDGED_GAP_S, timestamps.gap_limit_of_times(t)))]
    )
    skipped = {"nan": int((~good).sum())} if not good.all() else {}
    return Estimate(t, q, segment=broken.astype(np.int64), skipped=skipped, quality=quality)
