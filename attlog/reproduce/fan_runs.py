"""Fan's experiments for one seed: a minute at rest, and turned by hand to 45 deg both ways about each axis.

Three attitudes of the same samples: accelerometer and magnetometer alone, the Kalman filter with 12 states in its
printed order, the complementary filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.estimators import get
from attlog.reproduce.bench import (
    AXES,
    FLOWN_ON_TRUTH,
    FilterOutput,
    FlightSamples,
    count_spikes,
    crossing_s,
    detrended_std,
    flight_samples,
    quick_errors,
    rise_s,
    rms,
    run_filter,
)
from attlog.reproduce.paper import Claim, Measures, PaperNumber, Seeds, Verdict
from attlog.simulate.fly import fly
from attlog.simulate.scenario import PrescribedMotion, Scenario, load_scenario
from attlog.simulate.sensor_settings import ImuSettings, MagSettings, SensorSettings
from attlog.words.numbers import listed

Array = NDArray[np.float64]

RAW, EKF, FILTER = "accel_mag", "ekf12@fan-printed", "complementary@fan"
# Ours, for comparison: the gyro's sample before the vectors turn.
AHEAD = "ekf12@fan"
# Factors on our random walks of gravity and field: the paper leaves the filter's bandwidth open.
WIDER = (1.0, 3.0, 10.0)
REST_S, SETTLED_S, MOVED_S = 60.0, 20.0, 10.0
SPIKE_DEG = 0.5
SENSORS = SensorSettings(imu=(ImuSettings(rate_hz=200.0),), mag=(MagSettings(rate_hz=50.0),))
# From the pivot of a hand's turn to the sensors.
ARM_M = (0.2, 0.0, 0.0)


def wider(factor: float) -> str:
    """Return the Kalman filter with larger random walks of gravity and field."""
    values = {p.name: p.default for p in get("ekf12").parameters}
    walks = (f"{name}={float(values[name]) * factor:g}" for name in ("gravity_noise", "field_noise"))
    return EKF if factor == 1.0 else f"{EKF}:{','.join(walks)}"


EKFS = tuple(map(wider, WIDER))
ROWS = (RAW, FILTER, *EKFS)


def at_rest(seed: int) -> FlightSamples:
    """Return samples of a minute at rest on a table."""
    return flight_samples(
        fly(
            Scenario(name="fan", seconds=REST_S, motion=PrescribedMotion(), sensors=SENSORS, estimator=FLOWN_ON_TRUTH),
            seed,
        )
    )


def turns() -> Scenario:
    """Return the library's rotation about a point 20 cm away, as by a hand."""
    scenario = load_scenario("rotation")
    assert scenario.motion is not None
    return scenario.changed(motion=replace(scenario.motion, arm_m=ARM_M), sensors=SENSORS, estimator=FLOWN_ON_TRUTH)


def hand_turns(seed: int) -> FlightSamples:
    """Return samples of the board turned about each axis."""
    return flight_samples(fly(turns(), seed))


def heading_moves() -> list[tuple[float, float, float, float]]:
    """Return begin, end [s], start and goal [deg] of each turn of the heading."""
    scenario = turns()
    assert scenario.motion is not None
    now, heading, found = 0.0, scenario.place.heading_deg, []
    for move in scenario.motion.move:
        if move.heading_deg is not None:
            found.append((now, now + move.seconds, heading, move.heading_deg))
            heading = move.heading_deg
        now += move.seconds
    return found


def one_seed(seed: int) -> Measures:
    """Run both experiments for one seed.

    By row: ``spread`` of each axis and RMS angle to the true attitude (``rest off``) at rest; of the turns RMS
    ``error`` of each axis, ``turn off``, number of ``spikes`` (errors more than 0.5 deg from their median of 2 s) and
    the largest (``peak``), all in deg; ``delay`` and ``rise`` of heading beyond the true one's in ms.
    """
    still, moved = at_rest(seed), hand_turns(seed)
    found: Measures = {}
    for row in ROWS:
        one = run_filter(row, still)
        late = one.t >= SETTLED_S
        found["rest off", row] = _off(one, SETTLED_S)
        for axis in range(len(AXES)):
            found["spread", row, axis] = detrended_std(one.t[late], one.angles[late, axis])
    for row in (*ROWS, AHEAD):
        one = run_filter(row, moved)
        late = one.t >= MOVED_S
        errors = one.errors[late]
        t, quick = quick_errors(one.t[late], errors)
        count, peak = count_spikes(t, np.asarray(np.max(np.abs(quick), axis=1)), SPIKE_DEG)
        delay, rise = _heading(one)
        found |= {("error", row, axis): rms(errors[:, axis]) for axis in range(len(AXES))}
        found |= {("turn off", row): _off(one, MOVED_S), ("spikes", row): float(count), ("peak", row): peak}
        found |= {("delay", row): delay, ("rise", row): rise}
    return found


def _off(found: FilterOutput, since: float) -> float:
    """Return the RMS angle from the true attitude from ``since`` on."""
    late = found.t >= since
    angle = rotation.total_angle(rotation.earth_error(found.q[late], found.truth[late]))
    return rms(np.asarray(np.degrees(angle)))


def _heading(found: FilterOutput) -> tuple[float, float]:
    """Return delay at half of the way and rise time beyond the true heading's, in ms, means of the turns."""
    truth = np.degrees(np.unwrap(np.arctan2(*_direction(found.truth))))
    own = truth + found.heading_error
    delays, rises = [], []
    for begin, end, start, goal in heading_moves():
        part = (found.t >= begin - 0.5) & (found.t < end + 1.5)
        t = found.t[part]
        answers = []
        for y in (truth[part], own[part]):
            answers.append((crossing_s(t, y, begin, start, goal, 0.5), rise_s(t, y, begin, start, goal)))
        delays.append(answers[1][0] - answers[0][0])
        rises.append(answers[1][1] - answers[0][1])
    return 1e3 * float(np.mean(delays)), 1e3 * float(np.mean(rises))


def _direction(q: Array) -> tuple[Array, Array]:
    """Return east and north of the body's x axis."""
    w, x, y, z = q.T
    return np.asarray(2.0 * (x * y + w * z)), np.asarray(1.0 - 2.0 * (y * y + z * z))


CALLED = {RAW: "raw", FILTER: "complementary filter"} | {
    wider(f): "Kalman filter" if f == 1.0 else f"Kalman filter, walks x {f:g}" for f in WIDER
}
# Claim about the Kalman filter, and its verdict with each of the random walks.
Judged = tuple[Claim, list[Verdict]]


def spreads(found: Seeds, row: str, over: str, axis: int) -> PaperNumber:
    """Return the ratio of two filters' spread of one axis at rest."""
    what = f"spread of {AXES[axis]} at rest, {CALLED[row]} over {CALLED[over]}"
    return found.ratio(what, ("spread", row, axis), ("spread", over, axis))


def by_walk(verdicts: Sequence[Verdict]) -> str:
    """Return with which random walks a claim holds, and with which it is not significant."""
    held, unclear = (
        [f"{f:g}" for f, v in zip(WIDER, verdicts, strict=True) if v == which]
        for which in ("holds", "cannot be judged")
    )
    if len(unclear) == len(WIDER):
        return "with none of the random walks significantly"
    if len(held) in (0, len(WIDER)):
        words = "with every random walk" if held else "with none of the random walks"
    else:
        words = "with our random walks alone" if held == ["1"] else f"with random walks {listed(held)} times ours"
    if not unclear:
        return words
    return f"{words}; not significant with {'ours' if unclear == ['1'] else f'{listed(unclear)} times ours'}"
