"""A gyro whose digits are cut off, not rounded: found in its readings, and half a step put back.

Readings on a grid of step q are k q with whole k. Rounded, k = 0 stands for rates from -q/2 to q/2; cut towards zero,
for -q to q, and every other reading is half a step too small. A bias found at rest is then wrong by up to half a step
in motion: 0.03 deg/s, or 3.7 deg of heading in two minutes, for 16 bits over 2000 deg/s. Noise of more than a step
shows which it is, because it fills the cells k = -1, 0, 1 in proportion to their widths:

    log-likelihood of the reading among k = -1, 0, 1, cut less rounded, summed while |k| <= 1

for a normal density with the mean and spread of the readings around. A third kind, a dead zone of three steps, must
fit worse than the cut as well. No setting is fitted to data.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import jit

Array = NDArray[np.float64]
# Differences of rad/s below which two readings are equal but for the last digits of single precision.
SAME_RAD_S = math.radians(1e-5)
# Half of a smaller step turns by less than 3.6 deg in an hour: not worth finding, and readings in float end here.
LEAST_STEP_RAD_S = math.radians(0.002)
# Readings on each side of one that show mean and spread of the noise there.
SIDE = 16
# Of so many steps about zero the readings show the grid: farther out the error of its step adds up.
GRID_STEPS = 50.0
# Fewest of these readings, the share that lie on the grid, and how near, in steps.
LEAST_READINGS, ON_GRID, NEAR = 20, 0.95, 0.05
# Log-likelihood ratio that decides: 3000 to 1.
DECIDES = 8.0
# Probability of the cells k = -1, 0, 1 below which a reading there is no noise about the mean.
LEAST_PROBABILITY = 1e-3


class Axis(NamedTuple):
    """Columns of what is known of an axis: its step, or -1 for no multiples; readings, those on the grid, evidence."""

    step: int = 0
    seen: int = 1
    on_grid: int = 2
    cut: int = 3
    dead: int = 4


A = Axis()


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
    """Find whether a gyro's readings (n, 3) rad/s are cut towards zero; None if that never shows."""
    axes = np.zeros((3, len(A)))
    readings = find_truncation(axes, np.ascontiguousarray(gyr))
    return Truncation(axes[:, A.step].copy(), readings) if readings else None


@jit.loop("gyros that cut their digits")
def find_truncation(axes: jit.Out2, gyr: jit.F2) -> int:
    """Return after how many readings (n, 3) a cut towards zero has shown, 0 if it never does.

    ``axes`` (3, 5) zeros; its first column then holds each axis's step, 0 without a grid.
    """
    for i in range(1, len(gyr)):
        counted = False
        for j in range(3):
            look_for_step(axes, abs(gyr[i, j] - gyr[i - 1, j]), j)
            if axes[j, A.step] > 0.0:
                check_grid(axes, gyr[i, j], j)
                counted = (i >= 2 * SIDE and weigh(axes, gyr, i - SIDE, j)) or counted
        if counted:
            cut, dead = 0.0, 0.0
            for j in range(3):
                cut += axes[j, A.cut] if gridded(axes, j) else 0.0
                dead += axes[j, A.dead] if gridded(axes, j) else 0.0
            if cut > DECIDES and dead > 0.0:
                for j in range(3):
                    axes[j, A.step] = axes[j, A.step] if gridded(axes, j) else 0.0
                return i + 1
        if axes[0, A.step] < 0.0 and axes[1, A.step] < 0.0 and axes[2, A.step] < 0.0:
            return 0
    return 0


def gridded(axes: Any, j: int) -> bool:
    """Return whether an axis's readings lie on a grid."""
    seen = axes[j, A.seen]
    return bool(axes[j, A.step] > 0.0 and seen >= LEAST_READINGS and axes[j, A.on_grid] >= ON_GRID * seen)


def look_for_step(axes: Any, difference: float, j: int) -> None:
    """Take the smallest difference of successive readings for the step, -1 if it is too small; begin again with it."""
    step = axes[j, A.step]
    if step < 0.0 or not difference >= SAME_RAD_S or (step > 0.0 and difference > (1.0 - NEAR) * step):
        return
    for m in range(axes.shape[1]):
        axes[j, m] = 0.0
    axes[j, A.step] = difference if difference >= LEAST_STEP_RAD_S else -1.0


def check_grid(axes: Any, rate: float, j: int) -> None:
    """Count a reading near zero, and whether it is a multiple of the step."""
    x = rate / axes[j, A.step]
    if abs(x) < GRID_STEPS:
        axes[j, A.seen] += 1.0
        axes[j, A.on_grid] += 1.0 if abs(x - whole(x)) < NEAR else 0.0


def whole(x: float) -> float:
    """Return the nearest whole number."""
    return float(np.floor(x + 0.5))


def weigh(axes: Any, gyr: Any, i: int, j: int) -> bool:
    """Weigh reading ``i`` by its neighbours, and return whether it counted.

    It counts where on both sides the mean square of jumps from reading to reading is that of noise of a step or more:
    each reading is then news. A slow turn, or a halt after a fast one, may dwell in a cell.
    """
    step = axes[j, A.step]
    k = whole(gyr[i, j] / step)
    if not abs(k) <= 1.0:
        return False
    total, square = 0.0, 0.0
    for side in range(2):
        jumps, last = 0.0, 0.0
        for m in range(SIDE):
            x = whole(gyr[i + 1 + m if side else i - 1 - m, j] / step)
            total += x
            square += x * x
            jumps += (x - last) ** 2 if m else 0.0
            last = x
        if not jumps > 2.0 * (SIDE - 1):
            return False
    mean = total / (2 * SIDE)
    spread = math.sqrt(square / (2 * SIDE) - mean * mean)
    lost = math.copysign(min(abs(mean), 0.5), mean)
    rounded = share(k, 0.5, mean, spread)
    cut = share(k, 1.0, mean + lost, spread)
    dead = share(k, 1.5, mean + 2.0 * lost, spread)
    if not (rounded > 0.0 and cut > 0.0 and dead > 0.0):
        return False
    axes[j, A.cut] += math.log(cut / rounded)
    axes[j, A.dead] += math.log(cut / dead)
    return True


def share(k: float, edge: float, mean: float, spread: float) -> float:
    """Return the probability of cell k among -1, 0, 1, the middle one up to +-``edge``; 0 where all three are rare."""
    low, minus = below(-edge - 1.0, mean, spread), below(-edge, mean, spread)
    plus, high = below(edge, mean, spread), below(edge + 1.0, mean, spread)
    if high - low < LEAST_PROBABILITY:
        return 0.0
    return (plus - minus if k == 0.0 else minus - low if k < 0.0 else high - plus) / (high - low)


def below(x: float, mean: float, spread: float) -> float:
    """Return the normal distribution's probability below x."""
    return 0.5 + 0.5 * math.erf((x - mean) / (spread * math.sqrt(2.0)))
