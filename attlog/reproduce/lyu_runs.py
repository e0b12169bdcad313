"""Lyu's experiments for one seed: the board at rest, lifted and dropped, started with a wrong angle, and in flight.

Each is run with the traditional filter (fixed integral) and the one with variable integral, ki per second and per
sample; without a magnetometer, as in the paper.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.reproduce import bench
from attlog.reproduce.bench import (
    FLOWN_ON_TRUTH,
    FilterOutput,
    FlightSamples,
    detrended_std,
    flight_samples,
    gravity_error,
    overshoot_of,
    rms,
    run_filter,
)
from attlog.reproduce.paper import Measures
from attlog.simulate.flight import Flight
from attlog.simulate.fly import fly
from attlog.simulate.scenario import Command, EstimatorChoice, Move, PrescribedMotion, Scenario
from attlog.simulate.sensor_settings import AccelerometerSettings, GyroSettings, ImuSettings, SensorSettings

Array = NDArray[np.float64]

RATE_HZ = 200.0
# InvenSense PS-MPU-6000A: 0.005 deg/s/sqrt(Hz), 400 ug/sqrt(Hz); ranges, rate and remaining bias are ours.
MPU6050 = ImuSettings(
    rate_hz=RATE_HZ,
    gyro=GyroSettings(noise_dps_rthz=0.005, bias_spread_dps=0.1, range_dps=500.0, step_dps=500.0 / 32768),
    acc=AccelerometerSettings(noise_ug_rthz=400.0, range_g=4.0, step_mg=4000.0 / 32768),
)
READINGS = ("second", "sample")
ERR1, ERR2 = 0.3, 0.8
# Angle in deg and the gyro's range in deg/s: a drop of 60 deg in 0.3 s turns at up to 375 deg/s.
DROPS = ((20.0, 500.0), (40.0, 500.0), (60.0, 500.0), (60.0, 250.0))
WRONG_DEG = (20.0, 40.0, 60.0)
REST_S, SETTLED_S = 60.0, 20.0
# RMS of rotor vibration on each axis of the accelerometer: the mean |e| is above err1.
SHAKEN_M_S2 = 3.0
STILL_S, LIFT_S, HOLD_S, DROP_S, AFTER_S = 10.0, 1.0, 4.0, 0.3, 30.0
DROP_AT = STILL_S + LIFT_S + HOLD_S
DROP_WITHIN_DEG, WRONG_WITHIN_DEG = 0.25, 1.0


def fixed(reading: str) -> str:
    """Return the row of the traditional filter."""
    return f"complementary@lyu-fixed:ki_per={reading}"


def variable(reading: str) -> str:
    """Return the row of the filter with variable integral."""
    return f"variable_integral@lyu:ki_per={reading}"


def stopped(reading: str) -> str:
    """Return our variant for comparison, which fades the input of the integral."""
    return f"variable_integral@lyu:ki_per={reading},freeze=input"


# Without any integral.
NO_INTEGRAL = "complementary@lyu-fixed:ki=0"
ROWS = tuple(kind(reading) for reading in READINGS for kind in (fixed, variable, stopped))


def board(seconds: float, motion: PrescribedMotion, range_dps: float = 500.0) -> Scenario:
    """Return Lyu's board, moved by hand or at rest on a table, rotors off."""
    gyro = replace(MPU6050.gyro, range_dps=range_dps, step_dps=range_dps / 32768)
    return Scenario(
        name="lyu",
        seconds=seconds,
        motion=motion,
        sensors=SensorSettings(imu=(replace(MPU6050, gyro=gyro),), mag=()),
        estimator=FLOWN_ON_TRUTH,
    )


def lifted(angle: float) -> PrescribedMotion:
    """Return rest, a lift about one edge, a hold, a drop within 0.3 s."""
    moves = (
        Move(seconds=STILL_S),
        Move(seconds=LIFT_S, roll_deg=angle),
        Move(seconds=HOLD_S),
        Move(seconds=DROP_S, roll_deg=0.0, shock_m_s2=20.0),
    )
    return PrescribedMotion(arm_m=(0.0, -0.15, 0.0), move=moves)


def tilted(seed: int) -> PrescribedMotion:
    """Return a table tilted by 1 to 3 deg in a random direction."""
    draw = np.random.default_rng([seed, 24])
    size, where = draw.uniform(1.0, 3.0), draw.uniform(0.0, 2.0 * np.pi)
    return PrescribedMotion(roll_deg=float(size * np.cos(where)), pitch_deg=float(size * np.sin(where)))


def at_rest(seed: int) -> FlightSamples:
    """Return samples of the board on its tilted table."""
    return flight_samples(fly(board(REST_S, tilted(seed)), seed), mag=False)


def shaken(s: FlightSamples, seed: int) -> FlightSamples:
    """Return the samples with vibration, white at 200 Hz."""
    noise = np.random.default_rng([seed, 25]).standard_normal(s.acc.shape)
    return replace(s, acc=s.acc + SHAKEN_M_S2 * noise)


def drop(seed: int, angle: float, range_dps: float) -> FlightSamples:
    """Return samples of the board lifted and dropped."""
    return flight_samples(fly(board(DROP_AT + DROP_S + AFTER_S, lifted(angle), range_dps), seed), mag=False)


