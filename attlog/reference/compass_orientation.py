"""Mounting of a compass against its setting, without a heading.

In an earth frame that keeps the tilt and turns with the gyro, the field of a compass that is mounted as set is constant
but for an offset and the motors' field: ``P m = (Rz(w t) R)' h + o + c p`` with m the logged field, P the change of the
mounting, R the attitude, w the drift of its heading, h the earth's field, o the offset and c the field per unit of
power p. In windows of a minute h, o, c and w are free; least squares over all mountings that a parameter can set. Only
the dip separates a turn by 180 deg with the field upside down.

A wrong compass tilts the onboard attitude by up to 12 deg, so a second attitude by gyro and force alone must agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.earth import MagneticField
from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median, unique
from attlog.flight import recalibration
from attlog.flight.calibration import mounting_matrices, mounting_matrix
from attlog.flight.model import Array, FlightLog, Mag
from attlog.reference import alignment
from attlog.reference.compass_windows import MIN_SAMPLES, SAMPLE_HZ, TILTS, Window
from attlog.segments import Segments

# Searched drift of the heading, its step, and the most that it turns within a window from one step to the next.
MAX_DRIFT_DPS, DRIFT_STEP_DPS, DRIFT_STEP_DEG = 1.5, 0.25, 15.0
# Huber threshold in standard deviations of an axis.
HUBER_SIGMAS = 3.0
# Effective independent samples: errors are correlated over a second.
CORRELATED_SAMPLES = SAMPLE_HZ * 1.0
# Numbers of mountings that are tried: right angles and 45 deg. With right angles alone 16 of 296 mountings at 45 deg
# get a wrong name.
MOUNTINGS = 38

# Least data: seconds and range of the heading.
MIN_SECONDS, MIN_HEADING_DEG = 15.0, 5.0
# Largest residual of the best mounting, and largest error of the field's components, as shares of the earth's field.
MAX_LEFT_SHARE, MAX_FIELD_SIGMA_SHARE = 0.08, 0.08
# Largest mean drift of the heading.
MAX_MEAN_DRIFT_DPS = 1.0
# The field of a mounting is the earth's: dip, and size either way.
MAX_DIP_ERROR_DEG, MAX_SIZE_FACTOR = 15.0, 1.5
# Ratio of RMS residuals of the present mounting to the best, and of the next best to the best.
MIN_FAULT_RATIO, MIN_NEXT_RATIO = 1.3, 1.15
# Largest angle, less its interval, between the named mounting and the one that fits best with any angle: mountings are
# 45 deg apart, and a compass 28 deg askew is not one at 45 deg.
MAX_ASKEW_DEG = 10.0
# Mirrored axes are no mounting: they must fit better than any mounting by this ratio.
MIN_MIRROR_RATIO = 1.5

Verdict = Literal["ok", "fault", "unknown"]
Reason = Literal["", "data", "iron", "tilt", "drift", "world", "next", "askew", "attitudes"]


class Sums(NamedTuple):
    """Sums of a window about its nuisance: ``s`` (..., 3, 3) of R R', ``c`` (..., 3, 3, 3) of R m, ``v`` of m m."""

    s: Array
    c: Array
    v: float

    def fits(self, orders: Array) -> tuple[Array, Array]:
        """Return the earth's field (..., p, 3) and sum of squared residuals (..., p) of mountings (p, 3, 3)."""
        b = np.einsum("pab,...iab->...pi", orders, self.c)
        h = np.linalg.solve(self.s[..., None, :, :], b[..., None])[..., 0]
        return h, np.maximum(self.v - np.sum(b * h, axis=-1), 0.0)


class Fits(NamedTuple):
    """Fits of all mountings over all windows, each (p,): field components and their error (uT), residual, drift."""

    level: Array
    down: Array
    level_sigma: Array
    down_sigma: Array
    left: Array
    drift_dps: Array
    drifts: list[Array]
    weights: list[Array]

    @property
    def dip_deg(self) -> Array:
        """Dip of the field (p,)."""
        return np.degrees(np.arctan2(self.down, self.level))


