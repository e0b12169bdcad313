"""Which heading reference the drift in the air is quoted against."""

from __future__ import annotations

from attlog.present.table.rows import AIR, find, has_value
from attlog.result import Result

DRIFT_AIR = "drift_air_deg_per_min"


TOO_UNCERTAIN = "too_uncertain"
"""The code of an answer that leaves so much open that it tells nothing."""
TOO_SHORT = "record_too_short"
"""The code of a heading reference that is there for less time than a drift takes."""
QUOTED = ("truth", "smoother", "gnss_yaw", "onboard", "mag", "yaw_estimator", "course")
"""The order in which a heading reference is quoted; with truth no other is."""


def quoted_heading_reference(result: Result) -> str:
    """The heading reference that drift in the air is quoted against, whatever it ranks.

    The first of QUOTED by which any replayed row has a value; truth also where it tells nothing.
    """
    replayed = [row for row in result.estimators if row.kind == "replay"]
    unsure = short = ""
    for name in QUOTED:
        found = [find(row, f"{DRIFT_AIR}.{name}", AIR) for row in replayed]
        if any(has_value(a) for a in found):
            return name
        if any(a is not None and a.code == TOO_UNCERTAIN for a in found):
            if name == "truth":
                return name
            unsure = unsure or name
        if any(a is not None and a.code == TOO_SHORT for a in found):
            short = short or name
    return unsure or short or "onboard"
