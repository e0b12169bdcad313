"""Motor outputs on one scale for all firmwares, and positions of the motors of a frame.

An output of 0 is the least in flight and 1 the greatest, so that a motor which is switched off lies below 0.
Geometry follows ArduPilot's ``AP_MotorsMatrix`` and PX4's ``CA_ROTOR`` parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import brief
from attlog.core.sorting import median

Array = NDArray[np.float64]


# --- geometry ----------------------------------------------------------------------------------------------------

# Motors of a frame from number 1 on: bearing from the nose in deg, clockwise, and + where the propeller turns
# counter-clockwise seen from above.
QUAD_X = "45+ -135+ -45- 135-"
QUAD_PLUS = "90+ -90+ 0- 180-"
HEXA_X, HEXA_PLUS = "90- -90+ -30- 150+ 30+ -150-", "0- 180+ -120- 60+ -60+ 120-"
OCTO_X = "22.5- -157.5- 67.5+ 157.5+ -22.5+ -112.5+ -67.5- 112.5-"
OCTO_QUAD_X = "45+ -45- -135+ 135- -45+ 45- 135+ -135-"
# ArduPilot's frames by FRAME_CLASS and FRAME_TYPE; FRAME_TYPE had the name FRAME before 3.5.
ARDUPILOT_FRAMES: Mapping[tuple[int, int], str] = {
    (1, 0): QUAD_PLUS,
    (1, 1): QUAD_X,
    (1, 2): QUAD_X,
    (1, 3): "45- -135- -45+ 135+",
    (1, 12): "135- 45+ -135+ -45-",
    (1, 13): "45+ -45- -135+ 135-",
    (1, 14): "45+ 135- -135+ -45-",
    (1, 18): "135+ 45- -135- -45+",
    (2, 0): HEXA_PLUS,
    (2, 1): HEXA_X,
    (3, 1): OCTO_X,
    (4, 1): OCTO_QUAD_X,
}
# FRAME_CLASS by the frame in the text of the firmware, which had no such parameter before 3.5.
ARDUPILOT_CLASSES = {"QUAD": 1, "HEXA": 2, "OCTA": 3, "OCTA_QUAD": 4, "OCTAQUAD": 4}
# PX4's frames before 1.13 by SYS_AUTOSTART in thousands.
PX4_FRAMES = {4: QUAD_X, 5: QUAD_PLUS, 6: HEXA_X, 7: HEXA_PLUS, 8: OCTO_X, 12: OCTO_QUAD_X}
# Airframes with another order or spin than their thousand, or with tilting rotors: Reaper (quad H), S250AQ, tilt
# quadrotor, Mavrik.
PX4_OTHER_FRAMES = (4040, 4051, 4100, 12002)
# Greatest z component (down) of the thrust axis of an upright rotor, CA_ROTORn_AZ.
MAX_UPRIGHT_AZ = -0.7
# Cosine of the angle between the arms of opposite motors, at most.
MAX_OPPOSITE_COSINE = -0.9
# Bearing in deg up to which a motor is in front of, beside or behind the centre.
STRAIGHT_DEG = 15.0
# Most rotors of PX4's control allocation.
MAX_ROTORS = 12


@dataclass(frozen=True, slots=True)
class Geometry:
    """Motors of a frame: ``bearing`` (n,) deg from the nose, clockwise; ``spin`` (n,) +1 counter-clockwise from above.

    ``source``: parameters with their values.
    """

    bearing: Array
    spin: Array
    source: str

    @property
    def lever(self) -> Array:
        """The roll and pitch direction (n, 2) in which each motor pushes."""
        angle = np.radians(self.bearing)
        return np.column_stack([-np.sin(angle), np.cos(angle)])

    def opposite(self, motor: int) -> int | None:
        """Return the index of the motor across the centre, None without one. Coaxial motors: the first."""
        cosine = self.lever @ self.lever[motor]
        found = int(np.argmin(cosine))
        return found if cosine[found] < MAX_OPPOSITE_COSINE else None

    def position(self, motor: int) -> str:
        """Return the position of a motor, as "rear left"."""
        return position_name(float(self.bearing[motor]))


def position_name(bearing: float) -> str:
    """Return the name of a bearing in deg from the nose: front, rear left, right."""
    b = (bearing + 180.0) % 360.0 - 180.0
    side = "right" if b > 0 else "left"
    if abs(b) <= STRAIGHT_DEG:
        return "front"
    if abs(b) >= 180.0 - STRAIGHT_DEG:
        return "rear"
    if abs(abs(b) - 90.0) <= STRAIGHT_DEG:
        return side
    return f"{'front' if abs(b) < 90.0 else 'rear'} {side}"


def frame_of(text: str, source: str) -> Geometry:
    """Return the geometry of a row of the tables."""
    motors = text.split()
    bearing = np.array([float(motor[:-1]) for motor in motors])
    return Geometry(bearing, np.array([1.0 if motor.endswith("+") else -1.0 for motor in motors]), source)


def ardupilot_geometry(
    values: Mapping[str, float], motors: int, simulated: bool = False, frame: str = ""
) -> Geometry | None:
    """Return the geometry by FRAME_CLASS and FRAME_TYPE, or by the older FRAME and ``frame``, as "OCTA_QUAD".

    None for frames without a table. Without class and ``frame`` four ``motors`` are a quadrotor; six may be a Y6, and
    eight an octo quad. The simulator flies a plus frame where no parameter is logged.
    """
    kind = values.get("FRAME_TYPE", values.get("FRAME", 0.0 if simulated else None))
    group = values.get("FRAME_CLASS") or ARDUPILOT_CLASSES.get(frame) or {4: 1}.get(motors)
    row = None if kind is None or group is None else ARDUPILOT_FRAMES.get((int(group), int(kind)))
    if row is None or kind is None or group is None or len(row.split()) != motors:
        return None
    old = "FRAME_TYPE" not in values and "FRAME" in values
    return frame_of(row, f"FRAME {kind:g}" if old else f"FRAME_CLASS {group:g}, FRAME_TYPE {kind:g}")


def px4_geometry(values: Mapping[str, float], motors: int) -> Geometry | None:
    """Return the geometry by CA_ROTORn_PX, PY and KM, or by the older SYS_AUTOSTART; None without a table."""
    count = int(values.get("CA_ROTOR_COUNT", 0.0))
    names = [f"CA_ROTOR{k}_" for k in range(min(count, MAX_ROTORS))]
    if names and all(f"{name}{axis}" in values for name in names for axis in ("PX", "PY")):
        at = np.array([[values[f"{name}PX"], values[f"{name}PY"]] for name in names])
        spin = np.array([np.sign(values.get(f"{name}KM", 0.05)) for name in names])  # 0.05: PX4's default
        upright = all(values.get(f"{name}AZ", -1.0) <= MAX_UPRIGHT_AZ for name in names)
        if count != motors or not np.hypot(*at.T).all() or not upright:
            return None
        return Geometry(np.degrees(np.arctan2(at[:, 1], at[:, 0])), spin, "CA_ROTOR parameters")
    start = values.get("SYS_AUTOSTART", 0.0)
    row = None if start in PX4_OTHER_FRAMES else PX4_FRAMES.get(int(start // 1000))
    return frame_of(row, f"SYS_AUTOSTART {start:g}") if row is not None and len(row.split()) == motors else None


# --- outputs -----------------------------------------------------------------------------------------------------

# A ceiling of its own: outputs above this that so many records of a motor share to within the tolerance.
LEAST_CEILING, CEILING_RECORDS, CEILING_TOLERANCE = 0.8, 5, 0.004
# The outputs in telemetry.
SERVO_OUTPUTS = "SERVO_OUTPUT_RAW"
# Largest distance of neighbouring records: so many periods and seconds.
GAP_PERIODS, GAP_S = 3.0, 0.05


@dataclass(frozen=True, slots=True)
class MotorReport:
    """The firmware's own report at ``t`` s that ``motor`` (from 1, 0 for none in particular) failed, as ``text``."""

    t: float
    motor: int
    text: str


