"""Is the onboard attitude the wrong one? Its difference from the smoother, in degrees and in the smoother's sigmas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog import rotation
from attlog.flight.model import Array, FlightLog
from attlog.health.model import Check
from attlog.median import median
from attlog.reference import clock, scoring, trim
from attlog.reference.compare import interpolate
from attlog.reference.model import Reference
from attlog.reference.smoothed import apart_deg
from attlog.segments import gaps, resets
from attlog.segments.model import Segments
from attlog.segments.spans import Span

NAME = "onboard against smoother"
SIGMAS = 3.0
"""What lies within three sigmas of the smoother may be the smoother's own error."""
OFF_DEG, WRONG_DEG = {"tilt": 3.0, "heading": 10.0}, {"tilt": 10.0, "heading": 30.0}
"""What is worth a look, and what is wrong: onboard attitudes are off by 0.3 to 1.5 deg in tilt and 0.3 to 3 deg in
heading on flights with truth."""
LEAST_S = {"tilt": 5.0, "heading": 10.0}
MOUNTED = 0.3
"""What is left of a tilt error that a turn of the sensor explains, at most."""
LIMIT = "good up to 3 deg of tilt and 10 deg of heading, or 3 sigma of the smoother"


@dataclass(frozen=True, slots=True)
class Off:
    """How long (s) an angle of the onboard attitude is off, the longest span of it, its median and sigma there, deg."""

    angle: str
    seconds: float
    longest: Span
    size: float
    sigma: float
    wrong: bool
    """Whether it is not only off but the wrong attitude."""

    @property
    def text(self) -> str:
        """``tilt 18.2 deg off (sigma 0.3) from 320 s to 345 s, 51 s in all``."""
        first, last = self.longest
        more = "" if self.seconds < 1.2 * (last - first) else f", {self.seconds:.0f} s in all"
        return f"{self.angle} {self.size:.1f} deg off (sigma {self.sigma:.1f}) from {first:.0f} s to {last:.0f} s{more}"


def checks(log: FlightLog, segments: Segments, reference: Reference | None) -> list[Check]:
    """Tilt and heading of the attitude that flew against the smoother; nothing where that is not the reference."""
    attitude = log.onboard_attitude
    if reference is None or reference.kind != "smoother" or attitude is None:
        return []
    t, q, _ = clock.usable(attitude, reference.clock)
    if reference.trim is not None and not attitude.has_trim:
        q = trim.apply(q, reference.trim)
    index, _ = resets.known(log, log.onboard or "", segments)
    aligned = scoring.aligned_at(attitude, index, segments)
    counted = scoring.scored(reference, t) & (t >= (-np.inf if aligned is None else aligned))
    tilt, heading = apart_deg(reference, t, q)
    counted &= np.isfinite(tilt)
    if np.count_nonzero(counted) < 2 or reference.sigma_tilt_deg is None or reference.sigma_heading_deg is None:
        return []
    angles = {"tilt": (tilt, np.interp(t, reference.t, reference.sigma_tilt_deg))}
    if reference.heading_by == "own":
        angles["heading"] = (np.abs(heading), np.interp(t, reference.t, reference.sigma_heading_deg))
    found = [
        off for angle, (size, sigma) in angles.items() if (off := _off(angle, t, size, sigma, counted, gaps.number(t)))
    ]
    usual = ", ".join(_usual(angle, size[counted], sigma[counted]) for angle, (size, sigma) in angles.items())
    if not found:
        return [Check(NAME, "good", f"{log.onboard} differs from the smoother by {usual}.", threshold=LIMIT)]
    shown = [off for off in found if off.wrong] or found
    wrong = shown[0].wrong
    text = "The onboard attitude is the wrong one here" if wrong else "The onboard attitude is off"
    own, _ = interpolate(reference.t, reference.q, reference.gap_segment, t[counted])
    if shown[0].angle == "tilt" and mounted(q[counted], own):
        wrong, text = False, "The sensor's mounting is not what is set, or the onboard attitude is wrong throughout"
    text += f": {'; '.join(off.text for off in shown)}. In all it differs from the smoother by {usual}."
    first = min(off.longest[0] for off in shown)
    return [Check(NAME, "bad" if wrong else "warn", text, round(shown[0].size, 1), "deg", LIMIT, t=first)]


def mounted(onboard: Array, own: Array) -> bool:
    """Whether one turn of the sensor in the body explains the tilt (n, 4) of the onboard attitude against ``own``."""
    down = np.array([0.0, 0.0, 1.0])
    a, b = (rotation.rotate_inverse(q, down) for q in (own, onboard))
    u, _, v = np.linalg.svd(b.T @ a)
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    left, whole = (float(median(np.sum((b - x) ** 2, axis=1))) for x in (a @ turn.T, a))
    return left < MOUNTED**2 * whole


def _usual(angle: str, size: Array, sigma: Array) -> str:
    """``tilt 0.6 deg (2.1 sigma)``: RMS of the difference, and of its ratio to the smoother's own sigma."""
    rms = float(np.sqrt(np.mean(size**2)))
    return f"{angle} {rms:.1f} deg ({float(np.sqrt(np.mean((size / sigma) ** 2))):.1f} sigma)"


def _off(
    angle: str, t: Array, size: Array, sigma: Array, counted: NDArray[np.bool_], segment: NDArray[np.int64]
) -> Off | None:
    """Where an angle (n,) is wrong for long, else where it is off for long; None if nowhere."""
    for limit_deg in (WRONG_DEG, OFF_DEG):
        limit = np.maximum(limit_deg[angle], SIGMAS * sigma)
        parts = gaps.slices(counted & (size > limit), segment)
        spans = [(p, (float(t[p.start]), float(t[p.stop - 1]))) for p in parts]
        long = [(p, span) for p, span in spans if span[1] - span[0] >= LEAST_S[angle]]
        if long:
            part, longest = max(long, key=lambda found: found[1][1] - found[1][0])
            seconds = sum(b - a for _, (a, b) in long)
            sizes = float(median(size[part])), float(median(sigma[part]))
            return Off(angle, seconds, longest, *sizes, limit_deg is WRONG_DEG)
    return None
