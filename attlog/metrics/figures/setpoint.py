"""Arrays of the attitude set-point: what was demanded over the flight, and how the vehicle followed a step of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.metrics.base import Case
from attlog.metrics.figures.trace import Trace, envelope
from attlog.metrics.steps import controller, setpoint_response
from attlog.reference import trim
from attlog.reference.model import Row
from attlog.segments import gaps

Array = NDArray[np.float64]

MOST = 25_000
"""Samples of the demanded angles, before they become an envelope."""


def demanded(case: Case) -> list[Trace]:
    """``demand``: roll, pitch and heading of the set-point while armed (of the whole log where arming is unknown)."""
    wanted = case.log.setpoints
    if wanted is None:
        return []
    armed = case.segments.spans("armed") or case.segments.spans("all")
    own = np.zeros(len(wanted.t), bool)
    for a, b in armed:
        own |= (wanted.t >= a) & (wanted.t <= b)
    t, q = gaps.rising(np.where(own, wanted.t, np.nan), wanted.q)
    if len(t) < 2:
        return []
    if case.reference.trim is not None and not wanted.has_trim:
        q = trim.apply(q, case.reference.trim)
    angles = np.degrees(rotation.to_euler(q))
    angles[np.flatnonzero(np.diff(gaps.number(t)) != 0) + 1] = np.nan
    at, kept = envelope(t, angles, MOST)
    columns = {name: kept[:, k] for k, name in enumerate(("roll", "pitch", "heading"))}
    return [Trace("demand", "", at, columns, ratio=len(t) / len(at))]


def response(case: Case, row: Row) -> list[Trace]:
    """``setpoint``: the vehicle's response to a unit step of its set-point, roll and pitch; with the onboard row."""
    blocks = controller.moved(case, "all") if row.name == "onboard" else None
    if blocks is None or len(blocks.axis) < controller.MIN_BLOCKS:
        return []
    columns, t = {}, np.zeros(0)
    for axis, name in enumerate(("roll", "pitch")):
        own = blocks.axis == axis
        if own.sum() >= controller.MIN_BLOCKS // 2:
            t, columns[name] = setpoint_response.response(blocks.only(own))
    return [Trace("setpoint", row.name, t, columns)] if columns else []
