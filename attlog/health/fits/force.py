"""The accelerometer in flight: turned to earth, its force must change the velocity as GNSS sees it.

At rest a level vehicle tells neither which axis is which nor how large an offset is beside its attitude's own tilt.
Between two GNSS velocities the mean force does: with the attitude R, the logged force f and gravity g,
``dv/dt - g = R (A f + b)``. A near the unit matrix is a sound sensor; exchanged or reversed axes make it another
permutation; -b is the offset. Only the horizontal axes are solved for: f_z holds the vehicle up and says too little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Array, FlightLog, Gnss, Imu
from attlog.health.fits.regression import RobustFit, fit, interval
from attlog.health.model import Check, not_judged
from attlog.reference import trim
from attlog.reference.model import Reference
from attlog.segments.model import Segments
from attlog.segments.spans import Span, inside

AXES, OFFSET = "force axes", "force offset"
OVER_S = 2.0
"""Velocities change over so long: a receiver's noise of 0.1 m/s is then 0.07 m/s^2."""
EDGE_S, LEAST_S, LONGEST_S = 1.0, 20.0, 900.0
"""Left out at both ends of a flight, where the ground pushes; how much flight tells something; and of long logs the
first minutes, which are enough."""
LATE_S = np.arange(0.0, 0.61, 0.1)
"""How late a receiver may be: of these the one that fits best."""
G = 9.80665
TILT_M_S2 = {"truth": 0.01, "smoother": 0.05, "onboard": 0.1}
"""Gravity that a tilted attitude shows: 0.06, 0.3 and 0.6 deg (onboard, on flights with truth: 0.3 to 0.9). A truth
that was brought says itself how tilted it may be."""
LEAST_M_S2 = 0.15
"""Horizontal force (RMS about its mean) that shows which axis is which."""
CLEARLY = 4.0
"""Another order of axes leaves so many times less (squared)."""
FITS = 0.5
"""Of the force's own spread, at most so much may be left by the axes that are found."""
OFF_M_S2, FAR_M_S2 = 0.17, 0.5
"""1 and 3 deg of tilt, as of an accelerometer's offset by the smoother."""
SIGMAS, FLOOR_M_S2 = 4.0, 0.03
"""Offered above four times sqrt((1.5 standard errors)^2 + 0.03^2); planted 0.3 came back within two."""
LIMIT = f"ok up to {OFF_M_S2} m/s^2 or {SIGMAS:.0f} sigma, fault above {FAR_M_S2} (1 and 3 deg of tilt)"
AXES_LIMIT = f"fault: other axes leave {CLEARLY:.0f} times less of the force (squared) unexplained"
ORDERS: dict[str, Array] = {
    "x and y are exchanged": np.array([[0.0, 1.0], [1.0, 0.0]]),
    "x and y are both reversed": -np.eye(2),
    "x is reversed": np.diag([-1.0, 1.0]),
    "y is reversed": np.diag([1.0, -1.0]),
    "it is turned by 90 deg": np.array([[0.0, -1.0], [1.0, 0.0]]),
    "it is turned by -90 deg": np.array([[0.0, 1.0], [-1.0, 0.0]]),
}


@dataclass(frozen=True, slots=True)
class ForceFit:
    """What the flight says of the accelerometer's horizontal axes. ``columns`` (n, 2, 8), ``y`` (n, 2), ``t`` (n,) s.

    The columns are A by rows, b, and two of a constant tilt of the attitude.
    """

    solution: RobustFit
    columns: Array
    y: Array
    t: Array
    seconds: float

    def left(self, order: Array) -> float:
        """Median square that the axes in this order (2, 2) leave, whatever the offsets."""
        rest = self.y - self.columns[:, :, :4] @ order.ravel()
        rest = rest - self.columns[:, :, 4:] @ np.concatenate([self.solution.x[4:6], self.solution.x[6:8]])
        return float(np.median(np.sum((rest - np.median(rest, axis=0)) ** 2, axis=1)))

    @property
    def spread(self) -> float:
        """RMS of the measured horizontal force about its mean, m/s^2."""
        force = np.stack([self.columns[:, :, 0], self.columns[:, :, 1]])
        size = np.sqrt(np.sum(force**2, axis=2))
        return float(np.sqrt(np.sum(np.var(size, axis=1))))


