"""Judge an attitude by GNSS and gravity, without a filter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core import rotation
from attlog.core.sorting import unique

# Gravity where the body is still, motors off or idling: no filter decides where it is, none can argue with it.
#
# A motor's vibration turns the direction of single samples by degrees, never one way: a window is judged by the means
# of its eighths. A blow or a turn shows in their spread.
#
#     still   the angle by the gyro, its mean rate taken out, stays within 0.3 deg
#             standard deviation of the eight mean forces < 0.05 m/s^2, their directions within 0.5 deg
#             mean force within 0.6 m/s^2 of 9.8
#
# A calm hover passes too, and errs by 0.5 deg at most. Raw scatter is not limited.

Array = NDArray[np.float64]

# A window is 8 parts of 0.25 s; one begins with every second part.
WINDOW_PARTS, PART_S, STRIDE_PARTS = 8, 0.25, 2
EXCURSION_DEG, SPREAD_M_S2, DIRECTION_DEG = 0.3, 0.05, 0.5
G_M_S2, MAX_G_DIFFERENCE_M_S2 = 9.8, 0.6
STILL_WINDOW_S = WINDOW_PARTS * PART_S


def still_windows(t: Array, gyr: Array, acc: Array, near_m_s2: float = MAX_G_DIFFERENCE_M_S2) -> Array:
    """Return begin and end (k, 2) s of the windows in which the body was still; they overlap.

    ``t`` (n,) s ascending, gyro rad/s and specific force m/s^2 (n, 3) in body axes; the mean force lies within
    ``near_m_s2`` of gravity. Samples that are no numbers are
    left out; a part without a sample breaks every window that holds it.
    """
    good = np.isfinite(t) & rotation.finite_rows(gyr) & rotation.finite_rows(acc)
    if not good.all():
        t, gyr, acc = t[good], gyr[good], acc[good]
    if len(t) < WINDOW_PARTS:
        return np.zeros((0, 2))
    number = np.floor((t - t[0]) / PART_S).astype(np.int64)
    first = np.flatnonzero(np.concatenate([[True], np.diff(number) != 0]))
    count = np.diff(np.append(first, len(t)))[:, None]
    part, rate, force = number[first], _sums(gyr, first) / count, _sums(acc, first) / count
    begin = np.arange(len(part) - WINDOW_PARTS + 1)
    begin = begin[
        (part[begin] % STRIDE_PARTS == 0) & (part[begin + WINDOW_PARTS - 1] - part[begin] == WINDOW_PARTS - 1)
    ]
    if not len(begin):
        return np.zeros((0, 2))
    eighths = begin[:, None] + np.arange(WINDOW_PARTS)
    still = _steady_force(force[eighths], near_m_s2) & (_excursion_deg(rate[eighths]) < EXCURSION_DEG)
    start = t[0] + PART_S * part[begin[still]]
    return np.column_stack([start, start + STILL_WINDOW_S])


def tilt_residual(windows: Array, t: Array, acc: Array, q: Array) -> Array:
    """Return the angle (k,) in deg between mean force and the attitude's mean up over each window (k, 2); NaN without.

    ``acc`` (n, 3) m/s^2 at ``t`` (n,) s ascending; ``q`` (n, 4) is the body's attitude to earth (north, east, down) at
    these times, NaN where unknown.
    """
    force, up = mean_directions(windows, t, acc, q)
    cross = rotation.length(np.cross(force, up))
    angle: Array = np.degrees(np.arctan2(cross, np.sum(force * up, axis=1)))
    return angle


def mean_directions(windows: Array, t: Array, acc: Array, q: Array) -> tuple[Array, Array]:
    """Return mean force (k, 3) in m/s^2 and mean up (k, 3), a unit vector, in body axes over windows; NaN without."""
    if not len(windows):
        return np.zeros((0, 3)), np.zeros((0, 3))
    inside = within(windows, t) & rotation.finite_rows(acc) & rotation.finite_rows(q)
    t, acc = t[inside], acc[inside]
    up = rotation.rotate_inverse(q[inside], np.array([0.0, 0.0, -1.0]))
    low, high = np.searchsorted(t, windows[:, 0]), np.searchsorted(t, windows[:, 1])
    total = np.concatenate([np.zeros((1, 6)), np.cumsum(np.column_stack([acc, up]), axis=0)])
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (total[high] - total[low]) / (high - low)[:, None]
        return mean[:, :3], mean[:, 3:] / rotation.length(mean[:, 3:])[:, None]


def within(windows: Array, t: Array) -> NDArray[np.bool_]:
    """Select the ascending times (n,) in any of the windows (k, 2), which may overlap."""
    edges = np.zeros(len(t) + 1, np.int64)
    np.add.at(edges, np.searchsorted(t, windows[:, 0]), 1)
    np.add.at(edges, np.searchsorted(t, windows[:, 1]), -1)
    inside: NDArray[np.bool_] = np.cumsum(edges[:-1]) > 0
    return inside


def _sums(x: Array, first: NDArray[np.int64]) -> Array:
    """Return sums (m, 3) of samples (n, 3) over the parts that begin at ``first`` (m,)."""
    return np.asarray(np.add.reduceat(x, first, axis=0))


def _steady_force(force: Array, near_m_s2: float) -> NDArray[np.bool_]:
    """Select windows whose mean forces (k, 8, 3) are steady, point one way and are as large as gravity."""
    mean = force.mean(axis=1)
    size = rotation.length(mean)
    spread = np.sqrt(np.sum(force.var(axis=1), axis=1))
    steady: NDArray[np.bool_] = (spread < SPREAD_M_S2) & (np.abs(size - G_M_S2) < near_m_s2)
    whole = np.repeat(mean[steady, None], WINDOW_PARTS, axis=1)
    across = rotation.length(np.cross(force[steady], whole))
    angle = np.degrees(np.arctan2(across, np.sum(force[steady] * whole, axis=2)))
    steady[steady] = angle.max(axis=1, initial=0.0) < DIRECTION_DEG
    return steady


def _excursion_deg(rate: Array) -> Array:
    """Return the excursion (k,) deg of the angle by mean rates (k, 8, 3) from that of their mean, the gyro's bias."""
    turned = np.cumsum((rate - rate.mean(axis=1, keepdims=True)) * PART_S, axis=1)
    excursion: Array = np.degrees(rotation.length(turned).max(axis=1))
    return excursion


