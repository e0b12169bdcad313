"""Cleaned sensor samples, so that a filter's step sees only good numbers.

What happens to real input, once for all filters:

- a sample whose time or gyro is not finite, whose time does not rise or whose gyro is
  beyond any sensor's range is left out and counted; of times that run backwards the
  longest rising sequence is kept;
- a gyro whose readings are cut towards zero (:mod:`attlog.core.truncation`) gets half a step back
  from the reading on that shows it;
- a missing, zero or impossible accelerometer or magnetometer vector reaches the step as
  a zero vector, which asks for no correction;
- ``interval``: sample k acts over (t_{k-1}, t_k]; ``instant``: the mean of k-1 and k does;
- a gap (:mod:`attlog.core.timestamps`) of up to 0.5 s is integrated across with the
  neighbours' mean rate; beyond, a new segment begins and ``segment`` counts up;
- a magnetometer vector is worth 1.5 nominal periods, then it is missing;
- a step that would turn by more than 1 rad is to be taken in parts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.core import rotation, timestamps
from attlog.core.errors import UsageError
from attlog.core.limits import ACC_LIMIT_M_S2, GYRO_LIMIT_RAD_S
from attlog.core.sorting import median
from attlog.core.truncation import Truncation, truncation_of
from attlog.estimators.interface import Array, VectorsAt

Sampling = Literal["interval", "instant"]
D = TypeVar("D", bound=np.generic)

HOLD_PERIODS = 1.5
MISSING, NEW, HELD = 0, 1, 2


@dataclass(slots=True)
class PreparedSamples:
    """Cleaned input. ``substeps`` is 0 at the first sample of a segment: nothing to integrate there yet.

    ``t`` (n,), ``dt`` (n,), ``gyr`` (n, 3) effective rate over dt, ``acc`` and ``mag``
    (n, 3) with zero vectors where missing, ``use`` (n,) MISSING, NEW or HELD for the
    magnetometer, ``segment`` (n,), ``begin`` first index of each segment.
    """

    t: Array
    dt: Array
    substeps: NDArray[np.int64]
    gyr: Array
    acc: Array
    mag: Array
    use: NDArray[np.int64]
    segment: NDArray[np.int64]
    begin: NDArray[np.int64]
    skipped: dict[str, int] = field(default_factory=dict)
    truncation: Truncation | None = None
    # ``acc``, ``mag``, ``use`` with a row of nothing before the first sample, where they are views of such arrays.
    led: tuple[Array, Array, NDArray[np.int64]] | None = None
    # What start found, by begin, end and ``init``, for who runs over them again.
    starts: dict[tuple[int, int, str], Any] = field(default_factory=dict, init=False, repr=False, compare=False)
    # True if no filter runs over them again: they are then released before the output is put together.
    once: bool = False

    def release(self) -> None:
        """Drop the sensors, which in long logs are as large as what comes out of a filter; times and segments stay."""
        self.gyr = self.acc = self.mag = np.zeros((0, 3))
        self.use = self.substeps = np.zeros(0, np.int64)
        self.dt, self.led = np.zeros(0), None


def prepare(
    t: ArrayLike,
    gyr: ArrayLike,
    acc: ArrayLike | None,
    mag: ArrayLike | None = None,
    *,
    dt: ArrayLike | None = None,
    sampling: Sampling = "interval",
    hold_mag: bool = True,
    lead: bool = True,
    ours: bool = False,
) -> PreparedSamples:
    """Clean samples for the kernels; the input is never changed. UsageError for wrong shapes.

    ``t`` (n,) s ascending, ``gyr`` (n, 3) rad/s, ``acc`` (n, 3) m/s^2, ``mag`` (n, 3) in any unit, NaN rows where there
    is no new sample, all body axes (FRD); ``dt`` (n,) s a sample's own time of integration.
    ``lead``: whether :func:`handed` will be asked for the vectors of the sample before, which then need no copy.
    ``ours``: for filters that write to none of their inputs; the rate, and without ``lead`` the vectors, may then be
    the input itself.
    """
    if sampling not in ("interval", "instant"):
        raise UsageError(f"sampling={sampling} is not known; give interval or instant")
    has_mag = mag is not None
    t, gyr, acc, mag, own = _shapes(t, gyr, acc, mag, dt)
    skipped: dict[str, int] = {}
    t, gyr, acc, mag, own = _good_times(t, gyr, acc, mag, own, skipped)
    cut = truncation_of(gyr)
    if cut is not None:
        gyr = np.concatenate([gyr[: cut.readings], cut.restore(gyr[cut.readings :])])
    acc = _vectors(acc, ACC_LIMIT_M_S2, skipped, absent_is_missing=False)
    # zeros that are never written take no memory
    mag = _vectors(mag, np.inf, skipped, absent_is_missing=True) if has_mag else np.zeros((len(t), 3))
    step = np.diff(t, prepend=t[:1])
    missing = step > timestamps.MIN_GAP_S
    if missing.any():
        missing = step > timestamps.gap_limit_of_times(t)
    restart = missing & (step > timestamps.MAX_BRIDGED_GAP_S)
    bridged = missing & ~restart
    first = restart.copy()
    first[:1] = True
    if sampling == "interval":
        between = np.flatnonzero(bridged)
        rate = np.require(gyr, requirements=("C", "W")) if ours and not len(between) else gyr.copy()
        if len(between):
            rate[between] = 0.5 * (gyr[between - 1] + gyr[between])
    else:
        rate = np.empty(gyr.shape)
        rate[1:] = gyr[:-1]
        rate[1:] += gyr[1:]
        rate *= 0.5
        rate[first] = gyr[first]
    if own is not None:
        trusted = np.isfinite(own) & (own > 0) & (step < 1.5 * own) & ~first
        step = np.where(trusted, own, step)
    step[first] = 0.0
    substeps = np.ones(len(t), np.int64)
    if not _within(rate, 0.5 / max(float(step.max(initial=0.0)), 1e-9)):  # else no step turns by sqrt(3) / 2 rad
        angle = np.sqrt(np.einsum("ij,ij->i", rate, rate)) * step
        substeps = np.maximum(np.ceil(angle), 1).astype(np.int64)
    substeps[first] = 0
    for name, count in (("gap_bridged", int(bridged.sum())), ("restart", int(restart.sum()))):
        if count:
            skipped[name] = count
    segment = np.cumsum(restart).astype(np.int64)
    use = _mag_use(t, mag, segment, hold_mag)
    led = (_led(acc), _led(mag), _led(use)) if lead else None
    if led is not None:
        acc, mag, use = led[0][1:], led[1][1:], led[2][1:]
    else:
        acc, mag = (np.require(x, requirements=("C", "W")) for x in (acc, mag))
    return PreparedSamples(t, step, substeps, rate, acc, mag, use, segment, np.flatnonzero(first), skipped, cut, led)


def lagged_samples(samples: PreparedSamples, at: VectorsAt) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return vectors and magnetometer use of each step: ``acc``, ``mag`` (n, 3), ``use`` (n,).

    A step turns the attitude of the sample before by the rate since then. ``start``: it compares
    vectors with the attitude that it is given, so they are those of the sample before; ``end``: with
    the one that it has turned, so they are the sample's own. Handed the sample's own, a filter
    of the first kind is off by one sample of turning, 3.6 deg at 25 Hz and 90 deg/s.
    """
    if at == "end" or not len(samples.t):
        return samples.acc, samples.mag, samples.use
    acc, mag, use = samples.led or (_led(samples.acc), _led(samples.mag), _led(samples.use))
    return acc[:-1], mag[:-1], use[:-1]


