"""May a parameter be set so? It exists in this firmware, is within its documented range, and is not set so already."""

from __future__ import annotations

import math
from collections.abc import Sequence

from attlog.flight.model import FlightLog
from attlog.flight.parameters import ranges
from attlog.health.assessments.model import Setting

SAME = 1e-5
"""Parameters are 32-bit floats: values that differ by less than this part of them are the same."""


def refusal(log: FlightLog, settings: Sequence[Setting]) -> str:
    """Why one of the settings cannot be made, as a sentence; empty where all can.

    A parameter exists in a firmware where the log's own table holds it. A file given beside a log proves nothing.
    """
    for setting in settings:
        limits = ranges.documented(setting.name)
        if setting.name not in log.params or setting.name in log.filled_params:
            return f"The log does not hold the parameter {setting.name}."
        if limits is None:
            return f"No range of {setting.name} is documented."
        if not (math.isfinite(setting.new) and limits[0] <= setting.new <= limits[1]):
            return f"{setting.name} would be {setting.new:.4g}, outside its range of {limits[0]:g} to {limits[1]:g}."
    return ""


def keep(log: FlightLog, settings: Sequence[Setting]) -> list[Setting]:
    """Those of ``settings`` that change something; none where one cannot be made, because they belong together."""
    return [] if refusal(log, settings) else [setting for setting in settings if not is_set(log, setting)]


def is_set(log: FlightLog, setting: Setting) -> bool:
    """Whether a parameter has the new value already, at the end of the log."""
    line = log.params.get(setting.name)
    last = None if line is None or not line.value else float(line.value[-1])
    return last is not None and math.isclose(last, setting.new, rel_tol=SAME, abs_tol=SAME)
