"""In which axes is an attitude? The ones in which its rotation is the gyro's, and the mean force points up.

The body axes and the direction of the rotation follow from the gyro: body rates of q (body to earth) are 2 q* q'.
Whether the earth's third axis points down or up follows from the mean specific force, which must be -g along down.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.base.errors import UsageError
from attlog.base.limits import GYRO_LIMIT_RAD_S
from attlog.flight.model import Imu
from attlog.recorded.columns import AttitudeColumns
from attlog.segments import gaps

Array = NDArray[np.float64]
NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])
EARTH = {"ned": NO_TURN, "enu": rotation.ENU}
BODY = {"frd": NO_TURN, "flu": rotation.FLU}
"""The half turns that lead from these axes to north-east-down and to forward-right-down."""
INTERVAL_S, MANY = 0.1, 20_000
AGREES, MOVES_DPS, LEAST = 0.5, (20.0, 8.0, 3.0), 10
"""Rates that differ by less than half of their own size are the same rotation. The fastest of which there are enough
count: in slow ones what a filter adds to the gyro is not small."""
TILT_DEG = 20.0
"""The mean force may lie so far from the vertical: acceleration averages out over a flight."""
CLEAR = 1.5
"""The second best must be so much worse to be another."""


@dataclass(frozen=True, slots=True)
class FrameCandidate:
    """One reading of a file: what it is called, and its attitudes (n, 4), body FRD to earth NED."""

    name: str
    q: Array


@dataclass(frozen=True, slots=True)
class FrameFit:
    """The reading that physics agrees with, and how well."""

    name: str
    q: Array
    quality: dict[str, float | str]

    @property
    def apart(self) -> float:
        """How far its turning is from the gyro's, in percent; 100 where that is not known."""
        return float(self.quality.get("gyro_disagreement_pct", 100.0))


def candidates(table: AttitudeColumns, rows: NDArray[np.int64], asked: str, angles: str) -> list[FrameCandidate]:
    """All readings of a file that are not excluded by what was asked for or told by the names of its columns."""
    found = []
    for unit, q in _quaternions(table, rows, angles):
        for earth, turn in EARTH.items():
            for body, half in BODY.items():
                for inverse in (False, True):
                    name = f"{body}-{earth}" if inverse else f"{earth}-{body}"
                    if asked in ("auto", name):
                        own = rotation.conjugate(q) if inverse else q
                        ned = rotation.multiply(rotation.multiply(turn, own), half)
                        found.append(FrameCandidate(f"{name}{', ' + unit if unit else ''}", ned))
    return found


def _quaternions(table: AttitudeColumns, rows: NDArray[np.int64], angles: str) -> Iterator[tuple[str, Array]]:
    if table.q is not None:
        yield "", rotation.normalize(table.q[rows])
        return
    assert table.euler is not None
    unit = angles if angles != "auto" else table.angles
    for one in (unit,) if unit else ("deg", "rad"):
        scale = np.pi / 180.0 if one == "deg" else 1.0
        yield f"angles in {one}", rotation.from_euler(*(scale * table.euler[rows]).T)


def chosen(path: Path, t: Array, found: list[FrameCandidate], imu: Imu) -> FrameFit:
    """The reading that gyro and gravity agree with. UsageError where none does, or two do and they are not the same."""
    measured = [(c, _rate_difference(t, c.q, imu), _force(t, c.q, imu)) for c in found]
    upright = [m for m in measured if m[2] is None or m[2] <= TILT_DEG]
    moves = [m for m in upright if m[1] is not None]
    if moves:
        moves.sort(key=lambda m: m[1] or 0.0)
        best = moves[0]
        if (best[1] or 0.0) <= AGREES:
            _only_one(path, best, moves[1:])
            return FrameFit(best[0].name, best[0].q, _quality(best))
    elif len({c.name for c, _, _ in upright}) == 1:
        return FrameFit(upright[0][0].name, upright[0][0].q, _quality(upright[0]))
    raise UsageError(f"{path}: {_why(measured, bool(moves))}")


