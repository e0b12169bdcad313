"""A gyro whose digits are cut off, not rounded: found in its readings, and half a step put back.

Readings on a grid of step q are k q with whole k. Rounded, k = 0 stands for rates from -q/2 to q/2; cut towards zero,
for -q to q, and every other reading is half a step too small. A bias found at rest is then wrong by up to half a step
in motion: 0.03 deg/s, or 3.7 deg of heading in two minutes, for 16 bits over 2000 deg/s. Noise of more than a step
shows which it is, because it fills the cells k = -1, 0, 1 in proportion to their widths:

    log-likelihood of the readings among k = -1, 0, 1, cut less rounded

for a normal density with the mean and spread of a block of readings. Other densities have a peak at zero as well: a
vibration turns round there, a halt stays there. A block counts only where the noise is the sensor's own, white (Ljung
and Box) and normal (Jarque and Bera); a block that is neither throws away what the axis had shown before. A third kind,
a dead zone of three steps, must fit worse than the cut as well. No setting is fitted to data.

Source: LjungBox1978; JarqueBera1980.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# Differences of rad/s below which two readings are equal but for the last digits of single precision.
SAME_RAD_S = math.radians(1e-5)
# Half of a smaller step turns by less than 3.6 deg in an hour: not worth finding, and readings in float end here.
LEAST_STEP_RAD_S = math.radians(0.002)
# Readings that are judged together; those of a chunk are searched at once.
BLOCK, CHUNK = 512, 128 * 512
# Fewest equal neighbours in a block: white noise of eight steps has 18, and readings in float none.
LEAST_EQUAL = 16
# Share of a block's readings that lie on the grid, and how near, in steps.
ON_GRID, NEAR = 0.95, 0.05
# Least mean of a block in steps: what is narrow about it falls beside zero, and a halt at zero is off the mean.
LEAST_MEAN = 1.0
# Correlations that are tested, and the limits that white and normal noise exceeds once in 100 blocks.
LAGS, WHITE, NORMAL = 8, 20.1, 9.2
# Log-likelihood ratio that decides, 20,000 to 1, in at least so many blocks; twice as much against it ends the search.
DECIDES, LEAST_BLOCKS = 10.0, 2


@dataclass(frozen=True, slots=True)
class Truncation:
    """Step (3,) rad/s of each axis's grid, 0 without one, and the number of readings that it took to see the cut."""

    step: Array
    readings: int

    def restore(self, gyr: Array) -> Array:
        """Return rates (n, 3) rad/s with half a step put back, away from zero."""
        half = 0.5 * self.step
        return gyr + np.where(np.abs(gyr) > half, np.copysign(half, gyr), 0.0)


def truncation_of(gyr: Array) -> Truncation | None:
    """Find whether a gyro's readings (n, 3) rad/s are cut towards zero; None if that never shows.

    A reading that repeats the one before on all axes was held, and is no news.
    """
    if not any(np.count_nonzero(~(np.abs(np.diff(x)) >= SAME_RAD_S)) >= LEAST_EQUAL for x in gyr.T):
        return None  # most logs end here: too few equal neighbours for one block
    step, evidence, blocks = np.zeros(3), np.zeros((3, 2)), 0
    rest, at = np.zeros((0, 3)), np.zeros(0, np.int64)
    for begin in range(0, len(gyr), CHUNK):
        part = gyr[max(begin - 1, 0) : begin + CHUNK]
        fresh = np.isfinite(part.sum(axis=1))
        fresh[1:] &= (part[1:] != part[:-1]).any(axis=1)
        fresh[0] &= begin == 0
        new = np.flatnonzero(fresh)
        rest, at = np.concatenate([rest, part[new]]), np.concatenate([at, new + max(begin - 1, 0)])
        whole = len(rest) // BLOCK
        x, ends = rest[: whole * BLOCK].reshape(whole, BLOCK, 3), at[BLOCK - 1 : whole * BLOCK : BLOCK]
        rest, at = rest[whole * BLOCK :], at[whole * BLOCK :]
        equal = (np.abs(np.diff(x, axis=1)) < SAME_RAD_S).sum(axis=1) >= LEAST_EQUAL
        evidence[~equal.any(axis=0)] = 0.0
        for i in np.flatnonzero(equal.any(axis=1)):
            for j in range(3):
                found = step_of(x[i, :, j]) if equal[i, j] else 0.0
                if found > 0.0 and abs(found - step[j]) > NEAR * found:
                    step[j], evidence[j] = found, 0.0
                if found > 0.0 and is_noise(x[i, :, j] / found):
                    evidence[j] += weigh(np.rint(x[i, :, j] / found))
                else:
                    evidence[j] = 0.0
            blocks = blocks + 1 if evidence.any() else 0
            cut, dead = evidence.sum(axis=0).tolist()
            if cut > DECIDES and dead > 0.0 and blocks >= LEAST_BLOCKS:
                return Truncation(step, int(ends[i]) + 1)
            if cut < -2.0 * DECIDES:
                return None
    return None


