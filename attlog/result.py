"""The result of an analysis: the dataclasses that are the JSON contract.

``Result.to_json`` writes one document without NaN (null with a code instead),
keys sorted by meaning as declared here, angles in degrees, times in s or ms.
``traces`` are arrays for the figures; they go packed into the page, not into the
JSON file.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from attlog.base.errors import UsageError
from attlog.base.json_text import indented
from attlog.base.limits import MAX_RESULT_BYTES
from attlog.base.settings_file import bytes_of
from attlog.flight.model import Problem
from attlog.health.model import Check
from attlog.metrics.answer import Answer
from attlog.metrics.evidence.common_bias import CommonBias
from attlog.metrics.figures.trace import Trace
from attlog.metrics.ranking.alike import Alike
from attlog.metrics.statistics.units import UnitValues
from attlog.plain import IN_JSON, Misfit, plain, restored, without
from attlog.reference.model import AlignmentStep
from attlog.segments.model import Segment

if TYPE_CHECKING:
    import pandas

__all__ = [
    "AlignmentStep",
    "Alike",
    "Answer",
    "Check",
    "CommonBias",
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

SCHEMA_NAME, SCHEMA_NUMBER = "attlog-result/", 3
SCHEMA = f"{SCHEMA_NAME}{SCHEMA_NUMBER}"
OLDEST = 1
"""Schemas from this number on are read."""
WORDS_BEFORE = {("verdict", "look"): "warn", ("kind", "run"): "continuous", ("code", "bent"): "not_a_pure_delay"}
"""(key, value) of older schemas, and what the value is called now."""
NOT_UTF8 = re.compile("[\ud800-\udfff]")
"""Bytes of a file name that are not UTF-8, as Python keeps them: UTF-8 cannot hold them, a JSON escape can."""

MEASURED_TIMES = ("timing", "ns_per_update", "cost_ns", "cost_ratio")
"""What differs between two runs of the same log; ``--deterministic`` leaves it out."""
KEPT_OUT = {
    kind.__name__: tuple(f.name for f in fields(kind) if not f.metadata.get(IN_JSON, True))
    for kind in (Answer, CommonBias, UnitValues)
}
"""Fields that are not in the JSON, by class."""


TIMED_OUT = "estimator_timed_out"
"""The code of the problem that a user's filter took longer than it was given; its row has failed."""


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
    quality: dict[str, float | str] = field(default_factory=dict)


def nothing_ran(rows: Iterable[EstimatorRow]) -> str:
    """Why the first filter failed, where every filter that was to run did; empty else."""
    ran = [row for row in rows if row.kind == "replay"]
    return f"{ran[0].name}: {ran[0].reason}" if ran and all(row.status == "failed" for row in ran) else ""


