"""Which column of a CSV file is what? By its name, in any of the usual spellings."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.core.files import read_settings_text
from attlog.core.limits import MAX_RESULT_BYTES

Array = NDArray[np.float64]

UNITS_S = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
TIMES = ("t", "time", "timestamp", "stamp", "timeus", "timestampsample", "timesec", "elapsed", "seconds")
QUATERNIONS = (
    ("qw", "qx", "qy", "qz"),
    ("q0", "q1", "q2", "q3"),
    ("q1", "q2", "q3", "q4"),
    ("w", "x", "y", "z"),
    ("quatw", "quatx", "quaty", "quatz"),
    ("quaternionw", "quaternionx", "quaterniony", "quaternionz"),
    ("orientationw", "orientationx", "orientationy", "orientationz"),
    ("qs", "qx", "qy", "qz"),
    ("quat0", "quat1", "quat2", "quat3"),
)
POSITIONS = (
    ("px", "py", "pz"),
    ("x", "y", "z"),
    ("tx", "ty", "tz"),
    ("posx", "posy", "posz"),
    ("positionx", "positiony", "positionz"),
)
EULER = (("roll", "phi"), ("pitch", "theta"), ("yaw", "heading", "psi", "hdg"))
ANGLE_UNITS = {"deg": "deg", "degree": "deg", "degrees": "deg", "rad": "rad", "radian": "rad", "radians": "rad"}
# Attitudes come at 1 Hz to 5 kHz: where no unit is told, the one counts that says so.
TIME_STEP_RANGE_S = (2e-4, 1.0)


@dataclass(frozen=True, slots=True)
class AttitudeColumns:
    """What a file holds: times (n,) s, and quaternions (n, 4) scalar first or Euler angles (n, 3) with their unit."""

    t: Array
    q: Array | None
    euler: Array | None
    # Unit of the Euler angles as the names tell it: deg, rad, or empty.
    angles: str
    # The columns that were taken, for messages.
    names: str
    # Where it was (n, 3), in m, if the file tells.
    position: Array | None = None


def read_columns(path: Path) -> AttitudeColumns:
    """The time and attitude of a file. LogUnreadable if it cannot be opened, UsageError if they are not there."""
    text = read_settings_text(path, MAX_RESULT_BYTES)
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(("#", "%"))]
    if not lines:
        raise UsageError(f"{path}: holds no table")
    separator = max(",;\t", key=lines[0].count)
    rows = list(csv.reader(lines, delimiter=separator))
    head = [name.strip() for name in rows[0]]
    plain = [_plain_name(name) for name in head]
    time = _time_column(path, head, plain)
    found = next((c for c in QUATERNIONS if all(n in plain for n in c)), None)
    euler = None if found else _euler_columns(head, plain)
    if found is None and euler is None:
        raise UsageError(
            f"{path}: no attitude among its columns {', '.join(head[:12])}; give qw, qx, qy, qz or roll, pitch, yaw"
        )
    chosen = [plain.index(n) for n in found] if found else [i for i, _ in euler or []]
    place = _position_columns(plain, chosen)
    values = np.array([[_number(row, i) for i in (time, *chosen, *place)] for row in rows[1:]], np.float64)
    values = values.reshape(-1, 1 + len(chosen) + len(place))
    units = {u for _, u in euler or [] if u}
    if len(units) > 1:
        raise UsageError(f"{path}: Euler angles in two units, {' and '.join(sorted(units))}")
    t = _seconds(path, head[time], values[:, 0])
    names = ", ".join(head[i] for i in (time, *chosen))
    attitude, position = values[:, 1 : 1 + len(chosen)], values[:, 1 + len(chosen) :] if place else None
    quaternion, angles = (attitude, None) if found else (None, attitude)
    return AttitudeColumns(t, quaternion, angles, next(iter(units), ""), names, position)


def _plain_name(name: str) -> str:
    """A column's name without units, blanks, brackets and capitals: ``Quat [0]`` is quat0, ``roll_deg`` roll."""
    name = re.sub(r".*[./]", "", name.strip().lower())
    name = re.sub(r"[\s_]*[\[(]\s*(deg|degrees?|rad|radians?|m?s|us|ns|sec)\s*[\])]", "", name)
    name = re.sub(r"[_ ](deg|degrees?|rad|radians?|ms|us|ns|s|sec)$", "", name)
    return re.sub(r"[^a-z0-9]", "", name)


def _unit_of(name: str, known: Collection[str]) -> str:
    """The unit at the end of a column's name, if it is one of the known."""
    found = re.search(r"[_ \[(]([a-z]+)[\])]?$", name.strip().lower())
    word = found[1] if found else ""
    return word if word in known else "us" if name.strip().lower() == "timeus" and "us" in known else ""


def _time_column(path: Path, head: list[str], plain: list[str]) -> int:
    for wanted in TIMES:
        if wanted in plain:
            return plain.index(wanted)
    raise UsageError(f"{path}: no time among its columns {', '.join(head[:12])}; give t in seconds")


def _euler_columns(head: list[str], plain: list[str]) -> list[tuple[int, str]] | None:
    """Columns of roll, pitch and yaw with the unit that each name tells; None where one of them is missing."""
    places = []
    for names in EULER:
        at = next((plain.index(n) for n in names if n in plain), None)
        if at is None:
            return None
        places.append((at, ANGLE_UNITS.get(_unit_of(head[at], ANGLE_UNITS), "")))
    return places


def _position_columns(plain: list[str], taken: list[int]) -> list[int]:
    """The columns of a position, none of which is ``taken`` by the attitude; empty where there is none."""
    for names in POSITIONS:
        if all(n in plain for n in names):
            where = [plain.index(n) for n in names]
            return [] if set(where) & set(taken) else where
    return []


