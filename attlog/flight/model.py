"""A flight as numbers: one clock, SI units, body axes forward-right-down, earth axes north-east-down.

``t`` is float64 seconds from the first sample of the replayed IMU; the autopilot's own clock at that instant is
``FlightLog.t0_us``. Quaternions are scalar first and turn body vectors into earth vectors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from attlog.core.errors import guarded
from attlog.flight.advice import LoggingNeed, VehicleSettings, advise_rest, logging_advice, remedy
from attlog.flight.vehicle import VehicleKind, vehicle_kind

Array = NDArray[np.float64]
T = TypeVar("T")
Severity = Literal["info", "note", "warning", "error"]
# Roll, pitch and yaw in deg.
Angles = tuple[float, float, float]

# A hole longer than this and than five intervals is a pause of the logger (disarmed, telemetry lost).
PAUSE_S = 1.0
FIX_3D = 3
# A log that is armed later than this after its start does not wait for arming.
BEGINS_DISARMED_S = 5.0


def without_pauses(t: Array) -> NDArray[np.bool_]:
    """Mark the intervals (n - 1,) between samples at ``t`` (n,) s that are no pause of the logger."""
    dt = np.diff(t)
    return dt <= max(PAUSE_S, 5.0 * float(np.median(dt))) if len(dt) else np.zeros(0, bool)


def covered_seconds(t: Array) -> float:
    """Return the time in s that samples at ``t`` (n,) s cover, without pauses."""
    return float(np.diff(t)[without_pauses(t)].sum())


def logged_rate(t: Array) -> float:
    """Return the mean rate in Hz while the logger ran, 0 for fewer than two samples."""
    span = covered_seconds(t)
    return float(np.count_nonzero(without_pauses(t))) / span if span > 0 else 0.0


@dataclass(slots=True)
class Stream:
    """A measured quantity over time: ``x`` (n, k) in ``unit`` (SI) at ``t`` (n,) s.

    ``sampling`` is ``interval`` where a value is the mean over the interval that ends at its stamp (PX4), ``instant``
    where it is the value at the stamp (ArduPilot). ``delay`` (s): lag of the filters ahead of the logger.
    ``t_sample``: time of measurement, where it differs from the time of publication ``t``.
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
        """The time of measurement where it is logged, else the stamp."""
        return self.t if self.t_sample is None else self.t_sample


@dataclass(slots=True, weakref_slot=True)
class Imu:
    """An inertial unit: ``gyro`` rad/s and ``acc`` m/s^2 (specific force) at the same times.

    ``filtered``: processing before the logger ("none", "low-pass 80 Hz", ...). ``dt`` (n,): integration time of each
    sample where the log holds increments. ``device`` and ``acc_device``: ids of gyro and accelerometer.
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
    """A magnetometer: ``field`` (n, 3) in tesla, body axes.

    ``raw``: some hundred uncalibrated records in the sensor's axes. ``offsets``: offsets that the firmware reports to
    have applied, at each change. Both in tesla, None where they are not logged.
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
    """Signal quality of a receiver at the times of :class:`Gnss`, each (n,), NaN where it is not logged.

    ``noise`` and ``jamming`` (0 to 255): u-blox's noise level and indicator of narrow-band interference.
    ``jamming_state``: 1 ok, 2 warning, 3 critical. ``spoofing_state``: 1 none, 2 indicated, 3 by several signs.
    """

    satellites: Array
    hdop: Array
    noise: Array
    jamming: Array
    jamming_state: Array
    spoofing_state: Array


