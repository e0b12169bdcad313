"""A trajectory as it was stored: times, quaternions, positions, in axes and on a clock of its own.

TUM (``t x y z qx qy qz qw``, blanks) and EuRoC (``ns, x, y, z, qw, qx, qy, qz, ...``) as evo reads them, and tables
with a header.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.base.errors import UsageError
from attlog.base.files.settings_file import text_of
from attlog.base.limits import MAX_RESULT_BYTES
from attlog.recorded import columns

Array = NDArray[np.float64]
TUM_COLUMNS, EUROC_COLUMNS = 8, 8
NANOSECONDS = 1e12
"""Larger times without a unit are nanoseconds: as seconds they would be 30,000 years."""
LEAST = 20
"""Attitudes that make a trajectory."""


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


def read(path: Path) -> Trajectory:
    """The trajectory in a text file. LogUnreadable if it cannot be opened, UsageError for what is none."""
    text = text_of(path, MAX_RESULT_BYTES)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    numbers = [line for line in lines if not line.startswith(("#", "%"))]
    if not numbers:
        raise UsageError(f"{path}: holds no attitudes")
    if _number_of(re.split(r"[\s,;]+", numbers[0])[0]) is None:
        return _with_header(path)
    separator = "," if "," in numbers[0] else ";" if ";" in numbers[0] else None
    table = _table(path, numbers, separator)
    width = table.shape[1]
    if width < TUM_COLUMNS or (separator is None and width != TUM_COLUMNS):
        raise UsageError(
            f"{path}: {width} columns without a header; give TUM's t x y z qx qy qz qw, EuRoC's, or name the columns"
        )
    t, position, q = table[:, 0], table[:, 1:4], table[:, 4:8]
    if separator is None:
        return made(path.name, t, _both_ways(q[:, [3, 0, 1, 2]], "as TUM, scalar last"), position)
    return made(path.name, t, _both_ways(q, "as EuRoC, scalar first"), position)


def _both_ways(q: Array, usual: str) -> dict[str, Array]:
    """Attitudes (n, 4) as their format says, and as their inverse, which some programs write."""
    return {usual: q, f"{usual}, but earth to body": rotation.conjugate(q)}


def made(name: str, t: Array, quaternions: dict[str, Array], position: Array | None = None) -> Trajectory:
    """A trajectory of its good samples in rising time. UsageError where too few are left."""
    t = np.asarray(t, np.float64)
    t = t * 1e-9 if len(t) and float(np.nanmedian(t)) > NANOSECONDS else t
    first = next(iter(quaternions.values()))
    norm = rotation.length(first)
    good = np.isfinite(t) & np.isfinite(norm) & (np.abs(norm - 1.0) < 0.1)
    highest = np.maximum.accumulate(np.where(good, t, -np.inf))
    good[1:] &= t[1:] > highest[:-1]
    if np.count_nonzero(good) < LEAST:
        raise UsageError(f"{name}: {np.count_nonzero(good)} usable attitudes in rising time; {LEAST} are needed")
    kept = {reading: rotation.normalize(q[good]) for reading, q in quaternions.items()}
    return Trajectory(name, t[good], kept, None if position is None else position[good])


def _with_header(path: Path) -> Trajectory:
    table = columns.read(path)
    if table.q is not None:
        either = {"body to earth": table.q, "earth to body": rotation.conjugate(table.q)}
        return made(path.name, table.t, either, table.position)
    assert table.euler is not None
    units = (table.angles,) if table.angles else ("deg", "rad")
    scales = {"deg": np.pi / 180.0, "rad": 1.0}
    read_as = {f"roll, pitch, yaw in {u}": rotation.from_euler(*(scales[u] * table.euler).T) for u in units}
    return made(path.name, table.t, read_as, table.position)


def _table(path: Path, lines: list[str], separator: str | None) -> Array:
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