def _led(x: NDArray[D]) -> NDArray[D]:
    """Copy ``x`` behind a row of zeros: the sample before each is a view of it, not another copy."""
    out = np.zeros((len(x) + 1, *x.shape[1:]), x.dtype)
    if x.any():
        out[1:] = x
    return out


def place(t_imu: ArrayLike, t_mag: ArrayLike, field: ArrayLike) -> Array:
    """Place magnetometer samples on IMU times: (n, 3) with NaN rows where there is no new sample.

    ``t_imu`` (n,) s, ``t_mag`` (m,) s, ``field`` (m, 3) any unit. Each sample goes to the
    first IMU sample at or after it, the newest wins; samples after the last IMU time are
    dropped. UsageError for wrong shapes.
    """
    t_imu = np.asarray(t_imu, np.float64)
    t_mag = np.asarray(t_mag, np.float64)
    field = np.asarray(field, np.float64)
    if t_imu.ndim != 1 or t_mag.ndim != 1 or field.shape != (len(t_mag), 3):
        raise UsageError(
            f"place needs t_imu (n,), t_mag (m,), field (m, 3); got {t_imu.shape}, {t_mag.shape}, {field.shape}"
        )
    out = np.full((len(t_imu), 3), np.nan)
    good = np.isfinite(t_mag) & np.isfinite(field).all(axis=1)
    order = np.flatnonzero(good)[np.argsort(t_mag[good], kind="stable")]
    finite = np.flatnonzero(np.isfinite(t_imu))
    where = np.searchsorted(t_imu if len(finite) == len(t_imu) else t_imu[finite], t_mag[order], side="left")
    inside = where < len(finite)
    out[finite[where[inside]]] = field[order[inside]]
    return out


