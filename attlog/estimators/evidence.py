"""Judge an attitude by GNSS and gravity, without a filter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation

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

# The change of velocity between two fixes so far apart, and what still counts as that.
WINDOW_S, FROM_S, TO_S = 1.0, 0.7, 1.3
# Parts of 30 s are two halves side by side.
HALF_S, BLOCK_S = 15.0, 5.0
GAP_S = 0.15
DELAYS_S, STEP_S = (-0.25, 0.6), 0.025
# A delay is known where the residual so far beside it is so many times larger, else known to so many seconds.
BESIDE_S, PEAK_RATIO = 0.15, 1.5
SIGMA_DELAY_S, FLOOR_DEG = 0.02, 0.3
ROUNDS, OUTLIER, MIN_M_S = 3, 4.0, 0.05
# Median of the length of a plane vector of normal errors of sigma 1.
MEDIAN_OF_LENGTH = 1.18
MIN_CORRELATION, SCALES, MAX_SIGMA_DEG = 0.7, (0.7, 1.3), 10.0
MIN_BLOCKS, MIN_BLOCKS_OF_SEGMENT = 1.8, 2.5
WRONG_DEG, WRONG_SIGMAS = 8.0, 3.0
SOUND_DEG, SOUND_SIGMAS, SOUND_SIGMA_DEG = 3.0, 2.0, 2.0
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

    ``gnss`` (k,) from ``t0`` (k,) to ``t1`` (k,) s; ``force`` (d, k) the same for each of the ``delays`` (d,) s.
    """

    t0: Array
    t1: Array
    gnss: Complex
    force: Complex
    delays: Array


class _Delay(NamedTuple):
    """The one that fits best: its place among the delays, one sigma in s, and why there is none."""

    at: int
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
    """:func:`heading_offset` and :func:`pieces` for the work of one."""
    steps = velocity_steps(t, acc, q, fixes_t, velocity, spans)
    if len(steps.t0) < MIN_WINDOWS:
        return _none("no GNSS velocity beside samples of the IMU"), []
    number = np.floor_divide(steps.t0 - steps.t0[0], HALF_S)
    edges = np.searchsorted(number, np.arange(number[-1] + 3.0)).tolist()
    parts = {k: slice(a, b) for k, (a, b) in enumerate(zip(edges[:-2], edges[2:], strict=True)) if b - a >= MIN_WINDOWS}
    beside = [k for k in parts if k % 2 == 0]
    delay = _delay_of(steps, [parts[k] for k in beside])
    chosen = {k: _without_outliers(steps, part, delay) for k, part in parts.items()}
    whole = _fitted(steps, [chosen[k] for k in beside], delay, MIN_BLOCKS)
    return whole, [_fitted(steps, [part], delay, MIN_BLOCKS_OF_SEGMENT) for part in chosen.values()]


def velocity_steps(
    t: Array, acc: Array, q: Array, fixes_t: Array, velocity: Array, spans: Array | None = None
) -> VelocitySteps:
    """Return the change of velocity of each second by GNSS and by force, for every delay that is tried."""
    beyond = round(BESIDE_S / STEP_S)
    first, last = round(DELAYS_S[0] / STEP_S) - beyond, round(DELAYS_S[1] / STEP_S) + beyond
    delays: Array = STEP_S * np.arange(first, last + 1, dtype=np.float64)
    good = np.isfinite(fixes_t) & np.isfinite(velocity[:, 0]) & np.isfinite(velocity[:, 1])
    fixes, speed = fixes_t[good], velocity[good, 0] + 1j * velocity[good, 1]
    rate = _horizontal(acc, q)
    known = np.isfinite(rate.real) & np.isfinite(rate.imag) & np.isfinite(t)
    t, rate = t[known], rate[known]
    i, j = _pairs(fixes)
    if len(t) < 2 or len(i) == 0:
        return VelocitySteps(
            np.zeros(0), np.zeros(0), np.zeros(0, complex), np.zeros((len(delays), 0), complex), delays
        )
    # Every delay must see the same windows, so the force is needed a little before and after each.
    whole = _without_gap(t, fixes[i] - delays[-1], fixes[j] - delays[0])
    if spans is not None:
        whole &= _inside(spans, fixes[i], fixes[j])
    i, j = i[whole], j[whole]
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))])
    used = np.union1d(i, j)
    at = np.interp(fixes[used] - delays[:, None], t, integral)
    force = at[:, np.searchsorted(used, j)] - at[:, np.searchsorted(used, i)]
    return VelocitySteps(fixes[i], fixes[j], speed[j] - speed[i], force, delays)


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


