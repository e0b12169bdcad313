"""A simulated flight: true motion, and the samples and estimates of everything on board.

Body axes forward-right-down, earth axes north-east-down from the take-off place, SI units, radians; ``t`` s from the
start of the simulation (the boot). Quaternions are scalar first and turn body vectors into earth vectors. Of each
sensor ``t`` (n,) s is the stamp of publication, ``t_sample`` (n,) s the time of measurement as the driver has it.
Nothing here depends on a log format.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.simulate.scenario import Scenario

Array = NDArray[np.float64]


def _none(columns: int) -> Array:
    return np.zeros((0, columns))


@dataclass(slots=True)
class Truth:
    """True motion at the loop's rate (400 Hz), n samples at ``t``.

    ``q`` (n, 4); ``w`` (n, 3) body rate rad/s; ``w_dot`` (n, 3) rad/s^2; ``p v a`` (n, 3) m, m/s, m/s^2 of the
    centre of gravity in earth axes (at rest ``a`` is 0); ``rotor`` (n, 4) rad/s; ``wind`` (n, 3) m/s NED; ``field``
    (n, 3) T, earth axes, at the vehicle's place; ``ground`` (n,) whether a foot touches.
    """

    t: Array
    q: Array
    w: Array
    w_dot: Array
    p: Array
    v: Array
    a: Array
    rotor: Array
    wind: Array
    field: Array
    ground: NDArray[np.bool_]


@dataclass(slots=True)
class ImuStream:
    """One inertial unit: ``gyro`` rad/s, ``acc`` m/s^2 (specific force), each (n, 3).

    ``sampling`` interval: mean over the ``dt`` (n,) s that end at ``t_sample``, so ``gyro * dt`` is the rotation
    vector (coning corrected) of the interval; instant: the value at ``t_sample``. ``temperature`` (n,) deg C;
    ``clipped`` (n, 2) raw samples of gyro and accelerometer at their limit since the sample before. ``gyro_bias``
    and ``acc_bias`` (n, 3) are the true ones. ``lowpass_hz`` of gyro and accelerometer, 0 without.
    """

    instance: int
    sampling: Literal["interval", "instant"]
    rate_hz: float
    lowpass_hz: tuple[float, float]
    t: Array
    t_sample: Array
    dt: Array
    gyro: Array
    acc: Array
    temperature: Array
    clipped: NDArray[np.int64]
    gyro_bias: Array
    acc_bias: Array


@dataclass(slots=True)
class MagStream:
    """One magnetometer: ``field`` (n, 3) T, body axes."""

    instance: int
    rate_hz: float
    t: Array
    t_sample: Array
    field: Array


@dataclass(slots=True)
class GnssStream:
    """One GNSS receiver: positions, velocities and reported accuracies.

    ``lat lon`` deg, ``alt`` m above the ellipsoid, ``vel`` (n, 3) m/s NED, all NaN where ``fix`` is 0 (3:
    three-dimensional). ``ned`` (n, 3) m: measured position in earth axes. ``h_acc v_acc s_acc``: m, m, m/s. ``utc``
    (n,): Unix s of the epoch. ``satellites`` (n,).
    """

    instance: int
    rate_hz: float
    t: Array
    t_sample: Array
    lat: Array
    lon: Array
    alt: Array
    ned: Array
    vel: Array
    h_acc: Array
    v_acc: Array
    s_acc: Array
    fix: NDArray[np.int64]
    satellites: NDArray[np.int64]
    utc: Array


@dataclass(slots=True)
class BaroStream:
    """One barometer: ``pressure`` Pa, ``height`` m in the standard atmosphere, ``temperature`` deg C, each (n,)."""

    instance: int
    rate_hz: float
    t: Array
    t_sample: Array
    pressure: Array
    height: Array
    temperature: Array


@dataclass(slots=True)
class Onboard:
    """Estimates and set-points of the autopilot at the loop's rate; empty where it did not run.

    ``t`` (n,): ``q`` (n, 4) estimated attitude, ``bias`` (n, 3) rad/s what it takes off the gyro, ``q_setpoint``
    (n, 4), ``rate_setpoint`` (n, 3) rad/s, ``thrust_setpoint`` (n,) 0 to 1, ``torque_setpoint`` (n, 3) -1 to 1,
    ``motors`` (n, 4) commands 0 to 1 in the rotors' order. Time lines are (t, value) pairs from which on a value
    holds: ``armed``, ``landed`` booleans, ``mode`` names (``STABILIZE``, ``POSCTL``, ``GUIDED``, ``LAND``).
    ``estimator`` names the filter with preset.
    """

    t: Array = field(default_factory=lambda: np.zeros(0))
    q: Array = field(default_factory=lambda: _none(4))
    bias: Array = field(default_factory=lambda: _none(3))
    q_setpoint: Array = field(default_factory=lambda: _none(4))
    rate_setpoint: Array = field(default_factory=lambda: _none(3))
    thrust_setpoint: Array = field(default_factory=lambda: np.zeros(0))
    torque_setpoint: Array = field(default_factory=lambda: _none(3))
    motors: Array = field(default_factory=lambda: _none(4))
    armed: list[tuple[float, bool]] = field(default_factory=lambda: [(0.0, False)])
    landed: list[tuple[float, bool]] = field(default_factory=lambda: [(0.0, True)])
    mode: list[tuple[float, str]] = field(default_factory=lambda: [(0.0, "STABILIZE")])
    estimator: str = ""


@dataclass(slots=True)
class BatteryStream:
    """Battery monitor: ``t voltage current`` (n,) s, V, A; ``used`` (n,) Ah."""

    t: Array
    voltage: Array
    current: Array
    used: Array


@dataclass(slots=True)
class RpmStream:
    """Reported rotor speeds: ``rpm`` (n, 4) at ``t`` (n,) s."""

    t: Array
    rpm: Array


@dataclass(slots=True)
class Flight:
    """A simulated flight.

    ``events``: (t, text) such as an impact or the begin of a planted fault. ``gravity`` m/s^2 and
    ``declination_deg``: of the place.
    """

    scenario: Scenario
    seed: int
    gravity: float
    declination_deg: float
    truth: Truth
    imus: list[ImuStream]
    mags: list[MagStream]
    gnss: list[GnssStream]
    baro: list[BaroStream]
    onboard: Onboard
    battery: BatteryStream | None
    rpm: RpmStream | None
    events: list[tuple[float, str]] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Return the simulated time [s]."""
        return float(self.truth.t[-1]) if len(self.truth.t) else 0.0