@dataclass(frozen=True, slots=True)
class Orientation:
    """Whether a compass is mounted as set: ``turn`` (3, 3) rotates its logged field into the true body axes.

    ``ratio``: RMS residual as set over that of the best mounting; ``next_ratio``: that of the next best. ``dip_deg``:
    dip as set and turned; ``left_ut``: residuals likewise. ``angle_deg`` with ``sigma_deg``: the turn's angle.
    ``error`` (n, 3) uT at ``error_t`` (n,) s: field less the earth's, in true body axes. ``mirrored``: the axes are
    those of a mirror, which no mounting is. ``why``: reason for ``unknown``. ``best`` (3, 3): the turn that fits best,
    significant or not; None where none gives the earth's field.
    """

    verdict: Verdict
    reason: Reason = ""
    why: str = ""
    turn: Array = field(default_factory=lambda: np.eye(3))
    mirrored: bool = False
    ratio: float = math.nan
    next_ratio: float = math.nan
    dip_deg: tuple[float, float] = (math.nan, math.nan)
    left_ut: tuple[float, float] = (math.nan, math.nan)
    angle_deg: float = math.nan
    sigma_deg: float = math.nan
    error: Array = field(default_factory=lambda: np.zeros((0, 3)))
    error_t: Array = field(default_factory=lambda: np.zeros(0))
    seconds: float = 0.0
    samples: int = 0
    best: Array | None = None


def mounting_orders(now: float | None) -> Array:
    """Return the changes (p, 3, 3) to every other mounting from number ``now``; the first is none.

    ``now`` None: mounting unknown or not set by a number of its own, changes are those from number 0.
    """
    own = mounting_matrix(now)
    back = np.eye(3) if own is None else own.T
    found = np.eye(3)[None]
    for turn in mounting_matrices()[:MOUNTINGS] @ back:
        if np.abs(turn - found).max(axis=(1, 2)).min() > 1e-6:
            found = np.concatenate([found, turn[None]])
    return found


def mounting_number(turn: Array, now: float | None) -> int | None:
    """Return the number of the mounting that ``turn`` (3, 3) makes of number ``now``; None where there is none."""
    own = mounting_matrix(now)
    if own is None:
        return None
    same = np.abs(mounting_matrices()[:MOUNTINGS] - turn @ own).max(axis=(1, 2)) < 1e-6
    return int(np.argmax(same)) if same.any() else None


def mirrored_axes(turn: Array) -> str:
    """Return mirrored axes (3, 3) as ``x = -y, y = x``, as far as they are along the body's own."""
    said = []
    for k, row in enumerate(turn):
        source = int(np.argmax(np.abs(row)))
        if source != k or row[source] < 0:
            said.append(f"{'xyz'[k]} = {'-' if row[source] < 0 else ''}{'xyz'[source]}")
    return ", ".join(said)


@cached_per_log
def compass_orientation(log: FlightLog, segments: Segments, mag: Mag) -> Orientation:
    """Return whether a compass is mounted as its parameter says, and else how."""
    earth, imu = alignment.earth_field(log), log.replay_imu
    if imu is None or earth is None:
        why = "No position, so no earth field." if earth is None else "No gyro shows how the compass turned."
        return Orientation("unknown", "data", why)
    orders = mounting_orders(recalibration.flown_mounting(log, mag).number)
    made = [judge(windows, orders, earth) for make in TILTS if (windows := make(log, segments, imu, mag))]
    if not made:
        return Orientation("unknown", "data", TOO_LITTLE)
    return joined(made)


def joined(made: Sequence[Orientation]) -> Orientation:
    """Return what the tilts show together: a fault counts where every other tilt fits its mounting best."""
    named = next((one for one in made if one.verdict == "fault"), None)
    if named is None:
        return made[0] if made[0].verdict == "ok" else next((one for one in made if one.verdict == "ok"), made[0])
    if any(other.best is None or np.abs(other.best - named.turn).max() > 1e-6 for other in made):
        why = "Tilt by the onboard attitude and by gravity show different mountings."
        if any(one.best is None for one in made):
            why = "Only one of two tilts, by the onboard attitude and by gravity, shows a mounting."
        return Orientation("unknown", "attitudes", why)
    return named


# Fits.


def _drifts(window: Window) -> Array:
    """Return the tried drifts (w,) of a window in rad/s."""
    step = min(DRIFT_STEP_DPS, DRIFT_STEP_DEG / max(float(np.ptp(window.t)), 1e-9))
    count = math.ceil(MAX_DRIFT_DPS / step)
    return np.asarray(np.radians(step * np.arange(-count, count + 1)))


