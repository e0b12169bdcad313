"""Do filters that agree with each other, and the mean force, contradict the reference (onboard attitude, smoother)?

A filter that differs from the reference may be wrong. Where several different filters
stay together and the reference alone is elsewhere, the mean specific force decides:
turned to earth axes less the change of velocity it must be gravity. Without GNSS a smoother shares
the model of ``mekf`` and what that gets wrong: where only these two stand together, it is no reference.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.base.errors import AttlogError
from attlog.flight.model import FlightLog, Imu
from attlog.reference import scoring, smoothed, trim
from attlog.reference.compare import interpolate
from attlog.reference.model import AlignmentStep, Reference, Row
from attlog.reference.physics import sensor_faults
from attlog.segments import gaps

Array = NDArray[np.float64]

G = 9.80665
FILTERS = 3
"""So many different filters must agree, and they must be most of those that ran."""
TOGETHER_DEG, APART_DEG, TIMES = 8.0, 15.0, 2.5
"""Median distance of filters from their common down, and the least distance of the reference, also in these units."""
SHARE, LEAST_S = 0.2, 2.0
"""For a fifth of the scored time, and 2 s without a break."""
RIGHT_M_S2, WRONG_M_S2 = 1.0, 2.0
"""What is left of the mean force without gravity: by the filters at most, by the reference at least."""
SAME_MODEL = "mekf"
"""The filter whose model a smoother without GNSS has."""
CLOSE_DEG, ALONE_DEG, ALONE_SIGMAS = 3.0, 5.0, 4.0
"""Filters of other models stay this close to their common down, and the smoother is further from it than 5 deg, four of
its sigmas (three joint ones) and 2.5 times their spread."""
SAMPLES = 4000
DOWN = np.array([0.0, 0.0, 1.0])


class ReferenceCheck:
    """What rows that pass one by one say of a reference: each one's down at the reference's times, and no more.

    ``again`` gives the whole of a row that has passed, which is run once more: only where filters speak against the
    reference. Nothing is asked of a reference that was chosen by hand (``choice``), of filters that share a gyro which
    did not turn so, because they agree in what is wrong, and of a force in wrong axes, which does not say who is right.
    """

    def __init__(
        self, log: FlightLog, imu: Imu, reference: Reference, again: Callable[[Row], Row], choice: str = "auto"
    ) -> None:
        self._log, self._imu, self._reference, self._again = log, imu, reference, again
        use = np.flatnonzero(scoring.scored(reference, reference.t))
        self._use = use[:: max(1, len(use) // SAMPLES)].copy()  # the few alone: all are as many as the log's samples
        sound = not reference.gyro_fault and sensor_faults.FRAME not in reference.sensor_faults
        checked = choice == "auto" and sound and reference.kind in ("onboard", "smoother")
        self._asked = checked and len(self._use) >= 10
        self._heard: dict[str, tuple[Row, Array]] = {}

    def add(self, row: Row) -> None:
        """Take what a row says; of several rows of a filter the last one counts."""
        own = row.imu is None or row.imu.index == self._imu.index
        if self._asked and own and row.kind == "replay" and len(row.t) > 1 and row.estimator != smoothed.NAME:
            self._heard[row.estimator] = row, _down(row.t, row.q, row.segment, self._reference.t[self._use])

    def contradicted(self) -> tuple[str, AlignmentStep] | None:
        """Why an onboard attitude or a smoother is refused, and the numbers; None where filters and force agree."""
        if len(self._heard) < FILTERS:
            return None
        filters, downs = [row for row, _ in self._heard.values()], np.stack([d for _, d in self._heard.values()])
        found = _judged(self._log, self._imu, self._reference, filters, downs, self._use, self._again)
        return found or _alone(self._reference, [row.estimator for row in filters], downs, self._use)


def contradicted(
    log: FlightLog, imu: Imu, reference: Reference, rows: Sequence[Row]
) -> tuple[str, AlignmentStep] | None:
    """What :class:`ReferenceCheck` find in rows that are all at hand."""
    check = ReferenceCheck(log, imu, reference, lambda row: row)
    for row in rows:
        check.add(row)
    return check.contradicted()


def _judged(
    log: FlightLog,
    imu: Imu,
    reference: Reference,
    filters: Sequence[Row],
    downs: Array,
    use: NDArray[np.int64],
    again: Callable[[Row], Row],
) -> tuple[str, AlignmentStep] | None:
    """The verdict over filters by their ``downs`` (k, m, 3) at samples ``use`` (m,) of the reference."""
    t = reference.t[use]
    shared = np.isfinite(downs).all(axis=2).sum(axis=0) >= FILTERS
    if shared.sum() < 10:
        return None
    t, use, downs = t[shared], use[shared], downs[:, shared]
    own_down = rotation.rotate_inverse(reference.q[use], DOWN)
    common = np.nanmedian(downs, axis=0)
    common /= np.sqrt(np.sum(common**2, axis=1, keepdims=True))
    distance = _angle(downs, common)
    typical = np.array([np.median(d[np.isfinite(d)]) if np.isfinite(d).any() else np.inf for d in distance])
    near = np.flatnonzero(typical <= TOGETHER_DEG)
    if len(near) < max(FILTERS, (len(filters) + 1) // 2):
        return None
    spread = np.max(np.nan_to_num(distance[near]), axis=0)
    angles = _angle(own_down, common)
    off = angles > np.maximum(APART_DEG, TIMES * spread)
    spans = [s for s in gaps.slices(off, reference.segment[use]) if t[s.stop - 1] - t[s.start] >= LEAST_S]
    seconds = sum(float(t[s.stop - 1] - t[s.start]) for s in spans)
    if not spans or seconds < SHARE * _seconds(t, reference.segment[use]):
        return None
    longest = max(spans, key=lambda s: float(t[s.stop - 1] - t[s.start]))
    t0, t1 = float(t[longest.start]), float(t[longest.stop - 1])
    try:
        nearest = again(filters[int(near[np.argmin(typical[near])])])
    except AttlogError:
        return None
    by_filter = _mean_force(imu, reference, nearest.t, nearest.q, nearest.segment, t0, t1)
    by_reference = _mean_force(imu, reference, reference.t, reference.q, reference.segment, t0, t1)
    if by_filter is None or by_reference is None:
        return None
    gravity = np.array([0.0, 0.0, -G]) + _acceleration(log, t0, t1)
    right, wrong = (float(np.sqrt(np.sum((f - gravity) ** 2))) for f in (by_filter, by_reference))
    if right > RIGHT_M_S2 or wrong < WRONG_M_S2:
        return None
    angle = float(np.median(angles[longest]))
    who = "all" if len(near) == len(filters) else "most"
    fault = f"{reference.source} is wrong by {angle:.0f} deg: {who} filters agree, and their mean force is gravity"
    text = (
        f"Filters stay within {np.median(spread):.0f} deg of each other; from {t0:.1f} to {t1:.1f} s the mean force is "
        f"{_shown(by_filter)} m/s^2 (north, east, down) by them and {_shown(by_reference)} by {reference.source}"
    )
    return fault, AlignmentStep("contradiction", text, angle, "deg", reference.source, False)


def _alone(
    reference: Reference, names: Sequence[str], downs: Array, use: NDArray[np.int64]
) -> tuple[str, AlignmentStep] | None:
    """The verdict over a smoother without GNSS from which all models but its own stay away together.

    ``downs`` (k, m, 3) of the filters ``names`` (k,) at samples ``use`` (m,) of the reference.
    """
    sigma = reference.sigma_tilt_deg
    if reference.kind != "smoother" or sigma is None or "gnss" in str(reference.quality.get("aided_by", "")).split():
        return None
    others = downs[[name != SAME_MODEL for name in names]]
    shared = np.isfinite(others).all(axis=(0, 2))
    if len(others) < FILTERS or shared.sum() < 10:
        return None
    use, others = use[shared], others[:, shared]
    common = np.median(others, axis=0)
    common /= np.sqrt(np.sum(common**2, axis=1, keepdims=True))
    distance = _angle(others, common)
    near = np.median(distance, axis=1) <= CLOSE_DEG
    if near.sum() < max(FILTERS, (len(others) + 1) // 2):
        return None
    own = _angle(rotation.rotate_inverse(reference.q[use], DOWN), common)
    spread = distance[near].max(axis=0)
    alone = own > np.maximum(np.maximum(ALONE_DEG, ALONE_SIGMAS * sigma[use]), TIMES * spread)
    t, segment = reference.t[use], reference.segment[use]
    spans = [s for s in gaps.slices(alone, segment) if t[s.stop - 1] - t[s.start] >= LEAST_S]
    if not spans or sum(float(t[s.stop - 1] - t[s.start]) for s in spans) < SHARE * _seconds(t, segment):
        return None
    angle = float(np.median(own[spans[0]]))
    fault = (
        f"{near.sum()} of {len(others)} filters of other models agree with each other, {angle:.0f} deg from it: only "
        f"{SAME_MODEL}, whose model it shares, can be with it"
    )
    return fault, AlignmentStep("agreement", fault, angle, "deg", reference.source, False)


def _seconds(t: Array, segment: NDArray[np.int64]) -> float:
    """Time in s that samples (n,) cover without breaks."""
    dt = np.diff(t)
    return float(dt[np.diff(segment) == 0].sum())


def _down(t: Array, q: Array, segment: NDArray[np.int64], at: Array) -> Array:
    """Earth's down in body axes (n, 3) at times, NaN where the row has no attitude."""
    turned, _ = interpolate(t, q, segment, at)
    found: Array = np.full((len(at), 3), np.nan)
    good = rotation.finite(turned)
    found[good] = rotation.rotate_inverse(turned[good], DOWN)
    return found


