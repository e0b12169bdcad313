"""Parse ``--truth``, and read attitudes from text files: TUM, EuRoC, tables with a header in any usual spelling."""

from __future__ import annotations

import csv
import difflib
import math
import os
import re
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.errors import LogUnreadable, UsageError, missing_file
from attlog.core.files import read_settings_text
from attlog.core.limits import MAX_RESULT_BYTES
from attlog.core.sorting import median, nanmedian

KEYS = ("offset", "north", "topic")
# Suffixes of trajectory files; another name with a dot in it is taken for a file, too.
SUFFIXES = (".csv", ".txt", ".tum", ".tsv")
YES, NO = ("true", "yes", "1"), ("false", "no", "0")


@dataclass(frozen=True, slots=True)
class TruthRequest:
    """Parsed value of ``--truth``: ``name`` (file, folder or topic) and settings.

    ``offset``: approximate clock offset in s, None if unknown. ``north``: the first earth axis of the file is true
    north. ``topic``: pose or attitude within a log or bag.
    """

    name: str
    offset: float | None = None
    north: bool = False
    topic: str = ""

    @property
    def path(self) -> Path | None:
        """The file or folder named, None for a topic."""
        return Path(self.name) if os.path.exists(self.name) else None


def parse_truth(given: str) -> TruthRequest:
    """Parse a value of ``--truth``. UsageError for an unknown setting or invalid value."""
    name, keys = _split(given)
    values: dict[str, str] = {}
    for pair in filter(None, keys.split(",")):
        key, equals, value = pair.partition("=")
        if key not in KEYS or not equals:
            near = difflib.get_close_matches(key, KEYS, 1)
            hint = f"did you mean {near[0]}=?" if near else f"use {', '.join(KEYS)}"
            raise UsageError(f"--truth {given}: {pair!r} is no setting of a truth; {hint}")
        if key in values:
            raise UsageError(f"--truth {given}: {key} stands there twice")
        values[key] = value
    found = TruthRequest(
        name, _offset_seconds(given, values.get("offset")), _flag(given, values), values.get("topic", "")
    )
    if not name:
        raise UsageError(f"--truth {given!r}: name a file, a folder or a topic of the log")
    return found


def check_truth(given: str) -> None:
    """Check a value of ``--truth``. UsageError as :func:`parse_truth`, LogUnreadable for a missing file."""
    found = parse_truth(given)
    if found.path is None and meant_as_file(found.name):
        raise LogUnreadable(f"{found.name}: {missing_file(found.name)}")


def _split(given: str) -> tuple[str, str]:
    """Split name and settings at the last colon before a key; names may contain colons."""
    found = re.search(r":([a-z]+=[^:]*)$", given)
    if os.path.exists(given) or found is None:
        return given, ""
    return given[: found.start()], found[1]


def _offset_seconds(given: str, text: str | None) -> float | None:
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(f"--truth {given}: offset {text!r} is no number of seconds")
    return value


def _flag(given: str, values: dict[str, str]) -> bool:
    text = values.get("north", "false").lower()
    if text not in YES + NO:
        raise UsageError(f"--truth {given}: north {text!r}: use true or false")
    return text in YES


def meant_as_file(name: str) -> bool:
    """Return whether a name looks like a file: topics contain slashes, but no dots except ``name.N``."""
    last = re.split(r"[/\\]", name)[-1]
    return "." in last and not re.fullmatch(r"\w+\.\d+", last)