# How far is a heading off by GNSS acceleration? Any attitude, any vehicle, no compass.
#
# Over windows of 1 s the change of GNSS velocity ``a`` (earth axes) equals the integral ``b`` of the specific force,
# turned to earth by the attitude. Both as complex numbers north + i east, ``b = a exp(i theta)``, where ``theta`` is
# the heading error of the attitude. Longer windows add nothing, because GNSS errors correlate over seconds. Tilt
# errors and accelerometer biases add a constant, which goes with the mean of every 30 s.

Complex = NDArray[np.complex128]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

# The change of velocity between two fixes so far apart, and what still counts as that.
WINDOW_S, FROM_S, TO_S = 1.0, 0.7, 1.3
# Parts of 30 s are two halves side by side.
HALF_S, BLOCK_S = 15.0, 5.0
GAP_S = 0.15
DELAYS_S, STEP_S = (-0.25, 0.6), 0.025
# A delay is known where the residual so far beside it is so many times larger, else known to so many seconds.
BESIDE_S, PEAK_RATIO = 0.15, 1.5
DELAYS_TRIED_S: Array = STEP_S * np.arange(
    round((DELAYS_S[0] - BESIDE_S) / STEP_S), round((DELAYS_S[1] + BESIDE_S) / STEP_S) + 1, dtype=np.float64
)
SIGMA_DELAY_S, FLOOR_DEG = 0.02, 0.3
ROUNDS, OUTLIER, MIN_M_S = 3, 4.0, 0.05
# Median of the length of a plane vector of normal errors of sigma 1.
MEDIAN_OF_LENGTH = 1.18
MIN_CORRELATION, SCALES, MAX_SIGMA_DEG = 0.7, (0.7, 1.3), 10.0
MIN_BLOCKS, MIN_BLOCKS_OF_SEGMENT = 1.8, 2.5
WRONG_DEG, WRONG_SIGMAS = 8.0, 3.0
SOUND_DEG, SOUND_SIGMAS, SOUND_SIGMA_DEG = 3.0, 2.0, 2.0
# Windows, times delays, that are compared at once.
WINDOWS_AT_ONCE = 1 << 14
# Fewer in 30 s fit any rotation.
MIN_WINDOWS = 4


