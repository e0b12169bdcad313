"""A log as the questions about its sensors see it, prepared for a replay or without one."""

from __future__ import annotations

import numpy as np

from attlog.analysis import choices, replay
from attlog.analysis.config import Config
from attlog.base.errors import UsageError
from attlog.estimators.filters.pair import OWN_HEADING
from attlog.flight.model import FlightLog, part_of
from attlog.health.assessments.model import Assessment, HealthCase, MotionAttitude
from attlog.health.assessments.questions import assess
from attlog.health.figures import traces
from attlog.health.model import Check
from attlog.metrics.base import Case
from attlog.metrics.figures.trace import Trace
from attlog.segments.model import Segments
from attlog.segments.once import once


def assessments(case: Case, checks: list[Check], *, drawn: list[Trace] | None = None) -> list[Assessment]:
    """Every question about the sensors of a prepared log; ``checks`` are those of the audit.

    ``drawn``: where the arrays of their figures go, None where none are wanted.
    """
    return _assessed(HealthCase(case.log, case.segments, case.reference, checks, lambda: motion_attitude(case)), drawn)


def assessments_unreplayed(
    log: FlightLog, segments: Segments, checks: list[Check], *, drawn: list[Trace] | None = None
) -> list[Assessment]:
    """The same of a log that no filter can be run on, such as telemetry: there is no attitude to judge sensors by."""
    return _assessed(HealthCase(log, segments, None, checks, lambda: None), drawn)


def _assessed(asked: HealthCase, drawn: list[Trace] | None) -> list[Assessment]:
    with once():
        found = part_of(asked.log, "The sensors", lambda: assess(asked), list[Assessment])
        if drawn is not None:
            drawn += traces(asked, found)
    return found


def motion_attitude(case: Case) -> MotionAttitude | None:
    """The smoother without any compass; None where there is no velocity by GNSS or it cannot be run."""
    if not any(np.isfinite(receiver.vel_ned).any() for receiver in case.log.gnss):
        return None
    try:
        found = replay.smoother(
            case.log, case.segments, choices.reference_options(Config.trusted(case.settings)), compass=False
        )
    except UsageError:
        return None
    segment = np.zeros(len(found.t), np.int64) if found.segment is None else np.asarray(found.segment, np.int64)
    heading = found.aux.get(OWN_HEADING, found.aux["sigma_heading"])
    return MotionAttitude(found.t, found.q, segment, found.aux["sigma_tilt"], heading, dict(found.quality))
