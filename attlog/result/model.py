"""Dataclasses of a result, which define the JSON contract.

``Result.to_json`` writes one document without NaN (null with a code instead), keys in the order of the fields, angles
in degrees, times in s or ms. ``traces`` are arrays for the figures: packed in the page, absent from the JSON.
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
from attlog.flight.parameters import ParameterHistory
from attlog.health.check import Check
from attlog.health.findings import Finding
from attlog.metrics.gyro_bias import CommonBias
from attlog.metrics.metric import Answer
from attlog.metrics.ranking import Duplicates
from attlog.metrics.trace import Trace
from attlog.reference.model import AlignmentStep, Reproduction
from attlog.result import document
from attlog.result.document import SCHEMA
from attlog.segments.model import Segment
from attlog.story.flight_events import Event

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects

# Kind of the finding that a user's filter exceeded its time. Its row has failed.
TIMED_OUT = "estimator_timed_out"


@dataclass(slots=True)
class ParameterValue:
    """Parameter value used. ``origin``: default, preset, option, config, log, file."""

    value: float | str
    origin: str
    unit: str = ""
    meaning: str = ""


@dataclass(slots=True)
class EstimatorRow:
    """Table row: estimator, parameters, and every answer by window.

    ``title``: first line of an estimator's docstring, or the message of an onboard attitude. ``quality``: an
    estimator's remarks on its own run. ``kind``: ``replay``, ``onboard``, or ``rerun`` of the filter that flew, never
    ranked. ``reproduction``: deviation of the re-run from the flown attitude. ``mode``: of the re-run, resets and
    aiding as ``flown`` or by the filter's ``own`` rules.
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
    reproduction: Reproduction | None = None
    ns_per_update: float | None = None
    metrics: dict[str, dict[str, Answer]] = field(default_factory=dict)
    mode: str = ""


def nothing_ran(rows: Iterable[EstimatorRow]) -> str:
    """Return why the first filter failed if every filter did, else an empty text."""
    ran = [row for row in rows if row.kind == "replay"]
    return f"{ran[0].name}: {ran[0].reason}" if ran and all(row.status == "failed" for row in ran) else ""


@dataclass(slots=True)
class Verdict:
    """Answer to one of the four questions.

    ``question``: accuracy, noise, lag, yaw_drift. ``answered``: a filter has a value in the column ``metric``,
    ``window``. ``notes``: sentences on the measurement, and on rows that are not ranked.
    """

    question: str
    sentence: str
    metric: str
    window: str
    answered: bool = False
    notes: list[str] = field(default_factory=list)


@dataclass(slots=True)
class ReferenceSummary:
    """Reference of all comparisons, and each step of the alignment.

    ``sigma_tilt_deg``, ``sigma_heading_deg``: RMS error of the reference itself (smoother or external truth).
    ``heading_by``: source of its heading, ``own``, ``onboard`` or ``none``. ``refused``: attitude (truth, smoother)
    -> why it was rejected as reference. ``fit``: clock and axes of a truth from the user.
    """

    choice: str
    source: str
    rate_hz: Annotated[float, NullAsNaN()]
    floor_deg: Annotated[float, NullAsNaN()]
    text: str
    alignment: list[AlignmentStep] = field(default_factory=list)
    # Start of the comparison: filters and onboard attitude have settled.
    scoring_start_s: float = 0.0
    # End of the comparison (impact); None: end of the log.
    scoring_end_s: float | None = None
    sigma_tilt_deg: float | None = None
    sigma_heading_deg: float | None = None
    heading_by: str = "own"
    # Caveat: doubts about the reference, the source of its heading, a rejected better one.
    caveat: str = ""
    refused: dict[str, str] = field(default_factory=dict)
    fit: TruthFit | None = None


