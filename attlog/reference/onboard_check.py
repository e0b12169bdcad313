"""Errors of the onboard attitude against truth or smoother.

They do not count where gravity or GNSS acceleration supports the onboard attitude.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import median
from attlog.core.spans import Span
from attlog.estimators.evidence import HeadingOffset
from attlog.flight.model import Array, Attitude, FlightLog
from attlog.reference import alignment, heading_sources, reference_checks, scoring
from attlog.reference.heading_sources import find_gnss_motion
from attlog.reference.model import Reference
from attlog.reference.smoother import differences_deg, sure_of_heading
from attlog.segments import increments, model
from attlog.segments.model import Segments

# References that show errors of the onboard attitude.
REFERENCE_KINDS = ("truth", "smoother")
# Limit in joint sigmas. A causal onboard estimator is at least as uncertain as the smoother, hence sqrt(2).
SIGMAS, JOINT = 3.0, 2.0**0.5
# Limits of suspect and of wrong angles: onboard attitudes are off by 0.3 to 1.5 deg in tilt and 0.3 to 3 deg in heading
# on flights with truth.
SUSPECT_DEG, WRONG_DEG = {"tilt": 3.0, "heading": 8.0}, {"tilt": 10.0, "heading": 30.0}
MIN_ERROR_S = 3.0  # shorter ones may be manoeuvres


class OnboardError(NamedTuple):
    """Error of one angle of the onboard attitude, ``seconds`` long in all.

    ``size`` and ``sigma``: medians in the ``longest`` span, deg (sigma 0 for truth). ``wrong``: above WRONG_DEG, else
    above SUSPECT_DEG. ``evidence``: gravity or GNSS acceleration in that span, in words; ``confirmed``: it contradicts
    the onboard attitude and not the reference.
    """

    angle: str
    seconds: float
    longest: Span
    size: float
    sigma: float
    wrong: bool
    evidence: str = ""
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
    """Onboard attitude compared with a reference.

    ``q`` (n, 4) at ``t`` (n,) s in the reference's axes. By angle: ``sizes`` and ``sigmas`` (n,) deg; ``counted`` (n,):
    scored samples. ``supported``: angles for which gravity or GNSS acceleration supports the onboard attitude.
    """

    t: Array
    q: Array
    sizes: dict[str, Array]
    sigmas: dict[str, Array]
    counted: NDArray[np.bool_]
    errors: list[OnboardError]
    supported: list[str]


def compare_onboard(log: FlightLog, segments: Segments, reference: Reference) -> OnboardComparison | None:
    """Compare the onboard attitude with truth or smoother."""
    attitude = log.onboard_attitude
    if reference.kind not in REFERENCE_KINDS or attitude is None:
        return None
    t, q, _ = alignment.usable_samples(attitude, reference.alignment.clock)
    if reference.alignment.trim is not None and not attitude.has_trim:
        q = alignment.apply_trim(q, reference.alignment.trim)
    index, _ = increments.known_resets(log, log.onboard or "", segments)
    aligned = scoring.aligned_at(attitude, index, segments)
    tilt, heading = differences_deg(reference, t, q)
    counted = scoring.scored_mask(reference, t) & (t >= (-np.inf if aligned is None else aligned)) & np.isfinite(tilt)
    sigmas = _reference_sigmas(reference, t)
    if np.count_nonzero(counted) < 2 or sigmas is None:
        return None
    sizes = {"tilt": tilt}
    by_compass = reference.quality.get("heading_from") == "compass"
    if reference.heading.by == "own" and sure_of_heading(reference) and not by_compass:
        sizes["heading"] = np.abs(heading)
    evidence = OnboardEvidence(log, segments, reference, attitude)
    found = OnboardComparison(t, q, sizes, sigmas, counted, [], [])
    for angle in sizes:
        error, supported = _angle_error(angle, found, evidence)
        found.errors.extend([error] if error else [])
        found.supported.extend([angle] if supported and not error else [])
    return found


class OnboardEvidence:
    """Evidence of gravity and GNSS acceleration on onboard attitude and reference."""

    def __init__(self, log: FlightLog, segments: Segments, reference: Reference, attitude: Attitude) -> None:
        self._log, self._segments, self._reference, self._attitude = log, segments, reference, attitude
        self._tilt: reference_checks.StaticTilt | None = None
        self._computed = False
        # Without GNSS the reference's tilt in flight rests on an assumption.
        self.has_gnss = reference.kind == "truth" or "gnss" in str(reference.quality.get("aided_by", "")).split()

    def supports_onboard(self, angle: str, span: Span) -> bool:
        """Return whether evidence favours the onboard attitude or contradicts the reference."""
        if angle == "tilt":
            still = self._static_tilt()
            if self._reference.scoring.refuted and not self.contradicts_onboard(angle, span):
                return True  # gravity contradicts the reference elsewhere, so it must confirm it here
            return still is not None and still.supports_onboard(span)
        onboard, other = self._headings(span)
        if onboard is None or not onboard.known:
            return other is not None and other.wrong
        if onboard.sound or (other is not None and other.wrong and not onboard.wrong):
            return True
        return other is not None and other.known and abs(other.offset_deg) > abs(onboard.offset_deg)

    def contradicts_onboard(self, angle: str, span: Span) -> bool:
        """Return whether evidence contradicts the onboard attitude and not the reference."""
        if angle == "tilt":
            found = self._tilts(span)
            return found is not None and found[0] <= reference_checks.SOUND_TILT_DEG < found[1]
        onboard, other = self._headings(span)
        return onboard is not None and onboard.wrong and (other is None or not other.wrong)

    def words(self, angle: str, span: Span) -> str:
        """Return the evidence within a span as a clause, empty for none."""
        if angle == "tilt":
            found = self._tilts(span)
            return (
                ""
                if found is None
                else f"{found[1]:.1f} deg off gravity standing still, the reference {found[0]:.1f} deg"
            )
        onboard, other = self._headings(span)
        if onboard is None or not onboard.known:
            return ""
        words = heading_sources.heading_error_words(onboard)
        return words if other is None or not other.known else f"{words}, the reference {abs(other.offset_deg):.0f} deg"

    def _static_tilt(self) -> reference_checks.StaticTilt | None:
        if not self._computed:
            self._tilt = reference_checks.static_tilt(self._log, self._reference, self._attitude)
            self._computed = True
        return self._tilt

    def _tilts(self, span: Span) -> tuple[float, float] | None:
        still = self._static_tilt()
        return None if still is None else still.medians(span)

    def _headings(self, span: Span) -> tuple[HeadingOffset | None, HeadingOffset | None]:
        """Return heading errors of onboard attitude and reference by GNSS acceleration."""
        motion, reference = find_gnss_motion(self._log, self._segments), self._reference
        if motion is None:
            return None, None
        motion = motion.near(span)
        return motion.offsets(*self._onboard)[0], motion.offsets(reference.t, reference.q, reference.gap_segment)[0]

    @cached_property
    def _onboard(self) -> tuple[Array, Array, NDArray[np.int64]]:
        """Times, attitudes and segments of the onboard attitude."""
        t, q, _ = alignment.usable_samples(self._attitude, self._reference.alignment.clock)
        return t, q, model.number_segments(t)


def _angle_error(angle: str, found: OnboardComparison, evidence: OnboardEvidence) -> tuple[OnboardError | None, bool]:
    """Return the error of one angle, wrong rather than suspect.

    Also whether evidence supports the onboard attitude in a span that is off.
    """
    size, sigma, t = found.sizes[angle], found.sigmas[angle], found.t
    segment, supported = model.number_segments(t), False
    for limit_deg in (WRONG_DEG, SUSPECT_DEG):
        limit = np.maximum(limit_deg[angle], SIGMAS * JOINT * sigma)
        parts = model.segment_slices(found.counted & (size > limit), segment)
        spans = [(p, (float(t[p.start]), float(t[p.stop - 1]))) for p in parts]
        long = [(p, span) for p, span in spans if span[1] - span[0] >= MIN_ERROR_S]
        sure = limit_deg is WRONG_DEG or evidence.has_gnss or angle == "heading"
        kept = [
            (p, s)
            for p, s in long
            if not evidence.supports_onboard(angle, s) and (sure or evidence.contradicts_onboard(angle, s))
        ]
        supported |= len(kept) < len(long)
        if kept:
            part, longest = max(kept, key=lambda one: one[1][1] - one[1][0])
            seconds = sum(b - a for _, (a, b) in kept)
            medians = float(median(size[part])), float(median(sigma[part]))
            shown = evidence.words(angle, longest), evidence.contradicts_onboard(angle, longest)
            return OnboardError(angle, seconds, longest, *medians, limit_deg is WRONG_DEG, *shown), supported
    return None, supported


def _reference_sigmas(reference: Reference, t: Array) -> dict[str, Array] | None:
    """Return tilt and heading sigmas (n,) in deg; 0 for logged truth."""
    if reference.sigma is None:
        return dict.fromkeys(WRONG_DEG, np.zeros(len(t))) if reference.kind == "truth" else None
    own = {"tilt": reference.sigma.tilt_deg, "heading": reference.sigma.heading_deg}
    return {angle: np.interp(t, reference.t, sigma) for angle, sigma in own.items()}


def onboard_error(log: FlightLog, segments: Segments, reference: Reference) -> str:
    """Return the onboard attitude's error as a clause, or empty."""
    found = compare_onboard(log, segments, reference)
    return "" if found is None or not found.errors else found.errors[0].text
