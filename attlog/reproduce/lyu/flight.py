"""Lyu's filters in the loop: hover, then roll follows a sine, flown on either filter's attitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.base import rotation
from attlog.reproduce.lyu.runs import MPU6050, READINGS, fixed, variable
from attlog.reproduce.samples import gravity_error, rms, run, samples
from attlog.simulate.autopilot.loop import EstimatorChoice
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.scenario.commands import Command
from attlog.simulate.scenario.scenario import Scenario
from attlog.simulate.sensors.settings import SensorSettings

TRACK_S, SECONDS = 20.0, 32.0
AMPLITUDE_DEG, PERIOD_S = 15.0, 3.0


@dataclass(frozen=True, slots=True)
class LyuFlight:
    """One flight from take-off to its end: RMS of the tilt error of the estimate and of the distance of the true roll
    from its set-point (deg), the largest true tilt (deg), whether it ``landed`` on its own once it tracked, the
    largest |e|, ``equal`` to the flight on the traditional filter to the last bit.
    """

    error_deg: float
    tracking_deg: float
    most_deg: float
    landed: bool
    largest_e: float
    equal: bool


def scenario(row: str) -> Scenario:
    """Take-off, hover, a sine in roll; the board is Lyu's, without magnetometer."""
    commands = (
        Command(t=11.0, do="arm"),
        Command(t=12.0, do="takeoff", up_m=5.0),
        Command(t=TRACK_S, do="track", amplitude_deg=AMPLITUDE_DEG, period_s=PERIOD_S),
    )
    return Scenario(
        name="lyu",
        seconds=SECONDS,
        command=commands,
        sensors=SensorSettings(imu=(MPU6050,), mag=()),
        estimator=EstimatorChoice(row),
    )


def flight(row: str, seed: int) -> Flight:
    """A flight on one filter's attitude."""
    return fly(scenario(row), seed)


def one_seed(seed: int) -> dict[str, LyuFlight]:
    """All flights of one seed by row."""
    found: dict[str, LyuFlight] = {}
    for reading in READINGS:
        traditional = flight(fixed(reading), seed)
        other = flight(variable(reading), seed)
        equal = bool(np.array_equal(traditional.truth.q, other.truth.q))
        found[fixed(reading)] = _flown(traditional, fixed(reading), True)
        found[variable(reading)] = _flown(other, variable(reading), equal)
    return found


def _flown(flown: Flight, row: str, equal: bool) -> LyuFlight:
    on, truth = flown.onboard, flown.truth
    true = rotation.slerp(truth.t, truth.q, np.minimum(on.t, truth.t[-1]))
    air, tracking = on.t >= 12.0, on.t >= TRACK_S + 1.0
    tilt = np.degrees(rotation.inclination_angle(rotation.error(on.q, true)))[air]
    roll = np.degrees(rotation.to_euler(true)[:, 0] - rotation.to_euler(on.q_setpoint)[:, 0])[tracking]
    s = samples(flown, mag=False)
    e = gravity_error(s, run(row, s))[s.t >= 12.0]
    lean = np.degrees(rotation.inclination_angle(truth.q))[truth.t >= 12.0]
    landed = bool(truth.ground[truth.t >= TRACK_S].any())
    return LyuFlight(rms(tilt), rms(roll), float(lean.max()), landed, float(e.max()), equal)
