"""The result of an analysis: the dataclasses that are the JSON contract.

``Result.to_json`` writes one document without NaN (null with a code instead), keys in the order of the fields here,
angles in degrees, times in s or ms; :mod:`attlog.result.document` tells what it leaves out. ``traces`` are arrays for
the figures; they go packed into the page, not into the JSON file.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from attlog.core.files import read_settings_bytes
from attlog.core.limits import MAX_RESULT_BYTES
from attlog.core.plain import IN_JSON, NullAsNaN
from attlog.flight.model import TruthFit
from attlog.health.causes import Finding
from attlog.health.check import Assessment, Check
from attlog.metrics.gyro_bias import CommonBias
from attlog.metrics.metric import Answer
from attlog.metrics.ranking import Duplicates
from attlog.metrics.trace import Trace
from attlog.reference.model import AlignmentStep
from attlog.result import document
from attlog.result.document import SCHEMA
from attlog.segments.model import Segment
from attlog.story.flight_events import Event

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects

TIMED_OUT = "estimator_timed_out"
"""The kind of the finding that a user's filter took longer than it was given; its row has failed."""


@dataclass(slots=True)
class ParameterValue:
    """A parameter as it was used. ``origin``: default, preset, option, config, log, file."""

    value: float | str
    origin: str
    unit: str = ""
    meaning: str = ""


@dataclass(slots=True)
class EstimatorRow:
    """One line of the table: who, with which parameters, and every answer by window.

    ``title`` is what the source calls itself: the first line of an estimator's
    docstring, or the message that an onboard attitude comes from. ``quality`` is what an
    estimator that sees the whole run says of itself.
    """

    name: str
    kind: str
    estimator: str
    status: str
    reason: str = ""
    title: str = ""
    preset: str | None = None
    parameters: dict[str, ParameterValue] = field(default_factory=dict)
    is_reference: bool = False
    causal: bool = True
    uses_mag: bool = True
    north_by_gnss: bool = False
    start_s: float = 0.0
    skipped: dict[str, int] = field(default_factory=dict)
    quality: dict[str, float | str] = field(default_factory=dict)
    ns_per_update: float | None = None
    metrics: dict[str, dict[str, Answer]] = field(default_factory=dict)


def nothing_ran(rows: Iterable[EstimatorRow]) -> str:
    """Why the first filter failed, where every filter that was to run did; empty else."""
    ran = [row for row in rows if row.kind == "replay"]
    return f"{ran[0].name}: {ran[0].reason}" if ran and all(row.status == "failed" for row in ran) else ""