class HeadingOffset(NamedTuple):
    """How far a heading is off by GNSS acceleration between ``t0`` and ``t1`` s.

    ``offset_deg`` is the heading of the attitude minus the true one, clockwise positive, with one ``sigma_deg``;
    ``scale`` is GNSS acceleration over that of the force and ``correlation`` theirs, 0 to 1; ``delay_s`` how much later
    than the IMU the receiver is; ``blocks`` the number of blocks of 5 s that bear the weight. It counts where
    ``known``; else ``why`` says what is missing.
    """

    offset_deg: float
    sigma_deg: float
    scale: float
    correlation: float
    delay_s: float
    blocks: float
    t0: float
    t1: float
    known: bool
    why: str

    @property
    def wrong(self) -> bool:
        """Return whether the heading is in error beyond doubt."""
        return self.known and abs(self.offset_deg) > max(WRONG_DEG, WRONG_SIGMAS * self.sigma_deg)

    @property
    def sound(self) -> bool:
        """Return whether the heading is right beyond doubt."""
        sure = self.known and self.sigma_deg <= SOUND_SIGMA_DEG
        return sure and abs(self.offset_deg) < max(SOUND_DEG, SOUND_SIGMAS * self.sigma_deg)


@dataclass(frozen=True, slots=True, eq=False)
class VelocitySteps:
    """Changes of velocity over about 1 s, as north + i east in m/s, by GNSS and by force.

    ``gnss`` (k,) from ``t0`` (k,) to ``t1`` (k,) s. These are ``fixes`` (m,) s with the numbers ``first`` and
    ``second`` (k,); ``integral`` (n,) of the force at ``t`` (n,) s.
    """

    gnss: Complex
    fixes: Array
    first: Index
    second: Index
    t: Array
    integral: Complex

    @property
    def t0(self) -> Array:
        """Begin of each window, s."""
        return self.fixes[self.first]

    @property
    def t1(self) -> Array:
        """End of each window, s."""
        return self.fixes[self.second]

    def force(self, delay_s: ArrayLike) -> Complex:
        """Return the changes (..., k) by force of a receiver ``delay_s`` (...) later than the IMU, -0.4 to 0.75 s."""
        at = np.interp(self.fixes - np.asarray(delay_s)[..., None], self.t, self.integral)
        return np.asarray(at[..., self.second] - at[..., self.first])


class _Delay(NamedTuple):
    """Delay of GNSS behind the IMU that fits best, its sigma, and why it is not known (else empty)."""

    best_s: float
    sigma_s: float
    why: str = ""


def heading_offset(
    t: Array, acc: Array, q: Array, fixes_t: Array, velocity: Array, spans: Array | None = None
) -> HeadingOffset:
    """Return the heading error of attitudes ``q`` (n, 4), body FRD to NED, over all of the time.

    ``acc`` (n, 3) m/s^2 is the specific force at the same ``t`` (n,) s, ascending; ``velocity`` (m, 3) m/s NED of 3D
    fixes at ``fixes_t`` (m,) s. ``spans`` (k, 2) s: only windows inside one of them count; end them before blows.
    Samples that are no numbers are gaps.
    """
    return both(t, acc, q, fixes_t, velocity, spans)[0]


def pieces(
    t: Array, acc: Array, q: Array, fixes_t: Array, velocity: Array, spans: Array | None = None
) -> list[HeadingOffset]:
    """Return :func:`heading_offset` of each 30 s, every 15 s, with the delay of the whole flight."""
    return both(t, acc, q, fixes_t, velocity, spans)[1]


def both(
    t: Array, acc: Array, q: Array, fixes_t: Array, velocity: Array, spans: Array | None = None
) -> tuple[HeadingOffset, list[HeadingOffset]]:
    """Return :func:`heading_offset` and :func:`pieces` for the work of one."""
    steps = velocity_steps(t, acc, q, fixes_t, velocity, spans)
    if len(steps.first) < MIN_WINDOWS:
        return _none("no GNSS velocity beside samples of the IMU"), []
    number = np.floor_divide(steps.t0 - steps.t0[0], HALF_S)
    edges = np.searchsorted(number, np.arange(number[-1] + 3.0))
    parts, beside = np.column_stack([edges[:-2], edges[2:]]), np.arange(len(edges) - 2) % 2 == 0
    filled = parts[:, 1] - parts[:, 0] >= MIN_WINDOWS
    parts, beside = parts[filled], beside[filled]
    return _fitted(steps, parts, beside, _delay_of(steps, parts[beside]))


