"""On which clock is a truth? The one on which it turns as the gyro does.

The size of the angular rate is the same in all axes, so its correlation finds the offset first; then the rates
themselves fix it, with the turn between the two bodies. Kalibr and evo users expect the same of their tools.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, timestamps
from attlog.core.errors import UsageError
from attlog.core.kinematics import BodyRates, body_rates
from attlog.external.read import AttitudeColumns
from attlog.flight.model import FlightLog
from attlog.segments import model
from attlog.segments.increments import GyroIncrements

Array = NDArray[np.float64]

# Rates are means over so long at least, where noise of the truth is small, at so many instants at most.
SPAN_S, MAX_INTERVALS = 0.08, 6000
# Grid of the first search; what both must cover there, also as a share of the shorter of the two.
GRID_S, MIN_OVERLAP_S, MIN_OVERLAP_SHARE = 0.05, 10.0, 0.3
# So many offsets are looked at closer, this far from each other.
MAX_PEAKS, MIN_PEAK_DISTANCE_S = 6, 0.5
# Steps around the best offset, three to each side, before a parabola.
STEPS_S = (0.05, 0.02, 0.006, 0.002)
# So many intervals tell which offset is best.
COARSE_INTERVALS = 1200
# The record is fitted to so far from its middle, in so many steps; the gyro's change is taken over twice so long.
LENGTHS_S, ROUNDS, NEAR_S = (300.0, 900.0, 2700.0), 3, 0.004
JACKKNIFE = 10
# A drift is taken out where it is so many sigmas, and 1 ppm, and the vehicle turned in so many seconds.
DRIFT_SIGMAS, LEAST_DRIFT, LEAST_SPREAD = 4.0, 1e-6, 10.0
# Beyond so many medians, and no larger share: where a vehicle mostly stands still, its motion is no outlier.
OUTLIERS, FEW_OUTLIERS = 6.0, 0.005


@dataclass(frozen=True, slots=True)
class RateFit:
    """How well rates fit: gyro = turn x truth + bias. ``turn`` (3, 3) from the truth's body to the IMU's."""

    turn: Array
    bias: Array
    # Mean square of what is left, (rad/s)^2.
    misfit: float
    correlation: float
    n: int


def attitude_rates(t: Array, q: Array, span_s: float = SPAN_S) -> BodyRates:
    """Return body rates of attitudes (n, 4), body to earth, at rising ``t`` (n,) s over at least ``span_s``."""
    step = 1.0 / max(model.sample_rate(t), 1e-9)
    segment = model.number_segments(t, timestamps.gap_limit_of_times(t))
    return body_rates(t, q, segment, max(1, int(np.ceil(span_s / step - 1e-6))))


def fit_turn(truth: BodyRates, gyro: GyroIncrements, late: float = 0.0) -> RateFit | None:
    """The turn between the bodies and the gyro's bias (Kabsch), where the truth's clock is ``late`` too early."""
    seen = gyro.mean_rates(truth.start + late, truth.end + late)
    known = rotation.finite_rows(seen)
    if np.count_nonzero(known) < 30:
        return None
    own, seen = truth.rate[known], seen[known]
    keep = np.ones(len(own), bool)
    turn, bias, off = np.eye(3), np.zeros(3), np.zeros(len(own))
    for _ in range(3):
        turn, bias = _kabsch(own[keep], seen[keep])
        off = np.sum((seen - own @ turn.T - bias) ** 2, axis=1)
        keep = _inliers(off)
    a, b = own[keep] @ turn.T, seen[keep] - bias
    a = a - a.mean(axis=0)
    size = float(np.sqrt(np.sum(a * a) * np.sum((b - b.mean(axis=0)) ** 2)))
    correlation = float(np.sum(a * (b - b.mean(axis=0)))) / size if size > 0 else 0.0
    return RateFit(turn, bias, float(np.mean(off[keep])), correlation, int(keep.sum()))


def _inliers(square: Array) -> NDArray[np.bool_]:
    """Which squared misfits (n,) are no outliers."""
    beyond = max(OUTLIERS**2 * float(np.median(square)), float(np.quantile(square, 1.0 - FEW_OUTLIERS)), 1e-12)
    return np.asarray(square <= beyond)


def _kabsch(own: Array, seen: Array) -> tuple[Array, Array]:
    """The rotation (3, 3) and offset (3,) that take rates ``own`` (n, 3) to ``seen`` (n, 3) with least squares."""
    a, b = own - own.mean(axis=0), seen - seen.mean(axis=0)
    turn = rotation.nearest_rotation(b.T @ a)
    return turn, seen.mean(axis=0) - turn @ own.mean(axis=0)


def clock_candidates(truth: BodyRates, gyro: GyroIncrements, around: float | None, within: float) -> list[float]:
    """Offsets in s that the size of the rates suggests, the best first; only ``within`` s of ``around`` if given."""
    if around is not None:
        lags = around + np.arange(-within, within + 1e-9, GRID_S)
        found = [
            (f.correlation, float(lag))
            for lag in lags
            if (f := fit_turn(truth.at_most(COARSE_INTERVALS), gyro, float(lag)))
        ]
        return [max(found)[1]] if found else []
    grid = max(GRID_S, float(np.median(truth.end - truth.start)) / 2.0)
    begin, a = _sizes(truth, grid)
    edges = np.arange(gyro.t[0], gyro.t[-1], grid)
    turned = gyro.between(edges[:-1], edges[1:]) / grid
    known = gyro.known(edges[:-1], edges[1:])
    b = np.where(known, rotation.length(turned - np.median(turned[known], axis=0)), np.nan) if known.any() else turned
    score = _correlation(a, b, grid)
    found_at: list[float] = []
    for i in np.argsort(-score):
        if not np.isfinite(score[i]) or len(found_at) == MAX_PEAKS:
            break
        offset = float(edges[0] - begin + (i - (len(a) - 1)) * grid)
        if all(abs(offset - other) > MIN_PEAK_DISTANCE_S for other in found_at):
            found_at.append(offset)
    return found_at


def _sizes(truth: BodyRates, grid: float) -> tuple[float, Array]:
    """The size of the truth's rate on a grid from a time on; NaN where it has none."""
    middle = 0.5 * (truth.start + truth.end)
    begin = float(middle[0]) - 0.5 * grid
    place = ((middle - begin) / grid).astype(np.int64)
    size = rotation.length(truth.rate - np.median(truth.rate, axis=0))
    count = np.bincount(place)
    with np.errstate(invalid="ignore", divide="ignore"):
        return begin, np.bincount(place, size) / count


