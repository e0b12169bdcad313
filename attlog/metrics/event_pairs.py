"""An event in two attitudes: each as a rotation from its own mid-step, about the event's own axis.

A constant body misalignment between the two is found over all events and taken out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from attlog import rotation
from attlog.metrics.steps import Event

Array = NDArray[np.float64]

RANGE_S = 0.25
"""A delay is looked for up to this far on both sides."""
LARGEST_TURN_DEG = 120.0
"""Beyond, the rotation vector from mid-step may take the other way round."""
RIDGE_DEG = 5.0
"""A misalignment larger than this is not believed without much evidence."""
MIN_SAMPLES = 4


@dataclass(slots=True)
class Track:
    """An attitude over time: ``t`` (n,) s, ``q`` (n, 4), ``segment`` (n,) counts segments that must not be crossed."""

    t: Array
    q: Array
    segment: NDArray[np.int64]
    step: float = field(init=False)
    """Median time between samples, s."""
    moves: dict[tuple[Event, float], Move | None] = field(init=False, default_factory=dict)
    """What :func:`own_move` found, for the rows that are compared with this attitude."""

    def __post_init__(self) -> None:
        self.step = float(np.median(np.diff(self.t))) if len(self.t) > 1 else math.inf


@dataclass(slots=True)
class Move:
    """A segment of an attitude around an event: rotation vectors (n, 3) in deg from its sample nearest mid-step."""

    t: Array
    turn: Array
    middle: float


@dataclass(slots=True)
class Relative:
    """One event: rotation vectors (n, 3) in deg of both attitudes, each from its own attitude at mid-step."""

    event: Event
    t_ref: Array
    ref: Array
    t_est: Array
    est: Array


@dataclass(slots=True)
class Pair:
    """One event in both attitudes, deg about the event's own axis, each relative to its own attitude at mid-step."""

    event: Event
    t_ref: Array
    ref: Array
    t_est: Array
    est: Array


def misalignment(moves: list[Relative], delay: float, slow: bool) -> Array:
    """The constant body rotation (rotation vector (3,), rad) between estimate and reference, small angles, ridge 5 deg.

    est = k ref + phi x ref + c over all samples of all events; a constant mounting
    difference shows best in yaw turns. ``slow``: at the row's own times.
    """
    if not moves:
        return np.zeros(3)
    refs, ests = [], []
    for m in moves:
        if slow:
            ref, est = _at(m.t_est - delay, m.t_ref, m.ref), m.est
        else:
            ref, est = m.ref, _at(m.t_ref + delay, m.t_est, m.est)
        refs.append(ref - np.mean(ref, axis=0))
        ests.append(est - np.mean(est, axis=0))
    x, y = np.concatenate(refs), np.concatenate(ests)
    square = float(np.sum(x * x))
    y = y - float(np.sum(x * y)) / max(square, 1e-30) * x
    ridge = float(np.mean(np.sum(y * y, axis=1))) / np.radians(RIDGE_DEG) ** 2
    normal = (square + max(ridge, 1e-12)) * np.eye(3) - x.T @ x
    return np.linalg.solve(normal, np.sum(np.cross(x, y), axis=0))


def _at(at: Array, t: Array, x: Array) -> Array:
    return np.column_stack([np.interp(at, t, x[:, k]) for k in range(x.shape[1])])


def on_axis(moves: list[Relative], body: Array, est_step: float, ref_step: float) -> list[Pair]:
    """The rotation of each event about its own axis, ``body`` (rad) taken out of the estimate.

    The faster of the two is smoothed over the sampling interval of the slower one.
    """
    back = rotation.conjugate(rotation.from_rotvec(body))
    found = []
    for m in moves:
        near = np.sum(m.ref**2, axis=1) <= LARGEST_TURN_DEG**2
        stroke = np.flatnonzero(near & (m.t_ref >= m.event.onset) & (m.t_ref <= m.event.t90))
        if len(stroke) < 2:
            continue
        axis = m.ref[stroke[-1]] - m.ref[stroke[0]]
        length = float(np.linalg.norm(axis))
        if length < 1e-6:
            continue
        axis *= math.copysign(1.0 / length, m.event.delta_deg)
        t_ref, ref, t_est, est = m.t_ref, m.ref @ axis, m.t_est, rotation.rotate(back, m.est) @ axis
        if is_slower(est_step, ref_step):
            t_ref, ref = smoothed(t_ref, ref, round(est_step / ref_step))
        else:
            t_est, est = smoothed(t_est, est, round(ref_step / est_step))
        pair = Pair(m.event, t_ref, ref, t_est, est)
        if len(compared(pair, 0.0, is_slower(est_step, ref_step))[0]) >= MIN_SAMPLES:
            found.append(pair)
    return found


