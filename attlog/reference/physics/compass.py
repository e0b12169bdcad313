"""Are the axes of the compass those of the gyro? What the field does in turns tells all but a sign of the whole.

The direction of the earth's field stays where it is while the vehicle turns. Taken to other axes it does not, unless
the vehicle turns about the one axis that both frames share. The sign of the whole shows in the dip alone
(:mod:`attlog.reference.physics.dip`).
"""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Array, FlightLog
from attlog.reference.physics.turning import CLEARLY, LEAST_FIELD_DEG, LEAST_INTERVALS, field_changes
from attlog.segments import increments

MOST = 4000
"""Pairs of directions that are looked at: a long flight tells no more."""
EXPLAINED = 9.0
"""Other axes leave so many times less of the field's change (squared) than there is: iron that turns with the vehicle
makes a field that hardly changes, which any frame along it explains."""


def other_axes(log: FlightLog) -> str:
    """Which axes of the compass are swapped or reversed, as a sentence; empty where they are right or nothing tells.

    All 24 ways to name three axes (a sign of all three together does not show): one of them must leave a ninth of the
    field's change (squared), and a third of what the logged axes leave.
    """
    imu, mag = log.replay_imu, None if log.mag is None else log.mags[log.mag]
    if imu is None or mag is None:
        return ""
    start, end, before, after = field_changes(mag)
    turning = increments.of(imu)
    inside = np.flatnonzero(turning.known(start, end))
    inside = inside[:: len(inside) // MOST + 1]
    if len(inside) < LEAST_INTERVALS:
        return ""
    turned = rotation.to_matrix(rotation.from_rotvec(turning.between(start[inside], end[inside])))
    known = np.isfinite(turned).all(axis=(1, 2))
    turned, before, after = turned[known], before[inside][known], after[inside][known]
    if len(turned) < LEAST_INTERVALS:
        return ""
    left = [_left(turned, before @ axes.T, after @ axes.T) for axes in FRAMES]
    change = float(np.mean(np.sum((after - before) ** 2, axis=1)))
    best = int(np.argmin(left))
    own = np.degrees(np.sqrt(left[0]))
    if best == 0 or own < LEAST_FIELD_DEG or left[0] < CLEARLY * left[best] or change < EXPLAINED * left[best]:
        return ""
    return (
        f"{mag.field.source} does not turn as the gyro does ({own:.1f} deg in 0.3 s): it does with "
        f"{_named(FRAMES[best])} ({np.degrees(np.sqrt(left[best])):.1f} deg)"
    )


def _left(turned: Array, before: Array, after: Array) -> float:
    """The mean square of what is left of the field's change (n, 3) after the turn (n, 3, 3)."""
    return float(np.mean(np.sum((np.einsum("nji,nj->ni", turned, before) - after) ** 2, axis=1)))


def _frames() -> list[Array]:
    """The 24 signed permutations with the determinant 1, the identity first."""
    eye = np.eye(3)
    every = [
        eye[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return sorted((axes for axes in every if np.linalg.det(axes) > 0), key=lambda axes: -np.trace(axes))


FRAMES = _frames()


def _named(axes: Array) -> str:
    """Where the axes come from: ``y and x swapped`` is said as ``x = -y, y = -x, z = -z``, or its mirror image.

    Of the two (all signs the other way round turn alike) the one with fewer signs.
    """
    mirrored = axes if np.sum(axes < 0) <= np.sum(axes > 0) else -axes
    said = []
    for k, row in enumerate(mirrored):
        source = int(np.argmax(np.abs(row)))
        if source != k or row[source] < 0:
            said.append(f"{'xyz'[k]} = {'-' if row[source] < 0 else ''}{'xyz'[source]}")
    return ", ".join(said)