@dataclass(frozen=True, slots=True)
class Esc:
    """Telemetry of a speed controller: ``rpm``, ``current`` A and ``temperature`` deg C (n,) at ``t`` (n,) s.

    ``name``: as the log counts. ``motor``: number from 1 if logged. Current and temperature are NaN if not measured.
    """

    name: str
    t: Array
    rpm: Array
    current: Array
    temperature: Array
    motor: int | None = None
    __repr__ = brief


# Temperatures above these are in K, and in hundredths.
KELVIN, HUNDREDTHS = 200.0, 1000.0


def esc_telemetry(t: Array, x: Array, name: str, motor: int | None = None) -> Esc | None:
    """Return a controller by rpm, A and temperature (n, 3) at ``t`` (n,) s, None if it never turned.

    A column of zeros is not measured. The speed of a reversed motor counts by its size.
    """
    good = np.isfinite(t) & np.isfinite(x[:, 0]) & (np.diff(t, prepend=-np.inf) > 0)
    t, x = t[good], x[good]
    if len(t) < 2 or not x[:, 0].any():
        return None
    current, temperature = (column if column.any() else np.full(len(t), np.nan) for column in x[:, 1:].T)
    usual = float(median(temperature))
    if usual > HUNDREDTHS:
        temperature = 0.01 * temperature
    elif usual > KELVIN:
        temperature = temperature - 273.15
    return Esc(name, t, np.abs(x[:, 0]), current, temperature, motor)


