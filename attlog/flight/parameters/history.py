"""Parameters as time lines, with the defaults that the log states."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import accumulate, chain

import numpy as np

from attlog.flight.builder import LogBuilder
from attlog.flight.model import FlightLog, TimeLine
from attlog.formats.base import ParamChange


def values(changes: list[ParamChange]) -> dict[str, float]:
    """The first value of each parameter: what the vehicle booted with."""
    first: dict[str, float] = {}
    for change in changes:
        if not change.is_default and change.name not in first and math.isfinite(change.value):
            first[change.name] = change.value
    return first


def defaults(changes: list[ParamChange]) -> dict[str, float]:
    """The last default value that the log states of each parameter."""
    return {c.name: c.value for c in changes if c.is_default and math.isfinite(c.value)}


def time_lines(builder: LogBuilder, changes: list[ParamChange], source: str) -> dict[str, TimeLine]:
    """Every parameter's changes on the log's clock; values from before the data hold from the first stamp known.

    Repetitions of the same value (a table written again at each arming) are one entry.
    """
    told = (c.t_us for c in changes if c.t_us is not None and builder.is_near(c.t_us))
    begin = min(told, default=builder.t0_us)
    begin = min(begin, builder.t0_us)
    lines: dict[str, tuple[list[int], list[float]]] = {}
    for change in changes:
        if change.is_default or not math.isfinite(change.value):
            continue
        t, v = lines.setdefault(change.name, ([], []))
        if change.t_us is not None and not builder.is_near(change.t_us):
            continue
        if not v or v[-1] != change.value:
            t.append(begin if change.t_us is None else change.t_us)
            v.append(change.value)
    seconds = builder.seconds(np.fromiter(chain.from_iterable(t for t, _ in lines.values()), np.int64))
    begins = accumulate((len(t) for t, _ in lines.values()), initial=0)
    return {
        name: TimeLine(seconds[a : a + len(v)], v, source)
        for a, (name, (_, v)) in zip(begins, lines.items(), strict=False)
    }


NOT_SET_DEG = 1e-6
"""A declination of 0 is "not set", not "0 deg": on almost all of the earth 0 is wrong."""


def declination(log: FlightLog, names: Mapping[str, float]) -> tuple[float | None, str]:
    """Declination in deg and the name of the first parameter (``names``: factor to deg) that is set; None without."""
    for name, to_deg in names.items():
        value = log.param(name)
        if value is not None and NOT_SET_DEG < abs(value * to_deg) <= 180.0:
            return float(value) * to_deg, name
    return None, ""


LOOKED_UP = {"EKF2_DECL_TYPE": 1, "ATT_MAG_DECL_A": 1, "COMPASS_AUTODEC": 1}
"""Parameters whose lowest bit lets the autopilot look the declination up by its position."""


def looks_up_declination(log: FlightLog) -> bool:
    """Whether the autopilot takes the declination from its own map once it has a position, whatever it was told."""
    return any((value := log.param(name)) is not None and int(value) & bit for name, bit in LOOKED_UP.items())
