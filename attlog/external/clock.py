"""Clock offset and drift of an external attitude, by its rates against the gyro or by the log's known clocks.

The norm of the rate does not depend on body axes, so its cross-correlation gives candidate offsets. The rate vectors
then give offset, drift and the rotation between both bodies (Kabsch, Gauss-Newton, jackknife).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation, timestamps
from attlog.core.errors import UsageError
from attlog.core.kinematics import BodyRates, body_rates
from attlog.core.sorting import median, quantile
from attlog.external.read import Trajectory
from attlog.flight.model import FlightLog, Imu
from attlog.segments import model
from attlog.segments.increments import GyroIncrements, gyro_increments

Array = NDArray[np.float64]

# Interval of a mean rate, long enough for the noise of most truths; most intervals of one fit.
SPAN_S, MAX_INTERVALS = 0.08, 6000
# Grid of the cross-correlation; least overlap, also as a share of the shorter record.
GRID_S, MIN_OVERLAP_S, MIN_OVERLAP_SHARE = 0.05, 10.0, 0.3
# Most candidate offsets that are refined, and their least distance.
MAX_PEAKS, MIN_PEAK_DISTANCE_S = 6, 0.5
# Steps of the grid search around an offset, three to each side, before a parabola is fitted.
STEPS_S = (0.05, 0.02, 0.006, 0.002)
# Most intervals of the search for an offset.
COARSE_INTERVALS = 1200
# Half lengths of the record fitted in turn, Gauss-Newton steps of each, and half step of the gyro's time derivative.
LENGTHS_S, ROUNDS, NEAR_S = (300.0, 900.0, 2700.0), 3, 0.004
JACKKNIFE = 10  # tenths of the record
# Least correlation of rates of the same flight; ratio of misfits above which two offsets fit equally well.
MIN_CORRELATION, MIN_RIVAL_MISFIT = 0.9, 0.93
# Intervals of mean rates, tried in turn: the longer one suits a noisy truth of a slow flight; fewest intervals.
SPANS_S, MIN_RATES = (SPAN_S, 0.3), 30
# Interval over which rates of the same flight correlate even with a noisy truth.
LONG_S = 1.6
MAX_TURN_SIGMA_DEG = 4.0  # mountings with a larger uncertainty are refused
# Least jump of a pose that is cut: so many times the gyro's fastest rate, and the median step between poses.
JUMP_RATES, JUMP_STEPS = 1.5, 8.0
# The truth of another flight of one mission leaves the gyro's angle as the span grows; its own does not. Largest growth
# of the misfit in deg from SPAN_S to LONG_S, beside a share of the turn for the gyro's scale; as a factor for a noisy
# truth. Its own grows by up to 0.2 deg, another's by 0.6 and more (four missions flown twice, 24 flights).
MAX_GROWTH_DEG, MAX_GROWTH_SHARE, MIN_GROWTH_RATIO = 0.35, 0.05, 1.2
MAX_COMPARED_TURN_RAD = 0.35  # rotation vectors of long turns are no angle
# An unusual reading is taken if its misfit is below this share of the first reading's.
MAX_READING_MISFIT = 0.9
# Search range around a given offset, and around zero for a topic of the log.
AROUND_S, SAME_CLOCK_S = 0.5, 1.0
# A drift below this many sigmas or this size (s/s), or with fewer seconds of turning, is set to zero.
DRIFT_SIGMAS, LEAST_DRIFT, LEAST_SPREAD = 4.0, 1e-6, 10.0
# Outliers exceed this many times the root median square, and are at most this share: motion in a quiet record stays.
OUTLIERS, FEW_OUTLIERS = 6.0, 0.005


@dataclass(frozen=True, slots=True)
class RateFit:
    """Fit of rates: gyro = turn truth + bias, with ``turn`` (3, 3) from the truth's body to the IMU's.

    ``misfit`` is the mean square of the residuals, (rad/s)^2.
    """

    turn: Array
    bias: Array
    misfit: float
    correlation: float
    n: int


def attitude_rates(t: Array, q: Array, span_s: float = SPAN_S, fastest: float = np.inf) -> BodyRates:
    """Return mean body rates over at least ``span_s`` of attitudes (n, 4), body to earth, at rising ``t`` (n,) s.

    No interval contains a gap or a jump: a step faster than ``fastest`` rad/s by far.
    """
    step = 1.0 / max(model.sample_rate(t), 1e-9)
    segment = model.number_segments(t, timestamps.gap_limit_of_times(t))
    if np.isfinite(fastest):
        segment = model.merge_numbers(segment, np.cumsum(jump_mask(t, q, fastest)))
    return body_rates(t, q, segment, max(1, int(np.ceil(span_s / step - 1e-6))))


def jump_mask(t: Array, q: Array, fastest: float) -> NDArray[np.bool_]:
    """Mark attitudes (n,) reached by a step that no vehicle turning at up to ``fastest`` rad/s makes."""
    size = np.concatenate([[0.0], rotation.length(rotation.relative_rotvecs(q[:-1], q[1:]))])
    span = np.concatenate([[1.0], np.diff(t)])
    return np.asarray(size > np.maximum(JUMP_RATES * fastest * span, JUMP_STEPS * float(median(size))))


def fastest_rate(imu: Imu) -> float:
    """Return the largest mean rate of a gyro over SPAN_S, rad/s."""
    gyro = gyro_increments(imu)
    edges = np.arange(gyro.t[0], gyro.t[-1], SPAN_S)
    rates = gyro.mean_rates(edges[:-1], edges[1:])
    sizes = rotation.length(rates[rotation.finite_rows(rates)])
    return float(np.max(sizes, initial=0.0)) or np.inf


def fit_turn(truth: BodyRates, gyro: GyroIncrements, late: float = 0.0) -> RateFit | None:
    """Fit the rotation between both bodies and the gyro's bias (Kabsch).

    ``late`` s are added to the truth's times. None for fewer than 30 common intervals.
    """
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
    """Select the squared misfits (n,) within the outlier limit."""
    beyond = max(OUTLIERS**2 * float(median(square)), float(quantile(square, 1.0 - FEW_OUTLIERS)), 1e-12)
    return np.asarray(square <= beyond)


def _kabsch(own: Array, seen: Array) -> tuple[Array, Array]:
    """Return the rotation (3, 3) and offset (3,) from rates ``own`` (n, 3) to ``seen`` (n, 3) by least squares."""
    a, b = own - own.mean(axis=0), seen - seen.mean(axis=0)
    turn = rotation.nearest_rotation(b.T @ a)
    return turn, seen.mean(axis=0) - turn @ own.mean(axis=0)


def clock_candidates(truth: BodyRates, gyro: GyroIncrements, around: float | None, within: float) -> list[float]:
    """Return candidate offsets in s, best first.

    Peaks of the cross-correlation of the rates' norms; with ``around`` only the best offset within ``within`` s of it,
    by the correlation of the rate vectors.
    """
    if around is not None:
        lags = around + np.arange(-within, within + 1e-9, GRID_S)
        found = [
            (f.correlation, float(lag))
            for lag in lags
            if (f := fit_turn(truth.at_most(COARSE_INTERVALS), gyro, float(lag)))
        ]
        return [max(found)[1]] if found else []
    grid = max(GRID_S, float(median(truth.end - truth.start)) / 2.0)
    begin, a = _sizes(truth, grid)
    edges = np.arange(gyro.t[0], gyro.t[-1], grid)
    turned = gyro.between(edges[:-1], edges[1:]) / grid
    known = gyro.known(edges[:-1], edges[1:])
    b = np.where(known, rotation.length(turned - median(turned[known], axis=0)), np.nan) if known.any() else turned
    a, b = (np.minimum(x, _fastest_second(b, grid)) for x in (a, b))
    score = _correlation(a, b, grid)
    found_at: list[float] = []
    for i in np.argsort(-score):
        if not np.isfinite(score[i]) or len(found_at) == MAX_PEAKS:
            break
        offset = float(edges[0] - begin + (i - (len(a) - 1)) * grid)
        if all(abs(offset - other) > MIN_PEAK_DISTANCE_S for other in found_at):
            found_at.append(offset)
    return found_at


def _fastest_second(size: Array, grid: float) -> float:
    """Return the rate exceeded for one second in all: a jump or impact, shorter than that, must not decide a clock."""
    known = np.sort(size[np.isfinite(size)])
    return float(known[-min(len(known), max(1, round(1.0 / grid)))]) if len(known) else np.inf


def _sizes(truth: BodyRates, grid: float) -> tuple[float, Array]:
    """Average the norm of the rates on a grid; return its begin and values, NaN in empty cells."""
    middle = 0.5 * (truth.start + truth.end)
    begin = float(middle[0]) - 0.5 * grid
    place = ((middle - begin) / grid).astype(np.int64)
    size = rotation.length(truth.rate - median(truth.rate, axis=0))
    count = np.bincount(place)
    with np.errstate(invalid="ignore", divide="ignore"):
        return begin, np.bincount(place, size) / count


def _correlation(a: Array, b: Array, grid: float) -> Array:
    """Return Pearson's r of two series with gaps (NaN) at each lag.

    Lag 0 is at len(a) - 1. NaN for lags with little overlap.
    """
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
    """Refine an offset by grid search and a parabola; return it with its fit."""
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
    """Offset (s), drift (s/s) and rotation between both bodies, with jackknife sigmas.

    ``turn`` (3, 3) leads from the truth's body to the IMU's; ``turn_sigma`` (3,) rad is about IMU axes.
    """

    offset: float
    drift: float
    turn: Array
    offset_sigma: float
    drift_sigma: float
    turn_sigma: Array


def fit_clock(
    truth: BodyRates, gyro: GyroIncrements, offset: float, middle: float, start: RateFit
) -> TruthClock | None:
    """Fit offset at ``middle``, drift and rotation jointly, from the middle of the record outwards.

    None for fewer than 30 common intervals.
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
    """Return the effective number of seconds with turns (participation ratio of the squared rates)."""
    energy = np.bincount((truth.start - truth.start[0]).astype(np.int64), np.sum(truth.rate**2, axis=1))
    return float(np.sum(energy) ** 2 / max(float(np.sum(energy**2)), 1e-30))