@dataclass(slots=True)
class Gnss:
    """A receiver at ``t`` (n,) s: degrees, metres, m/s north-east-down; NaN without a value or a fix.

    ``yaw`` (n,) rad: heading of two antennas. ``utc_us`` (n,): Unix time, 0 where unknown. ``received`` (n,) s: arrival
    at the autopilot before its delay parameter is subtracted, None where it equals ``t``.
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
        """The heading (n, 1) rad of two antennas during a 3D fix, None of a single antenna."""
        if self.yaw is None:
            return None
        good = np.isfinite(self.yaw) & np.isfinite(self.t) & (self.fix >= FIX_3D)
        return Stream(self.t[good], self.yaw[good, None], "rad", "NED", f"dual-antenna yaw of {self.source}")


@dataclass(frozen=True, slots=True)
class TruthFit:
    """Fit of an external attitude to the log's clock and axes, with its uncertainty.

    ``name``: its file or message. Its times become the log's by ``offset_s`` at the middle of the common time and by
    ``drift_ppm``; ``body_deg`` turns its body axes to forward-right-down, ``world_deg`` its earth axes to
    north-east-down. ``correlation`` (0 to 1) and ``residual_dps`` (rms difference) compare its angular rates with the
    gyro's, over ``n`` samples in ``seconds``. ``sigma_tilt_deg`` and ``sigma_heading_deg``: own noise and open part of
    the fit, one sigma. ``north``: origin of its heading. ``reading``: conventions of its numbers ("scalar last").
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


@dataclass(slots=True)
class Attitude:
    """An estimated or measured attitude: ``q`` (n, 4) at ``t`` (n,) s.

    ``resets`` (k,): indices i where the step from sample i-1 to i is a reset and no rotation. ``has_trim``: the
    vehicle's trim (ArduPilot AHRS_TRIM) is already taken out. ``step_deg``: quantisation of the logged values (0 for
    float). ``normal``: ``q`` is normalized already, and readers may take the array itself. ``position`` (n, 3) m: of a
    pose in its own axes. ``fit``: of an external truth.
    """

    t: Array
    q: Array
    source: str
    t_sample: Array | None = None
    resets: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    has_trim: bool = False
    step_deg: float = 0.0
    normal: bool = False
    position: Array | None = None
    fit: TruthFit | None = None

    @property
    def rate(self) -> float:
        """Mean rate in Hz while the logger ran, 0 for fewer than two samples."""
        return logged_rate(self.t)

    def covers(self, t: Array) -> NDArray[np.bool_]:
        """Mark the times (m,) s between two samples without a pause of the logger."""
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
        """Return the value at ``t``: the first value before the first entry, None if empty."""
        if len(self.value) < 2:  # as of most parameters, of which a log has a thousand
            return self.value[0] if self.value else None
        i = int(np.searchsorted(self.t, t, side="right")) - 1
        return self.value[max(i, 0)]


@dataclass(slots=True)
class FlightState:
    """Arming, ground contact and flight mode over time, None where the log does not hold them."""

    armed: TimeLine | None = None
    landed: TimeLine | None = None
    mode: TimeLine | None = None


@dataclass(slots=True)
class Setpoints:
    """Commanded attitude and commanded body rates (n, 3) rad/s."""

    attitude: Attitude | None = None
    rates: Stream | None = None


@dataclass(slots=True)
class Power:
    """Drive of the vehicle.

    ``throttle`` (n, 1) 0 to 1. ``motors`` (n, motors): outputs from 0 (stopped) to 1 (full). ``rpm`` (n, rotors).
    ``battery`` (n, 2): V and A.
    """

    throttle: Stream | None = None
    motors: Stream | None = None
    rpm: Stream | None = None
    battery: Stream | None = None


@dataclass(slots=True)
class Parameters:
    """Parameters of the vehicle by name, and the quantities that follow from them.

    ``lines``: values over time. ``defaults``: as the log reports them. ``given``: values of a ground station's file.
    ``filled``: names that only this file holds. ``trim`` (3,) rad: rotation between IMU and vehicle that attitudes
    with ``has_trim`` have taken out. ``declination`` (deg, east positive): as set in the autopilot. Both are None
    where the log lacks the parameters named in ``trim_source`` and ``declination_source``.
    """

    lines: dict[str, TimeLine] = field(default_factory=dict)
    defaults: dict[str, float] = field(default_factory=dict)
    given: dict[str, float] = field(default_factory=dict)
    filled: frozenset[str] = frozenset()
    trim: Array | None = None
    trim_source: str = ""
    declination: float | None = None
    declination_source: str = ""


