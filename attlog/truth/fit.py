"""A trajectory put on the log's clock and axes, with what the fit leaves open; refused where the gyro disagrees."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.base.errors import UsageError
from attlog.flight.model import Array, Attitude, FlightLog, Imu
from attlog.flight.truth import Angles, TruthFit
from attlog.segments import increments
from attlog.truth import axes, clock
from attlog.truth.clock import RateFit, TruthClock
from attlog.truth.request import TruthRequest
from attlog.truth.trajectory import Trajectory

CORRELATES, APART = 0.9, 0.93
"""Rates of one flight correlate above the first; another offset's misfit must not be as good within the second."""
SPANS_S, LEAST_RATES = (clock.SPAN_S, 0.3), 30
"""Rates over the shorter tell most, over the longer a noisy truth still tells a slow flight."""
LONG_S = 1.6
"""Of one flight rates over so long correlate even under a noisy truth; those of two that look alike still do not."""
UNSURE_DEG = 4.0
"""A turn between the bodies that is less sure is not known."""
CLEARLY = 0.9
"""Another reading than the usual must leave less than this share of what the usual one leaves."""
AROUND_S, SAME_CLOCK_S = 0.5, 1.0
"""How far the clock may lie from a given offset, and that of a topic from the log's own."""
NOISE_S = 0.1
"""In so short a time a gyro is exact: what the truth turns otherwise is its noise."""


@dataclass(frozen=True, slots=True)
class ClockFit:
    """One ``reading`` of a trajectory as ``q`` (n, 4), the ``offset`` s near which it fits, and how well."""

    reading: str
    q: Array
    span: float
    offset: float
    rates: RateFit


@dataclass(frozen=True, slots=True)
class BestClock:
    """The reading that fits, with its clock about ``middle``; ``turning`` is its mean square rate in (rad/s)^2."""

    reading: str
    q: Array
    timing: TruthClock
    middle: float
    rates: RateFit
    turning: float


def aligned(log: FlightLog, trajectory: Trajectory, request: TruthRequest, own_clock: bool = False) -> Attitude:
    """The truth as an attitude body FRD to earth NED on the log's clock, with its :class:`TruthFit`.

    ``own_clock``: its times are the log's but for a delay. UsageError, with what to do, where its rates are not the
    gyro's, turn too little to tell, or fit several clocks.
    """
    imu = log.replay_imu
    if imu is None:
        raise UsageError(f"--truth {trajectory.name}: no IMU is replayed that it could be aligned with")
    found = _on_log(trajectory, imu, request, own_clock)
    timing, late = found.timing, imu.gyro.delay
    t = trajectory.t + timing.offset + timing.drift * (trajectory.t - found.middle) - late
    inside = (t >= imu.gyro.t_best[0]) & (t <= imu.gyro.t_best[-1])
    turn = axes.usual(rotation.from_matrix(timing.turn), timing.turn_sigma)
    t, q = t[inside], rotation.multiply(found.q[inside], rotation.conjugate(turn))  # the IMU's body to its world
    world = _world(log, imu, t, q, trajectory, inside, request.north)
    q = rotation.multiply(world.turn, q)
    rates = found.rates
    noise = _noise(t, q, imu, rates.bias, late)
    heading_var, tilt_var = timing.turn_sigma[2] ** 2, float(np.sum(timing.turn_sigma[:2] ** 2))
    tilted = float(np.mean(rotation.inclination_angle(q) ** 2))  # a body turned about its vertical tilts a tilted one
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

    turn: Array
    sigma_tilt: float
    sigma_heading: float
    north: Literal["file", "gnss", "nobody"]


def _world(
    log: FlightLog, imu: Imu, t: Array, q: Array, trajectory: Trajectory, inside: NDArray[np.bool_], keeps_north: bool
) -> WorldFit:
    """How the world of attitudes ``q`` (n, 4), FRD to that world, lies in NED; velocities take motion out."""
    if trajectory.known_axes:
        return WorldFit(np.array([1.0, 0.0, 0.0, 0.0]), 0.0, 0.0, "file")
    velocity = None if trajectory.position is None else axes.velocity_of(t, trajectory.position[inside])
    down = axes.vertical(imu, t, q, velocity)
    if down is None:
        raise UsageError(f"--truth {trajectory.name}: too little force in common to tell its vertical")
    north = None

    def turned(level: Array) -> float:
        return 0.0 if keeps_north else north.heading if north else _onto_onboard(log, t, rotation.multiply(level, q))

    level = axes.levelled(down.down)
    if velocity is not None and not keeps_north:
        north = axes.north_by_gnss(log, t, rotation.rotate(level, velocity))
    elif velocity is None and (moving := axes.gnss_velocity(log, t)) is not None:
        to_ned = rotation.multiply(_about_down(turned(level)), level)
        better = axes.vertical(imu, t, q, rotation.rotate(rotation.conjugate(to_ned), moving))
        down = better if better is not None and better.sigma < down.sigma else down
    level = axes.levelled(down.down, axes.SIGNIFICANT * down.sigma)
    left = rotation.rotate(level, down.down)
    sigma = max(down.sigma, float(np.arctan2(np.hypot(left[0], left[1]), left[2])))
    turn = rotation.multiply(_about_down(turned(level)), level)
    whose: Literal["file", "gnss", "nobody"] = "file" if keeps_north else "gnss" if north else "nobody"
    return WorldFit(turn, sigma, north.sigma if north else 0.0, whose)


