"""Where a time stands among ascending times, in loops that ask one time after the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def last_before(t: NDArray[np.float64], x: float, i: int, last: int) -> int:
    """The highest number up to ``last`` whose time (n,) is not after ``x``, 0 if none; looked for from ``i`` on."""
    if x < t[i]:
        i = 0
    step = 1
    while i + step <= last and t[i + step] <= x:  # doubled steps, then bisection
        i += step
        step *= 2
    high = min(i + step, last + 1)
    while high - i > 1:
        middle = (i + high) // 2
        if t[middle] <= x:
            i = middle
        else:
            high = middle
    return i