def _gauss_newton_step(
    truth: BodyRates, gyro: GyroIncrements, middle: float, now: TruthClock, with_drift: bool = True
) -> TruthClock | None:
    """Make one Gauss-Newton step; sigmas are by jackknife over tenths of the record."""
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
    off = off - median(off, axis=0)
    # gyro(t + d) = rotated own + bias, linearised: d change - (turn x own) - bias = -off
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
    """Candidate reading ``q`` (n, 4) of a trajectory, its offset in s, and the fit of rates over ``span`` s."""

    reading: str
    q: Array
    span: float
    offset: float
    rates: RateFit


@dataclass(frozen=True, slots=True)
class BestClock:
    """Best reading of a trajectory, its clock about ``middle`` s, and its mean square rate ``turning`` (rad/s)^2."""

    reading: str
    q: Array
    timing: TruthClock
    middle: float
    rates: RateFit
    turning: float


def find_clock(trajectory: Trajectory, imu: Imu, offset: float | None, own_clock: bool) -> BestClock:
    """Return the reading and clock with the best fit to the gyro.

    ``offset`` s: search near it only. ``own_clock``: the times are on the log's clock except for a delay. UsageError
    if no clock fits or several do.
    """
    gyro, name, fastest = gyro_increments(imu), trajectory.name, fastest_rate(imu)
    around = offset if offset is not None else 0.0 if own_clock else None
    within = AROUND_S if offset is not None else SAME_CLOCK_S
    tried: list[ClockFit] = []
    for span in SPANS_S:
        for words, q in trajectory.readings.items():
            rates = attitude_rates(trajectory.t, q, span, fastest)
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
    slow = fit_turn(attitude_rates(trajectory.t, best.q, LONG_S, fastest).at_most(MAX_INTERVALS), gyro, best.offset)
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
    found = _clock_with_drift(trajectory, best, gyro, fastest)
    _check_growth(trajectory, found, gyro, fastest)
    return found


