"""Axes of an external attitude: body axes from the gyro, vertical from gravity, north from GNSS velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.errors import UsageError
from attlog.core.kinematics import body_rates, earth_force, tilt_deg
from attlog.core.limits import GYRO_LIMIT_RAD_S
from attlog.core.sorting import median
from attlog.external.read import Trajectory
from attlog.flight.model import FlightLog, Imu
from attlog.segments import model
from attlog.segments.increments import gyro_increments

Array = NDArray[np.float64]

G = 9.80665
BLOCKS, MIN_BLOCKS = 10, 4  # of the jackknife
# Length of a block over which force, attitude and acceleration are averaged.
BLOCK_S = 2.0
# Prior sigma of the accelerometer's bias.
BIAS_M_S2 = np.array([0.15, 0.15, 0.3])
# Least speed, correlation and number of velocities from which north is estimated.
MIN_SPEED_M_S, MIN_CORRELATION, MIN_SPEEDS = 1.0, 0.9, 20
# Delays tried for a receiver's velocity: in a turn an unmodelled delay rotates north.
DELAYS_S = np.arange(-0.1, 0.41, 0.02)
DOWN = np.array([0.0, 0.0, 1.0])
# A difference below this many sigmas is insignificant.
SIGNIFICANT_SIGMAS = 3.0
# Rotations to FRD from the usual body axes: forward-right-down and forward-left-up.
USUAL_BODIES = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Vertical:
    """Direction of down (3,) in an attitude's world, its sigma in rad, and the fitted gravity in m/s^2."""

    down: Array
    sigma: float
    gravity: float


@dataclass(frozen=True, slots=True)
class North:
    """Rotation in rad about down from a levelled world to north, and its sigma."""

    heading: float
    sigma: float


def fit_vertical(imu: Imu, t: Array, q: Array, velocity: Array | None) -> Vertical | None:
    """Fit the direction of down in the world of an attitude to the accelerometer.

    ``q`` (n, 4) turns body FRD to that world, at ``t`` (n,) s on the log's clock. Least squares over blocks: force in
    body = -R^T g + bias + R^T a, with the acceleration a from ``velocity`` (n, 3) in that world. The sigma is the
    larger of covariance and jackknife. None for fewer than MIN_BLOCKS blocks.
    """
    at, force = model.select_rising(imu.acc.t_best, imu.acc.x)
    turned, _ = rotation.slerp_in_segments(t, q, model.number_segments(t), at)
    good = rotation.finite_rows(turned)
    if np.count_nonzero(good) < 10:
        return None
    at, force, turned = at[good], force[good], turned[good]
    block = ((at - at[0]) / BLOCK_S).astype(np.int64)
    _, first, count = np.unique(block, return_index=True, return_counts=True)
    whole = count >= 0.5 * median(count)
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
    """Solve y (k, 3) = -g + mean_turn (k, 3, 3) b for g and b, by reweighted least squares.

    The bias b has a zero-mean prior of BIAS_M_S2. None if g is below half of standard gravity.
    """
    k = len(y)
    rows = np.concatenate([np.broadcast_to(-np.eye(3), (k, 3, 3)), mean_turn], axis=2)
    weight, prior = np.ones(k), np.diag(np.concatenate([np.zeros(3), BIAS_M_S2**-2.0]))
    scale = 1.0
    for _ in range(5):
        per = weight / scale**2
        information = np.einsum("k,kij,kil->jl", per, rows, rows) + prior
        x = np.linalg.solve(information, np.einsum("k,kij,ki->j", per, rows, y))
        left = np.sqrt(np.sum((y - rows @ x) ** 2, axis=1) / 3.0)
        scale = max(1.4826 * float(median(left)), 1e-3)
        weight = np.minimum(1.0, 2.0 * scale / np.maximum(left, 1e-9)) ** 2
    gravity = float(np.linalg.norm(x[:3]))
    if gravity < 0.5 * G:
        return None
    covariance = np.linalg.inv(information)[:3, :3]
    across = np.eye(3) - np.outer(x[:3], x[:3]) / gravity**2
    sigma = float(np.sqrt(np.trace(across @ covariance @ across))) / gravity
    return Vertical(x[:3] / gravity, sigma, gravity)