def _correlation(a: Array, b: Array, grid: float) -> Array:
    """Pearson's r of two series with gaps (NaN) at every lag, lag 0 at len(a) - 1; NaN where they share little."""
    n = 1 << int(np.ceil(np.log2(len(a) + len(b))))

    def lagged(x: Array, y: Array) -> Array:
        product = np.fft.irfft(np.conj(np.fft.rfft(x, n)) * np.fft.rfft(y, n), n)
        return np.concatenate([product[n - (len(a) - 1) :], product[: len(b)]])

    known_a, known_b = (np.isfinite(x).astype(np.float64) for x in (a, b))
    x, y = (np.where(np.isfinite(v), v - np.nanmean(v), 0.0) for v in (a, b))
    count = lagged(known_a, known_b)
    sum_x, sum_y = lagged(x, known_b), lagged(known_a, y)
    with np.errstate(invalid="ignore", divide="ignore"):
        covariance = lagged(x, y) - sum_x * sum_y / count
        spread = (lagged(x * x, known_b) - sum_x**2 / count) * (lagged(known_a, y * y) - sum_y**2 / count)
        r = covariance / np.sqrt(np.maximum(spread, 1e-18))
    least = max(MIN_OVERLAP_S / grid, MIN_OVERLAP_SHARE * min(known_a.sum(), known_b.sum()))
    return np.asarray(np.where(count >= least, r, np.nan))


