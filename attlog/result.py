"""The result of an analysis: the dataclasses that are the JSON contract.

``Result.to_json`` writes one document without NaN (null with a code instead),
keys sorted by meaning as declared here, angles in degrees, times in s or ms.
``traces`` are arrays for the figures; they go packed into the page, not into the
JSON file.
"""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from attlog.flight.model import Problem
from attlog.health.model import Check
from attlog.metrics.answer import Answer
from attlog.metrics.trace import Trace
from attlog.reference.model import AlignmentStep
from attlog.segments.model import Segment

if TYPE_CHECKING:
    import pandas

__all__ = [
    "AlignmentStep",
    "Answer",
    "Check",
    "EstimatorRow",
    "ParameterValue",
    "Problem",
    "ReferenceSummary",
    "Result",
    "Segment",
    "Trace",
    "Verdict",
]
"""The whole contract: what stands in a result comes from here for those above it, wherever it is defined."""

SCHEMA = "attlog-result/1"
MEASURED_TIMES = ("timing", "ns_per_update", "cost_ns", "cost_ratio")
"""What differs between two runs of the same log; ``--deterministic`` leaves it out."""
ANSWER_KEEPS = tuple(f.name for f in dataclasses.fields(Answer) if not f.metadata.get("json", True))
"""Fields of an answer that are not in the JSON."""


@dataclass(slots=True)
class ParameterValue:
    """A parameter as it was used. ``origin``: default, preset, option, config, log."""

    value: float | str
    origin: str
    unit: str = ""
    meaning: str = ""


@dataclass(slots=True)
class EstimatorRow:
    """One line of the table: who, with which parameters, and every answer by window.

    ``title`` is what the source calls itself: the first line of an estimator's
    docstring, or the message that an onboard attitude comes from.
    """

    name: str
    kind: str
    estimator: str
    preset: str | None
    parameters: dict[str, ParameterValue]
    metrics: dict[str, dict[str, Answer]]
    skipped: dict[str, int]
    ns_per_update: float | None
    status: str
    reason: str = ""
    is_reference: bool = False
    causal: bool = True
    uses_mag: bool = True
    start_s: float = 0.0
    title: str = ""


@dataclass(slots=True)
class Verdict:
    """The answer to one of the three questions in plain sentences.

    ``question``: quiet, late, drifting. ``sentence`` is plain text. ``bars`` are
    (row, value, unit) for the card, ``not_judged`` (row, reason).
    """

    question: str
    title: str
    sentence: str
    metric: str
    window: str
    bars: list[tuple[str, float, str]] = field(default_factory=list)
    not_judged: list[tuple[str, str]] = field(default_factory=list)


@dataclass(slots=True)
class ReferenceSummary:
    """What everything was compared with, and each step of the alignment."""

    choice: str
    source: str
    rate_hz: float
    floor_deg: float
    text: str
    alignment: list[AlignmentStep] = field(default_factory=list)


@dataclass(slots=True)
class Result:
    """Everything ``attlog analyze`` found out about one log."""

    attlog: dict[str, str]
    command: str
    config: dict[str, Any]
    log: dict[str, Any]
    problems: list[Problem] = field(default_factory=list)
    audit: list[Check] = field(default_factory=list)
    segments: list[Segment] = field(default_factory=list)
    reference: ReferenceSummary | None = None
    estimators: list[EstimatorRow] = field(default_factory=list)
    comparisons: list[dict[str, Any]] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    best: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    """window -> metric -> rows that no row is told apart from as better; absent where that is everybody."""
    worst: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    """window -> metric -> the one row that is worst; absent where nobody is."""
    ranked: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    """window -> metric -> rows that were compared."""
    definitions: dict[str, dict[str, str]] = field(default_factory=dict)
    health: list[dict[str, Any]] = field(default_factory=list)
    timing: dict[str, float] = field(default_factory=dict)
    schema: str = SCHEMA
    traces: list[Trace] = field(default_factory=list)

    def to_dict(self, deterministic: bool = False) -> dict[str, Any]:
        """The JSON document as plain Python; ``deterministic`` drops measured times."""
        names = [f.name for f in dataclasses.fields(self) if f.name not in ("traces", "schema")]
        document = {"schema": self.schema} | {name: plain(getattr(self, name)) for name in names}
        return without(document, MEASURED_TIMES) if deterministic else document

    def to_json(self, path: str | Path | None = None, deterministic: bool = False) -> str:
        """The JSON text; also written to ``path`` (atomically) where given. OutputError if it cannot be."""
        text = json.dumps(self.to_dict(deterministic), ensure_ascii=False, indent=1, allow_nan=False) + "\n"
        if path is not None:
            from attlog.output import write_atomic

            write_atomic(Path(path), text)
        return text

    def to_html(self, path: str | Path, **options: Any) -> None:
        """Write the self-contained report. OutputError if it cannot be written."""
        from attlog.report import write_report

        write_report(self, Path(path), **options)

    def table(self, window: str = "all") -> pandas.DataFrame:
        """Rows by metrics for one window: values, NaN where there is none."""
        import pandas

        rows = {
            r.name: {m: (np.nan if a.value is None else a.value) for m, a in r.metrics.get(window, {}).items()}
            for r in self.estimators
        }
        return pandas.DataFrame.from_dict(rows, orient="index")


def plain(value: Any) -> Any:
    """Dataclasses, arrays and numpy scalars as JSON types; non-finite numbers become None.

    Fields whose metadata says ``json: False`` are left out.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value) if f.metadata.get("json", True)
        }
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(v) for v in (sorted(value) if isinstance(value, (set, frozenset)) else value)]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return str(value)


def without(value: Any, keys: tuple[str, ...]) -> Any:
    """The document with the named keys left out at every level."""
    if isinstance(value, dict):
        return {k: without(v, keys) for k, v in value.items() if k not in keys}
    if isinstance(value, list):
        return [without(v, keys) for v in value]
    return value
