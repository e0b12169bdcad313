"""What agreement with a reference proves, in words, and how wrong the reference says it may be."""

from __future__ import annotations

import math

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


def _of_smoother(ref: Reference) -> str:
    tilt, heading = (own_sigma_deg(ref, angle) or 0.0 for angle in ("inclination", "heading"))
    whose = {
        "own": f"{heading:.2g} deg in heading",
        "onboard": "headings are compared with onboard",
        "nobody": "headings are not compared",
    }[ref.heading_by]
    return (
        "Smoother: an estimate from both sides of each moment, from all sensors of the log, with the same IMU as the "
        "filters and the model of ESKF (without GNSS of MEKF). "
        f"Differences below its own sigma mean nothing: {tilt:.2g} deg in tilt, {whose}."
    )
