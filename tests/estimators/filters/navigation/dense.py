"""The transition of the smoother's states as a matrix, which its kernels never form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from attlog.estimators.filters.navigation.motion import SUM_T, WANDER, N, forward_rows, matrices, padded, square


def transition_matrix(sums: Any, rest: int, tau: float) -> Any:
    """The dense Phi (39, 39) over a node's ``sums``; ``tau`` s: how long the position error of GNSS wanders."""
    M, Phi = np.zeros((5, 3, 3)), padded(np.eye(N))
    matrices(sums, rest, M[0], M[1], M[2], M[3], M[4])
    forward_rows(Phi, sums[SUM_T], M, rest)
    dense = square(Phi)
    dense[WANDER : WANDER + 3] *= math.exp(-sums[SUM_T] / tau)
    return dense