def checks(log: FlightLog, segments: Segments, reference: Reference | None) -> list[Check]:
    """Axes and offset of the accelerometer by GNSS; nothing where nothing flew or no velocity was logged."""
    if log.replay_imu is None or not log.gnss or not segments.of("airborne"):
        return []
    if reference is None or reference.kind == "none":
        why = "No attitude in this log can turn the force to earth."
        return [not_judged(AXES, why, AXES_LIMIT), not_judged(OFFSET, why, LIMIT)]
    found = measured(log, segments, reference)
    if found is None:
        why = f"Less than {LEAST_S:.0f} s of flight have a GNSS velocity."
        return [not_judged(AXES, why, AXES_LIMIT), not_judged(OFFSET, why, LIMIT)]
    axes = _axes(log, found, reference)
    return [axes] if axes.verdict == "fault" else [axes, _offset(log, found, reference)]


def _axes(log: FlightLog, found: ForceFit, reference: Reference) -> Check:
    source = log.imus[log.imu or 0].acc.source
    usual = found.left(np.eye(2))
    name, best = min(((n, found.left(order)) for n, order in ORDERS.items()), key=lambda pair: pair[1])
    shown = f"{len(found.t)} changes of the GNSS velocity in {found.seconds:.0f} s of flight"
    if found.spread < LEAST_M_S2:
        why = f"The horizontal force hardly changes in flight ({found.spread:.2f} m/s^2)."
        return not_judged(AXES, why, AXES_LIMIT)
    clear = best * CLEARLY < usual and np.sqrt(best) < FITS * found.spread
    if not clear:
        text = f"{source} fits {shown}, turned by {reference.source}."
        return Check(AXES, "ok", text, round(float(np.sqrt(usual)), 3), "m/s^2", AXES_LIMIT)
    times = np.sqrt(usual / max(best, 1e-12))
    text = f"{source}: {name} against {shown}, turned by {reference.source}; that leaves {times:.1f} times less."
    return Check(AXES, "fault", text, round(float(np.sqrt(usual)), 3), "m/s^2", AXES_LIMIT)


def _offset(log: FlightLog, found: ForceFit, reference: Reference) -> Check:
    source = log.imus[log.imu or 0].acc.source
    offset = -found.solution.x[4:6]
    sigma = np.hypot(1.5 * found.solution.sigma[4:6], FLOOR_M_S2)
    worst = int(np.argmax(np.abs(offset) - SIGMAS * sigma))
    size, unsure = float(offset[worst]), float(sigma[worst])
    if unsure * SIGMAS > FAR_M_S2:
        why = f"The flight shows the offset to {1.96 * unsure:.2f} m/s^2 only (95 %)."
        return not_judged(OFFSET, why, LIMIT)
    told = abs(size) > max(OFF_M_S2, SIGMAS * unsure)
    verdict = "ok" if not told else "warning" if abs(size) <= FAR_M_S2 else "fault"
    text = f"{source} reads {size:+.2f} m/s^2 too much in {'xy'[worst]} ({interval(size, unsure, 2)}, 95 %) by "
    text += f"{len(found.t)} changes of the GNSS velocity in {found.seconds:.0f} s, turned by {reference.source}."
    return Check(OFFSET, verdict, text, round(size, 3), "m/s^2", LIMIT)


def measured(log: FlightLog, segments: Segments, reference: Reference) -> ForceFit | None:
    """The fit over all flights up to the reference's end; None where too little was flown with GNSS."""
    imu, gnss = log.replay_imu, _receiver(log)
    spans = [(a + EDGE_S, min(b - EDGE_S, reference.end)) for a, b in segments.spans("airborne")]
    spans = _first([(a, b) for a, b in spans if b - a > 2.0 * OVER_S], LONGEST_S)
    if imu is None or gnss is None or sum(b - a for a, b in spans) < LEAST_S:
        return None
    start, end, change = _changes(gnss, spans)
    turned = _turned(imu, reference, spans)
    if turned is None or len(start) < LEAST_S / OVER_S:
        return None
    best: ForceFit | None = None
    for late in LATE_S:
        means, known = turned.means(start - late, end - late)
        t, y = end[known], change[known] - means[known][:, :, 8]
        if len(t) < LEAST_S / OVER_S:
            continue
        columns = means[known][:, :, :8]
        prior = np.array([np.inf] * 6 + [_tilt_m_s2(reference)] * 2)
        solution = fit(t, columns, y, prior)
        if solution is not None and (best is None or solution.scatter < best.solution.scatter):
            best = ForceFit(solution, columns, y, t, float(np.sum(np.minimum(np.diff(t), OVER_S))))
    return best


def _tilt_m_s2(reference: Reference) -> float:
    usual = TILT_M_S2[reference.kind]
    return usual if reference.fit is None else max(usual, G * math.radians(reference.fit.sigma_tilt_deg))


