"""What agreement with a reference proves, in words, and how wrong the reference says it may be."""

from __future__ import annotations

import math
from collections.abc import Mapping

from attlog.reference.model import Reference
from attlog.reference.smoothed import sigma_deg


def meaning(ref: Reference) -> str:
    """One or two sentences for people."""
    if ref.kind == "smoother":
        return _of_smoother(ref)
    return {
        "truth": "Truth: errors are errors.",
        "onboard": "The autopilot's own attitude: agreement, not truth.",
        "none": "Nothing to compare with: only questions at rest can be answered.",
    }[ref.kind]


def own_sigma_deg(ref: Reference, angle: str) -> float | None:
    """How wrong a reference says its ``angle`` may be, RMS in deg; None for one that does not tell."""
    own = sigma_deg(ref, angle)
    return own if ref.kind == "smoother" and math.isfinite(own) else None


def heading_words(quality: Mapping[str, float | str]) -> str:
    """What a smoothed heading rests on, as a clause; empty of an estimate that does not tell."""
    found = str(quality.get("heading_from", ""))
    words = {
        "both": "compass and motion agree on the heading",
        "compass": "the heading rests on the compass alone",
        "motion": "the heading is from motion, without the compass",
        "nobody": f"there is no heading: {quality.get('heading_why', 'nothing shows it')}",
    }
    return words.get(found, "")


def _of_smoother(ref: Reference) -> str:
    tilt, heading = (own_sigma_deg(ref, angle) or 0.0 for angle in ("inclination", "heading"))
    whose = {
        "own": f"{heading:.2g} deg in heading",
        "onboard": "headings are compared with onboard",
        "nobody": "headings are not compared",
    }[ref.heading_by]
    words = heading_words(ref.quality)
    rests = f" {words[0].upper()}{words[1:]}." if words else ""
    return (
        "Smoother: an estimate from both sides of each moment, from all sensors of the log, with the same IMU as the "
        "filters and the model of ESKF (without GNSS of MEKF). "
        "Differences below its own sigma, relative to the IMU as mounted, mean nothing: "
        f"{tilt:.2g} deg in tilt, {whose}.{rests}"
    )