@dataclass(slots=True)
class Fix:
    """A GNSS fix: its epoch, ``ned`` (3,) m from the take-off place, ``vel`` (3,) m/s NED."""

    t_sample: float
    ned: Array
    vel: Array


@dataclass(slots=True)
class SensorInputs:
    """Samples that arrived since the step before; the first instance of each sensor.

    ``imu`` (k, 8): t_sample, dt, gyro (3) rad/s, acc (3) m/s^2, the newest last; k is 1 where the unit runs at the
    loop's rate, 0 in between for a slower one. ``mag`` (3,) T, ``height`` m (barometer, above the take-off place),
    ``fix``: None unless new. ``truth`` (q, w, p, v) is for autopilots that fly on truth.
    """

    imu: Array
    mag: Array | None
    height: float | None
    fix: Fix | None
    truth: tuple[Array, Array, Array, Array]


class Autopilot(Protocol):
    """Estimator, guidance and controller, one step per period of the loop.

    ``step`` returns four commands, 0 to 1 (thrust over full thrust), in the rotors' order (front right, back left,
    front left, back right). ``onboard`` returns the record of all steps, once at the end.
    """

    def step(self, t: float, measured: SensorInputs) -> Array: ...

    def onboard(self) -> Onboard: ...


# Autopilot of a scenario from gravity [m/s^2] and declination [rad] of its place.
Maker = Callable[[Scenario, float, float], Autopilot]


# A touch-down faster than this is an impact; landing gear is tested for less.
IMPACT_M_S = 2.0
OVERTURNED_DEG, UPRIGHT_DEG = 90.0, 30.0
# Contacts within this time are one touch-down.
MAX_BOUNCE_S = 1.5


