"""Is the onboard attitude in error by truth or smoother? Where it differs too far for both, and gravity agrees.

A smoother may be wrong itself. So it accuses beyond three joint sigmas only, and nobody of tilt where the vehicle
stands still and gravity speaks for the accused, nobody of heading where GNSS acceleration does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from attlog.core.spans import Span
from attlog.estimators.evidence import HeadingOffset
from attlog.flight.model import Array, Attitude, FlightLog
from attlog.reference import alignment, heading_sources, reference_checks, scoring
from attlog.reference.heading_sources import find_gnss_motion
from attlog.reference.model import Reference
from attlog.reference.smoother import differences_deg, sure_of_heading
from attlog.segments import model, resets
from attlog.segments.model import Segments

REFERENCE_KINDS = ("truth", "smoother")
SIGMAS = 3.0
# An onboard estimator, which saw the past alone, is at least as unsure as the smoother: so much larger is their joint
# sigma.
JOINT = float(np.sqrt(2.0))
# What is worth a look, and what is wrong: onboard attitudes are off by 0.3 to 1.5 deg in tilt and 0.3 to 3 deg in
# heading on flights with truth.
SUSPECT_DEG, WRONG_DEG = {"tilt": 3.0, "heading": 8.0}, {"tilt": 10.0, "heading": 30.0}
MIN_ERROR_S = 3.0


@dataclass(frozen=True, slots=True)
class OnboardError:
    """How long (s) an angle of the onboard attitude is off, the longest span of it, its median and sigma there, deg.
    The sigma of truth is 0. ``evidence``: what gravity or GNSS acceleration says of both there, empty for nothing.
    """

    angle: str
    seconds: float
    longest: Span
    size: float
    sigma: float
    # Whether it is not only off but the wrong attitude.
    wrong: bool
    evidence: str = ""
    # Whether gravity or GNSS acceleration finds the onboard attitude wrong there, and the judge right.
    confirmed: bool = False

    @property
    def text(self) -> str:
        """``tilt 18.2 deg off (sigma 0.3) from 320 s to 345 s, 51 s in all``."""
        first, last = self.longest
        more = "" if self.seconds < 1.2 * (last - first) else f", {self.seconds:.0f} s in all"
        sigma = f" (sigma {self.sigma:.1f})" if self.sigma > 0 else ""
        return f"{self.angle} {self.size:.1f} deg off{sigma} from {first:.0f} s to {last:.0f} s{more}"


@dataclass(frozen=True, slots=True, eq=False)
class OnboardComparison:
    """The onboard attitude against a judge: ``q`` (n, 4) at ``t`` (n,) s, in the judge's axes.

    ``sizes`` and ``sigmas`` (n,) deg by angle, ``counted`` (n,) what is scored; ``errors`` where it is in error, and
    ``acquitted`` the angles of which gravity or GNSS acceleration speaks for the onboard attitude.
    """

    t: Array
    q: Array
    sizes: dict[str, Array]
    sigmas: dict[str, Array]
    counted: NDArray[np.bool_]
    errors: list[OnboardError]
    acquitted: list[str]


def compare_onboard(log: FlightLog, segments: Segments, judge: Reference) -> OnboardComparison | None:
    """The attitude that flew against truth or smoother; None where neither is the judge or nothing is scored."""
    attitude = log.onboard_attitude
    if judge.kind not in REFERENCE_KINDS or attitude is None:
        return None
    t, q, _ = alignment.usable_samples(attitude, judge.clock)
    if judge.trim is not None and not attitude.has_trim:
        q = alignment.apply_trim(q, judge.trim)
    index, _ = resets.known_resets(log, log.onboard or "", segments)
    aligned = scoring.aligned_at(attitude, index, segments)
    tilt, heading = differences_deg(judge, t, q)
    counted = scoring.scored_mask(judge, t) & (t >= (-np.inf if aligned is None else aligned)) & np.isfinite(tilt)
    sigmas = _reference_sigmas(judge, t)
    if np.count_nonzero(counted) < 2 or sigmas is None:
        return None
    sizes = {"tilt": tilt}
    if judge.heading_by == "own" and sure_of_heading(judge) and judge.quality.get("heading_from") != "compass":
        sizes["heading"] = np.abs(heading)
    evidence = OnboardEvidence(log, segments, judge, attitude)
    found = OnboardComparison(t, q, sizes, sigmas, counted, [], [])
    for angle in sizes:
        error, acquitted = _angle_error(angle, found, evidence)
        found.errors.extend([error] if error else [])
        found.acquitted.extend([angle] if acquitted and not error else [])
    return found


class OnboardEvidence:
    """What gravity and GNSS acceleration say of a judge and the onboard attitude; found where it is first asked for."""

    def __init__(self, log: FlightLog, segments: Segments, judge: Reference, attitude: Attitude) -> None:
        self._log, self._segments, self._judge, self._attitude = log, segments, judge, attitude
        self._still: reference_checks.StaticTilt | None = None
        self._asked = False
        self.aids = ["gnss"] if judge.kind == "truth" else str(judge.quality.get("aided_by", "")).split()
        """What the judge is made of beside its IMU: without GNSS its tilt in flight rests on an assumption."""

    def acquits(self, angle: str, span: Span) -> bool:
        """Whether it speaks for the onboard attitude within a span, or against the judge."""
        if angle == "tilt":
            still = self._residuals()
            if self._judge.refuted and not self.confirms(angle, span):
                return True  # a judge that gravity refutes elsewhere needs its word here
            return still is not None and still.acquits(span)
        accused, judge = self._headings(span)
        if accused is None or not accused.told:
            return judge is not None and judge.wrong
        if accused.sound or (judge is not None and judge.wrong and not accused.wrong):
            return True
        return judge is not None and judge.told and abs(judge.offset_deg) > abs(accused.offset_deg)

    def confirms(self, angle: str, span: Span) -> bool:
        """Whether it speaks against the onboard attitude within a span, and not against the judge."""
        if angle == "tilt":
            still = self._residuals()
            found = None if still is None else still.medians(span)
            return found is not None and found[0] <= reference_checks.SOUND_TILT_DEG < found[1]
        accused, judge = self._headings(span)
        return accused is not None and accused.wrong and (judge is None or not judge.wrong)

    def words(self, angle: str, span: Span) -> str:
        """What it says of both within a span, as a part of a sentence; empty where it says nothing."""
        if angle == "tilt":
            still = self._residuals()
            found = None if still is None else still.medians(span)
            return (
                "" if found is None else f"{found[1]:.1f} deg off gravity standing still, the judge {found[0]:.1f} deg"
            )
        accused, judge = self._headings(span)
        if accused is None or not accused.told:
            return ""
        words = heading_sources.heading_error_words(accused)
        return words if judge is None or not judge.told else f"{words}, the judge {abs(judge.offset_deg):.0f} deg"

    def _residuals(self) -> reference_checks.StaticTilt | None:
        if not self._asked:
            self._still, self._asked = reference_checks.static_tilt(self._log, self._judge, self._attitude), True
        return self._still

    def _headings(self, span: Span) -> tuple[HeadingOffset | None, HeadingOffset | None]:
        """Heading errors of the onboard attitude and of the judge within a span by GNSS acceleration."""
        motion, judge = find_gnss_motion(self._log, self._segments), self._judge
        if motion is None:
            return None, None
        t, q, _ = alignment.usable_samples(self._attitude, judge.clock)
        accused, _ = motion.offsets(t, q, model.number_segments(t), spans=[span])
        return accused, motion.offsets(judge.t, judge.q, judge.gap_segment, spans=[span])[0]


def _angle_error(angle: str, found: OnboardComparison, evidence: OnboardEvidence) -> tuple[OnboardError | None, bool]:
    """Where an angle is wrong for long, else where it is off for long; and whether evidence spoke for it somewhere."""
    size, sigma, t = found.sizes[angle], found.sigmas[angle], found.t
    segment, acquitted = model.number_segments(t), False
    for limit_deg in (WRONG_DEG, SUSPECT_DEG):
        limit = np.maximum(limit_deg[angle], SIGMAS * JOINT * sigma)
        parts = model.segment_slices(found.counted & (size > limit), segment)
        spans = [(p, (float(t[p.start]), float(t[p.stop - 1]))) for p in parts]
        long = [(p, span) for p, span in spans if span[1] - span[0] >= MIN_ERROR_S]
        sure = limit_deg is WRONG_DEG or "gnss" in evidence.aids or angle == "heading"
        kept = [(p, s) for p, s in long if not evidence.acquits(angle, s) and (sure or evidence.confirms(angle, s))]
        acquitted |= len(kept) < len(long)
        if kept:
            part, longest = max(kept, key=lambda one: one[1][1] - one[1][0])
            seconds = sum(b - a for _, (a, b) in kept)
            sizes = float(np.median(size[part])), float(np.median(sigma[part]))
            said = evidence.words(angle, longest), evidence.confirms(angle, longest)
            return OnboardError(angle, seconds, longest, *sizes, limit_deg is WRONG_DEG, *said), acquitted
    return None, acquitted


def _reference_sigmas(judge: Reference, t: Array) -> dict[str, Array] | None:
    """The judge's own standard deviations (n,) of tilt and heading at ``t``, deg: 0 of logged truth; None without."""
    if judge.sigma_tilt_deg is None or judge.sigma_heading_deg is None:
        return dict.fromkeys(WRONG_DEG, np.zeros(len(t))) if judge.kind == "truth" else None
    own = {"tilt": judge.sigma_tilt_deg, "heading": judge.sigma_heading_deg}
    return {angle: np.interp(t, judge.t, sigma) for angle, sigma in own.items()}


def onboard_error(log: FlightLog, segments: Segments, judge: Reference) -> str:
    """What is in error of the onboard attitude by a judge, as a part of a sentence; empty where nothing is."""
    found = compare_onboard(log, segments, judge)
    return "" if found is None or not found.errors else found.errors[0].text
