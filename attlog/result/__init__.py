"""Result of an analysis: dataclasses, and their JSON document.

Other packages import the parts of a result from here, wherever they are defined.
"""

from __future__ import annotations

from attlog.health.check import Check, Setting, agreed_settings
from attlog.health.check import number_text as setting_number
from attlog.health.findings import Finding
from attlog.health.registry import CHECKS
from attlog.metrics.gyro_bias import CommonBias
from attlog.metrics.metric import Answer
from attlog.metrics.ranking import Duplicates
from attlog.metrics.trace import Trace
from attlog.reference.model import AlignmentStep, Reproduction
from attlog.result.document import MEASURED_TIMES, SCHEMA, SCHEMA_NAME
from attlog.result.model import (
    REFERENCE_NAME,
    TIMED_OUT,
    AttitudeTracks,
    EstimatorRow,
    ParameterValue,
    ReferenceSummary,
    Result,
    Verdict,
    nothing_ran,
    unknown_name,
)
from attlog.segments.model import Segment
from attlog.story.flight_events import Event

__all__ = [
    "CHECKS",
    "MEASURED_TIMES",
    "REFERENCE_NAME",
    "SCHEMA",
    "SCHEMA_NAME",
    "TIMED_OUT",
    "AlignmentStep",
    "Answer",
    "AttitudeTracks",
    "Check",
    "CommonBias",
    "Duplicates",
    "EstimatorRow",
    "Event",
    "Finding",
    "ParameterValue",
    "ReferenceSummary",
    "Reproduction",
    "Result",
    "Segment",
    "Setting",
    "Trace",
    "Verdict",
    "agreed_settings",
    "nothing_ran",
    "setting_number",
    "unknown_name",
]