@dataclass(slots=True)
class Verdict:
    """The answer to one of the four questions.

    ``question``: accuracy, noise, lag, yaw_drift. ``bars``: (row, value, unit) of the rows with a value in the column
    ``metric``, ``window``. ``notes``: sentences on what was measured and which rows are not ranked, and why.
    """

    question: str
    sentence: str
    metric: str
    window: str
    bars: list[tuple[str, float, str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(slots=True)
class ReferenceSummary:
    """What everything was compared with, and each step of the alignment.

    ``sigma_tilt_deg``, ``sigma_heading_deg``: how wrong a smoother or a brought truth may be itself (RMS over what is
    scored). ``heading_by``: whose north its heading has, ``own``, ``onboard`` or ``nobody``; ``relative``: changes
    alone are compared. ``refused``: why a better attitude (truth, smoother) was not taken. ``fit``: how a truth that
    the user brought came onto the log's clock and axes.
    """

    choice: str
    source: str
    rate_hz: Annotated[float, NullAsNaN()]
    floor_deg: Annotated[float, NullAsNaN()]
    text: str
    alignment: list[AlignmentStep] = field(default_factory=list)
    scoring_start_s: float = 0.0
    """Rows are compared from here on: before it filters and onboard settle."""
    scoring_end_s: float | None = None
    """Rows are compared up to here (impact); None: to the end."""
    sigma_tilt_deg: float | None = None
    sigma_heading_deg: float | None = None
    heading_by: str = "own"
    caveat: str = ""
    """What a ranking by it has to say beside it, as a clause: in doubt, what its heading rests on, who was refused."""
    refused: dict[str, str] = field(default_factory=dict)
    fit: TruthFit | None = None


@dataclass(slots=True)
class Result:
    """Everything ``attlog analyze`` found out about one log; its JSON (``attlog schema``) has the same names.

    ``estimators`` are the rows: each has its answers in ``metrics[window][metric]``, with ``value``, ``ci95``, ``n``
    and ``unit``, or ``code`` and ``reason`` where there is none. ``verdicts`` say in words which row is closest, quiet,
    late and drifting. ``headline`` and ``events``: what happened. ``findings`` and ``audit``: what is wrong, one
    entry for each cause, and what physics says of the sensors.
    ``segments``: what was going on when; ``reference``: what the rows are compared with, and how it was aligned.
    ``definitions``: what each metric means. Angles in deg, times in s or ms, as the metric's name says; times on
    the log's clock, 0 at the first sample of the replayed IMU.
    """

    attlog: dict[str, str]
    command: str
    config: dict[str, Any]
    log: dict[str, Any]
    headline: str = ""
    """What flew, from when to when, what went wrong first and how it ended, in at most 30 words."""
    events: list[Event] = field(default_factory=list)
    """What happened, in time order, each with its evidence."""
    findings: list[Finding] = field(default_factory=list)
    audit: list[Check] = field(default_factory=list)
    health: list[Assessment] = field(default_factory=list)
    """Can the sensors be trusted, and what should be set."""
    segments: list[Segment] = field(default_factory=list)
    reference: ReferenceSummary | None = None
    gyro_bias: list[CommonBias] = field(default_factory=list)
    """What was subtracted from the gyro for every filter alike, one for each replayed IMU."""
    estimators: list[EstimatorRow] = field(default_factory=list)
    alike: list[Duplicates] = field(default_factory=list)
    """Rows that share an equation, or whose attitudes are equal."""
    verdicts: list[Verdict] = field(default_factory=list)
    best: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    """window -> metric -> rows that none is significantly better than; absent where that is everybody."""
    worst: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    """window -> metric -> the one row that is worst; absent where nobody is."""
    ranked: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    """window -> metric -> rows that were compared."""
    timing: dict[str, float] = field(default_factory=dict)
    schema: str = SCHEMA
    traces: list[Trace] = field(default_factory=list, metadata={IN_JSON: False})
    __pydantic_config__: ClassVar[dict[str, Any]] = {"strict": True, "extra": "forbid", "arbitrary_types_allowed": True}

    def to_dict(self, deterministic: bool = False) -> dict[str, Any]:
        """The JSON document as plain Python; ``deterministic`` drops measured times and how the command was spelled."""
        return document.document(self, deterministic)

    def to_json(
        self, path: str | Path | None = None, deterministic: bool = False, *, whole: dict[str, Any] | None = None
    ) -> str:
        """The JSON text, one line; also written to ``path`` (atomically) where given. OutputError if it cannot be.

        ``whole``: what ``to_dict`` gave for it, where somebody has it already.
        """
        whole = self.to_dict(deterministic) if whole is None else whole
        text = json.dumps(whole, ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"
        if document.NOT_UTF8.search(text):  # a copy of all of it is not made for nothing
            text = document.NOT_UTF8.sub(lambda found: f"\\u{ord(found[0]):04x}", text)
        if path is not None:
            from attlog.core.files import write_atomic

            write_atomic(Path(path), text)
        return text

    @classmethod
    def load(cls, path: str | Path) -> Result:
        """The result that ``to_json`` wrote to ``path``, without traces: those are not in the file.

        LogUnreadable if the file cannot be opened, UsageError with the place for what is no result of this schema. A
        file written without measured times reads back with none: ``to_json(deterministic=True)`` gives its text again.
        """
        return cls.read(read_settings_bytes(Path(path), MAX_RESULT_BYTES), str(path))

    @classmethod
    def read(cls, content: bytes, name: str) -> Result:
        """The result that a JSON text is; errors as of :meth:`load` begin with ``name``."""
        return document.read(cls, content, name)

    @property
    def definitions(self) -> dict[str, dict[str, str]]:
        """What each metric of this version means: title, unit, better and text by its id; ``attlog schema`` tells
        them too."""
        from attlog import metrics

        return {
            name: {"title": m.title, "unit": m.unit, "better": m.better, "text": m.definition}
            for name, m in metrics.definitions().items()
        }

    def to_html(self, path: str | Path, **options: Any) -> None:
        """Write the self-contained report. OutputError if it cannot be written."""
        from attlog.report import write_report

        write_report(self, Path(path), **options)

    def figures(self) -> dict[str, str]:
        """Titles of the figures of the report that this result can fill, by the names that :meth:`figure` takes.

        Of a result read from JSON these are the few that need no lines.
        """
        from attlog.report.figures.catalogue import figures

        return figures(self)

    def figure(
        self,
        name: str,
        *,
        view: str | int = 0,
        rows: Sequence[str] | None = None,
        span: tuple[float, float] | None = None,
    ) -> plotly.graph_objects.Figure:
        """A figure of the report for a paper or a notebook: one column (88 mm), 8 pt, black axes, light colours.

        ``view``: which of the figure's views, by its name on the page or the start of it (``"pitch"``), else by its
        place. ``rows``: filters and onboard rows to draw; else those that the page shows at first. ``span``: flight
        time (from, to) in s. Long lines are the extremes of 600 buckets of what is in the span. UsageError for a name
        that is not in :meth:`figures`.
        """
        from attlog.report.figures.catalogue import figure

        return figure(self, name, view=view, rows=rows, span=span)

    def table(self, window: str = "all") -> pandas.DataFrame:
        """Values of one window: a line for each row, by its name, a column for each metric; NaN where there is none.

        Columns are named as in the JSON, with the unit in the name (``tilt_rmse_deg``, ``lag_ms``). Empty where
        the log has no such window.
        """
        import pandas

        rows = {
            r.name: {m: (np.nan if a.value is None else a.value) for m, a in r.metrics.get(window, {}).items()}
            for r in self.estimators
        }
        return pandas.DataFrame.from_dict(rows, orient="index")
