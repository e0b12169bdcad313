"""In which axes is a truth? Its body's by the gyro, its vertical by gravity, its north by motion or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.core.kinematics import body_rates, earth_force, tilt_deg
from attlog.core.limits import GYRO_LIMIT_RAD_S
from attlog.external.read import AttitudeColumns
from attlog.flight.model import FlightLog, Imu
from attlog.segments import model
from attlog.segments.increments import gyro_increments

Array = NDArray[np.float64]

G = 9.80665
BLOCKS, MIN_BLOCKS = 10, 4
# The mean force over so long is gravity, the bias and the change of velocity.
BLOCK_S = 2.0
# One sigma of an accelerometer's bias before a flight tells it.
BIAS_M_S2 = np.array([0.15, 0.15, 0.3])
# Motion tells north above so much speed, where both velocities correlate by so much, by so many of them.
SPEED_M_S, SAME_WAY, MIN_SPEEDS = 1.0, 0.9, 20
# A receiver's velocity may be late by what its driver does not know; on a curve that would turn north.
LATE_S = np.arange(-0.1, 0.41, 0.02)
DOWN = np.array([0.0, 0.0, 1.0])
# What differs from the usual by fewer sigmas is the usual.
SIGNIFICANT_SIGMAS = 3.0
# Body axes that people give: forward-right-down and forward-left-up.
USUAL_BODIES = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Vertical:
    """Earth's down (3,) in the truth's world, its one sigma in rad, and the size of gravity found in m/s^2."""

    down: Array
    sigma: float
    gravity: float


@dataclass(frozen=True, slots=True)
class North:
    """The heading in rad that turns the levelled world north, and its one sigma."""

    heading: float
    sigma: float


def fit_vertical(imu: Imu, t: Array, q: Array, velocity: Array | None) -> Vertical | None:
    """Down in the world of attitudes ``q`` (n, 4), body FRD to that world, at ``t`` (n,) s on the log's clock.

    Least squares over blocks: force in body = -R^T g + bias + R^T a, where ``velocity`` (n, 3) of the truth, if it
    has one, tells the acceleration a. None where less than a few blocks are covered.
    """
    at, force = model.select_rising(imu.acc.t_best, imu.acc.x)
    turned, _ = rotation.slerp_in_segments(t, q, model.number_segments(t), at)
    good = rotation.finite_rows(turned)
    if np.count_nonzero(good) < 10:
        return None
    at, force, turned = at[good], force[good], turned[good]
    block = ((at - at[0]) / BLOCK_S).astype(np.int64)
    _, first, count = np.unique(block, return_index=True, return_counts=True)
    whole = count >= 0.5 * np.median(count)
    to_world = rotation.to_matrix(turned)
    mean_turn = np.add.reduceat(to_world, first, axis=0) / count[:, None, None]
    mean_force = np.add.reduceat(rotation.rotate(turned, force), first, axis=0) / count[:, None]
    push = np.zeros_like(mean_force)
    if velocity is not None:
        ends = [np.column_stack([np.interp(x, t, v) for v in velocity.T]) for x in (at[first], at[first + count - 1])]
        push = (ends[1] - ends[0]) / np.maximum(at[first + count - 1] - at[first], 0.5)[:, None]
        whole &= rotation.finite_rows(push)
    if np.count_nonzero(whole) < MIN_BLOCKS:
        return None
    mean_turn, y = mean_turn[whole], (mean_force - push)[whole]
    whole_fit = _fit_down(mean_turn, y)
    if whole_fit is None:
        return None
    parts = np.array_split(np.arange(len(y)), min(BLOCKS, len(y)))
    left = [_fit_down(np.delete(mean_turn, p, axis=0), np.delete(y, p, axis=0)) for p in parts]
    off = np.array([one.down - whole_fit.down for one in left if one is not None])
    scatter = float(np.sqrt((len(off) - 1) / len(off) * np.sum((off - off.mean(axis=0)) ** 2)))
    return replace(whole_fit, sigma=max(whole_fit.sigma, scatter))


def _fit_down(mean_turn: Array, y: Array) -> Vertical | None:
    """The solution for y (k, 3) = -g + mean_turn (k, 3, 3) b, b near zero; the worst blocks count less."""
    k = len(y)
    rows = np.concatenate([np.broadcast_to(-np.eye(3), (k, 3, 3)), mean_turn], axis=2)
    weight, prior = np.ones(k), np.diag(np.concatenate([np.zeros(3), BIAS_M_S2**-2.0]))
    scale = 1.0
    for _ in range(5):
        per = weight / scale**2
        information = np.einsum("k,kij,kil->jl", per, rows, rows) + prior
        x = np.linalg.solve(information, np.einsum("k,kij,ki->j", per, rows, y))
        left = np.sqrt(np.sum((y - rows @ x) ** 2, axis=1) / 3.0)
        scale = max(1.4826 * float(np.median(left)), 1e-3)
        weight = np.minimum(1.0, 2.0 * scale / np.maximum(left, 1e-9)) ** 2
    gravity = float(np.linalg.norm(x[:3]))
    if gravity < 0.5 * G:
        return None
    covariance = np.linalg.inv(information)[:3, :3]
    across = np.eye(3) - np.outer(x[:3], x[:3]) / gravity**2
    sigma = float(np.sqrt(np.trace(across @ covariance @ across))) / gravity
    return Vertical(x[:3] / gravity, sigma, gravity)


def snap_to_usual(turn: Array, sigma: Array) -> Array:
    """The usual body axes where a turn (4,) of a body to FRD is no different, by ``sigma`` (3,) rad; else the turn."""
    for named in np.array(USUAL_BODIES):
        apart = rotation.to_rotvec(rotation.earth_error(turn, named))
        if np.all(np.abs(apart) <= SIGNIFICANT_SIGMAS * sigma):
            return np.asarray(named)
    return turn


def level_world(down: Array, within: float = 0.0) -> Array:
    """The rotation (4,) of least angle from the nearest of the world's axes, that makes ``down`` (3,) the third axis.

    A world that is level but for ``within`` rad stays so: an accelerometer's bias would only tilt it.

    East-north-up becomes north-east-down; a world whose vertical is its second axis is turned onto it first.
    """
    nearest = np.zeros(3)
    axis = int(np.argmax(np.abs(down)))
    nearest[axis] = np.sign(down[axis])
    turn = np.eye(3)
    if axis == 2:
        turn = np.eye(3) if nearest[2] > 0 else np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    else:
        north = np.zeros(3)
        north[(axis + 1) % 3] = 1.0
        turn = np.array([north, np.cross(nearest, north), nearest])
    rest = turn @ down
    q = rotation.from_matrix(turn)
    bend = np.cross(rest, DOWN)
    size = float(np.linalg.norm(bend))
    if size > np.sin(within):
        q = rotation.multiply(rotation.from_rotvec(bend / size * np.arctan2(size, float(rest @ DOWN))), q)
    return np.asarray(q)


def north_by_gnss(log: FlightLog, t: Array, velocity: Array) -> North | None:
    """The heading that turns horizontal velocities (n, 3) of the levelled truth onto the GNSS velocity.

    None where it did not move enough, or the two do not go the same way.
    """
    for gnss in log.gnss:
        good = (gnss.fix >= 3) & rotation.finite_rows(gnss.vel_ned[:, :2])
        products = [_velocity_products(t, velocity, gnss.t[good] - late, gnss.vel_ned[good]) for late in LATE_S]
        same, product = max(products, key=lambda found: found[0])
        if same < SAME_WAY:
            continue
        heading = float(np.angle(product.sum()))
        parts = np.array([p.sum() for p in np.array_split(product, BLOCKS)])
        off = np.angle((product.sum() - parts) * np.exp(-1j * heading))
        return North(heading, float(np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((off - off.mean()) ** 2))))
    return None


def _velocity_products(t: Array, velocity: Array, at: Array, seen: Array) -> tuple[float, NDArray[np.complex128]]:
    """How well velocities (n, 3) at ``t`` and ``seen`` (m, 3) go the same way, 0 to 1, and their products (k,)."""
    inside = (at > t[0]) & (at < t[-1])
    a = np.column_stack([np.interp(at[inside], t, v) for v in velocity.T[:2]]) @ [1.0, 1j]
    b = seen[inside, :2] @ [1.0, 1j]
    fast = (np.abs(a) > SPEED_M_S) & (np.abs(b) > SPEED_M_S)
    product = np.conj(a[fast]) * b[fast]
    if len(product) < MIN_SPEEDS:
        return 0.0, product
    size = np.sqrt(np.sum(np.abs(a[fast]) ** 2) * np.sum(np.abs(b[fast]) ** 2))
    return float(np.abs(product.sum()) / size), product


def gnss_velocity(log: FlightLog, t: Array) -> Array | None:
    """Velocity (n, 3) m/s NED at times (n,) s by the first receiver with a fix, NaN beyond it; None without one."""
    for gnss in log.gnss:
        at, v = model.select_rising(np.where(gnss.fix >= 3, gnss.t, np.nan), gnss.vel_ned)
        if len(at) > MIN_SPEEDS:
            return np.column_stack([np.interp(t, at, x, np.nan, np.nan) for x in v.T])
    return None


def velocity_from_position(t: Array, position: Array | None) -> Array | None:
    """Velocities (n, 3) of positions (n, 3), over 0.2 s; None without any."""
    if position is None or not np.isfinite(position).all() or len(t) < 3 or not np.ptp(position, axis=0).any():
        return None
    half = 0.1
    ends = [np.column_stack([np.interp(np.clip(t + s, t[0], t[-1]), t, p) for p in position.T]) for s in (-half, half)]
    span = np.clip(t + half, t[0], t[-1]) - np.clip(t - half, t[0], t[-1])
    return np.asarray((ends[1] - ends[0]) / np.maximum(span, 1e-3)[:, None])


# In which axes is an attitude? The ones in which its rotation is the gyro's, and the mean force points up.
#
# The body axes and the direction of the rotation follow from the gyro: body rates of q (body to earth) are 2 q* q'.
# Whether the earth's third axis points down or up follows from the mean specific force, which must be -g along down.

NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])
EARTH = {"ned": NO_TURN, "enu": rotation.ENU}
# The half turns that lead from these axes to north-east-down and to forward-right-down.
BODY = {"frd": NO_TURN, "flu": rotation.FLU}
INTERVAL_S, MAX_INTERVAL_S, MAX_RATE_INTERVALS = 0.1, 0.5, 20_000
# Rates that differ by less than half of their own size are the same rotation. The fastest of which there are enough
# count: in slow ones what a filter adds to the gyro is not small.
MAX_RATE_DIFFERENCE, MOVING_DPS, MIN_MOVING = 0.5, (20.0, 8.0, 3.0), 10
# The mean force may lie so far from the vertical: acceleration averages out over a flight.
TILT_DEG = 20.0
# The second best must be so much worse to be another.
MIN_RIVAL_RATIO = 1.5


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


def frame_candidates(table: AttitudeColumns, rows: NDArray[np.int64], asked: str, angles: str) -> list[FrameCandidate]:
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


def choose_frame(path: Path, t: Array, found: list[FrameCandidate], imu: Imu) -> FrameFit:
    """The reading that gyro and gravity agree with. UsageError where none does, or two do and they are not the same."""
    measured = [(c, _rate_difference(t, c.q, imu), _force_tilt_deg(t, c.q, imu)) for c in found]
    upright = [m for m in measured if m[2] is None or m[2] <= TILT_DEG]
    moves = [m for m in upright if m[1] is not None]
    if moves:
        moves.sort(key=lambda m: m[1] or 0.0)
        best = moves[0]
        if (best[1] or 0.0) <= MAX_RATE_DIFFERENCE:
            _only_one(path, best, moves[1:])
            return FrameFit(best[0].name, best[0].q, _fit_quality(best))
    elif len({c.name for c, _, _ in upright}) == 1:
        return FrameFit(upright[0][0].name, upright[0][0].q, _fit_quality(upright[0]))
    raise UsageError(f"{path}: {_reason_refused(measured, bool(moves))}")


def _only_one(
    path: Path,
    best: tuple[FrameCandidate, float | None, float | None],
    others: list[tuple[FrameCandidate, float | None, float | None]],
) -> None:
    rate = max(best[1] or 0.0, 1e-3)
    near = [
        o[0].name for o in others if (o[1] or 0.0) < MIN_RIVAL_RATIO * rate and not _same_attitude(o[0].q, best[0].q)
    ]
    if near:
        raise UsageError(
            f"{path}: could be {best[0].name} as well as {', '.join(near)}; say which as frame= or angles="
        )


def _same_attitude(a: Array, b: Array) -> bool:
    some = slice(None, None, max(1, len(a) // 1000))
    apart = rotation.total_angle(rotation.earth_error(a[some], b[some]))
    return bool(np.nanmax(apart) < np.radians(0.1))


def _fit_quality(m: tuple[FrameCandidate, float | None, float | None]) -> dict[str, float | str]:
    found: dict[str, float | str] = {}
    if m[1] is not None:
        found["gyro_disagreement_pct"] = round(100.0 * m[1], 2)
    if m[2] is not None:
        found["gravity_off_deg"] = round(m[2], 2)
    return found


def _reason_refused(measured: list[tuple[FrameCandidate, float | None, float | None]], moves: bool) -> str:
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
    """Return how far the attitude's rates are from the gyro's, over their size; None where the vehicle hardly turns."""
    if len(t) < 2:
        return None
    step = max(1, round(INTERVAL_S / max(float(np.median(np.diff(t))), 1e-4)))
    stride = max(step, len(t) // MAX_RATE_INTERVALS)
    rates = body_rates(t, q, np.zeros(len(t), np.int64), step, stride, MAX_INTERVAL_S)
    gyro = gyro_increments(imu).mean_rates(rates.start, rates.end)
    known = rotation.finite_rows(gyro) & (rotation.length(rates.rate) < GYRO_LIMIT_RAD_S)
    own, gyro = rates.rate[known], gyro[known]
    if len(own) < MIN_MOVING:
        return None
    gyro = gyro - np.median(gyro - own, axis=0)
    size = np.degrees(rotation.length(gyro))
    moving = next((m for m in (size > fast for fast in MOVING_DPS) if m.sum() >= MIN_MOVING), None)
    if moving is None:
        return None
    return float(np.sqrt(np.sum((own - gyro)[moving] ** 2) / np.sum(gyro[moving] ** 2)))


def _force_tilt_deg(t: Array, q: Array, imu: Imu) -> float | None:
    """Return the angle in deg between the mean specific force in earth axes and up; None without an accelerometer."""
    acc_t, acc = model.select_rising(imu.acc.t_best, imu.acc.x)
    mean = earth_force(acc_t, acc, t, q, None) if len(acc_t) >= MIN_MOVING else None
    return None if mean is None else tilt_deg(mean)
