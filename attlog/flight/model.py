"""Data model of a flight: one clock, SI units, body axes FRD, earth axes NED.

``t`` is float64 seconds from the first sample of the replayed IMU; the autopilot's own clock at that instant is
``FlightLog.t0_us``. Quaternions are scalar first and turn body vectors into earth vectors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import brief, listed, table_html, table_text
from attlog.core.errors import call_guarded
from attlog.core.sorting import median
from attlog.flight.advice import LoggingNeed, VehicleSettings, advise_rest, logging_advice, remedy
from attlog.flight.drive import Esc, MotorOutputs
from attlog.flight.timestamps import describe_early_end
from attlog.flight.vehicle import VehicleKind, vehicle_kind

if TYPE_CHECKING:
    from attlog.core.truncation import Truncation
    from attlog.formats.table import Messages

Array = NDArray[np.float64]
T = TypeVar("T")
Severity = Literal["info", "note", "warning", "error"]
# Roll, pitch and yaw in deg.
Angles = tuple[float, float, float]

# An interval longer than this and than five median intervals is a pause of the logger (disarmed, telemetry lost).
PAUSE_S = 1.0
FIX_3D = 3
# Disarmed time at the start from which a log counts as begun before arming.
BEGINS_DISARMED_S = 5.0


def without_pauses(t: Array) -> NDArray[np.bool_]:
    """Mark the intervals (n - 1,) between samples at ``t`` (n,) s during which the logger ran."""
    dt = np.diff(t)
    return dt <= max(PAUSE_S, 5.0 * float(median(dt))) if len(dt) else np.zeros(0, bool)


def covered_seconds(t: Array) -> float:
    """Return the time in s covered by samples at ``t`` (n,) s, without pauses."""
    return float(np.diff(t)[without_pauses(t)].sum())


def logged_rate(t: Array) -> float:
    """Return the mean rate in Hz while the logger ran, 0 for fewer than two samples."""
    ran = without_pauses(t)
    span = float(np.diff(t)[ran].sum())
    return float(np.count_nonzero(ran)) / span if span > 0 else 0.0


@dataclass(slots=True)
class Stream:
    """Time series of a measured quantity: ``x`` (n, k) in ``unit`` at ``t`` (n,) s.

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
    __repr__ = brief

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
    """Inertial unit: ``gyro`` rad/s and ``acc`` m/s^2 (specific force) at the same times.

    ``filtered``: processing before the logger ("none", "low-pass 80 Hz", ...). ``dt`` (n,): integration time of each
    sample where the log holds increments. ``truncation``: how the readings were cut, where half a step has been put
    back. ``device`` and ``acc_device``: ids of gyro and accelerometer.
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
    truncation: Truncation | None = None
    __repr__ = brief


@dataclass(slots=True)
class Mag:
    """Magnetometer: ``field`` (n, 3) in tesla, body axes.

    ``raw``: some hundred uncalibrated records in sensor axes. ``offsets``: offsets applied by the firmware as logged,
    at each change. Both in tesla, None if not logged.
    """

    index: int
    field: Stream
    calibrated: bool = True
    device: str | None = None
    enabled: bool = True
    raw: Stream | None = None
    offsets: Stream | None = None
    __repr__ = brief


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
    __repr__ = brief


@dataclass(slots=True)
class Gnss:
    """GNSS receiver at ``t`` (n,) s: degrees, metres, m/s NED; NaN without a value or a fix.

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
    __repr__ = brief

    @property
    def heading(self) -> Stream | None:
        """The dual-antenna heading (n, 1) rad during a 3D fix, None for a single antenna."""
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
    ``noise_tilt_deg`` and ``noise_heading_deg``: its white noise alone, which RMS errors lose.
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
    north: Literal["file", "gnss", "none"] = "none"
    reading: str = ""
    noise_tilt_deg: float = 0.0
    noise_heading_deg: float = 0.0