def refine_offset(
    truth: BodyRates,
    gyro: GyroIncrements,
    offset: float,
    most: int = COARSE_INTERVALS,
    steps: tuple[float, ...] = STEPS_S,
) -> tuple[float, RateFit] | None:
    """The offset near one, to a fraction of a ms, and the fit there; of at most so many intervals."""
    few = truth.at_most(most)
    for step in steps:
        around = offset + step * np.arange(-3, 4)
        misfits = np.array([np.inf if (f := fit_turn(few, gyro, float(o))) is None else f.misfit for o in around])
        if not np.isfinite(misfits).any():
            return None
        best = int(np.argmin(misfits))
        offset = float(around[best])
    if 0 < best < len(around) - 1:
        a, b, c = misfits[best - 1 : best + 2]
        bend = a - 2.0 * b + c
        offset += 0.5 * STEPS_S[-1] * float((a - c) / bend) if bend > 0 else 0.0
    found = fit_turn(few, gyro, offset)
    return None if found is None else (offset, found)


@dataclass(frozen=True, slots=True)
class TruthClock:
    """A clock and a turn between bodies that fit best, with jackknife sigmas: s, s/s, and rad (3,) about IMU axes."""

    offset: float
    drift: float
    turn: Array
    offset_sigma: float
    drift_sigma: float
    turn_sigma: Array


def fit_clock(
    truth: BodyRates, gyro: GyroIncrements, offset: float, middle: float, start: RateFit
) -> TruthClock | None:
    """Offset at ``middle``, drift and turn at once: least squares of gyro - turn x truth - bias, linear in all of them.

    The middle of a long record comes first: the clock that it tells leads to the rest. None where too little is shared.
    """
    at = 0.5 * (truth.start + truth.end) - middle
    reach = float(np.max(np.abs(at)))
    found = TruthClock(offset, 0.0, start.turn, np.inf, np.inf, np.full(3, np.inf))
    lengths = [length for length in LENGTHS_S if length < reach] + [reach]
    for length in lengths:
        part = truth.select(np.abs(at) <= length).at_most(MAX_INTERVALS)
        for _ in range(ROUNDS):
            better = _gauss_newton_step(part, gyro, middle, found)
            if better is None:
                return None
            found = better
    if abs(found.drift) < max(DRIFT_SIGMAS * found.drift_sigma, LEAST_DRIFT) or _turning_seconds(truth) < LEAST_SPREAD:
        sigma = found.drift_sigma
        for _ in range(ROUNDS):
            better = _gauss_newton_step(part, gyro, middle, replace(found, drift=0.0), with_drift=False)
            found = better or found
        found = replace(found, drift=0.0, drift_sigma=sigma)
    return found


def _turning_seconds(truth: BodyRates) -> float:
    """In how many seconds it turns, as a number of equal ones: a drift needs motion early and late."""
    energy = np.bincount((truth.start - truth.start[0]).astype(np.int64), np.sum(truth.rate**2, axis=1))
    return float(np.sum(energy) ** 2 / max(float(np.sum(energy**2)), 1e-30))