def wrong_start(row: str, s: FlightSamples, angle: float) -> FilterOutput:
    """Run a row over samples at rest from a start ``angle`` deg off in roll."""
    return run_filter(row, s, q0=rotation.multiply(s.q[0], rotation.from_euler(np.radians(angle), 0.0, 0.0)))


def bench_seed(seed: int) -> Measures:
    """Run all experiments on the bench for one seed.

    By row: ``spread`` at rest, ``shaken`` (roll 0, pitch 1; deg), and of a drop or a wrong start the ``settling``
    time of roll (s), its ``overshoot`` (deg), ``error`` of tilt (RMS, deg), ``above``: time with |e| above err1
    (%). ``equal``: variable and fixed integral to the last bit. ``largest e``: at rest; ``shaken e``: its mean.
    """
    still = at_rest(seed)
    rest = {row: run_filter(row, still) for row in ROWS}
    found = _spread("spread", rest) | _spread("spread", {NO_INTEGRAL: run_filter(NO_INTEGRAL, still)})
    found["largest e",] = max(float(gravity_error(still, one).max()) for one in rest.values())
    found["equal",] = float(all(np.array_equal(rest[fixed(r)].q, rest[variable(r)].q) for r in READINGS))
    shaking = shaken(still, seed)
    under = {kind(r): run_filter(kind(r), shaking) for r in READINGS for kind in (fixed, variable)}
    found |= _spread("shaken", under)
    found["shaken e",] = float(gravity_error(shaking, under[fixed("second")]).mean())
    for angle, range_dps in DROPS:
        s = drop(seed, angle, range_dps)
        for row in ROWS:
            found |= _dropped(s, run_filter(row, s), (row, angle, range_dps))
    for angle in WRONG_DEG:
        for row in ROWS:
            one = wrong_start(row, still, angle)
            roll, begin = one.errors[:, 0], float(one.t[0])
            found["settling", row, angle] = bench.settling_s(one.t, roll, begin, WRONG_WITHIN_DEG)
            found["overshoot", row, angle] = overshoot_of(one.t, roll, begin, angle, 0.0)
    return found


def _spread(what: str, found: Mapping[str, FilterOutput]) -> Measures:
    """Return standard deviations of roll (0) and pitch (1) in deg by row, straight line removed."""
    return {
        (what, row, axis): detrended_std(one.t[one.t >= SETTLED_S], one.angles[one.t >= SETTLED_S, axis])
        for row, one in found.items()
        for axis in (0, 1)
    }


def _dropped(s: FlightSamples, found: FilterOutput, where: tuple[str, float, float]) -> Measures:
    error, late = found.errors[:, 0], DROP_AT + DROP_S
    end = float(np.mean(error[found.t >= found.t[-1] - 5.0]))
    moving = (found.t >= STILL_S) & (found.t < late + 5.0)
    return {
        ("settling", *where): bench.settling_s(found.t, error - end, late, DROP_WITHIN_DEG),
        ("error", *where): rms(found.tilt_error[moving]),
        ("above", *where): 100.0 * float(np.mean(gravity_error(s, found)[moving] >= ERR1)),
    }


# Section 2 calls a vehicle beyond 45 deg unstable.
IN_CONTROL_DEG = 45.0
TRACK_S, SECONDS = 20.0, 32.0
AMPLITUDE_DEG, PERIOD_S = 15.0, 3.0


def flight_scenario(row: str) -> Scenario:
    """Return take-off, hover, a sine in roll; Lyu's board without magnetometer."""
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


def fly_row(row: str, seed: int) -> Flight:
    """Fly on one filter's attitude."""
    return fly(flight_scenario(row), seed)


def flight_seed(seed: int) -> Measures:
    """Fly all rows of one seed.

    By row: RMS ``error`` of tilt and ``tracking`` error of roll (deg), ``most``: largest true tilt (deg), ``kept``:
    in control, ``e``: largest |e|, ``equal`` to the flight on the traditional filter to the last bit.
    """
    found: Measures = {}
    for reading in READINGS:
        traditional, other = fly_row(fixed(reading), seed), fly_row(variable(reading), seed)
        found |= _flown(traditional, fixed(reading)) | _flown(other, variable(reading))
        found["equal", variable(reading)] = float(np.array_equal(traditional.truth.q, other.truth.q))
    return found


def _flown(flown: Flight, row: str) -> Measures:
    on, truth = flown.onboard, flown.truth
    true = rotation.slerp(truth.t, truth.q, np.minimum(on.t, truth.t[-1]))
    air, tracking = on.t >= 12.0, on.t >= TRACK_S + 1.0
    tilt = np.degrees(rotation.tilt_angle(rotation.earth_error(on.q, true)))[air]
    roll = np.degrees(rotation.to_euler(true)[:, 0] - rotation.to_euler(on.q_setpoint)[:, 0])[tracking]
    s = flight_samples(flown, mag=False)
    most = float(np.degrees(rotation.tilt_angle(truth.q))[truth.t >= 12.0].max())
    landed = bool(truth.ground[truth.t >= TRACK_S].any())
    return {
        ("error", row): rms(tilt),
        ("tracking", row): rms(roll),
        ("most", row): most,
        ("kept", row): float(not landed and most < IN_CONTROL_DEG),
        ("e", row): float(gravity_error(s, run_filter(row, s))[s.t >= 12.0].max()),
    }