@dataclass(slots=True)
class Attitude:
    """Estimated or measured attitude: ``q`` (n, 4) at ``t`` (n,) s.

    ``resets`` (k,): indices i at which the step from sample i-1 to i is a reset and no rotation. ``has_trim``: the
    vehicle's trim (ArduPilot AHRS_TRIM) is already removed. ``step_deg``: quantisation of the logged values (0 for
    float). ``normal``: ``q`` has unit norm and need not be copied. ``position`` (n, 3) m: of a pose, in its own axes.
    ``fit``: alignment of an external truth.
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
    __repr__ = brief

    @property
    def rate(self) -> float:
        """Mean rate in Hz while the logger ran, 0 for fewer than two samples."""
        return logged_rate(self.t)

    def covers(self, t: Array) -> NDArray[np.bool_]:
        """Mark the times (m,) s at which the attitude is logged, outside pauses of the logger."""
        if len(self.t) < 2:
            return np.zeros(len(t), bool)
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        inside = (t >= self.t[0]) & (t <= self.t[-1])
        covered: NDArray[np.bool_] = inside & without_pauses(self.t)[k]
        return covered


@dataclass(slots=True)
class TimeLine:
    """Piecewise constant value, from ``t[i]`` until ``t[i+1]``: modes, arming, parameters."""

    t: Array
    value: list[Any]
    source: str
    __repr__ = brief

    def at(self, t: float) -> Any:
        """Return the value at ``t``: the first value before the first entry, None if empty."""
        if len(self.value) < 2:  # as of most parameters, of which a log has a thousand
            return self.value[0] if self.value else None
        i = int(np.searchsorted(self.t, t, side="right")) - 1
        return self.value[max(i, 0)]


@dataclass(slots=True)
class FlightState:
    """Arming, ground contact and flight mode over time, None if not logged.

    ``mode_reason``: failsafe that set the mode, empty if none did.
    """

    armed: TimeLine | None = None
    landed: TimeLine | None = None
    mode: TimeLine | None = None
    mode_reason: TimeLine | None = None
    __repr__ = brief


@dataclass(slots=True)
class PilotInput:
    """Input of the pilot by radio or joystick.

    ``sticks`` (n, 3): roll right, pitch nose up, yaw right, from -1 to 1. ``signal``: True while it is received.
    """

    sticks: Stream | None = None
    signal: TimeLine | None = None
    __repr__ = brief


@dataclass(slots=True)
class Setpoints:
    """Commanded attitude and commanded body rates (n, 3) rad/s."""

    attitude: Attitude | None = None
    rates: Stream | None = None
    __repr__ = brief


@dataclass(slots=True)
class Power:
    """Propulsion and battery.

    ``throttle`` (n, 1) 0 to 1. ``motors`` (n, motors): outputs from 0 (stopped) to 1 (full). ``rpm`` (n, rotors).
    ``escs``: speed controllers whose rotors turned. ``battery`` (n, 2): V and A. ``outputs``: of a multirotor's motors
    between floor and ceiling of flight. ``board`` (n, 1) V: supply of the autopilot. ``overcurrent`` (n, 1): 1 while a
    supply of the board reports it.
    """

    throttle: Stream | None = None
    motors: Stream | None = None
    rpm: Stream | None = None
    escs: list[Esc] = field(default_factory=list)
    battery: Stream | None = None
    outputs: MotorOutputs | None = None
    board: Stream | None = None
    overcurrent: Stream | None = None
    __repr__ = brief


@dataclass(slots=True)
class Processor:
    """Load of the autopilot's processor.

    ``loops`` (n, 3): main loops that took too long, all main loops, and the longest in s, each since the record before.
    ``load`` and ``memory`` (n, 1): shares in use, 0 to 1, NaN where not logged.
    """

    loops: Stream | None = None
    load: Stream | None = None
    memory: Stream | None = None
    __repr__ = brief


@dataclass(slots=True)
class Parameters:
    """Parameters of the vehicle by name, and the trim and declination they set.

    ``lines``: values over time. ``defaults``: as logged, the airframe's where it differs from the firmware's.
    ``of_airframe``: names with a logged default of the firmware alone, because their value is the airframe's default.
    ``given``: values from a ground station's file. ``filled``: names that are only in this file. ``trim`` (3,) rad:
    rotation between IMU and vehicle, removed from attitudes with ``has_trim``. ``declination`` (deg, east positive): as
    set in the autopilot. Both are None if the parameters in ``trim_source`` and ``declination_source`` are not logged.
    """

    lines: dict[str, TimeLine] = field(default_factory=dict)
    defaults: dict[str, float] = field(default_factory=dict)
    of_airframe: frozenset[str] = frozenset()
    given: dict[str, float] = field(default_factory=dict)
    filled: frozenset[str] = frozenset()
    trim: Array | None = None
    trim_source: str = ""
    declination: float | None = None
    declination_source: str = ""
    __repr__ = brief


@dataclass(slots=True)
class InnovationTest:
    """Innovation test of the onboard estimator for an ``aid``: ``ratio`` (n,) to its gate at ``t`` (n,) s.

    Aids: compass, velocity, position, height, airspeed. Above 1 the aid is rejected.
    """

    aid: str
    t: Array
    ratio: Array
    source: str
    __repr__ = brief


@dataclass(slots=True)
class OnboardEstimator:
    """States of the onboard estimator beside its attitude.

    ``gyro_bias`` (n, 3) rad/s: subtracted from the replayed gyro, None where it runs on another one. ``acc_bias``
    (n, 3) m/s^2: subtracted from the accelerometer. ``yaw`` (n, 2) rad: heading from GNSS motion without a compass and
    its sigma, while it is valid. ``height`` (n, 1) m above its origin, ``speed`` (n, 1) m/s over ground. ``lane``:
    number of the EKF core or instance that flew. ``inputs``: function that reads the filter's logged inputs for a
    re-run, None for other firmware.
    """

    gyro_bias: Stream | None = None
    acc_bias: Stream | None = None
    yaw: Stream | None = None
    height: Stream | None = None
    speed: Stream | None = None
    innovation_tests: list[InnovationTest] = field(default_factory=list)
    lane: TimeLine | None = None
    inputs: Callable[..., Any] | None = None
    __repr__ = brief


# Definition of a vibration level. ``rest`` (ArduPilot's VIBE): root of the low-passed square of the remainder of a 5 Hz
# low-pass, per axis. ``difference`` (PX4): low-passed length of the difference of successive samples.
VibrationMeasure = Literal["rest", "difference"]


class VibrationLimits(NamedTuple):
    """Limits of a vibration level: quantile ``share`` of the flight, ``warning`` and ``fault`` in m/s^2."""

    share: float
    warning: float
    fault: float
    source: str


# PX4 documents no level at which a flight fails. The red line of Flight Review's plot is a guess of its author (pull
# request 252), so it is a warning here; faults are detected by clipping.
VIBRATION_LIMITS: dict[VibrationMeasure, VibrationLimits] = {
    "rest": VibrationLimits(0.95, 30.0, 60.0, "ardupilot.org, Measuring Vibration"),
    "difference": VibrationLimits(0.80, 9.81, np.inf, "PX4 Flight Review, Vibration Metrics"),
}


@dataclass(slots=True)
class OnboardVibration:
    """Onboard vibration level (n,) m/s^2 of an IMU at ``t`` (n,) s, of its worst axis if logged by axis."""

    unit: int
    measure: VibrationMeasure
    source: str
    t: Array
    level: Array
    __repr__ = brief


@dataclass(slots=True)
class Burst:
    """Batch of samples ``x`` (n, 3) rad/s or m/s^2 at the sensor's ``rate`` Hz, from ``t`` s on.

    ``filtered``: logged after the autopilot's low-pass and notch filters.
    """

    sensor: Literal["gyro", "accelerometer"]
    unit: int
    t: float
    rate: float
    x: NDArray[np.float32]
    filtered: bool
    source: str
    __repr__ = brief


@dataclass(slots=True)
class OnboardSpectrum:
    """Peaks (n, k) Hz of the onboard gyro spectrum at ``t`` (n,) s, NaN without a peak; gyro rate ``rate`` Hz.

    ``resolution`` Hz: width of a bin.
    """

    t: Array
    peaks: Array
    rate: float
    resolution: float
    source: str
    __repr__ = brief


@dataclass(slots=True)
class Clipping:
    """Samples at the end of a sensor's range, as counted on board.

    ``new`` (n,): samples since the record before, at ``t`` (n,) s. ``unit``: None for the selected unit. ``whole``:
    counted at the sensor's full rate, not only in logged records.
    """

    sensor: str
    unit: int | None
    source: str
    t: Array
    new: NDArray[np.int64]
    whole: bool
    __repr__ = brief


@dataclass(slots=True)
class Vibration:
    """Vibration as measured on board.

    ``level`` (n, 3) m/s^2: of the replayed IMU, by axis. ``levels``: of every IMU. ``bursts``: batches of samples at
    the sensors' rate. ``spectrum``: peaks of the onboard gyro spectrum.
    """

    level: Stream | None = None
    levels: list[OnboardVibration] = field(default_factory=list)
    bursts: list[Burst] = field(default_factory=list)
    spectrum: OnboardSpectrum | None = None
    clippings: list[Clipping] = field(default_factory=list)
    __repr__ = brief


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
    """Defect of the log or the flight, to be reported with the results.

    ``t`` s (of the first of ``count``) or ``offset`` in bytes is its place, ``value`` in ``unit`` its size. ``cause``
    and ``remedy``: a sentence each, empty if unknown. ``source``: stream it is about, empty if about none or several.
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
    source: str = ""