@dataclass(slots=True)
class Result:
    """Result of ``attlog analyze`` for one log; its JSON has the same names.

    ``attlog schema`` prints its schema. ``estimators``: rows with their answers in ``metrics[window][metric]``:
    ``value``, ``ci95``, ``n`` and ``unit``, or ``code`` and ``reason`` without a value. ``verdicts``: the four answers
    in words. ``headline`` and ``events``: what happened. ``findings``: problems, one entry per cause. ``checks``: of
    sensors and estimator, with settings. ``segments``: phases of the log. ``reference``: attitude that rows are
    compared with. ``definitions``: meaning of each metric. Angles in deg, times in s or ms, as the metric's name says,
    on the log's clock: 0 at the first sample of the replayed IMU.
    """

    attlog: dict[str, str]
    command: str
    config: dict[str, Any]
    log: dict[str, Any]
    # Vehicle, start and end, first failure and outcome, in at most 30 words.
    headline: str = ""
    # In time order, each with its evidence.
    events: list[Event] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)
    segments: list[Segment] = field(default_factory=list)
    reference: ReferenceSummary | None = None
    # Bias subtracted from the gyro for every filter, one per replayed IMU.
    gyro_bias: list[CommonBias] = field(default_factory=list)
    estimators: list[EstimatorRow] = field(default_factory=list)
    # Why the flown filter was not re-run; empty if it was, or if attlog has no such filter.
    not_rerun: str = ""
    # Rows with a common equation, or with equal attitudes.
    alike: list[Duplicates] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    # window -> metric -> rows that no row is significantly better than; absent if that is all of them.
    best: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    # window -> metric -> the significantly worst row; absent if there is none.
    worst: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    # window -> metric -> compared rows.
    ranked: dict[str, dict[str, list[str]]] = field(default_factory=dict)
    timing: dict[str, float] = field(default_factory=dict)
    schema: str = SCHEMA
    traces: list[Trace] = field(default_factory=list, metadata={IN_JSON: False})
    # Every parameter; the JSON's ``log`` has those that differ from their default, and what was set in flight.
    parameters: list[ParameterHistory] = field(default_factory=list, metadata={IN_JSON: False})
    __pydantic_config__: ClassVar[dict[str, Any]] = {"strict": True, "extra": "forbid", "arbitrary_types_allowed": True}

    def to_dict(self, deterministic: bool = False) -> dict[str, Any]:
        """Return the JSON document as plain Python objects.

        ``deterministic``: without measured times and the command.
        """
        return document.document(self, deterministic)

    def to_json(
        self, path: str | Path | None = None, deterministic: bool = False, *, whole: dict[str, Any] | None = None
    ) -> str:
        """Return the JSON text, one line; also write it to ``path`` (atomically) if given.

        ``whole``: output of ``to_dict``, if already computed. OutputError if the file cannot be written.
        """
        whole = self.to_dict(deterministic) if whole is None else whole
        text = json.dumps(whole, ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"
        if document.NOT_UTF8.search(text):  # copying all of it is avoided if possible
            text = document.NOT_UTF8.sub(lambda found: f"\\u{ord(found[0]):04x}", text)
        if path is not None:
            from attlog.core.files import write_atomic
            from attlog.core.own_files import REPORT

            write_atomic(Path(path), text, REPORT)
        return text

    @classmethod
    def load(cls, path: str | Path) -> Result:
        """Read the result that ``to_json`` wrote to ``path``, without traces.

        LogUnreadable if the file cannot be opened. UsageError with the place of the error if it is no result of this
        schema. A file without measured times stays without: ``to_json(deterministic=True)`` reproduces its text.
        """
        return cls.read(read_settings_bytes(Path(path), MAX_RESULT_BYTES), str(path))

    @classmethod
    def read(cls, content: bytes, name: str) -> Result:
        """Return the result of a JSON text; errors as of :meth:`load` begin with ``name``."""
        return document.read(cls, content, name)

    @property
    def definitions(self) -> dict[str, dict[str, str]]:
        """Title, unit, better and text of each metric by its id."""
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
        """Return titles of the figures that this result can fill, by name.

        Names are those of :meth:`figure`. A result read from JSON has only the few figures without traces.
        """
        from attlog.report.figures.catalogue import Album

        return Album.of(self).titles

    def figure(
        self,
        name: str,
        *,
        view: str | int = 0,
        rows: Sequence[str] | None = None,
        span: tuple[float, float] | None = None,
    ) -> plotly.graph_objects.Figure:
        """Return a figure for print: 88 mm wide, 8 pt, black axes, light colours.

        ``view``: a view of the figure by its name on the page or the start of it (``"pitch"``), else by its number.
        ``rows``: filters and onboard rows to draw, default those that the page shows at first. ``span``: flight time
        (from, to), s. Long lines are reduced to the extremes of 600 buckets. UsageError for a name that is not in
        :meth:`figures`.
        """
        import plotly.graph_objects as go

        from attlog.report.figures.catalogue import Album

        return go.Figure(Album.of(self).drawn(name, view=view, rows=rows, span=span))

    def table(self, window: str = "all") -> pandas.DataFrame:
        """Return the values of one window: a line per row, a column per metric.

        NaN without a value. Columns are named as in the JSON (``tilt_rmse_deg``, ``lag_ms``). Empty where the log has
        no such window.
        """
        import pandas

        rows = {
            r.name: {m: (np.nan if a.value is None else a.value) for m, a in r.metrics.get(window, {}).items()}
            for r in self.estimators
        }
        return pandas.DataFrame.from_dict(rows, orient="index")