@dataclass(slots=True)
class InnovationTest:
    """Innovation test of the onboard estimator for an ``aid``: ``ratio`` (n,) to its gate at ``t`` (n,) s.

    Aids: compass, velocity, position, height, airspeed. Above 1 the aid is rejected.
    """

    aid: str
    t: Array
    ratio: Array
    source: str


@dataclass(slots=True)
class OnboardEstimator:
    """States of the onboard estimator beside its attitude.

    ``gyro_bias`` (n, 3) rad/s: subtracted from the replayed gyro, None where it runs on another one. ``acc_bias``
    (n, 3) m/s^2: subtracted from the accelerometer. ``yaw`` (n, 2) rad: heading from GNSS motion without a compass and
    its sigma, while it is valid. ``lane``: number of the EKF core or instance that flew. ``inputs`` reads all that the
    filter was given, for a re-run of it; None where that is not known of the firmware.
    """

    gyro_bias: Stream | None = None
    acc_bias: Stream | None = None
    yaw: Stream | None = None
    innovation_tests: list[InnovationTest] = field(default_factory=list)
    lane: TimeLine | None = None
    inputs: Callable[..., Any] | None = None


# How a vibration level is made. ``rest`` (ArduPilot's VIBE): root of the low-passed square of what a 5 Hz low-pass
# leaves, per axis. ``difference`` (PX4): low-passed length of the difference of successive samples.
VibrationMeasure = Literal["rest", "difference"]


@dataclass(frozen=True, slots=True)
class VibrationLimits:
    """Limits of a vibration level: quantile ``share`` of the flight, ``warning`` and ``fault`` in m/s^2."""

    share: float
    warning: float
    fault: float
    source: str


# PX4 documents no level at which a flight fails. The red line of its plot is a guess of its author (pull request 252
# of Flight Review): a warning; clipping shows the rest.
VIBRATION_LIMITS: dict[VibrationMeasure, VibrationLimits] = {
    "rest": VibrationLimits(0.95, 30.0, 60.0, "ardupilot.org, Measuring Vibration"),
    "difference": VibrationLimits(0.80, 9.81, np.inf, "PX4 Flight Review, Vibration Metrics"),
}


@dataclass(slots=True)
class OnboardVibration:
    """Vibration level (n,) m/s^2 at ``t`` (n,) s that the autopilot measured of an IMU, of the worst axis."""

    unit: int
    measure: VibrationMeasure
    source: str
    t: Array
    level: Array


@dataclass(slots=True)
class Burst:
    """Successive samples ``x`` (n, 3) rad/s or m/s^2 of a sensor at its own ``rate`` Hz, from ``t`` s on.

    ``filtered``: taken behind the autopilot's low-pass and notches.
    """

    sensor: Literal["gyro", "accelerometer"]
    unit: int
    t: float
    rate: float
    x: NDArray[np.float32]
    filtered: bool
    source: str


@dataclass(slots=True)
class OnboardSpectrum:
    """Peaks (n, k) Hz that the autopilot found in its gyro of ``rate`` Hz, at ``t`` (n,) s; NaN for none.

    ``resolution`` Hz: width of a bin.
    """

    t: Array
    peaks: Array
    rate: float
    resolution: float
    source: str


@dataclass(slots=True)
class Clipping:
    """Samples at the end of a sensor's range, as the autopilot counted them.

    ``new`` (n,): samples since the record before, at ``t`` (n,) s. ``unit``: None for the selected unit. ``whole``:
    every sample was counted, not only those of slower records.
    """

    sensor: str
    unit: int | None
    source: str
    t: Array
    new: NDArray[np.int64]
    whole: bool


