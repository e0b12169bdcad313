"""Clock of an outside attitude: the offset at which it turns as the gyro, or one that the log knows.

The size of the rate is the same in all axes, so its correlation gives the offset first. The rates themselves then give
offset, drift and the turn between the two bodies (Kabsch, Gauss-Newton, jackknife).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, timestamps
from attlog.core.errors import UsageError
from attlog.core.kinematics import BodyRates, body_rates
from attlog.external.read import Trajectory
from attlog.flight.model import FlightLog, Imu
from attlog.segments import model
from attlog.segments.increments import GyroIncrements, gyro_increments

Array = NDArray[np.float64]

# Shortest interval of a mean rate, in which the noise of most truths is small; intervals of one fit.
SPAN_S, MAX_INTERVALS = 0.08, 6000
# Grid of the first search; time that both must cover, also as a share of the shorter one.
GRID_S, MIN_OVERLAP_S, MIN_OVERLAP_SHARE = 0.05, 10.0, 0.3
# Offsets that are refined, and their least distance.
MAX_PEAKS, MIN_PEAK_DISTANCE_S = 6, 0.5
# Steps around the best offset, three to each side, before the parabola.
STEPS_S = (0.05, 0.02, 0.006, 0.002)
# Intervals of the search for an offset.
COARSE_INTERVALS = 1200
# Half lengths of the record that are fitted in turn, Gauss-Newton steps each, and half the time of the gyro's change.
LENGTHS_S, ROUNDS, NEAR_S = (300.0, 900.0, 2700.0), 3, 0.004
JACKKNIFE = 10  # tenths of the record
# Correlation of the rates of one flight, and the ratio of misfits within which two offsets fit equally well.
MIN_CORRELATION, MIN_RIVAL_MISFIT = 0.9, 0.93
# Intervals that are tried in turn: over the longer one a noisy truth still shows a slow flight.
SPANS_S, MIN_RATES = (SPAN_S, 0.3), 30
# Interval over which rates of one flight correlate even under a noisy truth.
LONG_S = 1.6
MAX_TURN_SIGMA_DEG = 4.0  # less certain axes are refused
# Misfit of an unusual reading as a share of the usual one's, below which it is taken.
MAX_READING_MISFIT = 0.9
# Distance of the clock from a given offset, and of a topic's clock from the log's.
AROUND_S, SAME_CLOCK_S = 0.5, 1.0
# Sigmas and size (s/s) from which a drift is removed, and seconds in which the vehicle turned.
DRIFT_SIGMAS, LEAST_DRIFT, LEAST_SPREAD = 4.0, 1e-6, 10.0
# Medians beyond which a misfit is an outlier, and their largest share: motion in a quiet record is none.
OUTLIERS, FEW_OUTLIERS = 6.0, 0.005


@dataclass(frozen=True, slots=True)
class RateFit:
    """Fit of rates: gyro = turn x truth + bias, with ``turn`` (3, 3) from the truth's body to the IMU's.

    ``misfit`` is the mean square of the residuals, (rad/s)^2.
    """

    turn: Array
    bias: Array
    misfit: float
    correlation: float
    n: int


def attitude_rates(t: Array, q: Array, span_s: float = SPAN_S) -> BodyRates:
    """Return body rates of attitudes (n, 4), body to earth, at rising ``t`` (n,) s over at least ``span_s``."""
    step = 1.0 / max(model.sample_rate(t), 1e-9)
    segment = model.number_segments(t, timestamps.gap_limit_of_times(t))
    return body_rates(t, q, segment, max(1, int(np.ceil(span_s / step - 1e-6))))


def fit_turn(truth: BodyRates, gyro: GyroIncrements, late: float = 0.0) -> RateFit | None:
    """Fit the turn between the bodies and the gyro's bias (Kabsch) with ``late`` s added to the truth's times."""
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
    """Return the mask (n,) of squared misfits that are no outliers."""
    beyond = max(OUTLIERS**2 * float(np.median(square)), float(np.quantile(square, 1.0 - FEW_OUTLIERS)), 1e-12)
    return np.asarray(square <= beyond)


def _kabsch(own: Array, seen: Array) -> tuple[Array, Array]:
    """Return the rotation (3, 3) and offset (3,) from rates ``own`` (n, 3) to ``seen`` (n, 3) by least squares."""
    a, b = own - own.mean(axis=0), seen - seen.mean(axis=0)
    turn = rotation.nearest_rotation(b.T @ a)
    return turn, seen.mean(axis=0) - turn @ own.mean(axis=0)


def clock_candidates(truth: BodyRates, gyro: GyroIncrements, around: float | None, within: float) -> list[float]:
    """Return offsets in s by the size of the rates, best first; ``within`` s of ``around`` where that is given."""
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
    """Return the begin of a grid and the size of the rates on it, NaN where there is none."""
    middle = 0.5 * (truth.start + truth.end)
    begin = float(middle[0]) - 0.5 * grid
    place = ((middle - begin) / grid).astype(np.int64)
    size = rotation.length(truth.rate - np.median(truth.rate, axis=0))
    count = np.bincount(place)
    with np.errstate(invalid="ignore", divide="ignore"):
        return begin, np.bincount(place, size) / count


def _correlation(a: Array, b: Array, grid: float) -> Array:
    """Return Pearson's r of two series with gaps (NaN) at each lag; lag 0 is at len(a) - 1, NaN with little overlap."""
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
    """Return the offset near one to a fraction of a ms, and the fit there."""
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
    """Offset (s), drift (s/s) and turn between the bodies, with jackknife sigmas (rad about IMU axes for the turn)."""

    offset: float
    drift: float
    turn: Array
    offset_sigma: float
    drift_sigma: float
    turn_sigma: Array


