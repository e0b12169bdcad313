"""May a smoothed heading stand? GNSS acceleration and the gyro at rest, which no filter's model has part in, say so.

A gyro whose bias jumps turns the heading of every run alike, with the compass or without it, and both stay sure.
"""

from __future__ import annotations

import math

from attlog.estimators.base import Estimate
from attlog.estimators.evidence.gnss_heading import HeadingOffset, heading_offset
from attlog.estimators.filters import pair
from attlog.estimators.filters.navigation.measured import Inputs
from attlog.estimators.filters.navigation.passes.jumps import BIAS_CHANGED_DPS, bias_change_dps

LEAST_DEG, SIGMAS = 3.0, 3.0
"""A heading that is off by more than this by GNSS acceleration, in deg and in joint sigmas, does not stand."""

USEFUL_DEG = 5.0
"""A heading by motion alone that is no reference still judges a compass up to this sigma: it is checked as well."""


def checked(run: Estimate, inputs: Inputs) -> Estimate:
    """The run, without its heading where something contradicts it; in its quality what GNSS says of the heading."""
    own = pair.own_deg(run, pair.OWN_HEADING if pair.OWN_HEADING in run.aux else "sigma_heading")
    if run.quality["heading_from"] == "nobody" and own > USEFUL_DEG:
        return run
    offset = by_gnss(run, inputs)
    told: dict[str, float | str] = {}
    if offset is not None and offset.told:
        told = {"heading_gnss_deg": offset.offset_deg, "heading_gnss_sigma_deg": offset.sigma_deg}
        run.quality.update(told)
        if abs(offset.offset_deg) > max(LEAST_DEG, SIGMAS * math.hypot(offset.sigma_deg, own)):
            return pair.without_heading(run, f"GNSS acceleration shows it {abs(offset.offset_deg):.0f} deg off")
    changed = 0.0 if "gyro_jump_s" in run.quality else bias_change_dps(inputs)
    if changed > BIAS_CHANGED_DPS:
        return pair.without_heading(run, f"the gyro's bias at rest changed by {changed:.1f} deg/s")
    return run


def by_gnss(run: Estimate, inputs: Inputs) -> HeadingOffset | None:
    """How far the run's heading is off by GNSS acceleration; None without GNSS velocity."""
    fixes = inputs.velocity
    if fixes is None:
        return None
    return heading_offset(inputs.t, inputs.acc, run.q, fixes.t, fixes.x)