def _shapes(t: Any, gyr: Any, acc: Any, mag: Any, dt: Any) -> tuple[Array, Array, Array, Array, Array | None]:
    """float64 arrays of the right shapes; missing sensors become NaN rows."""
    try:
        t = np.asarray(t, np.float64)
        arrays = {
            n: None if x is None else np.asarray(x, np.float64) for n, x in (("gyr", gyr), ("acc", acc), ("mag", mag))
        }
        dt = None if dt is None else np.asarray(dt, np.float64)
    except (TypeError, ValueError) as error:
        raise UsageError(f"t, gyr, acc and mag must be arrays of numbers ({error})") from None
    if t.ndim != 1:
        raise UsageError(f"t must have shape (n,), not {t.shape}")
    if arrays["gyr"] is None:
        raise UsageError("gyr must have shape (n, 3), not None")
    for name, x in arrays.items():
        if x is not None and x.shape != (len(t), 3):
            raise UsageError(f"{name} must have shape ({len(t)}, 3) like t, not {x.shape}")
    if dt is not None and dt.shape != t.shape:
        raise UsageError(f"dt must have shape {t.shape} like t, not {dt.shape}")
    filled = [np.broadcast_to(np.nan, (len(t), 3)) if x is None else x for x in arrays.values()]
    return t, filled[0], filled[1], filled[2], dt


def _good_times(
    t: Array, gyr: Array, acc: Array, mag: Array, own: Array | None, skipped: dict[str, int]
) -> tuple[Array, Array, Array, Array, Array | None]:
    """Only samples with finite, rising time and a possible rate."""
    if _within(gyr, GYRO_LIMIT_RAD_S) and np.isfinite(t).all() and (np.diff(t) > 0).all():
        return t.copy(), gyr, acc, mag, own
    finite = np.isfinite(t) & _whole(np.isfinite(gyr))
    with np.errstate(invalid="ignore"):
        possible = _whole(np.abs(gyr) <= GYRO_LIMIT_RAD_S)
    keep = np.flatnonzero(finite & possible)
    rising = keep[timestamps.longest_rising(t[keep])]
    lost = {
        "nan": int((~finite).sum()),
        "saturated": int((finite & ~possible).sum()),
        "time_not_rising": len(keep) - len(rising),
    }
    skipped.update({name: count for name, count in lost.items() if count})
    return t[rising], gyr[rising], acc[rising], mag[rising], None if own is None else own[rising]


def _within(x: Array, limit: float) -> bool:
    """Return whether all of x is finite and within the limit, without masks."""
    if len(x) == 0:
        return True
    low, high = float(x.min()), float(x.max())
    return -limit <= low and high <= limit and math.isfinite(low) and math.isfinite(high)


