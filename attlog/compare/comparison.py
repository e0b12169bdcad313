"""What configurations are compared by: the four questions, and any metric that is asked for."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from attlog.compare.paired import Direction, PooledMean, Scale
from attlog.core.errors import UsageError, suggestion
from attlog.core.files import read_settings_bytes
from attlog.core.limits import MAX_RESULT_BYTES
from attlog.core.plain import to_plain
from attlog.core.settings import validated
from attlog.metrics import definitions
from attlog.metrics.metric import named
from attlog.words.ranking import AIR, ALL, DRIFT_AIR, PHASES, REST

FALLBACK_WINDOWS = ("all", "airborne", "armed", "rest", "hover", "cruise", "idle")
PHASE_PLACES = {"rest": "at rest", "hover": "in hover", "cruise": "in moving flight", "idle": "with motors idling"}
"""What the phases are called after a noun."""
SHORT_PLACES = PHASE_PLACES | {"cruise": "moving", "idle": "idling"}
"""The same in a title, as the table of one log has it."""


@dataclass(frozen=True, slots=True)
class ComparedMetric:
    """One question: ``metric`` in the first of ``windows`` that a log answers; ``main`` has a sentence and a plot.

    Its values are compared on ``scale``, as a ratio or as a difference.
    """

    metric: str
    windows: tuple[str, ...]
    title: str
    scale: Scale
    main: bool = True

    @property
    def id(self) -> str:
        """What it is called in files: ``tilt_rmse_deg@airborne``."""
        return f"{self.metric}@{self.windows[0]}"


MAIN_QUESTIONS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("tilt_rmse_deg", AIR),
    ("heading_rmse_deg", AIR),
    ("noise_tilt_deg", ("rest",)),
    ("noise_tilt_deg", ("hover",)),
    ("noise_tilt_deg", ("cruise",)),
    ("lag_ms", AIR),
    ("step_error_deg.0.5s", AIR),
    ("drift_rest_deg_per_min", REST),
    (DRIFT_AIR, AIR),
)
"""Metric and windows, in the order of a report on one log."""


def select_questions(metrics: Sequence[str] = (), window: str | None = None) -> list[ComparedMetric]:
    """The questions of a comparison: the main ones, or the ``metrics`` named (``all``), in one window if named.

    UsageError with a suggestion for metrics that do not exist.
    """
    known = definitions()
    windows = None if window is None else (window,)
    wrong = [m for m in metrics if m != "all" and m not in known]
    if wrong:
        raise UsageError("\n".join(f"there is no metric {m}{suggestion(m, ['all', *known])}" for m in wrong))
    if not metrics:
        found = [_main_question(name, places, windows) for name, places in MAIN_QUESTIONS]
    else:
        every = "all" in metrics
        found = [q for name in (known if every else metrics) for q in _metric_questions(name, windows, not every)]
    return list({q.id: q for q in found}.values())


def _main_question(name: str, places: tuple[str, ...], windows: tuple[str, ...] | None) -> ComparedMetric:
    """One of MAIN, called by its noun: ``Tilt error``, ``Noise added in hover``."""
    metric = named(definitions().values(), name)
    noun = metric.wording.noun if metric.wording is not None else metric.title
    added = " added" if places[0] != "rest" else ""
    place = f"{added} {SHORT_PLACES[places[0]]}" if metric.asked == "phases" else ""
    return ComparedMetric(name, windows or places, f"{noun[:1].upper()}{noun[1:]}{place}", metric.scale)


def _metric_questions(name: str, windows: tuple[str, ...] | None, main: bool) -> list[ComparedMetric]:
    """A metric by name in the windows that make sense for it: each phase for itself, at rest, or first in flight."""
    metric = definitions()[name]
    title, scale = metric.title, metric.scale
    in_flight = dict(MAIN_QUESTIONS).get(name) if scale == "ratio" and metric.asked == "flight" else None
    if windows or in_flight:
        return [ComparedMetric(name, windows or in_flight or (), title, scale, main)]
    if metric.asked == "phases":
        return [ComparedMetric(name, (phase,), f"{title}, {phase}", scale, main) for phase in PHASES]
    places = REST if metric.asked == "rest" else (*AIR, *(w for w in (*ALL, *FALLBACK_WINDOWS) if w not in AIR))
    return [ComparedMetric(name, places, title, scale, main)]


# The result of a comparison: one JSON document, its schema versioned, read back by ``Comparison.load``.

COMPARISON_SCHEMA = "attlog-comparison/2"


@dataclass(slots=True)
class ConfigurationSummary:
    """A configuration: ``name`` as its rows are called, ``label`` in sentences, ``text`` for the command line.

    ``parameters`` are those set by hand, ``before`` what comes before the filter.
    """

    name: str
    label: str
    text: str
    parameters: dict[str, str] = field(default_factory=dict)
    before: dict[str, str] = field(default_factory=dict)


@dataclass(slots=True)
class LogLine:
    """One log: what it is and was compared with, or why it could not be used (``code`` as of the command line).

    ``same_as`` names the log of the same flight that counts in its place where logs are pooled.
    """

    name: str
    path: str
    sha256: str = ""
    vehicle: str = ""
    firmware: str = ""
    seconds: float | None = None
    reference: str = ""
    code: int = 0
    reason: str = ""
    same_as: str = ""


@dataclass(slots=True)
class ConfigurationAnswer:
    """A configuration on a log: the answer as ``attlog analyze`` gives it, or the reason for none."""

    value: float | None
    ci95: tuple[float, float] | None = None
    n: int = 0
    window: str = ""
    status: str = "ok"
    reason: str = ""


@dataclass(slots=True)
class LogDifference:
    """A configuration beside the first on one log, on ``n`` common units of evidence.

    ``value`` is the ratio or the difference of sizes (below one, below zero: nearer to perfect), ``first``
    and ``second`` what it is of; None with the ``reason``. ``error`` is the standard error of the logarithm of
    the ratio, or of the difference; ``floor`` the size below which it counts as none.
    """

    log: str
    value: float | None
    ci95: tuple[float, float] | None = None
    p: float | None = None
    n: int = 0
    first: float | None = None
    second: float | None = None
    error: float | None = None
    floor: float = 0.0
    direction: Direction = "not significant"
    window: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class PooledDifference(PooledMean):
    """The differences of all logs that have a value as one; of ratios ``value`` and ``ci95`` are ratios again.

    ``tau`` stays on the scale of their logarithm. ``floor``: the size below which it counts as none.
    """

    floor: float
    direction: Direction


@dataclass(slots=True)
class Contrast:
    """One configuration beside the first: log by log, and over all of them (None where no log has a value)."""

    configuration: str
    logs: list[LogDifference] = field(default_factory=list)
    over: PooledDifference | None = None


@dataclass(slots=True)
class Question:
    """One metric in one kind of window (of several names the first in which a log has a value)."""

    id: str
    metric: str
    windows: list[str]
    title: str
    unit: str
    better: str
    scale: Scale
    main: bool
    cells: dict[str, dict[str, ConfigurationAnswer]] = field(default_factory=dict)
    """log -> configuration -> cell"""
    contrasts: list[Contrast] = field(default_factory=list)


@dataclass(slots=True)
class ConfigurationSentences:
    """What a configuration is worth beside the first, in sentences: the lead, and one for each further question."""

    configuration: str
    lead: str
    more: list[str] = field(default_factory=list)


@dataclass(slots=True)
class Comparison:
    """Everything ``attlog compare`` found out. The first of ``configurations`` is what the others are compared with.

    ``unanswered``: question id -> why no log answers it.
    """

    attlog: dict[str, str]
    command: str
    config: dict[str, Any]
    configurations: list[ConfigurationSummary] = field(default_factory=list)
    logs: list[LogLine] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    unanswered: dict[str, str] = field(default_factory=dict)
    verdicts: list[ConfigurationSentences] = field(default_factory=list)
    definitions: dict[str, str] = field(default_factory=dict)
    schema: str = COMPARISON_SCHEMA
    __pydantic_config__: ClassVar[dict[str, Any]] = {"strict": True, "extra": "forbid"}

    def to_json(self, path: str | Path | None = None) -> str:
        """The JSON text; also written to ``path`` (atomically) where given. OutputError if it cannot be."""
        text = json.dumps(to_plain(self), ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"
        text = text.encode("utf-8", "surrogatepass").decode("utf-8", "replace")
        if path is not None:
            from attlog.core.files import write_atomic

            write_atomic(Path(path), text)
        return text

    @classmethod
    def load(cls, path: str | Path) -> Comparison:
        """What ``to_json`` wrote. LogUnreadable if the file cannot be opened, UsageError for what is no comparison."""
        try:
            document = json.loads(read_settings_bytes(Path(path), MAX_RESULT_BYTES).decode("utf-8"))
        except (ValueError, RecursionError) as error:
            raise UsageError(f"{path}: not a comparison of attlog: no valid JSON: {error}") from None
        schema = document.get("schema") if isinstance(document, dict) else None
        if schema != COMPARISON_SCHEMA:
            raise UsageError(f"{path}: not a comparison of attlog: its schema is {schema!r}, not {COMPARISON_SCHEMA}")
        return validated(cls, document, f"{path}: not a comparison of attlog", strict=True)
