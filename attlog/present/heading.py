"""By which heading reference the drift in the air is told."""

from __future__ import annotations

from attlog.present.rows import AIR, find, has_value, is_ranked
from attlog.result import Result

DRIFT_AIR = "drift_air_deg_per_min"
HEADING_REFERENCES = ("truth", "smoother", "onboard", "gnss_yaw", "mag", "course")
"""The order in which a heading reference in the air is believed."""


def best_heading_reference(result: Result) -> str:
    """The first of HEADING_REFERENCES by which a filter's drift in the air is ranked, else has a value."""
    best, most = "onboard", 0
    for reference in HEADING_REFERENCES:
        found = [(row, find(row, f"{DRIFT_AIR}.{reference}", AIR)) for row in result.estimators]
        says = max(
            (1 + (row.kind == "replay") + is_ranked(row, a) for row, a in found if a is not None and has_value(a)),
            default=0,
        )
        if says > most:
            best, most = reference, says
    return best