def is_slower(est_step: float, ref_step: float) -> bool:
    """Whether the row is slower than the reference, which is then interpolated to the row's own times."""
    return est_step > 1.05 * ref_step


def smoothed(t: Array, x: Array, count: int) -> tuple[Array, Array]:
    """Local parabolas over about ``count`` samples, values and times alike (Savitzky & Golay 1964, order 2).

    A plain mean over the interval of a 10 Hz reference would round off the step and read
    a pure delay of 7.3 ms as 8.1.
    """
    half = count // 2
    if half < 2 or len(t) <= 2 * half + 1:
        return t, x
    u = np.arange(-half, half + 1)
    kernel = np.linalg.pinv(np.vander(u, 3, increasing=True).astype(np.float64))[0]
    return np.convolve(t, kernel, "valid"), np.convolve(x, kernel, "valid")


def relative(est: Track, ref: Track, events: list[Event], delay: float) -> list[Relative]:
    """Both attitudes around each event as rotations from their own attitude at mid-step.

    The estimate's own mid-step is ``delay`` (s) later. Events that one of them does not
    cover without a gap are left out, and samples that turned more than 120 deg.
    """
    found = (_relative(est, ref, event, delay) for event in events)
    return [m for m in found if m is not None]


def own_move(track: Track, event: Event, reach: float) -> Move | None:
    """The attitude from ``reach`` s before to after an event's window, from its own mid-step; None if not covered."""
    if (event, reach) not in track.moves:
        track.moves[event, reach] = _own_move(track, event, reach)
    return track.moves[event, reach]


def _own_move(track: Track, event: Event, reach: float) -> Move | None:
    part = segment(track, event, reach)
    if part is None or track.t[part][0] > event.onset or track.t[part][-1] < event.t90:
        return None
    t, q = track.t[part], track.q[part]
    if not np.isfinite(q).all():
        return None
    middle = int(np.argmin(np.abs(t - event.middle)))
    return Move(t, _turned(q[middle], q), float(t[middle]))


def segment(track: Track, event: Event, reach: float) -> slice | None:
    """The samples around an event that belong to the segment of its mid-step; None for fewer than 4."""
    i, j = np.searchsorted(track.t, [event.begin - reach, event.end + reach])
    middle = min(int(np.searchsorted(track.t, event.middle)), len(track.t) - 1)
    same = np.flatnonzero(track.segment[i:j] == track.segment[middle])
    return None if len(same) < MIN_SAMPLES else slice(int(same[0] + i), int(same[-1] + i) + 1)


def _turned(start: Array, q: Array) -> Array:
    return np.degrees(rotation.to_rotvec(rotation.multiply(rotation.conjugate(start), q)))


def _relative(est: Track, ref: Track, event: Event, delay: float) -> Relative | None:
    margin = RANGE_S + 2.0 * max(est.step, ref.step)
    own = own_move(ref, event, margin if is_slower(est.step, ref.step) else 0.0)
    part = segment(est, event, margin)
    if own is None or part is None:
        return None
    t_ref, r_ref, t_est, q_est = own.t, own.turn, est.t[part], est.q[part]
    early, late = min(delay, 0.0), max(delay, 0.0)
    covered = t_est[0] <= event.onset - 0.1 + early and t_est[-1] >= event.t90 + 0.3 + late
    if not covered or not np.isfinite(q_est).all():
        return None
    r_est = _turned(rotation.slerp(t_est, q_est, own.middle + delay)[0], q_est)
    if is_slower(est.step, ref.step):
        use = np.sum(r_est**2, axis=1) <= LARGEST_TURN_DEG**2
        use &= (t_est - late >= t_ref[0]) & (t_est - early <= t_ref[-1])
        t_est, r_est = t_est[use], r_est[use]
    else:
        use = np.sum(r_ref**2, axis=1) <= LARGEST_TURN_DEG**2
        use &= (t_ref + early >= t_est[0]) & (t_ref + late <= t_est[-1])
        t_ref, r_ref = t_ref[use], r_ref[use]
    if use.sum() < MIN_SAMPLES:
        return None
    return Relative(event, t_ref, r_ref, t_est, r_est)


def compared(pair: Pair, delay: float, slow: bool) -> tuple[Array, Array, Array]:
    """Times, reference and estimate ``delay`` s later, at the slower one's own samples within the event's window."""
    own = pair.t_est if slow else pair.t_ref
    use = (own >= pair.event.begin) & (own <= pair.event.end)
    t = own[use]
    if slow:
        return t, np.interp(t - delay, pair.t_ref, pair.ref), pair.est[use]
    return t, pair.ref[use], np.interp(t + delay, pair.t_est, pair.est)
