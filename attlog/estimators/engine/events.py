"""Aids as a step gets them: which measurement belongs to which sample, as rows of one table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.aids import (
    AIRSPEED,
    ALT,
    AT_REST,
    BARO,
    LAT,
    POS_H_ACC,
    POS_V_ACC,
    SIZE,
    VEL_ACC,
    VEL_D,
    VEL_E,
    VEL_N,
    Aids,
    Measurements,
)
from attlog.estimators.base import Array, Estimator


@dataclass(frozen=True, slots=True)
class Events:
    """``table[row[k]]`` is the ``aid`` of sample k, ``table[quiet[k]]`` the one of a step in which nothing arrives.

    ``row``, ``quiet`` (n,), ``table`` (m, SIZE).
    """

    row: NDArray[np.int64]
    quiet: NDArray[np.int64]
    table: Array


def events(estimator: Estimator, aids: Aids | None, t: Array, declination: float = 0.0) -> Events:
    """The aids that the estimator uses, each at the first sample at or after its time.

    ``t`` (n,) rising. Of several between two samples the newest is kept. The loop takes no
    step at the first sample of a segment, so what arrived until then, and in the gap before,
    is left out; so is what comes after the last sample. Steps know magnetic north only:
    velocities are turned to it by the ``declination`` (rad).
    """
    aids = aids or Aids()
    quiet = np.zeros(len(t), np.int64)
    base = np.full((3, SIZE), np.nan)
    if "at_rest" in estimator.uses:
        # Rows 0, 1, 2 hold nothing new: rest unknown, in motion, at rest.
        quiet = aids.resting(t) + 1
        base[1:, AT_REST] = 0.0, 1.0
    arrivals: list[tuple[NDArray[np.int64], int, Array]] = []
    for name, m, parts in (
        ("gnss", aids.position, (slice(LAT, ALT + 1), slice(POS_H_ACC, POS_V_ACC + 1))),
        ("gnss", aids.velocity, (slice(VEL_N, VEL_D + 1), slice(VEL_ACC, VEL_ACC + 1))),
        ("baro", aids.baro, (slice(BARO, BARO + 1), None)),
        ("airspeed", aids.airspeed, (slice(AIRSPEED, AIRSPEED + 1), None)),
    ):
        if name in estimator.uses and m is not None:
            arrivals += _arrivals(m, parts, t)
    hit = np.zeros(len(t), bool)
    for at, _, _ in arrivals:
        hit[at] = True
    where = np.flatnonzero(hit)
    table = np.vstack([base, base[quiet[where]]])
    row = quiet.copy()
    row[where] = len(base) + np.arange(len(where))
    for at, column, values in arrivals:
        # Samples come in the order of time, so the newest overwrites the older ones.
        table[row[at], column] = values
    if declination:
        north, east = table[:, VEL_N].copy(), table[:, VEL_E].copy()
        table[:, VEL_N] = np.cos(declination) * north + np.sin(declination) * east
        table[:, VEL_E] = np.cos(declination) * east - np.sin(declination) * north
    return Events(row, quiet, table)


def _arrivals(
    m: Measurements, parts: tuple[slice, slice | None], t: Array
) -> list[tuple[NDArray[np.int64], int, Array]]:
    """Sample number, column and value of everything that ``m`` tells."""
    at = np.searchsorted(t, m.t, side="left")
    inside = at < len(t)
    found = []
    for part, x in zip(parts, (m.x, m.sigma), strict=True):
        if part is None or x is None:
            continue
        columns = x.reshape(len(m.t), -1)[inside]
        found += [(at[inside], part.start + i, columns[:, i]) for i in range(columns.shape[1])]
    return found