def velocity_steps(
    t: Array, acc: Array, q: Array, fixes_t: Array, velocity: Array, spans: Array | None = None
) -> VelocitySteps:
    """Return the change of velocity of each second by GNSS and by force."""
    good = np.isfinite(fixes_t) & np.isfinite(velocity[:, 0]) & np.isfinite(velocity[:, 1])
    fixes, speed = fixes_t[good], velocity[good, 0] + 1j * velocity[good, 1]
    rate = _horizontal(acc, q)
    known = np.isfinite(rate.real) & np.isfinite(rate.imag) & np.isfinite(t)
    t, rate = t[known], rate[known]
    i, j = _pairs(fixes)
    if len(t) < 2 or len(i) == 0:
        none = np.zeros(0, np.int64)
        return VelocitySteps(np.zeros(0, complex), np.zeros(0), none, none, np.zeros(1), np.zeros(1, complex))
    # Every delay must see the same windows, so the force is needed a little before and after each.
    whole = _without_gap(t, fixes[i] - DELAYS_TRIED_S[-1], fixes[j] - DELAYS_TRIED_S[0])
    if spans is not None:
        whole &= _inside(spans, fixes[i], fixes[j])
    i, j = i[whole], j[whole]
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
    used = unique(np.concatenate([i, j]))
    first, second = np.searchsorted(used, i), np.searchsorted(used, j)
    return VelocitySteps(speed[j] - speed[i], fixes[used], first, second, t, integral)


def _horizontal(acc: Array, q: Array) -> Complex:
    """Return the horizontal specific force (n,) m/s^2, north + i east."""
    (w, x, y, z), (u, v, s) = q.T, acc.T
    north = (1.0 - 2.0 * (y * y + z * z)) * u + 2.0 * ((x * y - w * z) * v + (x * z + w * y) * s)
    east = (1.0 - 2.0 * (x * x + z * z)) * v + 2.0 * ((x * y + w * z) * u + (y * z - w * x) * s)
    return np.asarray(north + 1j * east)


def _pairs(t: Array) -> tuple[Index, Index]:
    """Pair each fix with that nearest to 1 s later, so that no velocity is interpolated."""
    if len(t) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    after = np.clip(np.searchsorted(t, t + WINDOW_S), 1, len(t) - 1)
    j = np.where(t[after] - t - WINDOW_S > t + WINDOW_S - t[after - 1], after - 1, after)
    length = t[j] - t
    i = np.flatnonzero((length >= FROM_S) & (length <= TO_S))
    return i, j[i]


def _without_gap(t: Array, t0: Array, t1: Array) -> NDArray[np.bool_]:
    """Select the spans from ``t0`` to ``t1`` (k,) between samples ``t`` (n,) without a gap."""
    ends = np.flatnonzero(~(np.diff(t) <= GAP_S))
    begun, ended = np.append(t[0], t[ends + 1]), np.append(t[ends], t[-1])
    k = np.searchsorted(begun, t0, side="right") - 1
    return np.asarray((k >= 0) & (t1 <= ended[k]))


def _inside(spans: Array, t0: Array, t1: Array) -> NDArray[np.bool_]:
    """Select the windows (k,) inside one of the spans."""
    found = np.zeros(len(t0), bool)
    for begin, end in np.asarray(spans, np.float64).reshape(-1, 2):
        found |= (t0 >= begin) & (t1 <= end)
    return found


