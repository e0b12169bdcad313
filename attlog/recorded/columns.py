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

from attlog.base.errors import UsageError
from attlog.base.files.settings_file import text_of
from attlog.base.limits import MAX_RESULT_BYTES

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
STEP_S = (2e-4, 1.0)
"""Attitudes come at 1 Hz to 5 kHz: where no unit is told, the one counts that says so."""


@dataclass(frozen=True, slots=True)
class AttitudeColumns:
    """What a file holds: times (n,) s, and quaternions (n, 4) scalar first or Euler angles (n, 3) with their unit."""

    t: Array
    q: Array | None
    euler: Array | None
    angles: str
    """Unit of the Euler angles as the names tell it: deg, rad, or empty."""
    names: str
    """The columns that were taken, for messages."""
    position: Array | None = None
    """Where it was (n, 3), in m, if the file tells."""


def read(path: Path) -> AttitudeColumns:
    """The time and attitude of a file. LogUnreadable if it cannot be opened, UsageError if they are not there."""
    text = text_of(path, MAX_RESULT_BYTES)
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(("#", "%"))]
    if not lines:
        raise UsageError(f"{path}: holds no table")
    separator = max(",;\t", key=lines[0].count)
    rows = list(csv.reader(lines, delimiter=separator))
    head = [name.strip() for name in rows[0]]
    plain = [_plain(name) for name in head]
    time = _time(path, head, plain)
    found = next((c for c in QUATERNIONS if all(n in plain for n in c)), None)
    euler = None if found else _euler(head, plain)
    if found is None and euler is None:
        raise UsageError(
            f"{path}: no attitude among its columns {', '.join(head[:12])}; give qw, qx, qy, qz or roll, pitch, yaw"
        )
    chosen = [plain.index(n) for n in found] if found else [i for i, _ in euler or []]
    place = _position(plain, chosen)
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


def _plain(name: str) -> str:
    """A column's name without units, blanks, brackets and capitals: ``Quat [0]`` is quat0, ``roll_deg`` roll."""
    name = re.sub(r".*[./]", "", name.strip().lower())
    name = re.sub(r"[\s_]*[\[(]\s*(deg|degrees?|rad|radians?|m?s|us|ns|sec)\s*[\])]", "", name)
    name = re.sub(r"[_ ](deg|degrees?|rad|radians?|ms|us|ns|s|sec)$", "", name)
    return re.sub(r"[^a-z0-9]", "", name)


def _unit(name: str, known: Collection[str]) -> str:
    """The unit at the end of a column's name, if it is one of the known."""
    found = re.search(r"[_ \[(]([a-z]+)[\])]?$", name.strip().lower())
    word = found[1] if found else ""
    return word if word in known else "us" if name.strip().lower() == "timeus" and "us" in known else ""


def _time(path: Path, head: list[str], plain: list[str]) -> int:
    for wanted in TIMES:
        if wanted in plain:
            return plain.index(wanted)
    raise UsageError(f"{path}: no time among its columns {', '.join(head[:12])}; give t in seconds")


def _euler(head: list[str], plain: list[str]) -> list[tuple[int, str]] | None:
    """Columns of roll, pitch and yaw with the unit that each name tells; None where one of them is missing."""
    places = []
    for names in EULER:
        at = next((plain.index(n) for n in names if n in plain), None)
        if at is None:
            return None
        places.append((at, ANGLE_UNITS.get(_unit(head[at], ANGLE_UNITS), "")))
    return places


def _position(plain: list[str], taken: list[int]) -> list[int]:
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
    unit = _unit(name, UNITS_S)
    if unit:
        return values * UNITS_S[unit]
    steps = np.diff(values[np.isfinite(values)])
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    for scale in (1.0, 1e-3, 1e-6, 1e-9):
        if STEP_S[0] <= step * scale <= STEP_S[1]:
            return values * scale
    raise UsageError(
        f"{path}: the steps of {name} make no rate of attitudes in s, ms, us or ns; name the unit, as in t_us"
    )