@dataclass(slots=True)
class FlightLog:
    """One power-up of a vehicle: sensors, attitudes, state and parameters on one clock.

    ``imus[imu]`` and ``mags[mag]`` are replayed (None: no usable one); ``choices`` gives the reason of each choice.
    ``attitudes`` maps sources to attitudes, ``onboard`` is the name of the one that flew. ``truth``: a simulator's or
    an external attitude. ``poses``: attitudes by motion capture or vision by topic, in their own axes.
    ``true_heading`` (n, 1) rad: external heading. ``rangefinder`` (n, 1) m: distance to the ground within the sensor's
    range. ``utc_offset`` s: Unix time minus ``t``. ``vehicle``: usual name of its type. ``texts``: messages of the
    autopilot (t, syslog level, text). ``settings``: firmware and parameters for advice on settings. ``messages``: the
    opened log of this power-up, None where it was released.
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
    pilot: PilotInput = field(default_factory=PilotInput)
    setpoints: Setpoints = field(default_factory=Setpoints)
    power: Power = field(default_factory=Power)
    processor: Processor = field(default_factory=Processor)
    parameters: Parameters = field(default_factory=Parameters)
    estimator: OnboardEstimator = field(default_factory=OnboardEstimator)
    vibration: Vibration = field(default_factory=Vibration)
    settings: VehicleSettings = field(default_factory=VehicleSettings)
    texts: list[tuple[float, int, str]] = field(default_factory=list)
    messages: Messages | None = field(default=None, repr=False, compare=False)
    boot: int = 0
    boots: int = 1
    choices: dict[str, str] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    seconds: float = 0.0

    def __repr__(self) -> str:
        return table_text(*self._summary())

    def _repr_html_(self) -> str:
        return table_html(*self._summary())

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        """Return title and rows of the short text."""
        sort = ", ".join(x for x in (str(self.firmware), self.vehicle, "simulated" if self.simulated else "") if x)
        modes = [] if self.state.mode is None else list(dict.fromkeys(map(str, self.state.mode.value)))
        sensors = [f"gnss {g.source}" for g in self.gnss] + [f"baro {b.source}" for b in self.baro]
        sensors += [] if self.airspeed is None else [f"airspeed {self.airspeed.source}"]
        attitudes = [f"{name} (onboard)" if name == self.onboard else name for name in self.attitudes]
        attitudes += [] if self.truth is None else [f"{self.truth.source} (truth)"]
        imus = [f"{u.index}: {u.gyro.source} {u.gyro.rate:.0f} Hz" for u in self.imus]
        mags = [f"{u.index}: {u.field.source} {u.field.rate:.0f} Hz" for u in self.mags]
        for names, chosen in ((imus, self.imu), (mags, self.mag)):
            if chosen is not None:
                names[chosen] += " (replayed)"
        rows = [
            ("vehicle", sort),
            ("imus", listed(imus, 4) or "none"),
            ("mags", listed(mags, 4) or "none"),
            ("others", listed(sensors, 6) or "none"),
            ("attitudes", listed(attitudes, 6) or "none"),
            ("modes", listed(modes, 8) or "not logged"),
            ("parameters", str(len(self.parameters.lines))),
            ("problems", f"{len(self.problems)}: {self.problems[0].text}" if self.problems else "none"),
        ]
        return f"FlightLog of {self.path.name}, {self.format}, {self.seconds:.1f} s", rows

    @property
    def kind(self) -> VehicleKind:
        """The vehicle's kind, OTHER if unknown."""
        return vehicle_kind(self.vehicle)

    @property
    def replay_imu(self) -> Imu | None:
        """The IMU to replay, None if no unit is replayable."""
        return None if self.imu is None else self.imus[self.imu]

    @property
    def onboard_attitude(self) -> Attitude | None:
        """The attitude that flew, None if not logged."""
        return self.attitudes.get(self.onboard or "")

    @property
    def truth_with_north(self) -> Attitude | None:
        """The truth, None if its heading is not referred to north."""
        return None if self.truth is None or (self.truth.fit and self.truth.fit.north == "none") else self.truth

    def advice(self, what: LoggingNeed, rate: float | None = None) -> str:
        """Return the setting that would log ``what``, or the reason why no setting helps.

        ``rate``: of the logged records in Hz, None without any. Empty if the firmware's settings are unknown.
        """
        if what == "rest" and self.begins_disarmed:
            return advise_rest("The log begins before arming already")
        foreign = self.settings.kind == "other" and bool(self.messages)
        if what in ("imu", "mag", "attitude") and not foreign and (ends := describe_early_end(self.messages)):
            return ends if what == "imu" else ""
        return logging_advice(self.settings, what, rate)

    def remedy(self, fault: str) -> str:
        """Return the remedy for a fault by the vehicle's parameters, empty if none is known."""
        mag = None if self.mag is None else self.mags[self.mag]
        return remedy(self.settings, fault, 0 if mag is None else mag.index, None if mag is None else mag.device)

    @property
    def begins_disarmed(self) -> bool:
        """True if the log begins at least BEGINS_DISARMED_S before the first arming."""
        armed = self.state.armed
        if armed is None or not armed.value or armed.value[0]:
            return False
        ends = armed.t[1] if len(armed.t) > 1 else self.seconds
        return float(ends) >= BEGINS_DISARMED_S

    def param(self, name: str, t: float | None = None) -> float | None:
        """Return a parameter's value at ``t`` (default: the first IMU sample), None if not logged."""
        line = self.parameters.lines.get(name)
        return None if line is None else line.at(0.0 if t is None else t)


def guarded_part(log: FlightLog, what: str, make: Callable[[], T], otherwise: Callable[[], T]) -> T:
    """Return ``make()``; on an unexpected error add a problem to the log and return ``otherwise()``."""

    def without(sentence: str) -> T:
        log.problems.append(Problem("part_failed", "error", sentence))
        return otherwise()

    return call_guarded(what, make, without)
