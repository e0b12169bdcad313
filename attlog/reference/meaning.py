"""What agreement with a reference proves, in words, and how wrong the reference says it may be."""

from __future__ import annotations

import math
from collections.abc import Mapping

from attlog.reference.model import Reference
from attlog.reference.smoothed import MOST_SIGMA_DEG, NAME, sigma_deg, unsure_of_tilt


def meaning(ref: Reference) -> str:
    """One or two sentences for people."""
    if ref.kind == "smoother":
        return _of_smoother(ref)
    if ref.fit is not None:
        return _of_brought(ref)
    return {
        "truth": "Truth: errors are errors.",
        "onboard": "The autopilot's own attitude: agreement, not truth.",
        "none": "Nothing to compare with: only questions at rest can be answered.",
    }[ref.kind]


def own_sigma_deg(ref: Reference, angle: str) -> float | None:
    """How wrong a reference says its ``angle`` may be, RMS in deg; None for one that does not tell, or borrows it."""
    if ref.sigma_tilt_deg is None or (angle == "heading" and ref.heading_by not in ("own", "relative")):
        return None
    own = sigma_deg(ref, angle)
    return own if math.isfinite(own) else None


def caveat(ref: Reference) -> str:
    """What a ranking by it has to say beside it: clauses without capital and full stop, with semicolons; may be empty.

    Whether it is in doubt or would have been refused, what its heading rests on, and why no better one was taken.
    """
    parts = [_doubt(ref)]
    if ref.kind == "smoother":
        parts.append(_heading_caveat(ref))
    if ref.kind in ("onboard", "none") and NAME in ref.refused:
        why = ref.refused[NAME]
        by_sensors = why in (ref.gyro_fault, *(fault.why for fault in ref.sensor_faults.values()))
        why = "its sensors failed a check" if by_sensors else _short(why)  # the check has its own entry
        parts.append(f"the smoother was refused: {why}")
    return "; ".join(part for part in parts if part)


def _doubt(ref: Reference) -> str:
    """Why a reference that was taken all the same is in doubt."""
    why = ref.doubt
    if not why and ref.kind == "smoother" and unsure_of_tilt(ref):
        why = f"its tilt sigma is above {MOST_SIGMA_DEG:.0f} deg"
    return f"the {ref.kind} is in doubt: {_short(why)}" if why else ""


def _short(why: str) -> str:
    """The first part of a reason."""
    return why.partition(";")[0].partition(", ")[0]


def _heading_caveat(ref: Reference) -> str:
    """What its own heading rests on, empty where compass and motion agree; why no heading is compared."""
    if ref.heading_by == "nobody":
        why = str(ref.quality.get("heading_why", "")) if ref.quality.get("heading_from") == "nobody" else ""
        return f"no heading is compared: {_short(why or ref.heading_why)}"
    one_source = ref.heading_by == "own" and ref.quality.get("heading_from") in ("compass", "motion", "brought")
    return heading_words(ref.quality) if one_source else ""


def heading_words(quality: Mapping[str, float | str]) -> str:
    """What a smoothed heading rests on, as a clause; empty of an estimate that does not tell."""
    found = str(quality.get("heading_from", ""))
    words = {
        "both": "compass and motion agree on the heading",
        "compass": "the heading rests on the compass alone",
        "motion": "the heading is from motion, without the compass",
        "brought": "the heading is the one that you brought",
        "nobody": f"there is no heading: {quality.get('heading_why', 'nothing shows it')}",
    }
    return words.get(found, "")


def _of_brought(ref: Reference) -> str:
    tilt, heading = (own_sigma_deg(ref, angle) or 0.0 for angle in ("inclination", "heading"))
    north = "" if ref.heading_by == "own" else " Its north is unknown: only changes of heading are compared."
    return (
        f"Truth that you brought ({ref.source}): differences are errors beyond its own sigma, {tilt:.2g} deg in tilt, "
        f"{heading:.2g} deg in heading.{north}"
    )


def _of_smoother(ref: Reference) -> str:
    tilt, heading = (own_sigma_deg(ref, angle) or 0.0 for angle in ("inclination", "heading"))
    whose = {
        "own": f"{heading:.2g} deg in heading",
        "onboard": "headings are compared with onboard",
        "nobody": "headings are not compared",
    }[ref.heading_by]
    words = heading_words(ref.quality)
    if ref.heading_by == "onboard" and ref.quality.get("heading_from") != "nobody":
        words = ref.heading_why
    rests = f" {words[0].upper()}{words[1:]}." if words else ""
    return (
        "Smoother: an estimate from both sides of each moment, from all sensors of the log, with the same IMU as the "
        "filters and the model of ESKF (without GNSS of MEKF). "
        "Differences below its own sigma, relative to the IMU as mounted, mean nothing: "
        f"{tilt:.2g} deg in tilt, {whose}.{rests}"
    )
