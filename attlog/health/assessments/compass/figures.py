"""The arrays that figures of the compasses are drawn from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.base import rotation
from attlog.flight.model import Mag
from attlog.health.assessments.compass import motion, offset
from attlog.health.assessments.compass.samples import SURE, Power, air_spans, drive_of, power_at
from attlog.health.assessments.compass.study import CompassStudy, studies
from attlog.health.assessments.model import Array, HealthCase
from attlog.reference import declination
from attlog.segments.spans import inside

MOST_SURE = 0.5
"""The attitude by motion is drawn with where its heading is sure in this share of the flight."""
POINTS = 1500
"""A figure is not wider than so many dots."""


@dataclass(frozen=True, slots=True)
class FieldHistory:
    """The field of one compass at ``t`` (n,) s in body axes, all (n, 3) uT.

    ``measured`` as logged, ``expected`` the earth's by an attitude (NaN where there is none), ``corrected`` as logged
    less the offset that is offered, None where none is. ``by``: whose attitude.
    """

    source: str
    t: Array
    measured: Array
    expected: Array
    corrected: Array | None
    by: str


@dataclass(frozen=True, slots=True)
class Interference:
    """The motors' power against the field of one compass in flight: ``power`` (n,) in A or 0 to 1 as ``kind`` says,
    ``excess`` (n,) uT how much larger the field is than the earth's.
    """

    source: str
    kind: Power
    power: Array
    excess: Array


def field_against_expected(case: HealthCase) -> list[FieldHistory]:
    """Every compass over the whole log, at most POINTS samples each; nothing without an attitude or a position."""
    model = declination.model(case.log)
    attitude = _attitude(case)
    if model is None or attitude is None:
        return []
    t, q, segment, by = attitude
    offered = {study.samples.source: study for study in studies(case)[0]}
    found = []
    for mag in case.log.mags:
        at, measured = _thinned(mag, np.ones(len(mag.field.t_best), bool))
        turned, _ = rotation.interpolated(t, q, segment, at)
        expected = np.full(measured.shape, np.nan)
        known = rotation.finite(turned)
        if known.any():
            expected[known] = rotation.rotate_inverse(turned[known], 1e6 * np.array(model.ned_t))
        corrected = _corrected(case, offered.get(mag.field.source), measured)
        found.append(FieldHistory(mag.field.source, at, measured, expected, corrected, by))
    return found


def interference(case: HealthCase) -> list[Interference]:
    """Power against the field's size for every compass in flight; nothing without position, flight or power."""
    model = declination.model(case.log)
    kind, drive = drive_of(case.log)
    if model is None or drive is None or case.segments is None:
        return []
    flown, earth = air_spans(case.segments), 1e6 * model.strength_t
    found = []
    for mag in case.log.mags:
        at, field = _thinned(mag, inside(mag.field.t_best, flown))
        power = power_at(drive, at)
        known = np.isfinite(power)
        if known.any():
            excess = np.linalg.norm(field[known], axis=1) - earth
            found.append(Interference(mag.field.source, kind, power[known], excess))
    return found


def _attitude(case: HealthCase) -> tuple[Array, Array, np.ndarray | None, str] | None:
    """The attitude by motion where its heading judges compasses, else the reference of the analysis, else (of a log
    that is not replayed) the onboard one: times, quaternions, segments and a name. None where nobody knows heading."""
    known, own = case.motion, case.log.onboard_attitude
    if known is not None and not motion.why_none(case):
        sure = known.sigma_heading <= SURE
        if sure[inside(known.t, air_spans(case.segments))].mean() >= MOST_SURE:
            return known.t, np.where(sure[:, None], known.q, np.nan), known.segment, "motion"
    reference = case.reference
    if reference is None and own is not None and len(own.t) > 1:
        return own.t, own.q, None, own.source
    if reference is None or reference.kind == "none" or len(reference.t) < 2:
        return None
    if reference.heading_by in ("nobody", "relative"):
        return None
    return reference.t, reference.q, reference.gap_segment, reference.source


def _corrected(case: HealthCase, study: CompassStudy | None, measured: Array) -> Array | None:
    """The field less the offset that may be set; None where none may."""
    if study is None or not study.air.counts or offset.why_not(case, study):
        return None
    return np.asarray(measured - study.air.offset)


def _thinned(mag: Mag, use: np.ndarray) -> tuple[Array, Array]:
    """Times and field (uT) of at most POINTS of the samples that may be used and are numbers."""
    where = np.flatnonzero(use & rotation.finite(mag.field.x))
    where = where[:: max(1, -(-len(where) // POINTS))]
    return mag.field.t_best[where], 1e6 * mag.field.x[where]