def _check_growth(trajectory: Trajectory, found: BestClock, gyro: GyroIncrements, fastest: float) -> None:
    """Raise UsageError for the truth of another flight of one mission, whose misfit grows with the span."""
    t = trajectory.t + found.timing.offset + found.timing.drift * (trajectory.t - found.middle)
    parts = [_angle_misfit_deg(attitude_rates(t, found.q, span, fastest), gyro, found) for span in (SPAN_S, LONG_S)]
    (short, _), (long, turn) = parts
    grown = math.sqrt(max(long**2 - short**2, 0.0))
    if grown > MAX_GROWTH_DEG + MAX_GROWTH_SHARE * turn and long > MIN_GROWTH_RATIO * short:
        raise UsageError(
            f"--truth {trajectory.name}: leaves the gyro by {long:.1f} deg within {LONG_S:.1f} s and {short:.1f} deg "
            f"within {SPAN_S:.2f} s: it is of another flight of this mission"
        )


def _angle_misfit_deg(truth: BodyRates, gyro: GyroIncrements, found: BestClock) -> tuple[float, float]:
    """Return the median angle in deg between turns of truth and gyro, and the median turn; zeros without any."""
    truth = truth.at_most(MAX_INTERVALS)
    span = (truth.end - truth.start)[:, None]
    seen = (gyro.mean_rates(truth.start, truth.end) - found.rates.bias) * span
    own = truth.rate @ found.timing.turn.T * span
    known = rotation.finite_rows(seen) & (rotation.length(own) < MAX_COMPARED_TURN_RAD)
    known &= rotation.length(seen) < MAX_COMPARED_TURN_RAD
    if np.count_nonzero(known) < MIN_RATES:
        return 0.0, 0.0
    sizes = rotation.length((seen - own)[known]), rotation.length(own[known])
    misfit, turn = (math.degrees(float(median(size))) for size in sizes)
    return misfit, turn


def _clock_with_drift(trajectory: Trajectory, best: ClockFit, gyro: GyroIncrements, fastest: float) -> BestClock:
    """Fit the drift. UsageError if the rotation between both bodies stays uncertain."""
    rates = attitude_rates(trajectory.t, best.q, best.span, fastest)
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


# Known clocks of a log, for an attitude that was computed from it.

# Least overlap as a share of the shorter of file and log.
MIN_FILE_OVERLAP = 0.5


@dataclass(frozen=True, slots=True)
class FileClock:
    """Times (n,) s of a file on a known clock, the mask (n,) of those ``inside`` the log, and the clock's name."""

    t: Array
    inside: NDArray[np.bool_]
    name: str


def file_clocks(file: Trajectory, log: FlightLog, offset: float) -> list[FileClock]:
    """Return the known clocks on which a file overlaps the log. UsageError without any."""
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