def _gauss_newton_step(
    truth: BodyRates, gyro: GyroIncrements, middle: float, now: TruthClock, with_drift: bool = True
) -> TruthClock | None:
    """One Gauss-Newton step, and the scatter of it where a tenth of the record is left out."""
    moved = truth.shifted(now.offset, now.drift, middle)
    known = gyro.known(moved.start - NEAR_S, moved.end + NEAR_S)
    if np.count_nonzero(known) < 30:
        return None
    moved = moved.select(known)
    span = (moved.end - moved.start)[:, None]
    early, seen, late = (gyro.between(moved.start + s, moved.end + s) / span for s in (-NEAR_S, 0.0, NEAR_S))
    change = (late - early) / (2.0 * NEAR_S)
    along = (0.5 * (moved.start + moved.end) - now.offset - middle)[:, None]
    own = moved.rate @ now.turn.T
    off = seen - own
    off = off - np.median(off, axis=0)
    # gyro(t + d) = turned own + bias: d x change - (turn x own) - bias = -off
    x, y, z = own.T
    columns = np.zeros((len(own), 3, 8))
    columns[:, :, 0], columns[:, :, 1] = change, change * along * with_drift
    columns[:, 0, 3], columns[:, 0, 4] = -z, y
    columns[:, 1, 2], columns[:, 1, 4] = z, -x
    columns[:, 2, 2], columns[:, 2, 3] = -y, x
    columns[:, :, 5:] = -np.eye(3)
    size = np.sum(off * off, axis=1)
    weight = _inliers(size).astype(np.float64)
    edges = np.linspace(0, len(own), JACKKNIFE + 1).astype(np.int64)[:-1]
    squares = np.add.reduceat(np.einsum("n,nij,nik->njk", weight, columns, columns), edges, axis=0)
    sums = np.add.reduceat(np.einsum("n,nij,ni->nj", weight, columns, -off), edges, axis=0)
    floor = np.diag([1e-6, 1e-6 if with_drift else 1.0, *[1e-9] * 6])
    total, right = squares.sum(axis=0) + floor, sums.sum(axis=0)
    step = np.linalg.solve(total, right)
    left = np.array([np.linalg.solve(total - m, right - v) for m, v in zip(squares, sums, strict=True)])
    sigma = np.sqrt((JACKKNIFE - 1) / JACKKNIFE * np.sum((left - left.mean(axis=0)) ** 2, axis=0))
    turn = rotation.to_matrix(rotation.from_rotvec(step[2:5])) @ now.turn
    offset, drift = now.offset + float(step[0]), now.drift + float(step[1])
    return TruthClock(offset, drift, turn, float(sigma[0]), float(sigma[1]), sigma[2:5])


# On which clock are the times of a file? One that the log knows, or the offset that the user gives.

# So much of the file, or of the log, must lie within the other.
MIN_FILE_OVERLAP = 0.5


def times_on_log(
    path: Path, table: AttitudeColumns, log: FlightLog, offset: float
) -> list[tuple[Array, NDArray[np.int64], str]]:
    """For each clock on which the file overlaps the log: times (m,) s on the log's clock, which rows (m,) of the table
    they are, and what clock it is.

    Rows whose time does not rise are left out. UsageError where nothing overlaps.
    """
    good = np.isfinite(table.t)
    highest = np.maximum.accumulate(np.where(good, table.t, -np.inf))
    good[1:] &= highest[1:] > highest[:-1]
    rows = np.flatnonzero(good)
    raw = table.t[rows]
    if len(raw) < 2:
        raise UsageError(f"{path}: {len(raw)} rows whose time rises; an attitude needs more")
    imu = log.replay_imu
    begin, end = (0.0, log.seconds) if imu is None else (float(imu.gyro.t_best[0]), float(imu.gyro.t_best[-1]))
    found = []
    for shift, said in _known_clocks(log, offset):
        t = raw + shift
        common = min(end, float(t[-1])) - max(begin, float(t[0]))
        if common >= MIN_FILE_OVERLAP * min(end - begin, float(t[-1] - t[0])):
            inside = (t >= begin) & (t <= end)
            found.append((t[inside], rows[inside], said))
    if found:
        return found
    raise UsageError(
        f"{path}: does not overlap the log: its times are {raw[0]:.3f} to {raw[-1]:.3f} s, the log's {begin:.3f} to "
        f"{end:.3f} s (0 is the first IMU sample, {log.t0_us / 1e6:.3f} s after the autopilot's boot); "
        f"give the difference as {path.name}:offset=SECONDS"
    )


def _known_clocks(log: FlightLog, offset: float) -> list[tuple[float, str]]:
    if offset:
        return [(offset, f"{offset:g} s added")]
    known = [(0.0, "the log's own, 0 is the first IMU sample")]
    if log.t0_us:
        known.append((-log.t0_us / 1e6, "the autopilot's, since its boot"))
    if log.utc_offset is not None:
        known.append((-log.utc_offset, "Unix time, by the log's GNSS"))
    return known