# Read attitudes from text files: TUM, EuRoC, and tables with a header in any usual spelling.

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
RAD = {"deg": math.pi / 180.0, "rad": 1.0}
# Usual steps of an attitude's time (1 Hz to 5 kHz), from which a missing unit is inferred.
TIME_STEP_RANGE_S = (2e-4, 1.0)
# t x y z qx qy qz qw; EuRoC files may have more columns.
TUM_COLUMNS = 8
# A median time above this is in nanoseconds; in seconds it would be 30,000 years.
NANOSECONDS = 1e12
# Fewest attitudes of a trajectory.
MIN_ATTITUDES = 20
# Limits of a quaternion's norm, wide enough for rounded values; rows outside are left out.
NORMS = (0.5, 2.0)


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Attitudes of a file at rising ``t`` (n,) s on its own clock, with positions (n, 3) m if given.

    ``readings``: quaternions (n, 4), scalar first, by interpretation of the numbers; a file with one interpretation
    names it "". ``known_axes``: body FRD and earth NED. ``left_out``: rows without attitude or rising time. ``held``
    (n,): repetitions of the pose before, as written while markers are lost or the vehicle stands still.
    """

    name: str
    t: Array
    readings: dict[str, Array]
    position: Array | None = None
    known_axes: bool = False
    left_out: int = 0
    held: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))

    def select(self, use: NDArray[np.bool_]) -> Trajectory:
        """Return the selected poses (n,)."""
        position = None if self.position is None else self.position[use]
        readings = {name: q[use] for name, q in self.readings.items()}
        return replace(self, t=self.t[use], readings=readings, position=position, held=self.held[use])

    def with_inverses(self) -> Trajectory:
        """Add readings of the quaternions as earth to body, as some programs write them."""
        names = {name: f"{name}, earth to body" if name else "earth to body" for name in self.readings}
        inverses = {names[name]: rotation.conjugate(q) for name, q in self.readings.items()}
        return replace(self, readings=self.readings | inverses)


def make_trajectory(
    name: str, t: Array, readings: dict[str, Array], position: Array | None = None, known_axes: bool = False
) -> Trajectory:
    """Return the trajectory of the samples with rising times and valid norms. UsageError for too few."""
    t = np.asarray(t, np.float64)
    t = t * 1e-9 if len(t) and float(nanmedian(t)) > NANOSECONDS else t
    norm = rotation.length(next(iter(readings.values())))
    good = np.isfinite(t) & (norm > NORMS[0]) & (norm < NORMS[1])
    highest = np.maximum.accumulate(np.where(good, t, -np.inf))
    good[1:] &= t[1:] > highest[:-1]
    count = int(np.count_nonzero(good))
    if count < MIN_ATTITUDES:
        raise UsageError(f"{name}: {count} usable attitudes in rising time; {MIN_ATTITUDES} are needed")
    kept = {reading: rotation.normalize(q[good]) for reading, q in readings.items()}
    place = None if position is None else position[good]
    held = _held_poses(next(iter(readings.values()))[good], place)
    return Trajectory(name, t[good], kept, place, known_axes, len(t) - count, held)


def _held_poses(q: Array, position: Array | None) -> NDArray[np.bool_]:
    """Mark poses (n,) equal to the one before: noise never repeats a measured pose to the last digit."""
    pose = q if position is None else np.column_stack([q, np.nan_to_num(position)])
    return np.concatenate([[False], np.all(pose[1:] == pose[:-1], axis=1)])


def read_trajectory(path: Path, angles: str = "auto") -> Trajectory:
    """Return the trajectory in a text file; ``angles`` is the unit of Euler angles.

    LogUnreadable if the file cannot be opened, UsageError without times or attitudes.
    """
    text = read_settings_text(path, MAX_RESULT_BYTES)
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith(("#", "%"))]
    if not lines:
        raise UsageError(f"{path}: holds no attitudes")
    if math.isnan(_number(re.split(r"[\s,;]+", lines[0].strip())[0])):
        return _with_header(path, lines, angles)
    separator = "," if "," in lines[0] else ";" if ";" in lines[0] else None
    table = _number_table(path, lines, separator)
    width = table.shape[1]
    if width < TUM_COLUMNS or (separator is None and width != TUM_COLUMNS):
        raise UsageError(
            f"{path}: {width} columns without a header; give TUM's t x y z qx qy qz qw, EuRoC's, or name the columns"
        )
    t, position, q = table[:, 0], table[:, 1:4], table[:, 4:8]
    readings = {"as TUM, scalar last": q[:, [3, 0, 1, 2]]} if separator is None else {"as EuRoC, scalar first": q}
    return make_trajectory(path.name, t, readings, position)


def _number_table(path: Path, lines: list[str], separator: str | None) -> Array:
    """Return the numbers of lines as (n, k), without a truncated last line. UsageError for any other invalid line."""
    rows = [line.split(separator) for line in lines]
    width = len(rows[0])
    if len(rows) > 1 and len(rows[-1]) != width:
        rows.pop()
    try:
        return np.array(rows, np.float64).reshape(len(rows), width)
    except ValueError:
        odd = next(k for k, row in enumerate(rows) if len(row) != width or any(not _is_number(cell) for cell in row))
        raise UsageError(f"{path}: row {odd + 1} has no {width} numbers: {lines[odd].strip()[:60]}") from None


def _with_header(path: Path, lines: list[str], angles: str) -> Trajectory:
    rows = list(csv.reader(lines, delimiter=max(",;\t", key=lines[0].count)))
    head = [name.strip() for name in rows[0]]
    plain = [_plain_name(name) for name in head]
    time = next((plain.index(name) for name in TIMES if name in plain), None)
    if time is None:
        raise UsageError(f"{path}: no time among its columns {', '.join(head[:12])}; give t in seconds")
    names = next((c for c in QUATERNIONS if all(n in plain for n in c)), None)
    chosen = [plain.index(n) for n in names] if names else _euler_columns(plain)
    if not chosen:
        raise UsageError(
            f"{path}: no attitude among its columns {', '.join(head[:12])}; give qw, qx, qy, qz or roll, pitch, yaw"
        )
    place = _position_columns(plain, chosen)
    values = np.array([[_number_at(row, i) for i in (time, *chosen, *place)] for row in rows[1:]], np.float64)
    values = values.reshape(-1, 1 + len(chosen) + len(place))
    attitude, position = values[:, 1 : 1 + len(chosen)], values[:, 1 + len(chosen) :] if place else None
    if names:
        readings = {"": attitude}
    else:
        units = _angle_units(path, [head[i] for i in chosen], angles)
        readings = {f"angles in {unit}": rotation.from_euler(*(RAD[unit] * attitude).T) for unit in units}
    return make_trajectory(path.name, _seconds(path, head[time], values[:, 0]), readings, position)


def _angle_units(path: Path, names: list[str], asked: str) -> list[str]:
    """Return the candidate units of Euler angles: ``asked``, else from the columns' names, else both."""
    if asked != "auto":
        return [asked]
    units = sorted({ANGLE_UNITS[u] for name in names if (u := _unit_of(name, ANGLE_UNITS))})
    if len(units) > 1:
        raise UsageError(f"{path}: Euler angles in two units, {' and '.join(units)}")
    return units or list(RAD)