@dataclass(slots=True)
class Verdict:
    """The answer to one of the four questions in plain sentences.

    ``question``: closest, quiet, late, drifting. ``sentence`` is plain text. ``bars`` are
    (row, value, unit) for the card, ``not_judged`` (row, reason), ``notes`` sentences on
    what was measured, for the card's details.
    """

    question: str
    title: str
    sentence: str
    metric: str
    window: str
    bars: list[tuple[str, float, str]] = field(default_factory=list)
    not_judged: list[tuple[str, str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


@dataclass(slots=True)
class ReferenceSummary:
    """What everything was compared with, and each step of the alignment.

    ``sigma_tilt_deg``, ``sigma_heading_deg``: how wrong a smoother says it may be itself (RMS over what is
    scored). ``heading_by``: whose north its heading has, ``own``, ``onboard`` or ``nobody``. ``refused``: why a
    better attitude (truth, smoother) was not taken.
    """

    choice: str
    source: str
    rate_hz: float
    floor_deg: float
    text: str
    alignment: list[AlignmentStep] = field(default_factory=list)
    scoring_start_s: float = 0.0
    """Rows are compared from here on: before it filters and onboard settle."""
    scoring_end_s: float | None = None
    """Rows are compared up to here (impact); None: to the end."""
    sigma_tilt_deg: float | None = None
    sigma_heading_deg: float | None = None
    heading_by: str = "own"
    refused: dict[str, str] = field(default_factory=dict)


@dataclass(slots=True)
class Result:
    """Everything ``attlog analyze`` found out about one log; its JSON (``attlog schema``) has the same names.

    ``estimators`` are the rows: each has its answers in ``metrics[window][metric]``, with ``value``, ``ci95``, ``n``
    and ``unit``, or ``code`` and ``reason`` where there is none. ``verdicts`` say in words which row is closest, quiet,
    late and drifting. ``problems`` and ``audit``: what is wrong with the log, and what physics says of its sensors.
    ``segments``: what was going on when; ``reference``: what the rows are compared with, and how it was aligned.
    ``definitions``: what each metric means. Angles in deg, times in s or ms, as the metric's name says; times on
    the log's clock, 0 at the first sample of the replayed IMU.
    """

    attlog: dict[str, str]
    command: str
    config: dict[str, Any]
    log: dict[str, Any]
    problems: list[Problem] = field(default_factory=list)
    audit: list[Check] = field(default_factory=list)
    segments: list[Segment] = field(default_factory=list)
    reference: ReferenceSummary | None = None
    gyro_bias: list[CommonBias] = field(default_factory=list)
    """What was taken off the gyro for every filter alike, one for each replayed IMU."""
    estimators: list[EstimatorRow] = field(default_factory=list)
    alike: list[Alike] = field(default_factory=list)
    """Rows that share an equation, or whose attitudes are equal."""
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
    traces: list[Trace] = field(default_factory=list, metadata={IN_JSON: False})

    def to_dict(self, deterministic: bool = False) -> dict[str, Any]:
        """The JSON document as plain Python; ``deterministic`` drops measured times and how the command was spelled."""
        document: dict[str, Any] = {"schema": self.schema} | plain(self)
        return without(document, MEASURED_TIMES) | {"command": ""} if deterministic else document

    def to_json(
        self, path: str | Path | None = None, deterministic: bool = False, *, document: dict[str, Any] | None = None
    ) -> str:
        """The JSON text; also written to ``path`` (atomically) where given. OutputError if it cannot be.

        ``document``: what ``to_dict`` gave for it, where somebody has it already.
        """
        whole = self.to_dict(deterministic) if document is None else document
        text = indented(whole, "\n")
        if NOT_UTF8.search(text):  # a copy of all of it is not made for nothing
            text = NOT_UTF8.sub(lambda found: f"\\u{ord(found[0]):04x}", text)
        if path is not None:
            from attlog.base.output import write_atomic

            write_atomic(Path(path), text)
        return text

    @classmethod
    def load(cls, path: str | Path) -> Result:
        """The result that ``to_json`` wrote to ``path``, without traces: those are not in the file.

        LogUnreadable if the file cannot be opened, UsageError for what is no result of
        this schema or an older one, with the place. A file written without measured times reads back
        with none: ``to_json(deterministic=True)`` gives its text again. Of an older schema its values are
        read; what it did not tell takes its default, and ``schema`` tells which it was.
        """
        document = _document(Path(path))
        older = document["schema"] != SCHEMA
        try:
            return restored(cls, _renamed(document) if older else document, may_lack=MEASURED_TIMES, older=older)
        except Misfit as misfit:
            raise UsageError(f"{path}: not a result of attlog: {misfit}") from None
        except RecursionError:
            raise UsageError(f"{path}: not a result of attlog: nested too deeply") from None

    def to_html(self, path: str | Path, **options: Any) -> None:
        """Write the self-contained report. OutputError if it cannot be written."""
        from attlog.report import write_report

        write_report(self, Path(path), **options)

    def table(self, window: str = "all") -> pandas.DataFrame:
        """Values of one window: a line for each row, by its name, a column for each metric; NaN where there is none.

        Columns are named as in the JSON, with the unit in the name (``inclination_rmse_deg``, ``lag_ms``). Empty where
        the log has no such window.
        """
        import pandas

        rows = {
            r.name: {m: (np.nan if a.value is None else a.value) for m, a in r.metrics.get(window, {}).items()}
            for r in self.estimators
        }
        return pandas.DataFrame.from_dict(rows, orient="index")


def _document(path: Path) -> dict[str, Any]:
    """The JSON object in a file, of the schema that this version writes. Errors as in ``Result.load``."""
    try:
        text = bytes_of(path, MAX_RESULT_BYTES).decode("utf-8")
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: not a result of attlog: no UTF-8 text at byte {error.start}") from None
    try:
        document = json.loads(text, parse_constant=_no_number)
    except json.JSONDecodeError as error:
        cut = " (the file ends there: it was cut off)" if error.pos >= len(text.rstrip()) else ""
        where = f"line {error.lineno}, column {error.colno}"
        raise UsageError(f"{path}: not valid JSON: {error.msg} in {where}{cut}") from None
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path}: not a result of attlog: {error}") from None
    schema = document.get("schema") if isinstance(document, dict) else None
    if not isinstance(schema, str) or not schema.startswith(SCHEMA_NAME):
        raise UsageError(f"{path}: not a result of attlog: it has no schema {SCHEMA_NAME}N")
    number = schema.removeprefix(SCHEMA_NAME)
    if not (number.isdecimal() and OLDEST <= int(number) <= SCHEMA_NUMBER):
        newer = number.isdecimal() and int(number) > SCHEMA_NUMBER
        what = "a newer attlog wrote it; update attlog" if newer else "analyse the log again with this version"
        raise UsageError(f"{path}: holds {schema[:40]} and this attlog reads {SCHEMA}: {what}")
    found: dict[str, Any] = document
    return found


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is no number of JSON")


def _renamed(value: Any) -> Any:
    """A document of an older schema in today's words."""
    if isinstance(value, dict):
        return {k: WORDS_BEFORE.get((k, v), v) if isinstance(v, str) else _renamed(v) for k, v in value.items()}
    return [_renamed(v) for v in value] if isinstance(value, list) else value
