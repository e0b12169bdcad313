"""Is the onboard attitude the wrong one? Its difference from the truth, or from the smoother in degrees and sigmas."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Array, FlightLog
from attlog.health.model import Check
from attlog.health.sensors.stillness import tilt_error
from attlog.reference import clock, scoring, trim
from attlog.reference.compare import interpolate
from attlog.reference.model import Reference
from attlog.reference.smoothed import differences_deg
from attlog.segments import gaps, resets
from attlog.segments.model import Segments
from attlog.segments.spans import Span

NAME, TRUTH = "onboard against smoother", "onboard against truth"
NAMES = {"smoother": NAME, "truth": TRUTH}
"""By what the reference is."""
SIGMAS = 3.0
"""What lies within three sigmas of the smoother may be the smoother's own error."""
OFF_DEG, WRONG_DEG = {"tilt": 3.0, "heading": 10.0}, {"tilt": 10.0, "heading": 30.0}
"""What is worth a look, and what is wrong: onboard attitudes are off by 0.3 to 1.5 deg in tilt and 0.3 to 3 deg in
heading on flights with truth."""
LEAST_S = {"tilt": 5.0, "heading": 10.0}
MOUNTED = 0.3
"""What is left of a tilt error that a turn of the sensor explains, at most."""
STANDS_DEG = 2.5
"""Sound onboard attitudes stay within this of gravity where the vehicle stands."""
LIMIT = "ok up to 3 deg of tilt and 10 deg of heading"
LIMITS = {"smoother": f"{LIMIT}, or 3 sigma of the smoother", "truth": LIMIT}


@dataclass(frozen=True, slots=True)
class OnboardError:
    """How long (s) an angle of the onboard attitude is off, the longest span of it, its median and sigma there, deg.
    The sigma of truth is 0."""

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
        sigma = f" (sigma {self.sigma:.1f})" if self.sigma > 0 else ""
        return f"{self.angle} {self.size:.1f} deg off{sigma} from {first:.0f} s to {last:.0f} s{more}"


def checks(log: FlightLog, segments: Segments, reference: Reference | None) -> list[Check]:
    """Tilt and heading of the attitude that flew against truth or smoother; nothing where neither is the reference."""
    attitude = log.onboard_attitude
    if reference is None or reference.kind not in NAMES or attitude is None:
        return []
    name, limit = NAMES[reference.kind], LIMITS[reference.kind]
    t, q, _ = clock.usable(attitude, reference.clock)
    if reference.trim is not None and not attitude.has_trim:
        q = trim.apply(q, reference.trim)
    index, _ = resets.known(log, log.onboard or "", segments)
    aligned = scoring.aligned_at(attitude, index, segments)
    counted = scoring.scored(reference, t) & (t >= (-np.inf if aligned is None else aligned))
    tilt, heading = differences_deg(reference, t, q)
    counted &= np.isfinite(tilt)
    if np.count_nonzero(counted) < 2:
        return []
    sigmas = _sigmas(reference, t)
    if sigmas is None:
        return []
    angles = {"tilt": tilt}
    if reference.heading_by == "own":
        angles["heading"] = np.abs(heading)
    segment = gaps.number(t)
    found = [off for angle, size in angles.items() if (off := _off(angle, t, size, sigmas[angle], counted, segment))]
    if not found:
        usual = ", ".join(_usual(angle, size[counted], sigmas[angle][counted]) for angle, size in angles.items())
        whom = "the truth" if reference.kind == "truth" else "the smoother"
        return [Check(name, "ok", f"{log.onboard} differs from {whom} by {usual}.", threshold=limit)]
    found = [off for off in found if not (off.angle == "tilt" and standing(log, reference, t, q, off.longest))]
    if not found:
        text = f"{log.onboard} agrees with gravity where it stands, better than the reference."
        return [Check(name, "ok", text, threshold=limit)]
    shown = [off for off in found if off.wrong] or found
    wrong = shown[0].wrong
    text = "The onboard attitude was wrong" if wrong else "The onboard attitude errs"
    own, _ = interpolate(reference.t, reference.q, reference.gap_segment, t[counted])
    if shown[0].angle == "tilt" and mounted(q[counted], own):
        wrong, text = False, "The sensor is mounted otherwise than set, or the onboard attitude is wrong throughout"
    lead, *others = shown
    text += f": {lead.text}."
    first, last = lead.longest
    verdict = "fault" if wrong else "warning"
    seen = [f"Its {off.text}." for off in others]
    return [
        Check(
            name, verdict, text, round(lead.size, 1), "deg", limit, t=first, t_end=last, about=lead.angle, evidence=seen
        )
    ]