def _whole(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Rows (n,) of a mask (n, 3) that hold in all three columns; many times faster than ``all(axis=1)``."""
    return mask[:, 0] & mask[:, 1] & mask[:, 2]


def _vectors(x: Array, limit: float, skipped: dict[str, int], absent_is_missing: bool) -> Array:
    """Return vectors with zeros for missing ones; count the reasons.

    An all-NaN sensor or NaN row of the magnetometer means "no sample" and is no fault.
    """
    if _within(x, limit) and x[:, 0].all():
        return x
    if absent_is_missing:
        there = np.flatnonzero(~_whole(np.isnan(x)))
        if len(there) < len(x):
            out = np.zeros(x.shape)
            out[there] = _vectors(x[there], limit, skipped, absent_is_missing)
            return out
    finite = _whole(np.isfinite(x))
    with np.errstate(invalid="ignore"):
        possible = _whole(np.abs(x) <= limit)
        empty = _whole(x == 0.0)
    nan = _whole(np.isnan(x))
    absent = nan if absent_is_missing or nan.all() else np.zeros(len(x), bool)
    for name, mask in (("nan", ~finite & ~absent), ("saturated", finite & ~possible), ("zero_vector", finite & empty)):
        if mask.any():
            skipped[name] = skipped.get(name, 0) + int(mask.sum())
    return np.where((finite & possible)[:, None], x, 0.0)


def _mag_use(t: Array, mag: Array, segment: NDArray[np.int64], hold: bool) -> NDArray[np.int64]:
    """Return NEW at magnetometer samples, HELD up to 1.5 periods after one of the same segment, else MISSING."""
    use = np.zeros(len(t), np.int64)
    at = np.flatnonzero(~_whole(mag == 0.0))
    if hold and 2 <= len(at) < len(t):
        period = float(median(np.diff(t[at])))
        later = np.diff(at, append=len(t))
        fresh = t[at[0] :] - np.repeat(t[at], later) <= HOLD_PERIODS * period
        use[at[0] :] = np.where(fresh & (segment[at[0] :] == np.repeat(segment[at], later)), HELD, MISSING)
    use[at] = NEW
    return use


# Constant-rate data for packages that know no time: integrals interpolated onto a regular grid, and back.

JITTER = 0.05
TYPICAL_FIELD_UT = 50.0


class UniformSamples(NamedTuple):
    """Samples ``period`` seconds apart. ``t`` (m,) s; ``gyr``, ``acc`` (m, 3); ``mag`` (m, 3), zero rows where none.

    ``mag_period`` (s) is the magnetometer's own; ``regular`` False where the input had to be resampled.
    """

    t: Array
    period: float
    gyr: Array
    acc: Array
    mag: Array
    mag_period: float
    regular: bool

    def back(self, t: Array, q: Array) -> Array:
        """Return attitudes (n, 4) at the input's times ``t`` from attitudes (m, 4) on the grid."""
        if self.regular:
            return q
        return rotation.slerp(self.t, q, np.clip(t, self.t[0], self.t[-1]))


def uniform(t: Array, gyr: Array, acc: Array, mag: Array) -> UniformSamples:
    """Return samples whose spacing varies by under 5 % as they are, others resampled at the median rate.

    ``t`` (n,) s, ``gyr`` (n, 3) rad/s, ``acc`` (n, 3) m/s^2, ``mag`` (n, 3) with NaN rows where it has no sample.
    Rates and specific forces are means over the interval before their time, so it is
    their integrals that are interpolated: no turn is lost.
    """
    step = np.diff(t)
    period = float(median(step)) if len(step) else 0.01
    finite = np.isfinite(mag)
    new = finite[:, 0] & finite[:, 1] & finite[:, 2]
    mag = np.where(new[:, None], mag, 0.0)
    mag_t = t[new]
    mag_period = float(median(np.diff(mag_t))) if len(mag_t) > 1 else period
    if len(step) == 0 or np.max(np.abs(step - period)) <= JITTER * period:
        return UniformSamples(t, period, gyr, acc, mag, max(mag_period, period), True)
    grid = t[0] + period * np.arange(int(np.ceil((t[-1] - t[0]) / period - 1e-9)) + 1)
    placed = np.zeros((len(grid), 3))
    placed[np.minimum(np.searchsorted(grid, mag_t - 1e-9), len(grid) - 1)] = mag[new]
    rates = [_resample(t, x, grid, period) for x in (gyr, acc)]
    return UniformSamples(grid, period, rates[0], rates[1], placed, max(mag_period, period), False)


def _resample(t: Array, x: Array, grid: Array, period: float) -> Array:
    """Return means over the grid's intervals of ``x`` (n, 3), means over the input's intervals."""
    step, mean = np.diff(t), np.empty((len(grid), 3))
    mean[:1] = x[:1]
    for i in range(3):  # one axis at a time: in long logs copies add up
        integral = np.concatenate([[0.0], np.cumsum(x[1:, i] * step)])
        mean[1:, i] = np.diff(np.interp(grid, t, integral)) / period
    # The last interval reaches beyond the input: only its covered part was integrated.
    covered = min((t[-1] - grid[-2]) / period, 1.0) if len(grid) > 1 else 1.0
    mean[-1] /= covered
    return mean


def typical_size(mag: Array) -> Array:
    """Scale the field (n, 3) to a median norm of 50, zero rows kept: packages expect microtesla."""
    return mag * typical_scale(mag)


def typical_scale(mag: Array) -> float:
    """Return the factor of :func:`typical_size`; 1 for a field (n, 3) without samples."""
    norm = np.sqrt(np.sum(mag**2, axis=1))
    return TYPICAL_FIELD_UT / float(median(norm[norm > 0])) if norm.any() else 1.0