def snap_to_usual(turn: Array, sigma: Array) -> Array:
    """Round a rotation (4,) to FRD to the nearest of USUAL_BODIES within its uncertainty ``sigma`` (3,) rad."""
    for named in np.array(USUAL_BODIES):
        apart = rotation.to_rotvec(rotation.earth_error(turn, named))
        if np.all(np.abs(apart) <= SIGNIFICANT_SIGMAS * sigma):
            return np.asarray(named)
    return turn


def level_world(down: Array, within: float = 0.0) -> Array:
    """Return the rotation (4,) that makes ``down`` (3,) the third axis of the world.

    The axis nearest to the vertical is first mapped to down by a signed permutation (east-north-up to
    north-east-down), then the remaining tilt is removed. A remaining tilt up to ``within`` rad is kept, because it may
    be the accelerometer's bias.
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
    """Fit the heading rotation from a levelled trajectory's velocities (n, 3) to GNSS.

    None if too few velocities exceed MIN_SPEED_M_S or their correlation is below MIN_CORRELATION.
    """
    for gnss in log.gnss:
        good = (gnss.fix >= 3) & rotation.finite_rows(gnss.vel_ned[:, :2])
        products = [_velocity_products(t, velocity, gnss.t[good] - delay, gnss.vel_ned[good]) for delay in DELAYS_S]
        same, product = max(products, key=lambda found: found[0])
        if same < MIN_CORRELATION:
            continue
        heading = float(np.angle(product.sum()))
        parts = np.array([p.sum() for p in np.array_split(product, BLOCKS)])
        off = np.angle((product.sum() - parts) * np.exp(-1j * heading))
        return North(heading, float(np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((off - off.mean()) ** 2))))
    return None


def _velocity_products(t: Array, velocity: Array, at: Array, seen: Array) -> tuple[float, NDArray[np.complex128]]:
    """Return the correlation of horizontal velocities, and their complex products (k,).

    ``velocity`` (n, 3) at ``t`` is interpolated to ``seen`` (m, 3) at ``at``. The angle of a product is the heading.
    """
    inside = (at > t[0]) & (at < t[-1])
    a = np.column_stack([np.interp(at[inside], t, v) for v in velocity.T[:2]]) @ [1.0, 1j]
    b = seen[inside, :2] @ [1.0, 1j]
    fast = (np.abs(a) > MIN_SPEED_M_S) & (np.abs(b) > MIN_SPEED_M_S)
    product = np.conj(a[fast]) * b[fast]
    if len(product) < MIN_SPEEDS:
        return 0.0, product
    size = np.sqrt(np.sum(np.abs(a[fast]) ** 2) * np.sum(np.abs(b[fast]) ** 2))
    return float(np.abs(product.sum()) / size), product


def gnss_velocity(log: FlightLog, t: Array) -> Array | None:
    """Interpolate GNSS velocities (n, 3) m/s NED to times (n,) s.

    NaN before the first and after the last 3D fix; None without a receiver of enough fixes.
    """
    for gnss in log.gnss:
        at, v = model.select_rising(np.where(gnss.fix >= 3, gnss.t, np.nan), gnss.vel_ned)
        if len(at) > MIN_SPEEDS:
            return np.column_stack([np.interp(t, at, x, np.nan, np.nan) for x in v.T])
    return None


def velocity_from_position(t: Array, position: Array | None) -> Array | None:
    """Return velocities (n, 3) by central differences over 0.2 s; None for missing or constant positions."""
    if position is None or not np.isfinite(position).all() or len(t) < 3 or not np.ptp(position, axis=0).any():
        return None
    half = 0.1
    ends = [np.column_stack([np.interp(np.clip(t + s, t[0], t[-1]), t, p) for p in position.T]) for s in (-half, half)]
    span = np.clip(t + half, t[0], t[-1]) - np.clip(t - half, t[0], t[-1])
    return np.asarray((ends[1] - ends[0]) / np.maximum(span, 1e-3)[:, None])


@dataclass(frozen=True, slots=True)
class WorldFit:
    """Rotation (4,) from a trajectory's world to NED, its sigmas in rad, and the origin of its north."""

    turn: Array
    sigma_tilt: float
    sigma_heading: float
    north: Literal["file", "gnss", "none"]