def standing(log: FlightLog, reference: Reference, t: Array, q: Array, span: Span) -> bool:
    """Whether the vehicle stands within a span and gravity finds the onboard attitude right there.

    ``q`` (n, 4) at ``t`` (n,) is the onboard attitude as it is compared, the vehicle's trim taken out.
    """
    imu = log.replay_imu
    if imu is None:
        return False
    at = imu.acc.t_best
    onboard, _ = interpolate(t, q, gaps.number(t), at)
    own, _ = interpolate(reference.t, reference.q, reference.gap_segment, at)
    if reference.trim is not None:
        onboard, own = trim.apply(onboard, -reference.trim), trim.apply(own, -reference.trim)
    accused, judge = tilt_error(imu, span, onboard), tilt_error(imu, span, own)
    return accused is not None and judge is not None and (accused < STANDS_DEG or accused < judge)


def _sigmas(reference: Reference, t: Array) -> dict[str, Array] | None:
    """The reference's own standard deviations (n,) of tilt and heading at ``t``, deg: 0 of truth; None without any."""
    if reference.kind == "truth":
        return dict.fromkeys(WRONG_DEG, np.zeros(len(t)))
    if reference.sigma_tilt_deg is None or reference.sigma_heading_deg is None:
        return None
    own = {"tilt": reference.sigma_tilt_deg, "heading": reference.sigma_heading_deg}
    return {angle: np.interp(t, reference.t, sigma) for angle, sigma in own.items()}


def mounted(onboard: Array, own: Array) -> bool:
    """Whether one turn of the sensor in the body explains the tilt (n, 4) of the onboard attitude against ``own``."""
    down = np.array([0.0, 0.0, 1.0])
    a, b = (rotation.rotate_inverse(q, down) for q in (own, onboard))
    u, _, v = np.linalg.svd(b.T @ a)
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    left, whole = (float(np.median(np.sum((b - x) ** 2, axis=1))) for x in (a @ turn.T, a))
    return left < MOUNTED**2 * whole


def _usual(angle: str, size: Array, sigma: Array) -> str:
    """``tilt 0.6 deg (2.1 sigma)``: RMS of the difference, and of its ratio to the reference's own sigma."""
    text = f"{angle} {float(np.sqrt(np.mean(size**2))):.1f} deg"
    return f"{text} ({float(np.sqrt(np.mean((size / sigma) ** 2))):.1f} sigma)" if sigma.all() else text


def _off(
    angle: str, t: Array, size: Array, sigma: Array, counted: NDArray[np.bool_], segment: NDArray[np.int64]
) -> OnboardError | None:
    """Where an angle (n,) is wrong for long, else where it is off for long; None if nowhere."""
    for limit_deg in (WRONG_DEG, OFF_DEG):
        limit = np.maximum(limit_deg[angle], SIGMAS * sigma)
        parts = gaps.slices(counted & (size > limit), segment)
        spans = [(p, (float(t[p.start]), float(t[p.stop - 1]))) for p in parts]
        long = [(p, span) for p, span in spans if span[1] - span[0] >= LEAST_S[angle]]
        if long:
            part, longest = max(long, key=lambda found: found[1][1] - found[1][0])
            seconds = sum(b - a for _, (a, b) in long)
            sizes = float(np.median(size[part])), float(np.median(sigma[part]))
            return OnboardError(angle, seconds, longest, *sizes, limit_deg is WRONG_DEG)
    return None