def _number(row: list[str], i: int) -> float:
    try:
        return float(row[i])
    except (ValueError, IndexError):
        return math.nan


def _seconds(path: Path, name: str, values: Array) -> Array:
    """Times in seconds, by the unit in the column's name, else by the one that makes a sensible rate."""
    unit = _unit_of(name, UNITS_S)
    if unit:
        return values * UNITS_S[unit]
    steps = np.diff(values[np.isfinite(values)])
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    for scale in (1.0, 1e-3, 1e-6, 1e-9):
        if TIME_STEP_RANGE_S[0] <= step * scale <= TIME_STEP_RANGE_S[1]:
            return values * scale
    raise UsageError(
        f"{path}: the steps of {name} make no rate of attitudes in s, ms, us or ns; name the unit, as in t_us"
    )


# A trajectory as it was stored: times, quaternions, positions, in axes and on a clock of its own.
#
# TUM (``t x y z qx qy qz qw``, blanks) and EuRoC (``ns, x, y, z, qw, qx, qy, qz, ...``) as evo reads them, and tables
# with a header.

TUM_COLUMNS, EUROC_COLUMNS = 8, 8
# Larger times without a unit are nanoseconds: as seconds they would be 30,000 years.
NANOSECONDS = 1e12
# Attitudes that make a trajectory.
MIN_ATTITUDES = 20


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Attitudes (n, 4) scalar first at rising ``t`` (n,) s, ``position`` (n, 3) m or None.

    ``quaternions``: each way in which the numbers can be read, by a name for people; most have one.
    ``known_axes``: its body and earth axes are attlog's already.
    """

    name: str
    t: Array
    quaternions: dict[str, Array]
    position: Array | None = None
    known_axes: bool = False


def read_trajectory(path: Path) -> Trajectory:
    """The trajectory in a text file. LogUnreadable if it cannot be opened, UsageError for what is none."""
    text = read_settings_text(path, MAX_RESULT_BYTES)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    numbers = [line for line in lines if not line.startswith(("#", "%"))]
    if not numbers:
        raise UsageError(f"{path}: holds no attitudes")
    if _number_of(re.split(r"[\s,;]+", numbers[0])[0]) is None:
        return _with_header(path)
    separator = "," if "," in numbers[0] else ";" if ";" in numbers[0] else None
    table = _number_table(path, numbers, separator)
    width = table.shape[1]
    if width < TUM_COLUMNS or (separator is None and width != TUM_COLUMNS):
        raise UsageError(
            f"{path}: {width} columns without a header; give TUM's t x y z qx qy qz qw, EuRoC's, or name the columns"
        )
    t, position, q = table[:, 0], table[:, 1:4], table[:, 4:8]
    if separator is None:
        return make_trajectory(path.name, t, _both_ways(q[:, [3, 0, 1, 2]], "as TUM, scalar last"), position)
    return make_trajectory(path.name, t, _both_ways(q, "as EuRoC, scalar first"), position)


def _both_ways(q: Array, usual: str) -> dict[str, Array]:
    """Attitudes (n, 4) as their format says, and as their inverse, which some programs write."""
    return {usual: q, f"{usual}, but earth to body": rotation.conjugate(q)}


def make_trajectory(name: str, t: Array, quaternions: dict[str, Array], position: Array | None = None) -> Trajectory:
    """A trajectory of its good samples in rising time. UsageError where too few are left."""
    t = np.asarray(t, np.float64)
    t = t * 1e-9 if len(t) and float(np.nanmedian(t)) > NANOSECONDS else t
    first = next(iter(quaternions.values()))
    norm = rotation.length(first)
    good = np.isfinite(t) & np.isfinite(norm) & (np.abs(norm - 1.0) < 0.1)
    highest = np.maximum.accumulate(np.where(good, t, -np.inf))
    good[1:] &= t[1:] > highest[:-1]
    if np.count_nonzero(good) < MIN_ATTITUDES:
        raise UsageError(
            f"{name}: {np.count_nonzero(good)} usable attitudes in rising time; {MIN_ATTITUDES} are needed"
        )
    kept = {reading: rotation.normalize(q[good]) for reading, q in quaternions.items()}
    return Trajectory(name, t[good], kept, None if position is None else position[good])


def _with_header(path: Path) -> Trajectory:
    table = read_columns(path)
    if table.q is not None:
        either = {"body to earth": table.q, "earth to body": rotation.conjugate(table.q)}
        return make_trajectory(path.name, table.t, either, table.position)
    assert table.euler is not None
    units = (table.angles,) if table.angles else ("deg", "rad")
    scales = {"deg": np.pi / 180.0, "rad": 1.0}
    read_as = {f"roll, pitch, yaw in {u}": rotation.from_euler(*(scales[u] * table.euler).T) for u in units}
    return make_trajectory(path.name, table.t, read_as, table.position)


def _number_table(path: Path, lines: list[str], separator: str | None) -> Array:
    """The numbers of lines (n, k); a last line that was cut is left out. UsageError for another that differs."""
    rows = [line.split(separator) for line in lines]
    width = len(rows[0])
    if len(rows) > 1 and len(rows[-1]) != width:
        rows.pop()
    try:
        return np.array(rows, np.float64).reshape(len(rows), width)
    except ValueError:
        for number, row in enumerate(rows, 1):
            if len(row) != width or any(_number_of(cell) is None for cell in row):
                raise UsageError(f"{path}: row {number} has no {width} numbers: {lines[number - 1][:60]}") from None
        raise


def _number_of(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None
