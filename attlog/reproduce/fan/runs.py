"""Fan's experiments for one seed: a minute at rest, and turned by hand to 45 deg both ways about each axis.

Three ways to an attitude on the same samples: accelerometer and magnetometer alone, the Kalman filter with 12 states
in its printed order, the complementary filter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.estimators import get
from attlog.reproduce import response
from attlog.reproduce.samples import AXES, NOBODY, FilterOutput, FlightSamples, rms, run, samples
from attlog.simulate.fly import fly
from attlog.simulate.scenario.commands import PrescribedMotion
from attlog.simulate.scenario.scenario import Scenario, load
from attlog.simulate.sensors.settings import ImuSettings, MagSettings, SensorSettings

Array = NDArray[np.float64]
Triple = tuple[float, float, float]

RAW, EKF, FILTER = "accel_mag", "ekf12@fan-printed", "complementary@fan"
AHEAD = "ekf12@fan"
"""Ours, for comparison: the gyro's sample before the vectors turn."""
WIDER = (1.0, 3.0, 10.0)
"""Factors on our random walks of gravity and field: the Kalman filter's bandwidth, of which the paper says nothing."""
REST_S, SETTLED_S, MOVED_S = 60.0, 20.0, 10.0
SPIKE_DEG = 0.5
SENSORS = SensorSettings(imu=(ImuSettings(rate_hz=200.0),), mag=(MagSettings(rate_hz=50.0),))
ARM_M = (0.2, 0.0, 0.0)
"""From the point that a hand turns about to the sensors."""


@dataclass(frozen=True, slots=True)
class HandTurn:
    """What a row made of the turns: RMS ``errors`` (roll, pitch, heading) in deg; how many ``spikes`` (errors that
    leave their own median of 2 s by more than 0.5 deg) and the largest of them; ``delay_ms`` and ``rise_ms`` of
    heading beyond the true one's, means of three turns; ``off_deg`` RMS of the whole angle to the true attitude.
    """

    errors: Triple
    off_deg: float
    spikes: int
    peak_deg: float
    delay_ms: float
    rise_ms: float


@dataclass(frozen=True, slots=True)
class FanSeed:
    """What one seed gave by row: ``spread`` (roll, pitch, heading) and ``off`` (RMS of the whole angle to the true
    attitude) at rest in deg, and the turns."""

    spread: dict[str, Triple]
    off: dict[str, float]
    turned: dict[str, HandTurn]


def wider(factor: float) -> str:
    """The Kalman filter with larger random walks of gravity and field."""
    values = {p.name: p.default for p in get("ekf12").parameters}
    walks = (f"{name}={float(values[name]) * factor:g}" for name in ("gravity_noise", "field_noise"))
    return EKF if factor == 1.0 else f"{EKF}:{','.join(walks)}"


EKFS = tuple(map(wider, WIDER))
ROWS = (RAW, FILTER, *EKFS)


def at_rest(seed: int) -> FlightSamples:
    """A minute at rest on a table."""
    return samples(
        fly(Scenario(name="fan", seconds=REST_S, motion=PrescribedMotion(), sensors=SENSORS, estimator=NOBODY), seed)
    )


def turns() -> Scenario:
    """The library's rotation, turned about a point 20 cm away as by a hand."""
    scenario = load("rotation")
    assert scenario.motion is not None
    return scenario.changed(motion=replace(scenario.motion, arm_m=ARM_M), sensors=SENSORS, estimator=NOBODY)


def turned(seed: int) -> FlightSamples:
    """The board turned about each axis."""
    return samples(fly(turns(), seed))


def heading_moves() -> list[tuple[float, float, float, float]]:
    """Each turn of the heading: when it begins and ends in s, and from where to where in deg."""
    scenario = turns()
    assert scenario.motion is not None
    now, heading, found = 0.0, scenario.place.heading_deg, []
    for move in scenario.motion.move:
        if move.heading_deg is not None:
            found.append((now, now + move.seconds, heading, move.heading_deg))
            heading = move.heading_deg
        now += move.seconds
    return found


def one_seed(seed: int) -> FanSeed:
    """Both experiments for one seed."""
    still, moved = at_rest(seed), turned(seed)
    rested = {row: run(row, still) for row in ROWS}
    return FanSeed(
        {row: _spread(one) for row, one in rested.items()},
        {row: _off(one, SETTLED_S) for row, one in rested.items()},
        {row: _turned(run(row, moved)) for row in (*ROWS, AHEAD)},
    )


def _off(found: FilterOutput, since: float) -> float:
    """RMS from ``since`` on of the angle between found and true attitude."""
    late = found.t >= since
    angle = rotation.total_angle(rotation.error(found.q[late], found.truth[late]))
    return rms(np.asarray(np.degrees(angle)))


def _spread(found: FilterOutput) -> Triple:
    late = found.t >= SETTLED_S
    a, b, c = (response.spread(found.t[late], found.angles[late, axis]) for axis in range(len(AXES)))
    return a, b, c


def _turned(found: FilterOutput) -> HandTurn:
    late = found.t >= MOVED_S
    errors = found.errors[late]
    t, quick = response.excursions(found.t[late], errors)
    count, peak = response.spikes(t, np.asarray(np.max(np.abs(quick), axis=1)), SPIKE_DEG)
    a, b, c = (rms(errors[:, axis]) for axis in range(len(AXES)))
    return HandTurn((a, b, c), _off(found, MOVED_S), count, peak, *_heading(found))


def _heading(found: FilterOutput) -> tuple[float, float]:
    """Delay at half of the way and rise time beyond the true heading's, in ms, means of the turns."""
    truth = np.degrees(np.unwrap(np.arctan2(*_direction(found.truth))))
    own = truth + found.heading_error
    delays, rises = [], []
    for begin, end, start, goal in heading_moves():
        part = (found.t >= begin - 0.5) & (found.t < end + 1.5)
        t = found.t[part]
        answers = []
        for y in (truth[part], own[part]):
            answers.append(
                (response.crossing_s(t, y, begin, start, goal, 0.5), response.rise_s(t, y, begin, start, goal))
            )
        delays.append(answers[1][0] - answers[0][0])
        rises.append(answers[1][1] - answers[0][1])
    return 1e3 * float(np.mean(delays)), 1e3 * float(np.mean(rises))


def _direction(q: Array) -> tuple[Array, Array]:
    """East and north of the body's x axis."""
    w, x, y, z = q.T
    return np.asarray(2.0 * (x * y + w * z)), np.asarray(1.0 - 2.0 * (y * y + z * z))