def flight_events(scenario: Scenario, truth: Truth, imus: Sequence[ImuStream] = ()) -> list[tuple[float, str]]:
    """Return (t, text) in order: faults, lift-off, touch-down, overturns, carrying, accelerometers at their range."""
    found = [(f.t, f"fault: {f.part} {f.instance} {f.kind}") for f in scenario.fault]
    if scenario.command or scenario.motion is None:
        carried = scenario.motion.after_s if scenario.motion is not None else None
        found += [] if carried is None else [(carried, "carried by hand")]
        end = len(truth.t) if carried is None else int(np.searchsorted(truth.t, carried))
        found += _contacts(truth, end) + _overturns(truth, end)
        found += [x for imu in imus for x in _at_the_limit(truth, imu)]
    return sorted(found)


def _contacts(truth: Truth, end: int) -> list[tuple[float, str]]:
    """Return lift-offs and touch-downs before a row of the truth."""
    found: list[tuple[float, str]] = []
    last = -np.inf
    for k in np.flatnonzero(truth.ground[1:end] != truth.ground[: end - 1]) + 1:
        t = float(truth.t[k])
        if truth.ground[k] and t - last > MAX_BOUNCE_S:
            speed = float(np.linalg.norm(truth.v[k - 1]))
            found.append((t, f"{'impact' if speed > IMPACT_M_S else 'touch-down'} at {speed:.1f} m/s"))
        elif not truth.ground[k] and not truth.ground[k : k + _sample_count(truth, MAX_BOUNCE_S)].any():
            found.append((t, "lift-off"))
        last = t
    return found


def _overturns(truth: Truth, end: int) -> list[tuple[float, str]]:
    """Return when the tilt passed 90 deg, once until it is upright again."""
    tilt = np.degrees(rotation.tilt_angle(truth.q[:end]))
    found: list[tuple[float, str]] = []
    over = False
    for k in np.flatnonzero((tilt > OVERTURNED_DEG) | (tilt < UPRIGHT_DEG)):
        if tilt[k] > OVERTURNED_DEG and not over:
            found.append((float(truth.t[k]), "overturn"))
        over = bool(tilt[k] > OVERTURNED_DEG)
    return found


def _at_the_limit(truth: Truth, imu: ImuStream) -> list[tuple[float, str]]:
    """Return from when to when an accelerometer was at its range in the air."""
    row = np.clip(np.searchsorted(truth.t, imu.t_sample), 0, len(truth.t) - 1)
    t = imu.t_sample[(imu.clipped[:, 1] > 0) & ~truth.ground[row]]
    if not len(t):
        return []
    name = f"accelerometer {imu.instance} at the end of its range"
    return [(float(t[0]), f"{name}, first"), (float(t[-1]), f"{name}, last")]


def _sample_count(truth: Truth, seconds: float) -> int:
    """Return the number of samples of the truth within a time."""
    return int(seconds / (truth.t[1] - truth.t[0]))


# Range of the flat earth and the standard atmosphere.
MAX_DISTANCE_M = 50_000.0
# Rates [rad/s] and specific forces [m/s^2] beyond any sensor; single precision still holds them.
MAX_SAMPLE = 1e9


def check_truth(truth: Truth) -> None:
    """Raise UsageError where the motion is not finite or leaves the simulated world, with its time."""
    rows = np.hstack([truth.q, truth.w, truth.p, truth.v, truth.a])
    gone = ~np.isfinite(rows).all(axis=1) | (np.abs(truth.p) > MAX_DISTANCE_M).any(axis=1)
    if gone.any():
        raise UsageError(
            f"the motion cannot be computed from {truth.t[np.argmax(gone)]:.3g} s on: the vehicle leaves "
            f"{MAX_DISTANCE_M / 1000:g} km or every bound; look at vehicle, controller, wind and motion"
        )


def check_samples(streams: Sequence[tuple[str, ImuStream]]) -> None:
    """Raise UsageError for an IMU without samples or with values that a log cannot hold."""
    for name, stream in streams:
        if not len(stream.t):
            raise UsageError(f"sensors.{name} gives no sample in this flight; look at its rate, loss and gaps")
        for part, values in (("gyro", stream.gyro), ("acc", stream.acc)):
            if not (np.abs(values) < MAX_SAMPLE).all():
                raise UsageError(f"sensors.{name}.{part} gives no finite numbers; look at its noise, step and scale")