def fit_world(
    log: FlightLog, imu: Imu, t: Array, q: Array, trajectory: Trajectory, inside: NDArray[np.bool_], keeps_north: bool
) -> WorldFit:
    """Fit the rotation to NED from the world of attitudes ``q`` (n, 4), FRD to that world.

    ``keeps_north``: north is taken from the file. UsageError if the vertical cannot be fitted.
    """
    if trajectory.known_axes:
        return WorldFit(np.array([1.0, 0.0, 0.0, 0.0]), 0.0, 0.0, "file")
    velocity = None if trajectory.position is None else velocity_from_position(t, trajectory.position[inside])
    down = fit_vertical(imu, t, q, velocity)
    if down is None:
        raise UsageError(f"--truth {trajectory.name}: too little force in common to tell its vertical")
    north = None

    def turned(level: Array) -> float:
        return 0.0 if keeps_north else north.heading if north else _onto_onboard(log, t, rotation.multiply(level, q))

    level = level_world(down.down)
    if velocity is not None and not keeps_north:
        north = north_by_gnss(log, t, rotation.rotate(level, velocity))
    elif velocity is None and (moving := gnss_velocity(log, t)) is not None:
        to_ned = rotation.multiply(_about_down(turned(level)), level)
        better = fit_vertical(imu, t, q, rotation.rotate(rotation.conjugate(to_ned), moving))
        down = better if better is not None and better.sigma < down.sigma else down
    level = level_world(down.down, SIGNIFICANT_SIGMAS * down.sigma)
    left = rotation.rotate(level, down.down)
    sigma = max(down.sigma, float(np.arctan2(np.hypot(left[0], left[1]), left[2])))
    turn = rotation.multiply(_about_down(turned(level)), level)
    whose: Literal["file", "gnss", "none"] = "file" if keeps_north else "gnss" if north else "none"
    return WorldFit(turn, sigma, north.sigma if north else 0.0, whose)


def _about_down(angle: float) -> Array:
    return rotation.from_rotvec([0.0, 0.0, angle])


def _onto_onboard(log: FlightLog, t: Array, q: Array) -> float:
    """Return the mean heading difference in rad from a levelled attitude to the onboard attitude.

    It replaces an unknown north, so that curves overlap in figures; 0 without an onboard attitude.
    """
    onboard = log.onboard_attitude
    if onboard is None:
        return 0.0
    other = rotation.slerp(t, q, onboard.t)
    good = rotation.finite_rows(other) & rotation.finite_rows(onboard.q)
    if not good.any():
        return 0.0
    off = rotation.heading_angle(rotation.earth_error(onboard.q[good], other[good]))
    return float(np.angle(np.mean(np.exp(1j * off))))


# Convention of an attitude file: selected by agreement of its rates with the gyro and of the mean force with up.

NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])
# Rotations from these axes to north-east-down and to forward-right-down.
EARTH = {"ned": NO_TURN, "enu": rotation.ENU}
BODY = {"frd": NO_TURN, "flu": rotation.FLU}
INTERVAL_S, MAX_INTERVAL_S, MAX_RATE_INTERVALS = 0.1, 0.5, 20_000  # of a rate; most that are compared
# Largest relative difference of the attitude's and the gyro's rates. The fastest turns are compared if there are
# enough: in slow turns the corrections of a filter are not small against the rate.
MAX_RATE_DIFFERENCE, MOVING_DPS, MIN_MOVING = 0.5, (20.0, 8.0, 3.0), 10
# Largest angle of the mean force to the vertical: acceleration averages out over a flight.
MAX_FORCE_TILT_DEG = 20.0
# Ratio of rate differences to the best convention from which another one is excluded.
MIN_RIVAL_RATIO = 1.5


@dataclass(frozen=True, slots=True)
class Frame:
    """Attitudes (n, 4), FRD to NED, of a file read in one convention.

    ``rate_difference``: rms difference from the gyro's rates over their rms. ``force_tilt_deg``: angle of the mean
    force to the vertical. None where unknown.
    """

    name: str
    q: Array
    rate_difference: float | None = None
    force_tilt_deg: float | None = None

    @property
    def quality(self) -> dict[str, float | str]:
        """Agreement with gyro and gravity, rounded for display."""
        found: dict[str, float | str] = {}
        if self.rate_difference is not None:
            found["gyro_disagreement_pct"] = round(100.0 * self.rate_difference, 2)
        if self.force_tilt_deg is not None:
            found["gravity_off_deg"] = round(self.force_tilt_deg, 2)
        return found