def _angle(a: Array, b: Array) -> Array:
    """Angles in deg between unit vectors (..., 3)."""
    angle: Array = np.degrees(np.arccos(np.clip(np.sum(a * b, axis=-1), -1.0, 1.0)))
    return angle


def _mean_force(
    imu: Imu, reference: Reference, t: Array, q: Array, segment: NDArray[np.int64], t0: float, t1: float
) -> Array | None:
    """Mean specific force (3,) in earth axes by an attitude over [t0, t1] s; None without both."""
    at = imu.acc.t_best
    inside = np.flatnonzero((at >= t0) & (at <= t1) & rotation.finite(imu.acc.x))
    inside = inside[:: max(1, len(inside) // SAMPLES)]
    turned, _ = interpolate(t, q, segment, at[inside])
    good = rotation.finite(turned)
    if good.sum() < 10:
        return None
    turned = turned[good] if reference.trim is None else trim.apply(turned[good], -reference.trim)
    mean: Array = rotation.rotate(turned, imu.acc.x[inside][good]).mean(axis=0)
    return mean


def _acceleration(log: FlightLog, t0: float, t1: float) -> Array:
    """Mean acceleration (3,) m/s^2 NED by GNSS between the ends of [t0, t1] s; zero where the log does not tell."""
    for gnss in log.gnss:
        good = (gnss.fix >= 3) & rotation.finite(gnss.vel_ned)
        if good.sum() > 3 and gnss.t[good][0] <= t0 + 1.0 and gnss.t[good][-1] >= t1 - 1.0:
            ends = [np.interp(x, gnss.t[good], gnss.vel_ned[good, k]) for x in (t0, t1) for k in range(3)]
            change: Array = (np.array(ends[3:]) - np.array(ends[:3])) / (t1 - t0)
            return change
    return np.zeros(3)


def _shown(force: Array) -> str:
    return " ".join(f"{x:.2f}" for x in force + 0.0)
