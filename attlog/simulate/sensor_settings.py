"""Settings of the sensors, one table each of a scenario, in the units of data sheets.

Defaults are a Pixhawk-class board: TDK ICM-20689 (data sheet DS-000143: 0.006 deg/s/sqrt(Hz), 150 ug/sqrt(Hz), 2000
deg/s and 16 g on 16 bit), a magneto-inductive magnetometer, a u-blox receiver without corrections, a MEMS barometer.
Turn-on biases are the remainder of a calibration in the field.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from attlog.flight.calibration import MOUNTING_EULER_DEG

STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)
Three = tuple[float, float, float]
Span = tuple[float, float]
NotNegative = Annotated[float, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
Percent = Annotated[float, Field(ge=0, le=100)]
ZERO: Three = (0.0, 0.0, 0.0)


@dataclass(frozen=True, config=STRICT)
class GyroSettings:
    """Gyro errors.

    ``noise_dps_rthz``: density of white noise [deg/s/sqrt(Hz)]. ``walk_dps_rts``: of the bias's random walk
    [deg/s/sqrt(s)]. ``bias_spread_dps``: standard deviation of a turn-on bias drawn per seed, added to
    ``bias_dps``. ``drift_dps_per_k``: per warming since the start. ``misalign_deg``: rotation of the axes about
    body x, y, z. ``lowpass_hz``: second-order Butterworth before sampling, 0 for none.
    """

    noise_dps_rthz: NotNegative = 0.006
    bias_dps: Three = ZERO
    bias_spread_dps: NotNegative = 0.1
    walk_dps_rts: NotNegative = 0.0002
    drift_dps_per_k: Three = ZERO
    scale_pct: Three = ZERO
    misalign_deg: Three = ZERO
    range_dps: Positive = 2000.0
    step_dps: NotNegative = 2000.0 / 32768
    lowpass_hz: NotNegative = 0.0


@dataclass(frozen=True, config=STRICT)
class AccelerometerSettings:
    """Accelerometer errors, as :class:`GyroSettings`, in ug/sqrt(Hz), m/s^2, g and mg."""

    noise_ug_rthz: NotNegative = 150.0
    bias_m_s2: Three = ZERO
    bias_spread_m_s2: NotNegative = 0.03
    walk_m_s2_rts: NotNegative = 0.0002
    drift_m_s2_per_k: Three = ZERO
    scale_pct: Three = ZERO
    misalign_deg: Three = ZERO
    range_g: Positive = 16.0
    step_mg: NotNegative = 16000.0 / 32768
    lowpass_hz: NotNegative = 0.0


@dataclass(frozen=True, config=STRICT)
class VibrationSettings:
    """Vibration of the rotors at the sensor.

    Per harmonic of each rotor's speed: the amplitude of one rotor at hover speed, growing with the square of its
    speed. ``acc_m_s2`` and ``gyro_dps`` are as long as ``harmonics``.
    """

    harmonics: tuple[Positive, ...] = (1.0, 2.0)
    acc_m_s2: tuple[NotNegative, ...] = (0.6, 0.4)
    gyro_dps: tuple[NotNegative, ...] = (0.3, 0.2)


@dataclass(frozen=True, config=STRICT)
class ImuSettings:
    """One inertial unit.

    ``sampling``: ``interval`` values are means over the interval that ends at the sample (increments, as PX4 logs
    them), ``instant`` ones the low-pass at the sample (ArduPilot). ``position_m``: from the centre of gravity, body
    axes. ``rotation_deg``: uncorrected mounting error (roll, pitch, yaw). ``delay_s``: publication after the
    sample. ``hidden_delay_s``: error of the reported sample time. ``jitter_s``: standard deviation of the sampling
    instant. ``loss_pct``: samples missing at random. ``gaps``: (from, to) s without samples. The unit warms by
    ``warming_k`` with time constant ``warming_s`` from ``temperature_c`` on.
    """

    rate_hz: Positive = 400.0
    sampling: Literal["interval", "instant"] = "interval"
    position_m: Three = ZERO
    rotation_deg: Three = ZERO
    delay_s: NotNegative = 0.0005
    hidden_delay_s: NotNegative = 0.0
    jitter_s: NotNegative = 0.0
    loss_pct: Percent = 0.0
    gaps: tuple[Span, ...] = ()
    temperature_c: float = 35.0
    warming_k: float = 10.0
    warming_s: Positive = 120.0
    gyro: GyroSettings = GyroSettings()
    acc: AccelerometerSettings = AccelerometerSettings()
    vibration: VibrationSettings = VibrationSettings()


Mounting = Annotated[int, Field(ge=0, lt=len(MOUNTING_EULER_DEG))]


@dataclass(frozen=True, config=STRICT)
class MagSettings:
    """One magnetometer, body axes, in microtesla.

    ``hard_iron_ut`` and ``soft_iron`` (rows of a 3x3 matrix): left by the calibration. ``current_ut_a`` [uT/A]:
    times the battery's current. ``mounted``: number of its mounting by MAV_SENSOR_ORIENTATION; ``orientation``: that
    which the vehicle's parameter says. Where they differ, the vehicle flies on turned axes.
    """

    rate_hz: Positive = 50.0
    noise_ut_rthz: NotNegative = 0.05
    hard_iron_ut: Three = ZERO
    hard_iron_spread_ut: NotNegative = 0.3
    soft_iron: tuple[Three, Three, Three] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    current_ut_a: Three = ZERO
    rotation_deg: Three = ZERO
    mounted: Mounting = 0
    orientation: Mounting = 0
    range_ut: Positive = 1100.0
    step_ut: NotNegative = 0.013
    delay_s: NotNegative = 0.001
    hidden_delay_s: NotNegative = 0.0
    jitter_s: NotNegative = 0.0
    loss_pct: Percent = 0.0
    gaps: tuple[Span, ...] = ()

    @property
    def is_external(self) -> bool:
        """True where a parameter of its own sets the mounting."""
        return bool(self.mounted or self.orientation)


@dataclass(frozen=True, config=STRICT)
class GnssSettings:
    """One GNSS receiver.

    White noise per fix and a slow wander: first-order Gauss-Markov, standard deviation ``wander_m`` horizontal,
    twice that vertical, correlation ``wander_s``. ``delay_s``: arrival after the epoch. ``outages``: (from, to) s
    without a fix; ``first_fix_s``: none before. ``antenna_m``: body axes.
    """

    rate_hz: Positive = 5.0
    noise_h_m: NotNegative = 0.05
    noise_v_m: NotNegative = 0.1
    wander_m: NotNegative = 0.5
    wander_s: Positive = 120.0
    noise_speed_m_s: NotNegative = 0.05
    delay_s: NotNegative = 0.12
    jitter_s: NotNegative = 0.002
    first_fix_s: NotNegative = 0.0
    outages: tuple[Span, ...] = ()
    antenna_m: Three = ZERO
    loss_pct: Percent = 0.0


@dataclass(frozen=True, config=STRICT)
class BaroSettings:
    """One barometer; noise and walk in metres of height, logged as pressure and as height."""

    rate_hz: Positive = 25.0
    noise_m_rthz: NotNegative = 0.03
    walk_m_rts: NotNegative = 0.01
    offset_m: float = 0.0
    step_pa: NotNegative = 0.1
    delay_s: NotNegative = 0.005
    jitter_s: NotNegative = 0.0
    loss_pct: Percent = 0.0
    gaps: tuple[Span, ...] = ()


@dataclass(frozen=True, config=STRICT)
class BatterySettings:
    """The battery and its monitor: open-circuit volts fall linearly from full to empty over the capacity."""

    rate_hz: Positive = 10.0
    full_v: Positive = 16.8
    empty_v: Positive = 13.2
    capacity_ah: Positive = 5.0
    resistance_ohm: NotNegative = 0.03
    idle_a: NotNegative = 0.4
    efficiency: Annotated[float, Field(gt=0, le=1)] = 0.6
    noise_a: NotNegative = 0.1
    noise_v: NotNegative = 0.02


@dataclass(frozen=True, config=STRICT)
class RpmSettings:
    """Rotor speeds reported by the speed controllers, rounded to ``step_rpm``."""

    rate_hz: Positive = 50.0
    noise_rpm: NotNegative = 5.0
    step_rpm: NotNegative = 1.0


@dataclass(frozen=True, config=STRICT)
class SensorSettings:
    """All sensors of the vehicle; several of one kind are instances 0, 1, ..."""

    imu: tuple[ImuSettings, ...] = (ImuSettings(),)
    mag: tuple[MagSettings, ...] = (MagSettings(),)
    gnss: tuple[GnssSettings, ...] = (GnssSettings(),)
    baro: tuple[BaroSettings, ...] = (BaroSettings(),)
    battery: BatterySettings = BatterySettings()
    rpm: RpmSettings | None = RpmSettings()

    def each(self) -> Iterator[tuple[str, Any]]:
        """Return every sensor with its place in a scenario: ``sensors.imu[0]``, ``sensors.battery``."""
        for kind in fields(self):
            value = getattr(self, kind.name)
            for k, one in enumerate(value if isinstance(value, tuple) else ()):
                yield f"sensors.{kind.name}[{k}]", one
            if is_dataclass(value):
                yield f"sensors.{kind.name}", value