def _delay_of(steps: VelocitySteps, segments: Index) -> _Delay:
    """Return the delay at which force and GNSS agree best, the heading of each 30 s free.

    Delay and heading are one quantity while a vehicle circles one way: then the residual hardly changes with it.
    """
    at, inside = _padded(segments)
    a = _centred(steps.gnss[at], inside)
    explained = np.zeros(len(DELAYS_TRIED_S))
    some = max(1, WINDOWS_AT_ONCE // max(at.size, 1))
    for k in range(0, len(explained), some):
        b = _centred(steps.force(DELAYS_TRIED_S[k : k + some])[:, at], inside)
        product = np.abs(np.sum(b.conj() * a, axis=-1)) ** 2
        explained[k : k + some] = np.sum(product / np.maximum(_power(b), 1e-12), axis=-1)
    total, beyond = float(np.sum(_power(a))), round(BESIDE_S / STEP_S)
    best = beyond + int(np.argmax(explained[beyond:-beyond]))
    rest = np.maximum(total - explained, 1e-12)
    known = min(rest[best - beyond], rest[best + beyond]) >= PEAK_RATIO * rest[best]
    edge = best in (beyond, len(DELAYS_TRIED_S) - 1 - beyond)
    why = f"the delay of GNSS is not found between {DELAYS_S[0]} and {DELAYS_S[1]} s" if edge else ""
    return _Delay(float(DELAYS_TRIED_S[best]), SIGMA_DELAY_S if known else BESIDE_S, why)


def _fitted(
    steps: VelocitySteps, parts: Index, beside: Mask, delay: _Delay
) -> tuple[HeadingOffset, list[HeadingOffset]]:
    """Fit the rotation over those of the parts (p, 2) that lie ``beside`` each other (p,), and over each part.

    Each part is cleaned of outliers by its own fit.
    """
    aside = STEP_S * max(1, round(delay.sigma_s / STEP_S))
    forces = [steps.force(delay.best_s + by) for by in (-aside, aside, 0.0)]
    at, inside = _padded(parts)
    kept = _without_outliers(steps.gnss[at], forces[2][at], inside)
    own = np.array([_centred(x[at], kept) for x in (steps.gnss, *forces)])
    each = _rotations(steps, at, kept, own, delay, aside, MIN_BLOCKS_OF_SEGMENT)
    if not beside.any():
        return _none("no GNSS velocity beside samples of the IMU"), each
    joint = at[beside].reshape(1, -1), kept[beside].reshape(1, -1), own[:, beside].reshape(4, 1, -1)
    return _rotations(steps, *joint, delay, aside, MIN_BLOCKS)[0], each


def _rotations(
    steps: VelocitySteps, at: Index, kept: Mask, own: Complex, delay: _Delay, aside: float, least_blocks: float
) -> list[HeadingOffset]:
    """Return the rotation of each row of windows ``at`` (p, w), of which some are ``kept`` (p, w).

    ``own`` (4, p, w): changes by GNSS, and by force ``aside`` s before, after and at the delay, about their means.
    """
    if not len(at):
        return []
    a, before, after, b = own
    rotations = [np.angle(np.sum(x * a.conj(), axis=1)) for x in (before, after, b)]
    turned = np.angle(np.exp(1j * (rotations[1] - rotations[0]))) * delay.sigma_s / (2.0 * aside)
    spread, blocks = _spread(steps.t0[at], a, b, kept)
    sigma = np.hypot(np.degrees(np.hypot(spread, turned)), FLOOR_DEG)
    power_a, power_b, product = _power(a), _power(b), np.abs(np.sum(b.conj() * a, axis=1))
    row, first, last = np.arange(len(at)), np.argmax(kept, axis=1), kept.shape[1] - 1 - np.argmax(kept[:, ::-1], axis=1)
    values = (
        np.degrees(rotations[2]),
        np.minimum(sigma, 180.0),
        product / np.maximum(power_b, 1e-12),
        product / np.maximum(np.sqrt(power_a * power_b), 1e-12),
        np.full(len(at), delay.best_s),
        blocks,
        steps.t0[at[row, first]],
        steps.t1[at[row, last]],
    )
    found = []
    for one in zip(*(x.tolist() for x in values), strict=True):
        offset = HeadingOffset._make((*one, False, ""))
        why = delay.why or _why_not(offset, least_blocks)
        found.append(offset._replace(known=not why, why=why))
    return found


def _padded(parts: Index) -> tuple[Index, Mask]:
    """Return the numbers (p, w) of the windows of each part (p, 2), a row each, and which of them are inside."""
    width = int((parts[:, 1] - parts[:, 0]).max(initial=0))
    at = parts[:, :1] + np.arange(width)
    inside = at < parts[:, 1:]
    return np.where(inside, at, 0), inside


def _centred(x: Complex, kept: Mask) -> Complex:
    """Return values (..., p, w) about the mean of their row, 0 where not kept (p, w)."""
    mean = np.sum(np.where(kept, x, 0.0), axis=-1) / np.maximum(np.count_nonzero(kept, axis=1), 1)
    return np.where(kept, x - mean[..., None], 0.0)


def _power(x: Complex) -> Array:
    """Return the sum of squares (...) of each row (..., w)."""
    return np.asarray(np.sum(x.real**2 + x.imag**2, axis=-1))


def _without_outliers(a: Complex, b: Complex, inside: Mask) -> Mask:
    """Select in each row (w,) the windows near the fit of the others, in three rounds."""
    keep, row = inside, np.arange(len(inside))
    for _ in range(ROUNDS):
        count = np.count_nonzero(keep, axis=1)
        x, y = (v - (np.sum(np.where(keep, v, 0.0), axis=1) / count)[:, None] for v in (a, b))
        own = np.where(keep, y, 0.0)
        turn = np.sum(own.conj() * x, axis=1) / np.maximum(_power(own), 1e-12)
        residual = np.abs(x - turn[:, None] * y)
        ascending = np.sort(np.where(keep, residual, np.inf), axis=1)
        median = 0.5 * (ascending[row, (count - 1) // 2] + ascending[row, count // 2])
        keep = inside & (residual <= OUTLIER * np.maximum(median / MEDIAN_OF_LENGTH, MIN_M_S)[:, None])
    return keep


def _spread(t: Array, a: Complex, b: Complex, kept: Mask) -> tuple[Array, Array]:
    """Return one sigma (p,) in rad of the rotation from ``b`` to ``a`` (p, w), and the effective number of 5 s blocks.

    The larger of the jackknife of the blocks (Efron 1982, ch. 3) and of what the residuals say. Values that are not
    kept are 0.
    """
    begin = t[np.arange(len(t)), np.argmax(kept, axis=1)]
    number = np.where(kept, np.floor_divide(t - begin[:, None], BLOCK_S), 0.0).astype(np.int64)
    shape = len(t), int(number.max()) + 1
    number += shape[1] * np.arange(len(t))[:, None]

    def by_blocks(x: NDArray[Any]) -> Array:
        sums = np.bincount(number.ravel(), x.ravel(), shape[0] * shape[1])
        return np.asarray(sums, np.float64).reshape(shape)

    product = b.conj() * a
    sums = by_blocks(product.real) + 1j * by_blocks(product.imag)
    weight, filled = by_blocks(np.abs(b) ** 2), by_blocks(kept) > 0.0
    size, windows = np.count_nonzero(filled, axis=1), np.count_nonzero(kept, axis=1)
    whole, power = np.sum(sums, axis=1), np.maximum(np.sum(weight, axis=1), 1e-12)
    blocks = power**2 / np.maximum(np.sum(weight**2, axis=1), 1e-24)
    turned = np.angle((whole[:, None] - sums) * whole.conj()[:, None])
    mean = np.sum(np.where(filled, turned, 0.0), axis=1) / size
    jackknife = (size - 1) / size * np.sum(np.where(filled, turned - mean[:, None], 0.0) ** 2, axis=1)
    residual = a - (whole / power)[:, None] * b
    # Windows of 1 s that begin at every fix share most of their errors.
    shared = np.maximum(1.0, WINDOW_S * windows / (size * BLOCK_S))
    with np.errstate(divide="ignore", invalid="ignore"):
        across = 0.5 * _power(residual) / windows * shared * power / np.abs(whole) ** 2
    return np.where((size < 2) | (whole == 0.0), np.pi, np.sqrt(np.maximum(jackknife, across))), blocks


def _why_not(found: HeadingOffset, least_blocks: float) -> str:
    """Return the reason why an offset does not count, empty where it does."""
    if found.correlation < MIN_CORRELATION:
        return f"GNSS and force do not show one motion: correlation {found.correlation:.2f}"
    if not SCALES[0] <= found.scale <= SCALES[1]:
        return f"GNSS shows {found.scale:.2g} times the acceleration of the force"
    if found.blocks < least_blocks:
        return "one movement alone bears it"
    if found.sigma_deg > MAX_SIGMA_DEG:
        return f"too little acceleration: it is known to {found.sigma_deg:.0f} deg (sigma)"
    return ""


def _none(why: str) -> HeadingOffset:
    nan = float("nan")
    return HeadingOffset(nan, nan, nan, nan, nan, 0.0, nan, nan, False, why)