@dataclass(slots=True)
class Vibration:
    """Vibration as logged beside the continuous samples.

    ``level`` (n, 3) m/s^2: the autopilot's own measure of the replayed IMU, by axis. ``levels``: the level of every
    IMU. ``bursts``: samples at the sensors' own rate. ``spectrum``: peaks of the onboard gyro spectrum.
    """

    level: Stream | None = None
    levels: list[OnboardVibration] = field(default_factory=list)
    bursts: list[Burst] = field(default_factory=list)
    spectrum: OnboardSpectrum | None = None
    clippings: list[Clipping] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Firmware:
    """The autopilot's firmware: ``name`` is ``PX4``, ``ArduPilot`` or as logged; ``version`` as text."""

    name: str
    version: str = ""
    git: str = ""
    board: str = ""

    def __str__(self) -> str:
        return " ".join(x for x in (self.name, self.version) if x)


@dataclass(frozen=True, slots=True)
class Problem:
    """A defect of the log that readers of a result must know.

    ``t`` s (the first of ``count``) or ``offset`` bytes locate it; ``value`` in ``unit`` is its size. ``cause`` and
    ``remedy``: a sentence each, empty where unknown.
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
    """One power-up of a vehicle: sensors, attitudes, state and parameters on one clock.

    ``imus[imu]`` is replayed, ``mags[mag]`` likewise (None: no usable one); ``choices`` gives the reason of each
    choice. ``attitudes`` maps sources to attitudes, ``onboard`` names the one that flew. ``truth``: a simulator's or an
    external attitude. ``poses``: attitudes of motion capture or vision by topic, in their own axes. ``true_heading``
    (n, 1) rad: an external heading. ``rangefinder`` (n, 1) m: distance to the ground within the sensor's range.
    ``utc_offset`` (s) turns ``t`` into Unix time. ``vehicle``: its usual name, ``kind`` its abilities. ``texts``:
    messages of the autopilot (t, syslog level, text). ``settings``: what advice on the vehicle's settings is based on.
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
    state: FlightState = field(default_factory=FlightState)
    setpoints: Setpoints = field(default_factory=Setpoints)
    power: Power = field(default_factory=Power)
    parameters: Parameters = field(default_factory=Parameters)
    estimator: OnboardEstimator = field(default_factory=OnboardEstimator)
    vibration: Vibration = field(default_factory=Vibration)
    settings: VehicleSettings = field(default_factory=VehicleSettings)
    texts: list[tuple[float, int, str]] = field(default_factory=list)
    boot: int = 0
    boots: int = 1
    choices: dict[str, str] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def kind(self) -> VehicleKind:
        """The vehicle's abilities, OTHER for an unknown vehicle."""
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
        """The truth, unless its heading has no known north."""
        return None if self.truth is None or (self.truth.fit and self.truth.fit.north == "nobody") else self.truth

    def advice(self, what: LoggingNeed, rate: float | None = None) -> str:
        """Name the setting that would log ``what``, or the reason where every setting is right.

        ``rate``: of the logged records in Hz, None without any. Empty where the firmware's settings are unknown.
        """
        if what == "rest" and self.begins_disarmed:
            return advise_rest("The log begins before arming already")
        return logging_advice(self.settings, what, rate)

    def remedy(self, fault: str) -> str:
        """Return what to do about a fault by the vehicle's parameters, empty where nothing helps."""
        mag = None if self.mag is None else self.mags[self.mag]
        return remedy(self.settings, fault, 0 if mag is None else mag.index, None if mag is None else mag.device)

    @property
    def begins_disarmed(self) -> bool:
        """Whether the log ran for some seconds before the first arming."""
        armed = self.state.armed
        if armed is None or not armed.value or armed.value[0]:
            return False
        ends = armed.t[1] if len(armed.t) > 1 else self.seconds
        return float(ends) >= BEGINS_DISARMED_S

    def param(self, name: str, t: float | None = None) -> float | None:
        """Return a parameter's value at ``t`` (default: the first IMU sample), None without one."""
        line = self.parameters.lines.get(name)
        return None if line is None else line.at(0.0 if t is None else t)


def guarded_part(log: FlightLog, what: str, make: Callable[[], T], otherwise: Callable[[], T]) -> T:
    """Return ``make()``; where that ends in a bug, add a problem to the log and return ``otherwise()``."""

    def without(sentence: str) -> T:
        log.problems.append(Problem("part_failed", "error", sentence))
        return otherwise()

    return guarded(what, make, without)