def step_of(x: Array) -> float:
    """Return the step of the grid on which readings (n,) lie, 0 without one."""
    values = np.sort(x)
    gaps = np.diff(values)
    gaps = np.sort(gaps[gaps > SAME_RAD_S])
    step = float(gaps[len(gaps) // 2]) if len(gaps) else 0.0
    if step < LEAST_STEP_RAD_S:
        return 0.0
    k = values / step
    return step if np.mean(np.abs(k - np.rint(k)) < NEAR) >= ON_GRID else 0.0


def is_noise(x: Array) -> bool:
    """Return whether readings (n,) in steps, half a step put back, are white and normal."""
    x = x + np.copysign(0.5, x) * (np.abs(x) > 0.5)
    n, mean, variance = len(x), x.mean(), x.var()
    if not (variance > 1.0 and abs(mean) > LEAST_MEAN):
        return False
    x = x - mean
    x = x / math.sqrt(variance)
    skew, excess = np.mean(x**3), np.mean(x**4) - 3.0
    if n / 6.0 * (skew * skew + 0.25 * excess * excess) > NORMAL:
        return False
    return white(x) and white((x * x - 1.0) / math.sqrt(excess + 2.0))


def white(x: Array) -> bool:
    """Return whether readings (n,) of mean 0 and spread 1 do not depend on those before."""
    n = len(x)
    total = sum((np.dot(x[lag:], x[:-lag]) / n) ** 2 / (n - lag) for lag in range(1, LAGS + 1))
    return bool(n * (n + 2.0) * total < WHITE)


def weigh(k: Array) -> Array:
    """Return the evidence (2,) of readings (n,) in steps: cut over rounded, cut over a dead zone."""
    counts = np.array([np.count_nonzero(k == cell) for cell in (-1.0, 0.0, 1.0)])
    likely = [cells(k, counts[1], edge) for edge in (0.5, 1.0, 1.5)]
    if min(p.min() for p in likely) <= 0.0:
        return np.zeros(2)
    rounded, cut, dead = (float(counts @ np.log(p)) for p in likely)
    return np.array([cut - rounded, cut - dead])


def cells(k: Array, zeros: int, edge: float) -> Array:
    """Return the probabilities (3,) of cells -1, 0, 1 among themselves, the middle one up to +-``edge``."""
    x = k + np.sign(k) * (edge - 0.5)
    mean = x.mean()
    # A cell of width w widens the spread by w^2 / 12.
    square = x.var() - (1.0 + (4.0 * edge * edge - 1.0) * zeros / len(k)) / 12.0
    if square < 1.0:
        return np.zeros(3)
    p = np.diff([math.erf((x - mean) / math.sqrt(2.0 * square)) for x in (-edge - 1.0, -edge, edge, edge + 1.0)])
    return np.asarray(p / p.sum()) if p.sum() > 1e-3 else np.zeros(3)
