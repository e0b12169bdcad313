"""Who is tilted where the vehicle stands still? Gravity there says it of any attitude, with no filter between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.estimators.evidence.still import still_windows, tilt_residual, within
from attlog.flight.model import Attitude, FlightLog, Imu
from attlog.reference import clock, trim
from attlog.reference.compare import interpolate
from attlog.reference.model import Reference
from attlog.segments import gaps, spans
from attlog.segments.once import asked_once
from attlog.segments.spans import Span

Array = NDArray[np.float64]

SOUND_DEG = 2.5
"""Nearly all sound onboard attitudes stay within this of gravity; accelerometer biases make half of it."""
REFUSED_DEG, SIGMAS, FLOOR_DEG = 3.0, 3.0, 1.0
"""A judge that is further from gravity, in degrees and in its sigmas (with 1 deg of the accelerometer's own)."""
DOUBTED_DEG, TWICE = 2.0, 2.0
"""Or by this, and so many times as far as the attitude it judges."""
BORDER_S = 1.0
"""A window this near borders a span."""
FEWEST = 3
"""Windows; a single one may be a slow landing."""
WRONG_DEG = 5.0
"""Twice what sound attitudes show: an onboard attitude that is this far from gravity is no reference."""
SHARE, SHARE_OF_ALL = 0.5, 0.2
"""A judge that is refused in so much of the still time, and of all, is refused throughout."""


@dataclass(frozen=True, slots=True, eq=False)
class StillResiduals:
    """Angles (k,) in deg to gravity over still ``windows`` (k, 2) s: of the judge and of the ``accused`` attitude.

    ``sigma`` (k,) deg is the judge's own of its tilt. NaN where an attitude is not known.
    """

    windows: Array
    judge: Array
    accused: Array
    sigma: Array

    def medians(self, span: Span) -> tuple[float, float] | None:
        """The median of judge and accused over windows within a span, else over those at its ends; None without."""
        known = np.isfinite(self.judge) & np.isfinite(self.accused)
        begin, end = self.windows.T
        inside = known & (begin >= span[0]) & (end <= span[1])
        if not inside.any():
            inside = known & (end >= span[0] - BORDER_S) & (begin <= span[1] + BORDER_S)
        if not inside.any():
            return None
        return float(np.median(self.judge[inside])), float(np.median(self.accused[inside]))

    def acquits(self, span: Span) -> bool:
        """Whether gravity, as far as the vehicle stands still in or beside a span, speaks for the accused."""
        found = self.medians(span)
        return found is not None and not (found[1] > SOUND_DEG and found[1] > found[0])

    def refusing(self) -> list[tuple[Span, float, float, float]]:
        """Where gravity refuses the judge: span, its median, the accused's (NaN if unknown) and the judge's sigma."""
        with np.errstate(invalid="ignore"):
            bad = self.judge > np.maximum(REFUSED_DEG, SIGMAS * np.hypot(self.sigma, FLOOR_DEG))
            bad |= (self.judge > DOUBTED_DEG) & (self.judge > TWICE * self.accused)
        found = []
        for begin, end in spans.merge([(float(a), float(b)) for a, b in self.windows[bad]]):
            there = bad & (self.windows[:, 0] >= begin) & (self.windows[:, 1] <= end)
            if np.count_nonzero(there) < FEWEST:
                continue
            accused = self.accused[there]
            theirs = float(np.nanmedian(accused)) if np.isfinite(accused).any() else np.nan
            found.append(
                ((begin, end), float(np.median(self.judge[there])), theirs, float(np.median(self.sigma[there])))
            )
        return found


def residuals(log: FlightLog, judge: Reference, attitude: Attitude | None) -> StillResiduals | None:
    """What gravity says of a reference and of a logged attitude; None where the vehicle is never still."""
    imu = log.replay_imu
    if imu is None or not len(windows := still(imu)):
        return None
    q = judge.q if judge.trim is None else trim.apply(judge.q, -judge.trim)
    of_judge = _residual(imu, windows, judge.t, q, judge.gap_segment)
    of_accused = np.full(len(windows), np.nan)
    if attitude is not None:
        t, q, _ = clock.usable(attitude, judge.clock)
        if attitude.has_trim and log.trim is not None:
            q = trim.apply(q, -log.trim)
        of_accused = _residual(imu, windows, t, q, gaps.number(t))
    own = judge.sigma_tilt_deg
    middle = windows.mean(axis=1)
    sigma = np.zeros(len(windows)) if own is None or not len(own) else np.interp(middle, judge.t, own)
    before = middle < judge.scoring_start  # while filters settle nothing is judged
    of_judge[before] = np.nan
    return StillResiduals(windows, of_judge, of_accused, sigma)


def refusal(found: StillResiduals, judge: Reference, name: str) -> tuple[str, list[Span]]:
    """Why gravity refuses a judge throughout (empty where it does not), and the spans in which it does.

    What was estimated from one gap to the next is refused as a whole where it is refused in most of its still time and
    in a fifth of all. ``name`` is the accused attitude's.
    """
    bad = found.refusing()
    if not bad:
        return "", []
    wrong = [span for span, *_ in bad]
    known = spans.merge([(float(a), float(b)) for a, b in found.windows[np.isfinite(found.judge)]])
    refused, whole = list[Span](), 0
    numbers = np.unique(judge.gap_segment)
    for number in numbers:
        t = judge.t[judge.gap_segment == number]
        own = [(float(t[0]), float(t[-1]))]
        seconds = spans.seconds(spans.intersect(wrong, own))
        most = seconds > SHARE * spans.seconds(spans.intersect(known, own))
        throughout = most and seconds > SHARE_OF_ALL * (own[0][1] - own[0][0])
        refused += own if throughout else spans.intersect(wrong, own)
        whole += throughout
    if whole < len(numbers):
        return "", refused
    (begin, end), residual, accused, sigma = max(bad, key=lambda one: one[0][1] - one[0][0])
    other = f", {name} {accused:.1f} deg" if np.isfinite(accused) else ""
    why = f"standing still from {begin:.0f} to {end:.0f} s it is {residual:.1f} deg off gravity (sigma {sigma:.1f})"
    return why + other, refused


def wrong(found: StillResiduals, name: str, judge: str) -> str:
    """Why gravity says that ``name`` is tilted and the judge is not, over all still time; empty where it does not."""
    medians = found.medians((-np.inf, np.inf))
    if medians is None or medians[1] <= max(WRONG_DEG, medians[0]) or medians[0] > SOUND_DEG:
        return ""
    return f"standing still {name} is {medians[1]:.1f} deg off gravity, {judge} {medians[0]:.1f} deg"


@asked_once
def still(imu: Imu) -> Array:
    """The still windows (k, 2) s of a unit."""
    n = min(len(imu.acc.t_best), len(imu.acc.x), len(imu.gyro.x))
    t, x = gaps.rising(imu.acc.t_best[:n], np.column_stack([imu.gyro.x[:n], imu.acc.x[:n]]))
    return still_windows(t, x[:, :3], x[:, 3:])


def _residual(imu: Imu, windows: Array, t: Array, q: Array, segment: NDArray[np.int64]) -> Array:
    """Angle (k,) in deg between gravity and an attitude (n, 4) at ``t`` (n,), of the IMU, over still windows."""
    at, force = gaps.rising(imu.acc.t_best, imu.acc.x)
    use = within(windows, at)
    at, force = at[use], force[use]
    turned, _ = interpolate(t, rotation.normalize(q), segment, at)
    return tilt_residual(windows, at, force, turned)