def _first(spans: list[Span], seconds: float) -> list[Span]:
    """The first spans, so many seconds of them together."""
    kept: list[Span] = []
    for a, b in spans:
        left = seconds - sum(end - begin for begin, end in kept)
        if left > 0.0:
            kept.append((a, min(b, a + left)))
    return kept


def _receiver(log: FlightLog) -> Gnss | None:
    """The receiver with the most velocities of a 3D fix."""
    return max(log.gnss, key=lambda g: np.count_nonzero(_usable(g)), default=None)


def _usable(gnss: Gnss) -> Array:
    return np.asarray((gnss.fix >= 3) & rotation.finite(gnss.vel_ned[:, :2]))


def _changes(gnss: Gnss, spans: list[tuple[float, float]]) -> tuple[Array, Array, Array]:
    """Begin and end (n,) s of pairs OVER_S apart, half of that from pair to pair, and mean accelerations (n, 2)."""
    use = _usable(gnss).astype(bool)
    t, first = np.unique(gnss.t[use], return_index=True)
    velocity = gnss.vel_ned[use][first, :2]
    none = np.zeros(0, np.int64)
    starts, ends = [none], [none]
    for a, b in spans:
        mine = np.flatnonzero((t >= a) & (t <= b))
        if len(mine) < 3:
            continue
        every = max(1, round(0.5 * OVER_S / max(float(np.median(np.diff(t[mine]))), 1e-3)))
        i = mine[::every]
        j = np.searchsorted(t, t[i] + OVER_S - 1e-6)
        good = (j <= mine[-1]) & (t[np.minimum(j, len(t) - 1)] - t[i] < 1.5 * OVER_S)
        starts.append(i[good])
        ends.append(j[good])
    i, j = np.concatenate(starts), np.concatenate(ends)
    return t[i], t[j], (velocity[j] - velocity[i]) / (t[j] - t[i])[:, None]


class TurnedForce:
    """Sums over time of the force's parts in earth axes, so that their mean over any span costs the same."""

    def __init__(self, t: Array, force: Array, q: Array) -> None:
        turn = rotation.to_matrix(q)[:, :2, :]
        parts = [turn[:, :, i] * force[:, j : j + 1] for i in (0, 1) for j in (0, 1)]
        parts += [turn[:, :, 0], turn[:, :, 1]]
        constant = np.zeros((len(t), 2, 2))
        constant[:, 0, 0] = constant[:, 1, 1] = 1.0
        every = np.concatenate([np.stack(parts, axis=2), constant, (turn[:, :, 2] * force[:, 2:3])[:, :, None]], axis=2)
        dt = np.diff(t, prepend=t[0])
        self.t, self.hole = t, np.cumsum(dt > 0.2)
        self.sums = np.cumsum(every * np.minimum(dt, 0.2)[:, None, None], axis=0).reshape(len(t), -1)

    def means(self, start: Array, end: Array) -> tuple[Array, Array]:
        """Means (n, 2, 9) over spans, and which of them (n,) lie between samples without a hole."""
        i = np.clip(np.searchsorted(self.t, [start, end]), 1, len(self.t) - 1)
        known = (start > self.t[0]) & (end < self.t[-1]) & (self.hole[i[0]] == self.hole[i[1]])
        share = [(x - self.t[k - 1]) / (self.t[k] - self.t[k - 1]) for x, k in ((start, i[0]), (end, i[1]))]
        first, last = (
            self.sums[k - 1] + s[:, None] * (self.sums[k] - self.sums[k - 1])
            for s, k in zip(share, (i[0], i[1]), strict=True)
        )
        return ((last - first) / (end - start)[:, None]).reshape(-1, 2, 9), known


def _turned(imu: Imu, reference: Reference, spans: list[Span]) -> TurnedForce | None:
    """The force with the reference's attitude of the IMU, where both are known, in and shortly before ``spans``."""
    own = reference.q if reference.trim is None else trim.apply(reference.q, -reference.trim)
    near = inside(imu.acc.t_best, [(a - LATE_S[-1] - EDGE_S, b) for a, b in spans])
    t, force = imu.acc.t_best[near], imu.acc.x[near]
    q, _ = rotation.interpolated(reference.t, own, reference.gap_segment, t)
    good = rotation.finite(q) & rotation.finite(force)
    t, first = np.unique(t[good], return_index=True)
    return None if len(t) < 100 else TurnedForce(t, force[good][first], q[good][first])
