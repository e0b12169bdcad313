"""Axes and offset of the logged accelerometer against the onboard attitude and the GNSS velocity.

Turned to earth axes by a right attitude, the mean specific force is the acceleration by GNSS less gravity. Where it is
not, accelerometer or attitude is wrong. A fault of the accelerometer is fixed to the body, and it moves the mean force
in flight away from the thrust axis or from the size of gravity; an error of the attitude does neither.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.log_cache import cached_per_log
from attlog.core.sorting import median, unique
from attlog.flight.model import FIX_3D, Array, FlightLog, Gnss
from attlog.reference import alignment, gyro_checks
from attlog.segments import Segments, increments, model
from attlog.segments.model import interpolate_attitudes

GRAVITY_M_S2 = 9.80665
# Length of a mean force, and of the means that are turned to earth axes: a vehicle hardly turns within those.
PIECE_S, STEP_S = 2.0, 0.1
# Smallest share of a piece with samples; smallest number of pieces, and of those in the air.
MIN_PIECE_SHARE, MIN_PIECES, MIN_FLOWN_PIECES = 0.5, 10, 5
# Largest misfit of the right axes or offset, and smallest of wrong ones (3 deg of tilt).
MAX_MISFIT_M_S2, MIN_MISFIT_M_S2 = 1.0, 0.5
# Smallest ratio of two misfits (squared: 4, as of the health check of axes). On 68 flights with sound accelerometers
# other axes fit up to 1.3 times better.
MIN_MISFIT_RATIO = 2.0
# Offset of a sound accelerometer: it may explain a misfit, so that no exchange of axes is needed.
USUAL_OFFSET_M_S2 = 1.0
# Smallest horizontal offset and turn that are faults: the tilt to gravity that refuses an attitude.
MIN_OFFSET_M_S2, MIN_TURN_DEG = 1.7, 10.0
# Smallest angle of the mean force to the thrust axis that shows it, and one that no wind makes.
MIN_THRUST_ANGLE_DEG, FAR_THRUST_ANGLE_DEG = 5.0, 30.0
# Smallest misfit of the force's size, which no attitude changes: vertical offsets of sound units stay below.
MIN_SIZE_MISFIT_M_S2 = 0.5
# Most times tried for a step of the offset; limit of a misfit in the search, so that it finds the most pieces.
MAX_STEP_TIMES, MAX_COUNTED_MISFIT_M_S2 = 60, 2.0
ROUNDS = 3  # of reweighting
# Every order and sign of three axes, mirror images too: x and y exchanged is one.
SIGNED_ORDERS = [np.eye(3)[list(p)] * signs for p in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)]


@dataclass(frozen=True, slots=True, eq=False)
class ForcePieces:
    """Means over pieces from ``t`` (k,) s, PIECE_S long.

    ``turn`` (k, 3, 3): R to earth axes; ``products`` (k, 3, 3, 3): R_ij times force f_l; ``body`` (k, 3): force in body
    axes; ``expected`` (k, 3): force in earth axes by GNSS; m/s^2. ``flown`` (k,): in the air, else at rest or idling.
    """

    t: Array
    turn: Array
    products: Array
    body: Array
    expected: Array
    flown: NDArray[np.bool_]

    def select(self, use: NDArray[np.bool_] | slice) -> ForcePieces:
        """Return the selected pieces."""
        means = self.t[use], self.turn[use], self.products[use], self.body[use], self.expected[use]
        return ForcePieces(*means, self.flown[use])

    def excess(self, axes: Array | None = None) -> Array:
        """Return the forces (k, 3) in earth axes beyond the expected ones, with other ``axes`` (3, 3)."""
        force = np.einsum("kijl,jl->ki", self.products, np.eye(3) if axes is None else axes)
        return np.asarray(force - self.expected)

    def misfits(self, offset: Array | float = 0.0, axes: Array | None = None) -> Array:
        """Return the sizes (k,) of the excess less an ``offset`` (3,) in body axes."""
        return rotation.length(self.excess(axes) - self.turn @ np.broadcast_to(offset, 3))


@cached_per_log
def accelerometer_fault(log: FlightLog, segments: Segments) -> str:
    """Return why axes or offset of the replayed accelerometer are wrong by the force in flight, or empty."""
    pieces = force_pieces(log, segments)
    if pieces is None:
        return ""
    found = exchanged_axes(pieces.select(pieces.flown)) or large_offset(pieces)
    return "" if not found or _gyro_differs(log, segments) else f"turned by {log.onboard}, {found}"


def _gyro_differs(log: FlightLog, segments: Segments) -> bool:
    """Return whether the whole IMU, not the accelerometer alone, has other axes than the attitude."""
    imu, attitude = log.replay_imu, log.onboard_attitude
    if imu is None or attitude is None:
        return False
    mag = None if log.mag is None else log.mags[log.mag]
    jumps, _ = increments.known_resets(log, log.onboard or "", segments)
    return bool(gyro_checks.gyro_consistency(imu, attitude, jumps, mag).of)


def exchanged_axes(pieces: ForcePieces) -> str:
    """Return how much better other axes of the accelerometer fit pieces in the air, or empty."""
    if len(pieces.t) < MIN_PIECES:
        return ""
    usual, _ = _body_fit(pieces.turn, pieces.excess())
    usual *= min(1.0, USUAL_OFFSET_M_S2 / max(float(rotation.length(usual)), 1e-9))
    as_logged = min(float(median(pieces.misfits(offset))) for offset in (np.zeros(3), usual))
    if as_logged < MIN_MISFIT_M_S2:
        return ""
    best = min(float(median(pieces.misfits(axes=axes))) for axes in SIGNED_ORDERS)
    if best > min(MAX_MISFIT_M_S2, as_logged / MIN_MISFIT_RATIO):
        return ""
    ratio = as_logged / max(best, 0.01)
    return f"other axes of the accelerometer fit the GNSS velocity {ratio:.1f} times better: its axes are wrong"


def large_offset(pieces: ForcePieces) -> str:
    """Return which offset, from when on, or which turn of the accelerometer makes a wrong force fit, or empty.

    Two of three must show that it is no error of the attitude: no constant in earth axes fits as well; the mean force
    in the air comes nearer to the thrust axis (by far: this alone); the force gets the size of the expected one.
    """
    after, offset = _offset_step(pieces)
    horizontal = float(rotation.length(offset[:2]))
    if horizontal >= MIN_OFFSET_M_S2 and _is_fixed_to_body(after, after.misfits(offset), after.body - offset):
        since = "" if len(after.t) == len(pieces.t) else f"from {after.t[0]:.0f} s on "
        values = ", ".join(f"{axis} {x:+.1f}" for axis, x in zip("xyz", offset, strict=True))
        return f"the accelerometer fits the GNSS velocity {since}only less {values} m/s^2: its offset is wrong"
    in_body = np.einsum("kij,ki->kj", pieces.turn, pieces.expected)
    turn = rotation.nearest_rotation(in_body.T @ pieces.body)
    angle = float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(turn) - 1.0), -1.0, 1.0))))
    if angle > MIN_TURN_DEG and _is_fixed_to_body(pieces, pieces.misfits(axes=turn), pieces.body @ turn.T):
        return f"the accelerometer fits the GNSS velocity only when turned by {angle:.0f} deg: its mounting is wrong"
    return ""


def _is_fixed_to_body(pieces: ForcePieces, misfits: Array, mended: Array) -> bool:
    """Return whether ``mended`` body forces (k, 3) with ``misfits`` (k,) show a fault of the accelerometer."""
    flown, left = pieces.flown, float(median(misfits))
    if np.count_nonzero(flown) < MIN_FLOWN_PIECES:
        return False
    if left > min(MAX_MISFIT_M_S2, float(median(pieces.misfits())) / MIN_MISFIT_RATIO):
        return False
    excess, expected = pieces.excess(), rotation.length(pieces.expected)
    in_earth = rotation.length(excess - median(excess, axis=0))
    angles, sizes = list[float](), list[float]()
    for body in (pieces.body, mended):
        x, y, z = np.mean(body[flown], axis=0)
        angles.append(float(np.degrees(np.arctan2(np.hypot(x, y), -z))))
        sizes.append(float(median(np.abs(rotation.length(body) - expected))))
    shown = (
        any(size(in_earth) > MIN_MISFIT_RATIO * size(misfits) for size in (median, _capped_rms)),
        angles[0] > max(MIN_THRUST_ANGLE_DEG, MIN_MISFIT_RATIO * angles[1]),
        sizes[0] > max(MIN_SIZE_MISFIT_M_S2, MIN_MISFIT_RATIO * sizes[1]),
    )
    return sum(shown) >= 2 or (shown[1] and angles[0] > FAR_THRUST_ANGLE_DEG)


def _capped_rms(misfits: Array) -> float:
    """Return the root mean square of misfits (k,), each up to a limit."""
    return float(np.sqrt(np.mean(np.minimum(misfits, MAX_COUNTED_MISFIT_M_S2) ** 2)))


def _offset_step(pieces: ForcePieces) -> tuple[ForcePieces, Array]:
    """Return the pieces from a step of the offset on, and the offset (3,) from then on; all pieces without a step."""
    found: list[tuple[float, int, Array]] = []
    excess = pieces.excess()
    before = np.cumsum(np.minimum(rotation.length(excess), MAX_COUNTED_MISFIT_M_S2) ** 2)
    for k in unique(np.linspace(0, len(pieces.t) - MIN_PIECES, MAX_STEP_TIMES).astype(int)).tolist():
        offset, misfits = _body_fit(pieces.turn[k:], excess[k:])
        cost = float(np.sum(np.minimum(misfits, MAX_COUNTED_MISFIT_M_S2) ** 2)) + (float(before[k - 1]) if k else 0.0)
        # a step must explain one piece more
        found.append((cost + (MAX_COUNTED_MISFIT_M_S2**2 if k else 0.0), k, offset))
    _, k, offset = min(found, key=lambda one: one[0])
    return pieces.select(slice(k, None)), offset


def _body_fit(turn: Array, excess: Array) -> tuple[Array, Array]:
    """Return the offset (3,) in body axes that fits best, by reweighted least squares, and the misfits (k,) left."""
    square = np.einsum("kij,kil->kjl", turn, turn).reshape(-1, 9)
    moment = np.einsum("kij,ki->kj", turn, excess)
    weight, offset, misfits = np.ones(len(excess)), np.zeros(3), rotation.length(excess)
    for _ in range(ROUNDS):
        normal = (weight @ square).reshape(3, 3) + 1e-9 * np.eye(3)
        offset = np.linalg.solve(normal, weight @ moment)
        misfits = rotation.length(excess - turn @ offset)
        weight = 1.0 / np.maximum(1.0, misfits / max(float(median(misfits)), 1e-6))
    return offset, misfits


def force_pieces(log: FlightLog, segments: Segments) -> ForcePieces | None:
    """Return mean forces of the replayed IMU, in the air with a GNSS velocity and at rest; None for too few."""
    imu, attitude = log.replay_imu, log.onboard_attitude
    receiver = max(log.gnss, key=lambda g: np.count_nonzero(_has_velocity(g)), default=None)
    if imu is None or attitude is None or receiver is None:
        return None
    known = _has_velocity(receiver)
    fixes_t, velocity = model.select_rising(receiver.t[known], receiver.vel_ned[known])
    t, q, _ = alignment.usable_samples(attitude, "sample")
    at, force = model.select_rising(*_means(imu.acc.t_best, imu.acc.x))
    if len(fixes_t) < 2 or len(at) < MIN_PIECES or len(t) < 2:
        return None
    q = alignment.untrim(q, log.parameters.trim if attitude.has_trim else None)
    turned, _ = interpolate_attitudes(t, q, model.number_segments(t), at)
    good = rotation.finite_rows(turned)
    at, force, turn = at[good], force[good], rotation.to_matrix(turned[good])
    starts = [(a, b, True) for a, b in segments.spans("airborne")]
    starts += [(s.t0, s.t1, False) for kind in ("rest", "idle") for s in segments.of(kind)]
    begin = np.array([(x, flown) for a, b, flown in sorted(starts) for x in np.arange(a, b - PIECE_S + 1e-9, PIECE_S)])
    if len(begin) < MIN_PIECES or len(at) < MIN_PIECES:
        return None
    begin, flown = begin[:, 0], begin[:, 1] > 0.0
    first, last = (np.searchsorted(at, x) for x in (begin, begin + PIECE_S))
    fixes = [np.searchsorted(fixes_t, x) for x in (begin, begin + PIECE_S)]
    measured = (fixes[0] > 0) & (fixes[1] < len(fixes_t)) & (fixes[1] - fixes[0] >= 2)
    use = (last - first >= MIN_PIECE_SHARE * PIECE_S / STEP_S) & (measured | ~flown)
    begin, flown, first, last = begin[use], flown[use], first[use], last[use]
    if len(begin) < MIN_PIECES:
        return None
    expected = np.tile([0.0, 0.0, -GRAVITY_M_S2], (len(begin), 1))
    ends = [np.column_stack([np.interp(x, fixes_t, v) for v in velocity.T]) for x in (begin, begin + PIECE_S)]
    expected[flown] += (ends[1] - ends[0])[flown] / PIECE_S
    products = [np.einsum("nij,nl->ijl", turn[a:b], force[a:b]) / (b - a) for a, b in zip(first, last, strict=True)]
    turns, body = ([np.mean(x[a:b], axis=0) for a, b in zip(first, last, strict=True)] for x in (turn, force))
    return ForcePieces(begin, np.array(turns), np.array(products), np.array(body), expected, flown)


def _has_velocity(receiver: Gnss) -> NDArray[np.bool_]:
    return np.asarray((receiver.fix >= FIX_3D) & rotation.finite_rows(receiver.vel_ned))


def _means(t: Array, force: Array) -> tuple[Array, Array]:
    """Return times (n,) and forces (n, 3) averaged over STEP_S."""
    t, force = model.select_rising(t, force)
    if not len(t):
        return t, force
    first = np.flatnonzero(np.diff(((t - t[0]) / STEP_S).astype(np.int64), prepend=-1))
    count = np.diff(np.append(first, len(t)))
    return np.add.reduceat(t, first) / count, np.add.reduceat(force, first, axis=0) / count[:, None]