def possible_frames(readings: dict[str, Array], asked: str = "auto") -> list[Frame]:
    """Return the attitudes of each reading in all conventions, or only in ``asked`` (``ned-frd``)."""
    found = []
    for reading, q in readings.items():
        for earth, turn in EARTH.items():
            for body, half in BODY.items():
                for name, own in ((f"{earth}-{body}", q), (f"{body}-{earth}", rotation.conjugate(q))):
                    if asked in ("auto", name):
                        ned = rotation.multiply(rotation.multiply(turn, own), half)
                        found.append(Frame(f"{name}{', ' + reading if reading else ''}", ned))
    return found


def choose_frame(path: Path, t: Array, frames: Sequence[Frame], imu: Imu) -> Frame:
    """Return the convention that agrees with gyro and gravity.

    UsageError if none agrees, or if two with different attitudes agree about equally well.
    """
    seen = [
        replace(f, rate_difference=_rate_difference(t, f.q, imu), force_tilt_deg=_force_tilt_deg(t, f.q, imu))
        for f in frames
    ]
    upright = [f for f in seen if f.force_tilt_deg is None or f.force_tilt_deg <= MAX_FORCE_TILT_DEG]
    moving = sorted((f for f in upright if f.rate_difference is not None), key=_difference)
    if moving and _difference(moving[0]) <= MAX_RATE_DIFFERENCE:
        best = moving[0]
        limit = MIN_RIVAL_RATIO * max(_difference(best), 1e-3)
        near = [f.name for f in moving[1:] if _difference(f) < limit and not _same_attitude(f.q, best.q)]
        if near:
            raise UsageError(
                f"{path}: could be {best.name} as well as {', '.join(near)}; say which as frame= or angles="
            )
        return best
    if not moving and len({f.name for f in upright}) == 1:
        return upright[0]
    raise UsageError(f"{path}: {_reason_refused(seen)}")


def _difference(frame: Frame) -> float:
    return 9.0 if frame.rate_difference is None else frame.rate_difference


def _percent(share: float | None) -> str:
    return "?" if share is None else f"{100.0 * share:.0f}"


def _same_attitude(a: Array, b: Array) -> bool:
    some = slice(None, None, max(1, len(a) // 1000))
    apart = rotation.total_angle(rotation.earth_error(a[some], b[some]))
    return bool(np.nanmax(apart) < np.radians(0.1))


def _reason_refused(seen: list[Frame]) -> str:
    """Return the disagreement of the best three conventions as a sentence."""
    if all(f.rate_difference is None for f in seen):
        return "the vehicle turns too little to tell its axes by the gyro; say them as frame=ned-frd or frame=enu-flu"
    nearest = sorted(seen, key=lambda f: _difference(f) + ((f.force_tilt_deg or 0.0) > MAX_FORCE_TILT_DEG))[:3]
    parts = [
        f"{f.name}: turns otherwise than the gyro by {_percent(f.rate_difference)} %, "
        f"gravity off by {f.force_tilt_deg or 0.0:.0f} deg"
        for f in nearest
    ]
    return (
        f"is no attitude of this log in any axes that were tried ({'; '.join(parts)}). Is it of this log, its clock "
        "right (offset=SECONDS), and its rotation from body to earth?"
    )


def _rate_difference(t: Array, q: Array, imu: Imu) -> float | None:
    """Return the rms difference of the attitude's and gyro's rates over the rms rate; None without turns."""
    if len(t) < 2:
        return None
    step = max(1, round(INTERVAL_S / max(float(median(np.diff(t))), 1e-4)))
    stride = max(step, len(t) // MAX_RATE_INTERVALS)
    rates = body_rates(t, q, np.zeros(len(t), np.int64), step, stride, MAX_INTERVAL_S)
    gyro = gyro_increments(imu).mean_rates(rates.start, rates.end)
    known = rotation.finite_rows(gyro) & (rotation.length(rates.rate) < GYRO_LIMIT_RAD_S)
    own, gyro = rates.rate[known], gyro[known]
    if len(own) < MIN_MOVING:
        return None
    gyro = gyro - median(gyro - own, axis=0)
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
