"""Dataclasses of a result, which define the JSON contract.

``Result.to_json`` writes one document without NaN (null with a code instead), keys in the order of the fields, angles
in degrees, times in s or ms. ``traces`` are arrays for the figures: packed in the page, absent from the JSON.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.brief import brief, counted, listed, table_html, table_text
from attlog.core.errors import UsageError, suggestion
from attlog.core.files import read_settings_bytes
from attlog.core.limits import MAX_RESULT_BYTES
from attlog.core.plain import IN_JSON, NullAsNaN, json_text
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
from attlog.segments.model import WINDOWS, Segment, interpolate_attitudes, merge_numbers, number_segments
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
    __repr__ = brief


def nothing_ran(rows: Iterable[EstimatorRow]) -> str:
    """Return why the first filter failed if every filter did, else an empty text."""
    ran = [row for row in rows if row.kind == "replay"]
    return f"{ran[0].name}: {ran[0].reason}" if ran and all(row.status == "failed" for row in ran) else ""


def unknown_name(what: str, name: str, known: Sequence[str]) -> str:
    """Return the sentence about an unknown name, with all known ones and the nearest."""
    near = suggestion(name, known)
    return f"no {what} {name!r}; this result has {', '.join(known) or 'none'}{near if 'did you mean' in near else ''}"


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
    __repr__ = brief


# Most common times of :class:`AttitudeTracks`, and the highest rate in Hz at which they are kept.
MAX_TRACK_SAMPLES, MAX_TRACK_HZ = 30_000, 100.0
REFERENCE_NAME = "reference"


@dataclass(slots=True)
class AttitudeTracks:
    """Attitudes (n, 4) of every row and of the reference at common times ``t`` (n,) s, NaN where a row has none.

    They are as compared: with trim, declination and heading offset applied. Single precision keeps 10^-5 deg.
    """

    t: NDArray[np.float64]
    q: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    __repr__ = brief

    @classmethod
    def at_times_of(cls, t: NDArray[np.float64]) -> AttitudeTracks:
        """Return empty tracks at rising times ``t`` (n,), of more than the limits at every k-th."""
        seconds = float(t[-1] - t[0]) if len(t) > 1 else 0.0
        return cls(t[:: max(1, math.ceil(len(t) / max(1.0, min(MAX_TRACK_SAMPLES, MAX_TRACK_HZ * seconds + 1.0))))])

    def add(self, name: str, t: NDArray[np.float64], q: NDArray[np.float64], segment: NDArray[np.int64]) -> None:
        """Add attitudes (n, 4) at rising ``t`` (n,), interpolated within segments (n,) and gaps."""
        if len(t):
            own = merge_numbers(segment, number_segments(t))
            self.q[name] = interpolate_attitudes(t, q, own, self.t)[0].astype(np.float32)

    def frame(self, rows: Sequence[str] | None = None) -> pandas.DataFrame:
        """Return a table by time in s, two levels of columns: row and quantity. UsageError for an unknown row."""
        import pandas

        asked = list(self.q) if rows is None else [rows] if isinstance(rows, str) else list(rows)
        parts = {}
        for name in asked:
            if name not in self.q:
                raise UsageError(unknown_name("row", name, list(self.q)))
            q = self.q[name].astype(np.float64)
            angles = np.degrees(rotation.to_euler(q))
            columns = {f"{angle}_deg": angles[:, k] for k, angle in enumerate(("roll", "pitch", "yaw"))}
            parts[name] = pandas.DataFrame(columns | {f"q_{c}": q[:, k] for k, c in enumerate("wxyz")}, index=self.t)
        if not parts:
            return pandas.DataFrame(index=pandas.Index(self.t, name="time_s"))
        found = pandas.concat(parts, axis=1, names=["row", "quantity"])
        found.index.name = "time_s"
        return found


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
    # None where the rows were evaluated without traces, and in a result read from JSON.
    tracks: AttitudeTracks | None = field(default=None, metadata={IN_JSON: False})
    # Every parameter; the JSON's ``log`` has those that differ from their default, and what was set in flight.
    parameters: list[ParameterHistory] = field(default_factory=list, metadata={IN_JSON: False})
    __pydantic_config__: ClassVar[dict[str, Any]] = {"strict": True, "extra": "forbid", "arbitrary_types_allowed": True}

    def __repr__(self) -> str:
        return table_text(*self._summary())

    def _repr_html_(self) -> str:
        return table_html(*self._summary())

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        """Return title and rows of the short text."""
        verdicts = Counter(check.verdict for check in self.checks)
        reference = "none" if self.reference is None else f"{self.reference.choice} ({self.reference.source})"
        rows = [
            ("headline", self.headline or "none"),
            ("findings", f"{len(self.findings)}: {self.findings[0].text}" if self.findings else "none"),
            ("events", counted(self.events, "event")),
            ("checks", ", ".join(f"{n} {verdict}" for verdict, n in verdicts.most_common()) or "none"),
            ("reference", reference),
            ("estimators", listed([row.name for row in self.estimators]) or "none"),
            ("windows", listed(self.windows) or "none"),
            *((v.question, v.sentence) for v in self.verdicts[:1]),
        ]
        return f"Result of {self.log.get('name', 'a log')}, attlog {self.attlog.get('version', '')}".rstrip(), rows

    @property
    def windows(self) -> list[str]:
        """Names of the windows in which rows have answers, as for :meth:`table`."""
        return list(dict.fromkeys(window for row in self.estimators for window in row.metrics))

    def row(self, name: str) -> EstimatorRow:
        """Return the row of a filter or onboard attitude by its name. UsageError with all names for an unknown one."""
        names = [row.name for row in self.estimators]
        if name not in names:
            raise UsageError(unknown_name("row", name, names))
        return self.estimators[names.index(name)]

    def to_dict(self, deterministic: bool = False) -> dict[str, Any]:
        """Return the JSON document as plain Python objects.

        ``deterministic``: without measured times and the command.
        """
        return document.document(self, deterministic)

    def to_json(self, path: str | Path | None = None, deterministic: bool = False) -> str:
        """Return the JSON text, one line; also write it to ``path`` (atomically) if given.

        OutputError if the file cannot be written.
        """
        text = json_text(self.to_dict(deterministic)) + "\n"
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

    def attitudes(self, rows: Sequence[str] | None = None) -> pandas.DataFrame:
        """Return attitudes of every filter, onboard attitude and the reference at common times.

        A line per time in s, columns by row and quantity: ``result.attitudes()["mahony"]["roll_deg"]``. Quantities are
        ``roll_deg``, ``pitch_deg``, ``yaw_deg`` and ``q_w`` to ``q_z``; the row ``reference`` is the reference. They
        are as compared (trim, declination and heading offset applied), at the times of the reference, at most 100 Hz
        and 30,000; :func:`attlog.estimate` gives a filter at every sample. ``rows``: names of the rows wanted.
        UsageError for an unknown row, and for a result read from JSON or evaluated without traces.
        """
        if self.tracks is None:
            raise UsageError(
                "this result holds no attitudes, as none does that is read from JSON or evaluated without traces; "
                "attlog.analyze(log) gives one with them"
            )
        return self.tracks.frame(rows)

    def table(self, window: str = "all") -> pandas.DataFrame:
        """Return the values of one window: a line per row, a column per metric.

        NaN without a value. Columns are named as in the JSON (``tilt_rmse_deg``, ``lag_ms``). UsageError for a window
        that is not in :attr:`windows`.
        """
        import pandas

        if window not in self.windows and (self.estimators or window not in WINDOWS):
            raise UsageError(unknown_name("window", window, self.windows or WINDOWS))

        rows = {
            r.name: {m: (np.nan if a.value is None else a.value) for m, a in r.metrics.get(window, {}).items()}
            for r in self.estimators
        }
        return pandas.DataFrame.from_dict(rows, orient="index")