def _delay_of(steps: VelocitySteps, segments: list[slice]) -> _Delay:
    """Return the delay at which force and GNSS agree best, the heading of each 30 s free.

    Delay and heading are one quantity while a vehicle circles one way: then the residual hardly changes with it.
    """
    explained, total = np.zeros(len(steps.delays)), 0.0
    for part in segments:
        a, b = steps.gnss[part], steps.force[:, part]
        a, b = a - a.mean(), b - b.mean(axis=1, keepdims=True)
        power = np.sum(b.real**2 + b.imag**2, axis=1)
        # Sums, not a matrix product: the library of products starts threads for so little, which cost ten times it.
        explained += np.abs(np.sum(b.conj() * a, axis=1)) ** 2 / np.maximum(power, 1e-12)
        total += float(np.sum(np.abs(a) ** 2))
    beyond = round(BESIDE_S / STEP_S)
    at = beyond + int(np.argmax(explained[beyond:-beyond]))
    rest = np.maximum(total - explained, 1e-12)
    known = min(rest[at - beyond], rest[at + beyond]) >= PEAK_RATIO * rest[at]
    edge = at in (beyond, len(steps.delays) - 1 - beyond)
    why = f"the delay of GNSS is not found between {DELAYS_S[0]} and {DELAYS_S[1]} s" if edge else ""
    return _Delay(at, SIGMA_DELAY_S if known else BESIDE_S, why)


def _fitted(steps: VelocitySteps, chosen: list[Index], delay: _Delay, least_blocks: float) -> HeadingOffset:
    """Fit the rotation over the chosen windows of several segments, each about its own mean."""
    if not sum(len(part) for part in chosen):
        return _none("no GNSS velocity beside samples of the IMU")
    aside = max(1, round(delay.sigma_s / STEP_S))
    tried = np.array([steps.gnss, *steps.force[[delay.at - aside, delay.at + aside, delay.at]]])
    own = [tried[:, part] for part in chosen if len(part)]
    a, before, after, b = np.concatenate([x - x.mean(axis=1, keepdims=True) for x in own], axis=1)
    rotations = [np.angle(np.sum(x * a.conj())) for x in (before, after, b)]
    t = np.concatenate([steps.t0[part] for part in chosen])
    turned = np.angle(np.exp(1j * (rotations[1] - rotations[0]))) * delay.sigma_s / (2.0 * aside * STEP_S)
    spread, blocks = _spread(t, a, b)
    sigma = np.degrees(np.hypot(spread, turned))
    power_a, power_b = (float(np.sum(np.abs(x) ** 2)) for x in (a, b))
    product = float(np.abs(np.sum(b.conj() * a)))
    found = HeadingOffset(
        offset_deg=float(np.degrees(rotations[2])),
        sigma_deg=float(min(np.hypot(sigma, FLOOR_DEG), 180.0)),
        scale=product / max(power_b, 1e-12),
        correlation=product / max(float(np.sqrt(power_a * power_b)), 1e-12),
        delay_s=float(steps.delays[delay.at]),
        blocks=blocks,
        t0=float(t[0]),
        t1=float(steps.t1[chosen[-1][-1]]) if len(chosen[-1]) else float(t[-1]) + WINDOW_S,
        known=False,
        why="",
    )
    why = delay.why or _why_not(found, least_blocks)
    return found._replace(known=not why, why=why)


def _without_outliers(steps: VelocitySteps, part: slice, delay: _Delay) -> Index:
    """Return the windows of a part near the fit of the others, after at most three rounds."""
    a, b = steps.gnss[part], steps.force[delay.at, part]
    near: Index = np.arange(len(a))
    for _ in range(ROUNDS):
        before = near
        x, y = a - a[near].mean(), b - b[near].mean()
        turn = np.sum(y[near].conj() * x[near]) / max(float(np.sum(np.abs(y[near]) ** 2)), 1e-12)
        residual = np.abs(x - turn * y)
        limit = OUTLIER * max(float(np.median(residual[near])) / MEDIAN_OF_LENGTH, MIN_M_S)
        near = np.flatnonzero(residual <= limit)
        if np.array_equal(near, before):
            break
    return np.asarray(near + part.start)


def _spread(t: Array, a: Complex, b: Complex) -> tuple[float, float]:
    """Return one sigma in rad of the rotation from ``b`` to ``a`` (k,), and the effective number of 5 s blocks.

    The larger of the jackknife of the blocks (Efron 1982, ch. 3) and of what the residuals say.
    """
    number = np.cumsum(np.diff(np.floor_divide(t - t[0], BLOCK_S), prepend=0.0) != 0.0)
    size = int(number[-1]) + 1
    product = b.conj() * a
    sums = np.bincount(number, product.real, size) + 1j * np.bincount(number, product.imag, size)
    weight = np.bincount(number, np.abs(b) ** 2, size)
    whole = np.sum(sums)
    power = max(float(weight.sum()), 1e-12)
    blocks = power**2 / max(float(np.sum(weight**2)), 1e-24)
    if size < 2 or np.abs(whole) == 0.0:
        return np.pi, blocks
    turned = np.angle((whole - sums) * np.conj(whole))
    jackknife = (size - 1) / size * float(np.sum((turned - turned.mean()) ** 2))
    residual = a - whole / power * b
    # Windows of 1 s that begin at every fix share most of their errors.
    shared = max(1.0, WINDOW_S * len(t) / (size * BLOCK_S))
    across = 0.5 * float(np.mean(np.abs(residual) ** 2)) * shared * power / float(np.abs(whole)) ** 2
    return float(np.sqrt(max(jackknife, across))), blocks


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