def _plain_name(name: str) -> str:
    """Normalise a column's name: ``Quat [0]`` becomes quat0, ``roll_deg`` roll."""
    name = re.sub(r".*[./]", "", name.strip().lower())
    name = re.sub(r"[\s_]*[\[(]\s*(deg|degrees?|rad|radians?|m?s|us|ns|sec)\s*[\])]", "", name)
    name = re.sub(r"[_ ](deg|degrees?|rad|radians?|ms|us|ns|s|sec)$", "", name)
    return re.sub(r"[^a-z0-9]", "", name)


def _unit_of(name: str, known: Collection[str]) -> str:
    """Return the unit at the end of a column's name, empty if not among the ``known``."""
    found = re.search(r"[_ \[(]([a-z]+)[\])]?$", name.strip().lower())
    word = found[1] if found else ""
    return word if word in known else "us" if name.strip().lower() == "timeus" and "us" in known else ""


def _euler_columns(plain: list[str]) -> list[int]:
    """Return the columns of roll, pitch and yaw; empty where one is missing."""
    places = [next((plain.index(n) for n in names if n in plain), -1) for names in EULER]
    return places if min(places) >= 0 else []


def _position_columns(plain: list[str], taken: list[int]) -> list[int]:
    """Return the columns of a position, empty where there is none beside the ``taken`` ones."""
    for names in POSITIONS:
        if all(n in plain for n in names):
            where = [plain.index(n) for n in names]
            return [] if set(where) & set(taken) else where
    return []


def _number(text: str) -> float:
    """Return the number in a text, NaN for none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def _number_at(row: list[str], i: int) -> float:
    return _number(row[i]) if i < len(row) else math.nan


def _is_number(text: str) -> bool:
    return not math.isnan(_number(text)) or text.strip().lower() == "nan"


def _seconds(path: Path, name: str, values: Array) -> Array:
    """Convert times to seconds by the unit in the column's name, else by the unit that gives a usual rate."""
    unit = _unit_of(name, UNITS_S)
    if unit:
        return values * UNITS_S[unit]
    steps = np.diff(values[np.isfinite(values)])
    step = float(median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    for scale in (1.0, 1e-3, 1e-6, 1e-9):
        if TIME_STEP_RANGE_S[0] <= step * scale <= TIME_STEP_RANGE_S[1]:
            return values * scale
    raise UsageError(
        f"{path}: the steps of {name} make no rate of attitudes in s, ms, us or ns; name the unit, as in t_us"
    )