def fit_clock(
    truth: BodyRates, gyro: GyroIncrements, offset: float, middle: float, start: RateFit
) -> TruthClock | None:
    """Fit the offset at ``middle``, drift and turn at once, from the middle of the record outwards.

    None where truth and gyro share too little.
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
    """Return the effective number of seconds with turns: a drift needs motion early and late."""
    energy = np.bincount((truth.start - truth.start[0]).astype(np.int64), np.sum(truth.rate**2, axis=1))
    return float(np.sum(energy) ** 2 / max(float(np.sum(energy**2)), 1e-30))


def _gauss_newton_step(
    truth: BodyRates, gyro: GyroIncrements, middle: float, now: TruthClock, with_drift: bool = True
) -> TruthClock | None:
    """Make one Gauss-Newton step, with the jackknife over tenths of the record as its sigma."""
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


@dataclass(frozen=True, slots=True)
class ClockFit:
    """One reading of a trajectory as ``q`` (n, 4), the offset (s) near which it fits, and its fit."""

    reading: str
    q: Array
    span: float
    offset: float
    rates: RateFit


@dataclass(frozen=True, slots=True)
class BestClock:
    """The reading that fits, its clock about ``middle`` s, and its mean square rate ``turning`` in (rad/s)^2."""

    reading: str
    q: Array
    timing: TruthClock
    middle: float
    rates: RateFit
    turning: float


def find_clock(trajectory: Trajectory, imu: Imu, offset: float | None, own_clock: bool) -> BestClock:
    """Return the reading and the clock that fit best, near ``offset`` s where that is given.

    ``own_clock``: the times are the log's but for a delay. UsageError where no clock fits, or two do.
    """
    gyro, name = gyro_increments(imu), trajectory.name
    around = offset if offset is not None else 0.0 if own_clock else None
    within = AROUND_S if offset is not None else SAME_CLOCK_S
    tried: list[ClockFit] = []
    for span in SPANS_S:
        for words, q in trajectory.readings.items():
            rates = attitude_rates(trajectory.t, q, span)
            if len(rates.start) < MIN_RATES:
                continue
            for offset in clock_candidates(rates, gyro, around, within):
                fine = refine_offset(rates, gyro, offset)
                if fine is not None:
                    tried.append(ClockFit(words, q, span, *fine))
        if any(c.rates.correlation >= MIN_CORRELATION for c in tried):
            break
    if not tried:
        raise UsageError(f"--truth {name}: shares no 10 s with the log's gyro; give :offset=SECONDS if you know it")
    usual = next(iter(trajectory.readings))
    best = min(
        tried,
        key=lambda c: (1.0 - max(c.rates.correlation, 0.0) ** 2) / (1.0 if c.reading == usual else MAX_READING_MISFIT),
    )
    slow = fit_turn(attitude_rates(trajectory.t, best.q, LONG_S).at_most(MAX_INTERVALS), gyro, best.offset)
    if max(best.rates.correlation, 0.0 if slow is None else slow.correlation) < MIN_CORRELATION:
        turns = math.degrees(
            float(np.sqrt(np.mean(np.var(imu.gyro.x[rotation.finite_rows(imu.gyro.x)], axis=0).sum())))
        )
        raise UsageError(
            f"--truth {name}: its rates do not follow the gyro (correlation {best.rates.correlation:.2f}, "
            f"{MIN_CORRELATION} needed; the log turns by {turns:.0f} deg/s RMS): is it of this flight?"
        )
    rival = next(
        (c for c in tried if abs(c.offset - best.offset) > 0.1 and c.rates.correlation > MIN_CORRELATION), None
    )
    if rival is not None and rival.rates.misfit * MIN_RIVAL_MISFIT < best.rates.misfit:
        raise UsageError(
            f"--truth {name}: fits at {best.offset:.2f} s as well as at {rival.offset:.2f} s; give :offset=SECONDS"
        )
    return _clock_with_drift(trajectory, best, gyro)


def _clock_with_drift(trajectory: Trajectory, best: ClockFit, gyro: GyroIncrements) -> BestClock:
    """Add the drift. UsageError where the turn between the bodies stays unknown."""
    rates = attitude_rates(trajectory.t, best.q, best.span)
    shared = gyro.known(rates.start + best.offset, rates.end + best.offset)
    rates = rates.select(shared)
    middle = float(np.mean(rates.start))
    timing = fit_clock(rates, gyro, best.offset, middle, best.rates)
    sigma = 90.0 if timing is None else float(np.degrees(np.max(timing.turn_sigma)))
    if timing is None or sigma > MAX_TURN_SIGMA_DEG:
        raise UsageError(
            f"--truth {trajectory.name}: the flight turns about too few axes to tell how it is mounted "
            f"(sigma {sigma:.0f} deg)"
        )
    moved = rates.at_most(MAX_INTERVALS).shifted(timing.offset, timing.drift, middle)
    turning = float(np.mean(np.sum(rates.rate**2, axis=1)))
    return BestClock(best.reading, best.q, timing, middle, fit_turn(moved, gyro) or best.rates, turning)


# Clocks that a log knows, for an attitude that was computed from it.

# Share of the file, or of the log, that lies within the other.
MIN_FILE_OVERLAP = 0.5


@dataclass(frozen=True, slots=True)
class FileClock:
    """Times (n,) s of a file on the log's clock, the ``inside`` mask (n,) of those within the log, and its name."""

    t: Array
    inside: NDArray[np.bool_]
    name: str


def file_clocks(file: Trajectory, log: FlightLog, offset: float) -> list[FileClock]:
    """Return every known clock on which a file overlaps the log. UsageError where none does."""
    imu = log.replay_imu
    begin, end = (0.0, log.seconds) if imu is None else (float(imu.gyro.t_best[0]), float(imu.gyro.t_best[-1]))
    found = []
    for shift, name in _known_clocks(log, offset):
        t = file.t + shift
        common = min(end, float(t[-1])) - max(begin, float(t[0]))
        if common >= MIN_FILE_OVERLAP * min(end - begin, float(t[-1] - t[0])):
            found.append(FileClock(t, (t >= begin) & (t <= end), name))
    if found:
        return found
    raise UsageError(
        f"{file.name}: does not overlap the log: its times are {file.t[0]:.3f} to {file.t[-1]:.3f} s, the log's "
        f"{begin:.3f} to {end:.3f} s (0 is the first IMU sample, {log.t0_us / 1e6:.3f} s after the autopilot's boot); "
        f"give the difference as {file.name}:offset=SECONDS"
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