@dataclass
class MotorOutputs:
    """Outputs ``x`` (n, motors) of a multirotor at ``t`` (n,) s: 0 at the flight floor, 1 at the ceiling, NaN off.

    ``scaled``: False where no parameter gives floor and ceiling, and 1000 to 2000 us are taken. ``names``: columns in
    ``source``, by motor. ``geometry``: None for an unknown frame. ``reports``: of the firmware. ``changes``: outputs
    that were assigned to another function after boot, as time and sentence.
    """

    t: Array
    x: Array
    source: str
    names: list[str]
    scaled: bool = True
    geometry: Geometry | None = None
    reports: list[MotorReport] = field(default_factory=list)
    changes: list[tuple[float, str]] = field(default_factory=list)
    __repr__ = brief

    @property
    def motors(self) -> int:
        """Number of motors."""
        return int(self.x.shape[1])

    @cached_property
    def period(self) -> float:
        """Median time between records in s, infinite for fewer than two."""
        return float(median(np.diff(self.t))) if len(self.t) > 1 else np.inf

    @cached_property
    def ceiling(self) -> float:
        """The highest output that the firmware gives: 1, or less where it stops below."""
        return own_ceiling(self.x)

    def title(self, motor: int) -> str:
        """Return the name of the motor with this index, as "motor 2 (rear left)"."""
        where = "" if self.geometry is None else f" ({self.geometry.position(motor)})"
        return f"motor {motor + 1}{where}"

    def position(self, motor: int) -> str:
        """Return the position of the motor with this index, empty where unknown."""
        return "" if self.geometry is None else self.geometry.position(motor)

    def in_a_row(self) -> NDArray[np.int64]:
        """Return row numbers (n,) of the records: a gap above three periods begins another row."""
        return row_numbers(self.t)


def row_numbers(t: Array) -> NDArray[np.int64]:
    """Return row numbers (n,) of records at ``t`` s: a gap above three median periods begins another row."""
    if len(t) < 2:
        return np.zeros(len(t), np.int64)
    steps = np.diff(t)
    broken = steps >= GAP_PERIODS * float(median(steps)) + GAP_S
    return np.concatenate([[0], np.cumsum(broken)]).astype(np.int64)


def own_ceiling(x: Array) -> float:
    """Return the highest output above 0.8 at which records pile up, else 1.

    At least five records lie within the tolerance below it, at most half as many in the next one, and fewer than five
    above it: a crowd at the top is a limit, a tail is not.
    """
    high = np.sort(x[x > LEAST_CEILING])  # NaN is not above
    top = np.searchsorted(high, high - CEILING_TOLERANCE)
    next_ = np.searchsorted(high, high - 2.0 * CEILING_TOLERANCE)
    place = np.arange(1, len(high) + 1)
    count, above = place - top, len(high) - place
    piled = high[(count >= CEILING_RECORDS) & (count >= 2 * (top - next_)) & (above < CEILING_RECORDS)]
    return min(float(piled[-1]), 1.0) if len(piled) else 1.0


def pulse_share(pulse: Array, low: float | Array, high: float | Array, floor: float, ceiling: float) -> Array:
    """Return outputs (n, motors): pulses as share of their range, from ``floor`` to ``ceiling`` of it in flight.

    ``low`` and ``high``: of all motors or of each (motors,).
    """
    share: Array = ((pulse - low) / (high - low) - floor) / (ceiling - floor)
    return share