def _projected(window: Window, drifts: Array, weight: Array) -> tuple[Array, Array]:
    """Return earth matrices (w, n, 3, 3) and field (n, 3), weighted and without nuisance, for drifts (w,)."""
    angle = drifts[:, None] * window.t
    cosine, sine = np.cos(angle)[..., None], np.sin(angle)[..., None]
    north, east, down = window.earth[None, :, 0], window.earth[None, :, 1], window.earth[None, :, 2]
    rows = [cosine * north - sine * east, sine * north + cosine * east, np.broadcast_to(down, (*angle.shape, 3))]
    root = np.sqrt(weight)[:, None]
    matrices = (root * np.stack(rows, axis=2).reshape(*angle.shape, 9)).reshape(len(drifts), len(window.t), 9)
    basis, _ = np.linalg.qr(root * window.nuisance)
    measured = root * window.field
    matrices = matrices - basis @ (basis.T @ matrices)
    return matrices.reshape(*angle.shape, 3, 3), measured - basis @ (basis.T @ measured)


def _sums(matrices: Array, measured: Array) -> Sums:
    """Return sums over samples (..., n, 3, 3) and (n, 3)."""
    s = np.einsum("...nia,...nja->...ij", matrices, matrices, optimize=True) + 1e-9 * np.eye(3)
    flat = matrices.reshape(*matrices.shape[:-2], 9)
    c = np.swapaxes(flat, -1, -2) @ measured
    return Sums(s, c.reshape(*c.shape[:-2], 3, 3, 3), float(np.sum(measured**2)))


def fit_orders(windows: Sequence[Window], orders: Array) -> Fits:
    """Fit all mountings (p, 3, 3) to all windows."""
    every = np.arange(len(orders))
    left, count, drift = np.zeros(len(orders)), 0.0, np.zeros(len(orders))
    parts, info, drifts_by, weights = [], [], [], []
    for window in windows:
        drifts, weight = _drifts(window), np.ones(len(window.t))
        matrices, measured = _projected(window, drifts, weight)
        sums = _sums(matrices, measured)
        h, rss = sums.fits(orders)
        w, p = np.unravel_index(int(np.argmin(rss)), rss.shape)
        off = rotation.length(measured @ orders[p].T - np.einsum("nia,i->na", matrices[w], h[w, p]))
        scale = float(median(off)) / 1.538  # median length of three unit normals
        weight = np.minimum(1.0, HUBER_SIGMAS * scale / np.maximum(off, 1e-12))
        sums = _sums(*_projected(window, drifts, weight))
        h, rss = sums.fits(orders)
        k = np.argmin(rss, axis=0)
        at, least = _vertices(drifts, rss, k)
        inverse = np.linalg.inv(sums.s[k])
        info.append(np.column_stack([1.0 / np.trace(inverse[:, :2, :2], axis1=1, axis2=2), 1.0 / inverse[:, 2, 2]]))
        best = h[k, every]
        parts.append(np.column_stack([np.hypot(best[:, 0], best[:, 1]), best[:, 2]]))
        left, count, drift = left + least, count + float(weight.sum()), drift + len(window.t) * at
        drifts_by.append(at)
        weights.append(weight)
    by, value = np.array(info), np.array(parts)
    total = by.sum(axis=0)
    mean = (by * value).sum(axis=0) / total
    rms = np.sqrt(left / max(count, 1.0))
    sigma = (rms / math.sqrt(3.0))[:, None] / np.sqrt(total / CORRELATED_SAMPLES)
    samples = sum(len(window.t) for window in windows)
    level_sigma, mean_drift = math.sqrt(2.0) * sigma[:, 0], np.degrees(drift) / samples
    return Fits(mean[:, 0], mean[:, 1], level_sigma, sigma[:, 1], rms, mean_drift, drifts_by, weights)


