"""Is the heading of the attitude that flew wrong by GNSS acceleration, all the time or in some of the flight?"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from attlog.estimators.evidence.gnss_heading import WRONG_DEG, WRONG_SIGMAS, HeadingOffset
from attlog.flight.model import FlightLog
from attlog.reference import clock, scoring
from attlog.reference.physics.gnss_motion import GnssMotion, motion_of
from attlog.segments import Segments, gaps, resets
from attlog.segments.once import asked_once
from attlog.segments.spans import Span, merge

SAME_SIGMAS = 2.0
"""Two 30 s are off alike up to so many joint sigmas."""


@dataclass(frozen=True, slots=True)
class WrongHeading:
    """When the heading is wrong, the best known of these offsets, and whether it is right at other times."""

    spans: list[Span]
    offset: HeadingOffset
    partly: bool = False


def onboard_offsets(
    log: FlightLog, segments: Segments, motion: GnssMotion
) -> tuple[HeadingOffset, list[HeadingOffset]]:
    """The heading error of the attitude that flew, over the flight and in each 30 s, from its own alignment on."""
    attitude = log.onboard_attitude
    assert attitude is not None
    t, q, _ = clock.usable(attitude, "sample")
    aligned = scoring.aligned_at(attitude, resets.known(log, log.onboard or "", segments)[0], segments)
    return motion.offsets(t, q, gaps.number(t), -np.inf if aligned is None else aligned)


def wrong_heading(whole: HeadingOffset, parts: list[HeadingOffset]) -> WrongHeading | None:
    """When the heading is wrong: all the time, or in some of the 30 s; None where it nowhere is."""
    off = [part for part in parts if part.wrong]
    if whole.wrong and not any(part.told and not part.wrong for part in parts):
        return WrongHeading([(whole.t0, whole.t1)], whole)
    if off:
        spans = list(merge((part.t0, part.t1) for part in [*off, *_alike(off, parts)]))
        return WrongHeading(spans, min(off, key=lambda part: part.sigma_deg), partly=any(part.sound for part in parts))
    return WrongHeading([(whole.t0, whole.t1)], whole) if whole.wrong else None


def _alike(off: list[HeadingOffset], parts: list[HeadingOffset]) -> list[HeadingOffset]:
    """Neighbours of wrong 30 s that are off as far, though less clearly: they accuse nobody, but say since when."""
    found: list[HeadingOffset] = []
    queue = list(off)
    while queue:
        one = queue.pop()
        for part in parts:
            apart = abs((part.offset_deg - one.offset_deg + 180.0) % 360.0 - 180.0)
            near = part.t0 <= one.t1 and part.t1 >= one.t0 and part not in found and not part.told
            off_too = abs(part.offset_deg) > max(WRONG_DEG, WRONG_SIGMAS * part.sigma_deg)
            if near and off_too and apart <= SAME_SIGMAS * math.hypot(part.sigma_deg, one.sigma_deg):
                found.append(part)
                queue.append(part)
    return found


@asked_once
def wrong_onboard(log: FlightLog, segments: Segments) -> str:
    """Why the onboard heading is wrong, as a part of a sentence; empty where it is not, or where GNSS does not tell."""
    motion = motion_of(log, segments)
    if motion is None or log.onboard_attitude is None:
        return ""
    wrong = wrong_heading(*onboard_offsets(log, segments, motion))
    return "" if wrong is None else f"the heading of {log.onboard} is {words(wrong.offset)}"


def words(found: HeadingOffset) -> str:
    """``28 deg off by GNSS acceleration (± 4 deg)``."""
    return f"{abs(found.offset_deg):.0f} deg off by GNSS acceleration (± {max(found.sigma_deg, 1.0):.0f} deg)"