def _only_one(
    path: Path,
    best: tuple[FrameCandidate, float | None, float | None],
    others: list[tuple[FrameCandidate, float | None, float | None]],
) -> None:
    rate = max(best[1] or 0.0, 1e-3)
    near = [o[0].name for o in others if (o[1] or 0.0) < CLEAR * rate and not _same(o[0].q, best[0].q)]
    if near:
        raise UsageError(
            f"{path}: could be {best[0].name} as well as {', '.join(near)}; say which as frame= or angles="
        )


def _same(a: Array, b: Array) -> bool:
    some = slice(None, None, max(1, len(a) // 1000))
    apart = rotation.total_angle(rotation.error(a[some], b[some]))
    return bool(np.nanmax(apart) < np.radians(0.1))


def _quality(m: tuple[FrameCandidate, float | None, float | None]) -> dict[str, float | str]:
    found: dict[str, float | str] = {}
    if m[1] is not None:
        found["gyro_disagreement_pct"] = round(100.0 * m[1], 2)
    if m[2] is not None:
        found["gravity_off_deg"] = round(m[2], 2)
    return found


def _why(measured: list[tuple[FrameCandidate, float | None, float | None]], moves: bool) -> str:
    """What was tried and how far off it was."""
    if not moves and all(m[1] is None for m in measured):
        return "the vehicle turns too little to tell its axes by the gyro; say them as frame=ned-frd or frame=enu-flu"
    told = sorted(measured, key=lambda m: (m[1] if m[1] is not None else 9.0) + ((m[2] or 0.0) > TILT_DEG))[:3]
    parts = [
        f"{c.name}: turns otherwise than the gyro by {100.0 * (r if r is not None else np.nan):.0f} %, "
        f"gravity off by {g if g is not None else np.nan:.0f} deg"
        for c, r, g in told
    ]
    return (
        "is no attitude of this log in any axes that were tried ("
        + "; ".join(parts)
        + "). Is it of this log, its clock right "
        "(offset=SECONDS), and its rotation from body to earth?"
    )


def _rate_difference(t: Array, q: Array, imu: Imu) -> float | None:
    """How far the turning of the attitude is from the gyro's, over its size; None where the vehicle hardly turns."""
    step = max(1, round(INTERVAL_S / max(float(np.median(np.diff(t))), 1e-4))) if len(t) > 1 else 1
    first = np.arange(0, len(t) - step, max(step, len(t) // MANY))
    last = first + step
    first, last = (x[(t[last] - t[first]) < 5.0 * INTERVAL_S] for x in (first, last))
    gyro_t, rate = gaps.rising(imu.gyro.t_best, imu.gyro.x)
    if len(first) < 10 or len(gyro_t) < 10:
        return None
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(rate[1:] * np.diff(gyro_t)[:, None], axis=0)])
    gyro = np.column_stack(
        [np.interp(t[last], gyro_t, turned[:, k]) - np.interp(t[first], gyro_t, turned[:, k]) for k in range(3)]
    )
    own = rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[first]), q[last]))
    span = (t[last] - t[first])[:, None]
    own, gyro = own / span, gyro / span
    gyro = gyro - np.median(gyro - own, axis=0) if np.isfinite(own).all() else gyro
    size = np.degrees(np.sqrt(np.sum(gyro**2, axis=1)))
    sound = np.isfinite(own).all(axis=1) & (np.sum(own**2, axis=1) < GYRO_LIMIT_RAD_S**2)
    moving = next((m for m in (sound & (size > fast) for fast in MOVES_DPS) if m.sum() >= LEAST), None)
    if moving is None:
        return None
    return float(np.sqrt(np.sum((own - gyro)[moving] ** 2) / np.sum(gyro[moving] ** 2)))


def _force(t: Array, q: Array, imu: Imu) -> float | None:
    """The angle in deg between the mean specific force in earth axes and up; None without an accelerometer."""
    acc_t, acc = gaps.rising(imu.acc.t_best, imu.acc.x)
    if len(acc_t) < 10:
        return None
    force = np.column_stack([np.interp(t, acc_t, acc[:, k]) for k in range(3)])
    earth = rotation.rotate(q, force)
    earth = earth[np.isfinite(earth).all(axis=1)]
    if len(earth) == 0:
        return None
    mean = np.mean(earth, axis=0)
    return float(np.degrees(np.arctan2(np.hypot(mean[0], mean[1]), -mean[2])))
