"""The contract: everything that an analysis found, as dataclasses, as a JSON document, and read back.

What stands in a result comes from here for those above it, wherever it is defined.
"""

from __future__ import annotations

from attlog.health.assessments.model import Assessment, Setting
from attlog.health.findings import Finding
from attlog.health.model import Check
from attlog.metrics.answer import Answer
from attlog.metrics.evidence.common_bias import CommonBias
from attlog.metrics.figures.trace import Trace
from attlog.metrics.ranking.duplicates import Duplicates
from attlog.reference.model import AlignmentStep
from attlog.result.document import MEASURED_TIMES, SCHEMA, SCHEMA_NAME
from attlog.result.model import TIMED_OUT, EstimatorRow, ParameterValue, ReferenceSummary, Result, Verdict, nothing_ran
from attlog.segments.model import Segment
from attlog.story.event import Event

__all__ = [
    "MEASURED_TIMES",
    "SCHEMA",
    "SCHEMA_NAME",
    "TIMED_OUT",
    "AlignmentStep",
    "Answer",
    "Assessment",
    "Check",
    "CommonBias",
    "Duplicates",
    "EstimatorRow",
    "Event",
    "Finding",
    "ParameterValue",
    "ReferenceSummary",
    "Result",
    "Segment",
    "Setting",
    "Trace",
    "Verdict",
    "nothing_ran",
]
