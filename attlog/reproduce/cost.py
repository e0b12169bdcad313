"""What an update of a filter costs: processor time of kernels that are compiled alike, over the same samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog import estimators

Array = NDArray[np.float64]
ROUNDS, UPDATES, REPEATS, RATE_HZ = 9, 4000, 7, 400.0
MEASURED = f"Processor time of {UPDATES:,} updates, compiled alike, {ROUNDS} runs in turn."


@dataclass(frozen=True, slots=True)
class CostSamples:
    """A slow swing in noise: ``gyr`` rad/s, ``acc`` m/s^2, ``mag`` uT (n, 3) at ``t`` (n,) s."""

    t: Array
    gyr: Array
    acc: Array
    mag: Array


def swing(updates: int = UPDATES) -> CostSamples:
    """The samples that every filter is timed with."""
    rng = np.random.default_rng(0)
    t = np.arange(updates) / RATE_HZ
    turn = np.sin(np.outer(t, [1.0, 1.3, 0.7]))
    acc = np.array([0.0, 0.0, -9.81]) + turn + 0.05 * rng.standard_normal(turn.shape)
    return CostSamples(t, 0.3 * turn, acc, np.array([20.0, 0.0, 40.0]) + turn)


def nanoseconds(
    rows: Sequence[str], every: int | None = 1, rounds: int = ROUNDS, updates: int = UPDATES, repeats: int = REPEATS
) -> dict[str, list[float]]:
    """Nanoseconds per update of each filter, ``rounds`` times in turn.

    ``every`` how many updates a new field comes, None: never. Of ``repeats`` runs of a round the fastest counts: the
    others were interrupted by something.
    """
    s = swing(updates)
    mag = None
    if every is not None:
        mag = s.mag.copy()
        mag[np.arange(updates) % every != 0] = np.nan
    found: dict[str, list[float]] = {row: [] for row in rows}
    for _ in range(rounds):
        for row, spent in found.items():
            times = [estimators.estimate(row, s.t, s.gyr, s.acc, mag).ns_per_update for _ in range(repeats)]
            spent.append(min(times))
    return found