def _about_down(angle: float) -> Array:
    return rotation.from_rotvec([0.0, 0.0, angle])


def _on_log(trajectory: Trajectory, imu: Imu, request: TruthRequest, own_clock: bool) -> BestClock:
    """The reading and the clock that fit best. UsageError where none fits, or two do."""
    gyro, name = increments.of(imu), trajectory.name
    around = request.offset if request.offset is not None else 0.0 if own_clock else None
    within = AROUND_S if request.offset is not None else SAME_CLOCK_S
    tried: list[ClockFit] = []
    for span in SPANS_S:
        for words, q in trajectory.quaternions.items():
            rates = clock.rates(trajectory.t, q, span)
            if len(rates.start) < LEAST_RATES:
                continue
            for offset in clock.candidates(rates, gyro, around, within):
                fine = clock.refined(rates, gyro, offset)
                if fine is not None:
                    tried.append(ClockFit(words, q, span, *fine))
        if any(c.rates.correlation >= CORRELATES for c in tried):
            break
    if not tried:
        raise UsageError(f"--truth {name}: shares no 10 s with the log's gyro; give :offset=SECONDS if you know it")
    usual = next(iter(trajectory.quaternions))
    best = min(
        tried, key=lambda c: (1.0 - max(c.rates.correlation, 0.0) ** 2) / (1.0 if c.reading == usual else CLEARLY)
    )
    slow = clock.fit(clock.rates(trajectory.t, best.q, LONG_S).thinned(), gyro, best.offset)
    if max(best.rates.correlation, 0.0 if slow is None else slow.correlation) < CORRELATES:
        turns = math.degrees(float(np.sqrt(np.mean(np.var(imu.gyro.x[rotation.finite(imu.gyro.x)], axis=0).sum()))))
        raise UsageError(
            f"--truth {name}: its rates do not follow the gyro (correlation {best.rates.correlation:.2f}, "
            f"{CORRELATES} needed; the log turns by {turns:.0f} deg/s RMS): is it of this flight?"
        )
    rival = next((c for c in tried if abs(c.offset - best.offset) > 0.1 and c.rates.correlation > CORRELATES), None)
    if rival is not None and rival.rates.misfit * APART < best.rates.misfit:
        raise UsageError(
            f"--truth {name}: fits at {best.offset:.2f} s as well as at {rival.offset:.2f} s; give :offset=SECONDS"
        )
    return _timed(trajectory, best, gyro)


def _timed(trajectory: Trajectory, best: ClockFit, gyro: increments.GyroIncrements) -> BestClock:
    """The clock with its drift. UsageError where the turn between the bodies stays unknown."""
    rates = clock.rates(trajectory.t, best.q, best.span)
    shared = gyro.known(rates.start + best.offset, rates.end + best.offset)
    rates = rates.part(shared)
    middle = float(np.mean(rates.start))
    timing = clock.timed(rates, gyro, best.offset, middle, best.rates)
    sigma = 90.0 if timing is None else float(np.degrees(np.max(timing.turn_sigma)))
    if timing is None or sigma > UNSURE_DEG:
        raise UsageError(
            f"--truth {trajectory.name}: the flight turns about too few axes to tell how it is mounted "
            f"(sigma {sigma:.0f} deg)"
        )
    moved = rates.thinned().shifted(timing.offset, timing.drift, middle)
    turning = float(np.mean(np.sum(rates.rate**2, axis=1)))
    return BestClock(best.reading, best.q, timing, middle, clock.fit(moved, gyro) or best.rates, turning)


def _noise(t: Array, q: Array, imu: Imu, bias: Array, late: float) -> Array:
    """White noise (3,) rad of an attitude about body axes: half the square of what it turns otherwise than the gyro."""
    rates = clock.rates(t + late, q, NOISE_S)
    gyro = increments.of(imu)
    known = gyro.known(rates.start, rates.end)
    span = (rates.end - rates.start)[known]
    seen = gyro.between(rates.start[known], rates.end[known]) - bias * span[:, None]
    off = rates.rate[known] * span[:, None] - seen
    size = np.median(np.abs(off - np.median(off, axis=0)), axis=0) * 1.4826
    return np.asarray(size / math.sqrt(2.0))


def _onto_onboard(log: FlightLog, t: Array, q: Array) -> float:
    """The heading in rad that turns a levelled attitude onto the onboard one in the mean: figures lie on each other."""
    onboard = log.onboard_attitude
    if onboard is None:
        return 0.0
    other = rotation.slerp(t, q, onboard.t)
    good = rotation.finite(other) & rotation.finite(onboard.q)
    if not good.any():
        return 0.0
    off = rotation.heading_angle(rotation.error(onboard.q[good], other[good]))
    return float(np.angle(np.mean(np.exp(1j * off))))


def _angles(q: NDArray[np.float64]) -> Angles:
    roll, pitch, yaw = (float(x) for x in np.degrees(rotation.to_euler(np.atleast_2d(q))[0]))
    return roll, pitch, yaw
