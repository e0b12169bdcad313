"""How a truth that the user brought came onto the log's clock and axes, and how wrong it may be itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import guarded
from attlog.flight.advice import GENERAL_REMEDIES, Fault, LoggingAdvice, LoggingNeed, advise_rest
from attlog.flight.vehicle import VehicleKind, vehicle_kind

Angles = tuple[float, float, float]
"""Roll, pitch and yaw in deg."""


@dataclass(frozen=True, slots=True)
class TruthFit:
    """What :mod:`attlog.external.attitude` found of an attitude called ``name`` (a file, or a message of the log).

    Its times become the log's by ``offset_s`` at the middle of what both cover and ``drift_ppm``, its body axes
    forward-right-down by ``body_deg``, its earth axes north-east-down by ``world_deg``. ``correlation`` of its angular
    rates with the gyro's (0 to 1), ``residual_dps`` the RMS of their difference, over ``n`` samples in ``seconds``.
    ``sigma_tilt_deg`` and ``sigma_heading_deg``: its own noise and what the fit leaves open, one sigma.
    ``north``: whose north its heading has: that of the ``file``, of ``gnss`` motion, or ``nobody``'s.
    """

    name: str
    offset_s: float
    offset_sigma_s: float
    drift_ppm: float
    drift_sigma_ppm: float
    body_deg: Angles
    world_deg: Angles
    correlation: float
    residual_dps: float
    n: int
    seconds: float
    sigma_tilt_deg: float
    sigma_heading_deg: float
    north: Literal["file", "gnss", "nobody"] = "nobody"
    reading: str = ""
    """How its numbers were read: ``body to earth, scalar last``."""


# What a log holds of vibration beside its continuous samples: the autopilot's own levels, bursts, onboard spectra.

Array = NDArray[np.float64]
VibrationMeasure = Literal["rest", "difference"]
"""How a level is made. ``rest`` (ArduPilot's VIBE): root of the low-passed square of what a 5 Hz low-pass leaves, per
axis. ``difference`` (PX4): low-passed length of the difference of successive samples."""


@dataclass(frozen=True, slots=True)
class VibrationLimits:
    """What a measure's level may be: ``share`` of the flight is judged, ``warning`` and ``fault`` in m/s^2."""

    share: float
    warning: float
    fault: float
    source: str


VIBRATION_LIMITS: dict[VibrationMeasure, VibrationLimits] = {
    "rest": VibrationLimits(0.95, 30.0, 60.0, "ardupilot.org, Measuring Vibration"),
    "difference": VibrationLimits(0.80, 9.81, np.inf, "PX4 Flight Review, Vibration Metrics"),
}
"""PX4 names no level at which a flight fails, only where its plot turns red, which its author (pull request 252 of
Flight Review) calls a guess: it is a warning, and clipping tells the rest."""


@dataclass(slots=True)
class OnboardVibration:
    """The level that the autopilot measured of one unit: ``level`` (n,) m/s^2 at ``t`` (n,) s, of the worst axis where
    the measure has axes. ``unit`` is the IMU's index."""

    unit: int
    measure: VibrationMeasure
    source: str
    t: Array
    level: Array


@dataclass(slots=True)
class Burst:
    """Successive samples of one sensor at its own rate, between pauses: ``x`` (n, 3) rad/s or m/s^2 at ``rate`` Hz from
    ``t`` s on. ``filtered``: behind the autopilot's low-pass and notches."""

    sensor: Literal["gyro", "accelerometer"]
    unit: int
    t: float
    rate: float
    x: NDArray[np.float32]
    filtered: bool
    source: str


@dataclass(slots=True)
class OnboardSpectrum:
    """The peaks that the autopilot found in its gyro at ``rate`` Hz: ``peaks`` (n, k) Hz at ``t`` (n,) s, NaN for none,
    each good to ``resolution`` Hz."""

    t: Array
    peaks: Array
    rate: float
    resolution: float
    source: str


# A flight as numbers: one clock, SI units, body FRD, earth NED.
#
# ``t`` is float64 seconds; 0 is the first sample of the IMU that is replayed. The
# autopilot's own clock at that instant is ``FlightLog.t0_us``. Quaternions are
# scalar first and turn body vectors into earth vectors.

T = TypeVar("T")
Severity = Literal["info", "note", "warning", "error"]
PAUSE_S = 1.0
"""Holes longer than this and than five intervals are pauses of the logger (disarmed, telemetry lost)."""


def without_pauses(t: Array) -> NDArray[np.bool_]:
    """Which intervals (n - 1,) between samples at ``t`` (n,) s are no pauses of the logger."""
    dt = np.diff(t)
    return dt <= max(PAUSE_S, 5.0 * float(np.median(dt))) if len(dt) else np.zeros(0, bool)


def covered_seconds(t: Array) -> float:
    """Time in s that samples at ``t`` (n,) s cover, pauses left out."""
    return float(np.diff(t)[without_pauses(t)].sum())


def logged_rate(t: Array) -> float:
    """Mean rate in Hz of samples at ``t`` (n,) s: count over span without pauses, 0 for fewer than two samples."""
    span = covered_seconds(t)
    return float(np.count_nonzero(without_pauses(t))) / span if span > 0 else 0.0


FIX_3D = 3
BEGINS_DISARMED_S = 5.0
"""A log that is armed later than this after its start does not wait for arming."""


@dataclass(slots=True)
class Stream:
    """A measured quantity over time.

    ``t`` (n,) s and ``x`` (n, k) in ``unit`` (SI). ``sampling`` is ``interval`` where a
    value is the mean over the interval that ends at its stamp (PX4), ``instant``
    where it is the value at the stamp (ArduPilot). ``delay`` (s) is the known lag of
    filters ahead of the logger. ``t_sample`` is set where the time of measurement
    differs from the time of publication ``t``.
    """

    t: Array
    x: Array
    unit: str
    frame: str
    source: str
    sampling: Literal["interval", "instant"] = "instant"
    delay: float = 0.0
    t_sample: Array | None = None

    @property
    def rate(self) -> float:
        """Mean rate in Hz while the logger ran, 0 for fewer than two samples."""
        return logged_rate(self.t)

    @property
    def t_best(self) -> Array:
        """The time of measurement where the log tells it, else the stamp."""
        return self.t if self.t_sample is None else self.t_sample


@dataclass(slots=True)
class Imu:
    """One inertial unit. ``gyro`` rad/s and ``acc`` m/s^2 (specific force) at the same times.

    ``filtered`` says what happened before logging ("none", "low-pass 80 Hz", ...).
    ``dt`` (n,) is the own integration time of each sample where the log holds
    increments (delta angles), else None. ``acc_device`` is the accelerometer's id where the log tells it.
    """

    index: int
    gyro: Stream
    acc: Stream
    calibrated: bool = True
    filtered: str = "unknown"
    device: str | None = None
    temperature: Stream | None = None
    dt: Array | None = None
    note: str = ""
    acc_device: str | None = None


@dataclass(slots=True)
class Mag:
    """One magnetometer, ``field`` in tesla (n, 3), body FRD, calibrated unless said.

    ``raw`` are some hundred records of what the driver gave before any calibration, in the sensor's axes, where the log
    holds them beside; ``offsets`` the offsets that the firmware says it applied, at each change. Both in tesla.
    """

    index: int
    field: Stream
    calibrated: bool = True
    device: str | None = None
    enabled: bool = True
    raw: Stream | None = None
    offsets: Stream | None = None


@dataclass(slots=True)
class Reception:
    """What a receiver says of its signals at the times of :class:`Gnss`: all (n,), NaN where it does not tell.

    ``noise`` and ``jamming`` (0 to 255) are u-blox's noise level and indicator of narrow-band interference;
    ``jamming_state`` 1 ok, 2 warning, 3 critical, ``spoofing_state`` 1 none, 2 indicated, 3 by several signs.
    """

    satellites: Array
    hdop: Array
    noise: Array
    jamming: Array
    jamming_state: Array
    spoofing_state: Array


@dataclass(slots=True)
class Gnss:
    """One receiver at ``t`` (n,): degrees, metres, m/s NED; NaN where the log has no value.

    ``yaw`` (n,) rad is the heading of a receiver with two antennas, ``utc_us`` (n,) Unix
    time, 0 where unknown. Without a fix position and velocity are NaN. ``received`` (n,) s is when the autopilot took
    the record to have come, before its delay parameter, None where that is ``t``.
    """

    index: int
    t: Array
    source: str
    lat: Array
    lon: Array
    alt: Array
    vel_ned: Array
    h_acc: Array
    v_acc: Array
    s_acc: Array
    fix: NDArray[np.int64]
    yaw: Array | None = None
    utc_us: NDArray[np.int64] | None = None
    received: Array | None = None
    reception: Reception | None = None

    @property
    def heading(self) -> Stream | None:
        """The heading (n, 1) rad of two antennas where it has a 3D fix; None of a receiver without."""
        if self.yaw is None:
            return None
        good = np.isfinite(self.yaw) & np.isfinite(self.t) & (self.fix >= FIX_3D)
        return Stream(self.t[good], self.yaw[good, None], "rad", "NED", f"dual-antenna yaw of {self.source}")


@dataclass(slots=True)
class Attitude:
    """An attitude somebody estimated: ``q`` (n, 4) at ``t``.

    ``resets`` (k,) are indices i where the step from sample i-1 to i is a reset and
    not a rotation. ``has_trim`` is True where the vehicle's trim (ArduPilot
    AHRS_TRIM) is already taken out. ``step_deg`` is the quantisation of the logged
    values in degrees (0 for float).
    """

    t: Array
    q: Array
    source: str
    t_sample: Array | None = None
    resets: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    has_trim: bool = False
    step_deg: float = 0.0
    normal: bool = False
    """Whether ``q`` was normalized already: who needs it so takes the array itself, because copies add up."""
    position: Array | None = None
    """Where it was (n, 3) m, of a pose in axes of its own."""
    fit: TruthFit | None = None
    """How it came onto the log's clock and axes, of a truth that the user brought."""

    @property
    def rate(self) -> float:
        """Mean rate in Hz while the logger ran, 0 for fewer than two samples."""
        return logged_rate(self.t)

    def covers(self, t: Array) -> NDArray[np.bool_]:
        """Which of the times (m,) s it covers: between two of its samples without a pause between them."""
        if len(self.t) < 2:
            return np.zeros(len(t), bool)
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        inside = (t >= self.t[0]) & (t <= self.t[-1])
        covered: NDArray[np.bool_] = inside & without_pauses(self.t)[k]
        return covered


@dataclass(slots=True)
class TimeLine:
    """A value that holds from ``t[i]`` until ``t[i+1]``: modes, arming, parameters."""

    t: Array
    value: list[Any]
    source: str

    def at(self, t: float) -> Any:
        """The value that holds at ``t``; the first value before the first entry, None if empty."""
        if len(self.value) < 2:  # as of most parameters, of which a log has a thousand
            return self.value[0] if self.value else None
        i = int(np.searchsorted(self.t, t, side="right")) - 1
        return self.value[max(i, 0)]


@dataclass(slots=True)
class Clipping:
    """Samples at the end of a sensor's range, as the autopilot counted them.

    ``new`` (n,) of them came by ``t`` (n,) s since the record before. ``unit`` is None where it is the selected one,
    whichever that was. ``whole``: every sample was counted; else only what a slower record happens to show.
    """

    sensor: str
    unit: int | None
    source: str
    t: Array
    new: NDArray[np.int64]
    whole: bool


@dataclass(slots=True)
class InnovationTest:
    """How far what an ``aid`` (compass, velocity, position, height, airspeed) measured was from the onboard estimator's
    prediction: ``ratio`` (n,) of its own gate at ``t`` (n,) s, above 1 rejected, whether logged squared or as its root.
    """

    aid: str
    t: Array
    ratio: Array
    source: str


@dataclass(frozen=True, slots=True)
class Firmware:
    """Who flew: ``name`` is ``PX4`` or ``ArduPilot`` (or what the log says), ``version`` as text."""

    name: str
    version: str = ""
    git: str = ""
    board: str = ""

    def __str__(self) -> str:
        return " ".join(x for x in (self.name, self.version) if x)


@dataclass(frozen=True, slots=True)
class Problem:
    """Something the reader of a result must know. ``t`` s (of the first, of ``count``) or ``offset`` bytes say where.

    ``value`` in ``unit`` is its size. One sentence each: ``cause`` and ``remedy``; empty where nothing is known.
    """

    code: str
    severity: Severity
    text: str
    t: float | None = None
    offset: int | None = None
    count: int = 1
    value: float | None = None
    unit: str = ""
    cause: str = ""
    remedy: str = ""


@dataclass(slots=True)
class FlightLog:
    """Everything of one boot that attlog uses. See the module docstring for clock and frames.

    ``imus[imu]`` is the one to replay, ``mags[mag]`` likewise (None: no usable one);
    the reason for each choice stands in ``choices`` (quantity -> sentence).
    ``attitudes`` maps source names to attitudes; ``onboard`` names the one that flew.
    ``setpoints`` is the attitude set-point, ``rate_setpoints`` a stream in rad/s.
    ``rangefinder`` (n, 1) m is the distance to what lies below, readings out of range left out.
    ``motors`` (n, motors) are the outputs to them, 0 stopped to 1 full, where the log tells which outputs these are.
    ``utc_offset`` (s) turns ``t`` into Unix time where GNSS told it. ``vehicle`` is what
    people call the vehicle, ``kind`` what it can do. ``trim`` (3,) rad is the rotation
    between IMU and vehicle that attitudes with ``has_trim`` have taken out, and
    ``declination_param`` (deg, east positive) what the autopilot was told; None where the
    log does not tell, with the names of the parameters in ``trim_source`` and
    ``declination_source``. ``given_params`` are those of a ground station's file, ``filled_params`` the names
    that only the file told. ``logging`` knows the vehicle's logging settings,
    ``remedies`` what to do about a fault, ``compass_switches`` the parameter that uses a compass, by its index,
    ``compass_first`` the one that says with which an estimator starts, empty without.
    ``acc_bias`` (n, 3) m/s^2 is what the onboard estimator takes off the accelerometer in body axes,
    ``onboard_gyro_bias`` (n, 3) rad/s what it takes off the gyro that is replayed, None where it runs on another one;
    ``onboard_vibration`` (n, 3) m/s^2 the level that the autopilot measures itself at full rate, ``vibrations`` that of
    every unit in the firmware's own measure, ``bursts`` samples at the sensors' own rate, ``onboard_spectrum`` the
    peaks that the autopilot finds in its gyro.
    ``lane`` is the EKF core or instance that flew, by its number.
    ``true_heading`` (n, 1) rad is a heading that the user brought as the true one.
    ``poses`` maps topics to attitudes that motion capture or vision measured, in axes of their own, not yet aligned.
    ``yaw_estimator`` (n, 2) rad is the heading that the autopilot finds from GNSS motion without a compass, and its one
    sigma, where it calls it valid.
    """

    path: Path
    format: str
    size: int
    t0_us: int
    firmware: Firmware
    vehicle: str
    simulated: bool = False
    utc_offset: float | None = None
    imus: list[Imu] = field(default_factory=list)
    imu: int | None = None
    imu_that_flew: TimeLine | None = None
    mags: list[Mag] = field(default_factory=list)
    mag: int | None = None
    gnss: list[Gnss] = field(default_factory=list)
    baro: list[Stream] = field(default_factory=list)
    rangefinder: Stream | None = None
    airspeed: Stream | None = None
    attitudes: dict[str, Attitude] = field(default_factory=dict)
    onboard: str | None = None
    truth: Attitude | None = None
    poses: dict[str, Attitude] = field(default_factory=dict)
    true_heading: Stream | None = None
    setpoints: Attitude | None = None
    rate_setpoints: Stream | None = None
    armed: TimeLine | None = None
    landed: TimeLine | None = None
    mode: TimeLine | None = None
    throttle: Stream | None = None
    motors: Stream | None = None
    rpm: Stream | None = None
    battery: Stream | None = None
    params: dict[str, TimeLine] = field(default_factory=dict)
    param_defaults: dict[str, float] = field(default_factory=dict)
    given_params: dict[str, float] = field(default_factory=dict)
    filled_params: frozenset[str] = frozenset()
    trim: Array | None = None
    trim_source: str = ""
    declination_param: float | None = None
    declination_source: str = ""
    logging: LoggingAdvice | None = None
    remedies: dict[Fault, str] = field(default_factory=lambda: dict(GENERAL_REMEDIES))
    compass_switches: dict[int, str] = field(default_factory=dict)
    compass_first: str = ""
    acc_bias: Stream | None = None
    onboard_gyro_bias: Stream | None = None
    onboard_vibration: Stream | None = None
    vibrations: list[OnboardVibration] = field(default_factory=list)
    bursts: list[Burst] = field(default_factory=list)
    onboard_spectrum: OnboardSpectrum | None = None
    yaw_estimator: Stream | None = None
    clippings: list[Clipping] = field(default_factory=list)
    innovation_tests: list[InnovationTest] = field(default_factory=list)
    lane: TimeLine | None = None
    texts: list[tuple[float, int, str]] = field(default_factory=list)
    boot: int = 0
    boots: int = 1
    choices: dict[str, str] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def kind(self) -> VehicleKind:
        """What the vehicle can do; OTHER where the log does not tell what it is."""
        return vehicle_kind(self.vehicle)

    @property
    def replay_imu(self) -> Imu | None:
        """The IMU to replay, None where no unit can be."""
        return None if self.imu is None else self.imus[self.imu]

    @property
    def onboard_attitude(self) -> Attitude | None:
        """The attitude that flew, None where the log holds none."""
        return self.attitudes.get(self.onboard or "")

    @property
    def truth_with_north(self) -> Attitude | None:
        """The truth where its heading means something: not of one that was brought without a north."""
        return None if self.truth is None or (self.truth.fit and self.truth.fit.north == "nobody") else self.truth

    def advice(self, what: LoggingNeed, rate: float | None = None) -> str:
        """What would log ``what``: the setting that is missing, or the reason where every setting is right.

        ``rate`` (Hz) is that of the records the log holds, None where it holds none.
        Empty where nothing is known of the firmware's settings.
        """
        if what == "rest" and self.begins_disarmed:
            return advise_rest("The log begins before arming already")
        return "" if self.logging is None else self.logging.advice(what, rate)

    @property
    def begins_disarmed(self) -> bool:
        """Whether the log was running for some seconds before the vehicle was armed for the first time."""
        if self.armed is None or not self.armed.value or self.armed.value[0]:
            return False
        ends = self.armed.t[1] if len(self.armed.t) > 1 else self.seconds
        return float(ends) >= BEGINS_DISARMED_S

    def param(self, name: str, t: float | None = None) -> float | None:
        """A parameter's value at ``t`` (default: at the first IMU sample); None if the log has none."""
        line = self.params.get(name)
        return None if line is None else line.at(0.0 if t is None else t)


def guarded_part(log: FlightLog, what: str, make: Callable[[], T], otherwise: Callable[[], T]) -> T:
    """A part of what is found out about a log; where that ends in a bug it is a problem of the log, and
    ``otherwise`` stands in (``attlog/barrier.py``)."""

    def without(sentence: str) -> T:
        log.problems.append(Problem("part_failed", "error", sentence))
        return otherwise()

    return guarded(what, make, without)
