"""A simulated flight: what happened, and what everything on board measured and thought.

Body axes forward-right-down, earth axes north-east-down from the take-off place, SI units,
radians; ``t`` s from the start of the simulation (the boot). Quaternions are scalar first and
turn body vectors into earth vectors. Of each sensor: ``t`` (n,) s is the stamp of publication, ``t_sample`` (n,) s the
time of measurement as the driver knows it. Nothing here depends on a log format.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from attlog.simulate.scenario.scenario import Scenario

Array = NDArray[np.float64]


def _none(columns: int) -> Array:
    return np.zeros((0, columns))


@dataclass(slots=True)
class Truth:
    """What happened, at the loop's rate (400 Hz), n samples at ``t``.

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
    """One receiver: ``lat lon`` deg, ``alt`` m above the ellipsoid, ``vel`` (n, 3) m/s NED, all NaN where ``fix``
    is 0 (3: three- dimensional). ``ned`` (n, 3) m is the measured position in earth axes. ``h_acc v_acc s_acc`` m,
    m, m/s as the receiver states them; ``utc`` (n,) Unix s of the epoch, ``satellites`` (n,)."""

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
    """One barometer: ``pressure`` Pa, ``height`` m above sea level in the standard atmosphere, ``temperature`` deg
    C, each (n,)."""

    instance: int
    rate_hz: float
    t: Array
    t_sample: Array
    pressure: Array
    height: Array
    temperature: Array


@dataclass(slots=True)
class Onboard:
    """What the autopilot estimated and wanted, at the loop's rate; empty arrays where it did not run.

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
    """The battery's monitor: ``t voltage current`` (n,) s, V, A; ``used`` (n,) Ah."""

    t: Array
    voltage: Array
    current: Array
    used: Array


@dataclass(slots=True)
class RpmStream:
    """Rotor speeds as told: ``rpm`` (n, 4) at ``t`` (n,) s."""

    t: Array
    rpm: Array


@dataclass(slots=True)
class Flight:
    """A simulated flight. ``events`` are (t, what) such as an impact or a planted fault that began; ``gravity``
    m/s^2 and ``declination_deg`` hold at the place. ``extra`` is free for those who add to a flight."""

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
    extra: dict[str, Any] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """Time that was simulated, s."""
        return float(self.truth.t[-1]) if len(self.truth.t) else 0.0