def _vertices(drifts: Array, rss: Array, k: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return drift (p,) and least residual (p,) by parabolas through the grid's minima ``k`` (p,)."""
    every, inner = np.arange(rss.shape[1]), np.clip(k, 1, len(drifts) - 2)
    a, b, c = (rss[inner + j, every] for j in (-1, 0, 1))
    bend = a - 2.0 * b + c
    shift = np.where((bend > 0) & (inner == k), 0.5 * (a - c) / np.maximum(bend, 1e-30), k - inner)
    least = np.where(inner == k, b - 0.25 * (a - c) * shift, rss[k, every])
    return drifts[inner] + shift * (drifts[1] - drifts[0]), np.maximum(least, 0.0)


# Judgement.

NEEDED = "Move for 30 s with turns by 90 deg and tilts of 5 deg."
TOO_LITTLE = f"Too little motion shows the mounting. {NEEDED}"


def judge(windows: Sequence[Window], orders: Array, earth: MagneticField) -> Orientation:
    """Compare the mountings (p, 3, 3), of which the first is the present one, over the windows."""
    samples = sum(len(window.t) for window in windows)
    seconds = sum(float(np.ptp(window.t)) for window in windows)
    if samples < MIN_SAMPLES or seconds < MIN_SECONDS or heading_range_deg(windows) < MIN_HEADING_DEG:
        return Orientation("unknown", "data", TOO_LITTLE)
    fits = fit_orders(windows, orders)
    found, best = _compare(fits, earth)
    mirror, other = _compare(fits._replace(down=-fits.down), earth)  # a mirror changes the field's sign alone
    rival = np.inf if best is None else float(fits.left[best])
    mirrored = mirror.verdict != "unknown" and rival > MIN_MIRROR_RATIO * float(fits.left[other])
    if mirrored:
        found, best = replace(mirror, verdict="fault", mirrored=True), other
    sign = -1.0 if mirrored else 1.0
    turn = None if best is None else sign * orders[best]
    found = replace(found, seconds=seconds, samples=samples, best=turn)
    if found.verdict == "unknown" or best is None or turn is None:
        return found
    shown = replace(
        found,
        turn=turn,
        dip_deg=(float(fits.dip_deg[0]), sign * float(fits.dip_deg[best])),
        left_ut=(float(fits.left[0]), float(fits.left[best])),
    )
    return shown if mirrored else _measured(shown, windows, fits, orders[best], best)


def heading_range_deg(windows: Sequence[Window]) -> float:
    """Return the largest range of the heading within a window."""
    headings = [np.unwrap(np.arctan2(window.earth[:, 1, 0], window.earth[:, 0, 0])) for window in windows]
    return max((math.degrees(float(np.ptp(heading))) for heading in headings), default=0.0)


def _compare(fits: Fits, earth: MagneticField) -> tuple[Orientation, int | None]:
    """Return the verdict on the fits, and the best mounting's index: None where none gives the earth's field."""
    strength = 1e6 * earth.strength_t
    size = np.maximum(np.hypot(fits.level, fits.down), 1e-9)
    on_earth = np.abs(fits.dip_deg - earth.inclination_deg) <= MAX_DIP_ERROR_DEG
    on_earth &= np.abs(np.log(size / strength)) <= math.log(MAX_SIZE_FACTOR)
    first, second = np.argsort(np.where(on_earth, fits.left, np.inf), kind="stable")[:2].tolist()
    if not on_earth[first]:
        return Orientation("unknown", "world", "No mounting gives the field of the earth: iron is near."), None
    left = float(fits.left[first])
    ratio = float(fits.left[0]) / max(left, 1e-9)
    next_ratio = float(fits.left[second]) / max(left, 1e-9) if on_earth[second] else math.inf
    unknown = partial(Orientation, "unknown", ratio=ratio, next_ratio=next_ratio)
    if left > MAX_LEFT_SHARE * strength:
        return unknown("iron", "Iron or motors bend the field too much to show the mounting."), first
    if max(fits.level_sigma[first], fits.down_sigma[first]) > MAX_FIELD_SIGMA_SHARE * strength:
        return unknown("tilt", f"The flight tilts too little to show the mounting. {NEEDED}"), first
    if abs(fits.drift_dps[first]) > MAX_MEAN_DRIFT_DPS:
        return unknown("drift", "Gyro and field turn differently, so the mounting is unknown."), first
    if next_ratio < MIN_NEXT_RATIO or (first != 0 and ratio < MIN_FAULT_RATIO):
        return unknown("next", f"Several mountings fit the field equally well. {NEEDED}"), first
    return Orientation("ok" if first == 0 else "fault", ratio=ratio, next_ratio=next_ratio), first


# Interval of the turn, and the errors that are left.

# Blocks of the jackknife, its factor for errors in common, and the error of the tilt.
BLOCK_S, STANDARD_ERRORS, FLOOR_DEG = 10.0, 1.5, 0.5
NEWTON_PASSES = 4
# Generators of rotations about x, y and z.
ABOUT = np.array([np.cross(np.eye(3), axis) for axis in np.eye(3)])


def _measured(found: Orientation, windows: Sequence[Window], fits: Fits, order: Array, best: int) -> Orientation:
    """Return the judgement with the turn's angle, its error, and the errors of the field."""
    blocks: list[list[Sums]] = []
    for window, drift, weight in zip(windows, fits.drifts, fits.weights, strict=True):
        matrices, measured = _projected(window, drift[best : best + 1], weight)
        number = ((window.t - window.t[0]) / BLOCK_S).astype(np.int64)
        parts = [number == k for k in unique(number)]
        blocks.append([_sums(matrices[0][part], measured[part]) for part in parts])
    whole = [_added(each) for each in blocks]
    turn = order
    hessian = np.eye(3)
    for _ in range(NEWTON_PASSES):
        each_way = [_slope(sums, turn) for sums in whole]
        hessian = np.sum([bend for _, bend in each_way], axis=0)
        step = np.linalg.lstsq(hessian, -np.sum([slope for slope, _ in each_way], axis=0), rcond=None)[0]
        size = float(np.sqrt(np.sum(step**2)))
        turn = rotation.to_matrix(rotation.from_rotvec(step * min(1.0, 0.3 / max(size, 1e-9)))) @ turn
    slopes = [_slope(sums, turn)[0] for sums in whole]
    total = np.sum(slopes, axis=0)
    moved = [
        np.linalg.lstsq(hessian, -(total - slope + _slope(_without(sums, block), turn)[0]), rcond=None)[0]
        for sums, each, slope in zip(whole, blocks, slopes, strict=True)
        for block in each
        if len(each) > 1
    ]
    count = len(moved)
    sd = (
        np.sqrt((count - 1) / count * np.sum((moved - np.mean(moved, axis=0)) ** 2, axis=0))
        if count > 1
        else np.full(3, np.pi)
    )
    angle, sigma = _angle(turn, sd)
    askew, askew_sigma = _angle(turn @ order.T, sd)
    if found.verdict == "fault" and askew - 1.96 * askew_sigma > MAX_ASKEW_DEG:
        why = f"The compass is rotated by {angle:.0f} deg, which no orientation parameter describes."
        return replace(found, verdict="unknown", reason="askew", why=why, turn=np.eye(3), best=None)
    errors = [
        window.field @ order.T - _expected(window, float(drift[best]), sums, order)
        for window, drift, sums in zip(windows, fits.drifts, whole, strict=True)
    ]
    return replace(
        found,
        angle_deg=angle,
        sigma_deg=sigma,
        error=np.concatenate(errors),
        error_t=np.concatenate([window.t + window.middle for window in windows]),
    )


def _angle(turn: Array, sd: Array) -> tuple[float, float]:
    """Return the angle of a rotation (3, 3) and its error in deg, ``sd`` (3,) rad about the axes."""
    vector = rotation.to_rotvec(rotation.from_matrix(turn))
    angle = float(np.sqrt(np.sum(vector**2)))
    along = float(np.sqrt(np.sum((vector * sd) ** 2))) / angle if angle > 1e-3 else float(np.max(sd))
    return math.degrees(angle), math.hypot(STANDARD_ERRORS * math.degrees(along), FLOOR_DEG)


def _added(parts: Sequence[Sums]) -> Sums:
    return Sums(sum(p.s for p in parts), sum(p.c for p in parts), sum(p.v for p in parts))  # type: ignore[arg-type]


def _without(sums: Sums, part: Sums) -> Sums:
    return Sums(sums.s - part.s + 1e-9 * np.eye(3), sums.c - part.c, sums.v - part.v)


def _slope(sums: Sums, turn: Array) -> tuple[Array, Array]:
    """Return gradient (3,) and Hessian (3, 3) of the squared residual by a small rotation after ``turn`` (3, 3)."""
    b = np.einsum("ab,iab->i", turn, sums.c)
    once = np.einsum("kab,iab->ki", ABOUT @ turn, sums.c)
    twice = 0.5 * (np.einsum("kab,lbc->klac", ABOUT, ABOUT) + np.einsum("lab,kbc->klac", ABOUT, ABOUT)) @ turn
    inverse = np.linalg.inv(sums.s)
    h = inverse @ b
    bend = once @ inverse @ once.T + np.einsum("klab,iab,i->kl", twice, sums.c, h)
    return -2.0 * once @ h, -2.0 * bend


def _expected(window: Window, drift: float, sums: Sums, order: Array) -> Array:
    """Return the earth's field (n, 3) uT in the window's body axes."""
    h, _ = sums.fits(order[None])
    angle = drift * window.t
    north = np.cos(angle) * h[0, 0] + np.sin(angle) * h[0, 1]
    east = np.cos(angle) * h[0, 1] - np.sin(angle) * h[0, 0]
    turned = np.column_stack([north, east, np.full(len(angle), h[0, 2])])
    return np.asarray(np.einsum("nia,ni->na", window.earth, turned))
