"""Questions of ``attlog compare``, ``sweep`` and ``tune``, and the comparison document."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any

from attlog.compare.paired import Difference, Interval, Scale
from attlog.core.errors import UsageError, suggestion
from attlog.core.plain import to_plain
from attlog.estimators.registry import FLOWN
from attlog.metrics import Metric, definitions
from attlog.metrics.heading import GNSS_HEADING_NAME
from attlog.metrics.metric import named
from attlog.metrics.rerun import AID_GROUPS, RESETS
from attlog.words.flight import mode_phrase
from attlog.words.numbers import counted
from attlog.words.ranking import AIR, ALL, DRIFT_AIR, PHASES, REST, SELF_COMPARED

FALLBACK_WINDOWS = ("all", "airborne", "armed", "rest", "hover", "cruise", "idle")
# Phases after a noun, in a sentence and in a title.
PHASE_PLACES = {"rest": "at rest", "hover": "in hover", "cruise": "in moving flight", "idle": "with motors idling"}
SHORT_PLACES = PHASE_PLACES | {"cruise": "moving", "idle": "idling"}
# Metric and windows, in the order of the report of one log.
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
# Additional questions of a re-run onboard filter. They need no reference.
FLOWN_QUESTIONS: tuple[tuple[str, tuple[str, ...]], ...] = (
    *((f"{what}.{aid}", AIR) for aid in AID_GROUPS for what in ("innovation_rms", "test_ratio_rms", "rejected_pct")),
    (RESETS.name, AIR),
    (GNSS_HEADING_NAME, ALL),
)
# Shown on the page alone: without units of evidence their differences have no interval.
MINOR_FLOWN_QUESTIONS = tuple(
    (f"{what}.{aid}", AIR) for aid in AID_GROUPS for what in ("innovation_bias", "innovation_correlation")
)
OWN_REFERENCE = "the reference is the attitude of the filter that flew"
COMPARISON_SCHEMA = "attlog-comparison/3"


@dataclass(slots=True)
class SettingAnswer:
    """Answer of one setting on one log, or why it is missing."""

    value: float | None
    ci95: Interval | None = None
    n: int = 0
    window: str = ""
    status: str = "ok"
    reason: str = ""


@dataclass(slots=True)
class Contrast:
    """One configuration against the first, log by log and pooled in ``over``."""

    configuration: str
    logs: list[Difference] = field(default_factory=list)
    over: Difference | None = None


@dataclass(frozen=True, slots=True)
class Question:
    """One metric, in the first of ``windows`` in which a log has a value.

    ``main``: the question has a sentence and a figure. ``cells``: log -> configuration -> answer.
    """

    metric: str
    windows: tuple[str, ...]
    title: str
    unit: str
    better: str
    scale: Scale
    main: bool = True
    cells: dict[str, dict[str, SettingAnswer]] = field(default_factory=dict, compare=False)
    contrasts: list[Contrast] = field(default_factory=list, compare=False)

    @property
    def id(self) -> str:
        """Return the question's name in files: ``tilt_rmse_deg@airborne``."""
        return f"{self.metric}@{self.windows[0]}"

    @property
    def name(self) -> str:
        """Return ``METRIC``, or ``METRIC@WINDOW`` for a part of the log."""
        return self.metric if self.window == "all" else self.id

    @property
    def window(self) -> str:
        """Return its first window."""
        return self.windows[0]

    @property
    def needs_reference(self) -> bool:
        """Return whether the metric needs the reference attitude."""
        return not self.metric.startswith((*SELF_COMPARED, GNSS_HEADING_NAME))

    def contrast(self, name: str) -> Contrast:
        """Return the contrast of a configuration after the first."""
        return next(c for c in self.contrasts if c.configuration == name)


def select_questions(metrics: Sequence[str] = (), window: str | None = None, *, flown: bool = False) -> list[Question]:
    """Return the main questions, or those of ``metrics``.

    ``metrics``: ``METRIC[@WINDOW]`` or ``all``. ``flown``: add the questions of a re-run onboard filter. UsageError
    lists every error.
    """
    windows = None if window is None else (window,)
    if not metrics:
        found = [
            replace(_main_question(m, places), windows=windows or places)
            for m, places in (*MAIN_QUESTIONS, *FLOWN_QUESTIONS * flown)
        ]
        found += [
            replace(_main_question(m, p), windows=windows or p, main=False) for m, p in MINOR_FLOWN_QUESTIONS * flown
        ]
    else:
        asked = parse_metrics(["*" if m == "all" else m for m in metrics])
        every = "all" in metrics
        found = [q for m, own in asked for q in _metric_questions(m, (own,) if own else windows, not every)]
    return list({q.id: q for q in found}.values())


def parse_metrics(texts: Iterable[str], known: Sequence[Metric] = ()) -> list[tuple[Metric, str]]:
    """Parse texts such as ``lag_ms``, ``noise_*@hover`` to metrics and windows.

    The window is "" where none is named. UsageError lists every error.
    """
    by_name = {m.name: m for m in known or definitions().values()}
    found: dict[tuple[str, str], tuple[Metric, str]] = {}
    wrong = []
    for text in texts:
        name, _, window = (part.strip() for part in text.partition("@"))
        meant = [m for n, m in by_name.items() if fnmatchcase(n, name)]
        if not meant:
            wrong.append(f"{text}: there is no metric {name}{suggestion(name, ['all', *by_name])}")
        if "@" in text and not window:
            wrong.append(f"{text}: no window after @; give one such as {name}@hover")
        found |= {(m.name, window): (m, window) for m in meant}
    if wrong or not found:
        raise UsageError("\n".join(wrong) or "no metric; give one such as tilt_rmse_deg")
    return list(found.values())


def question_of(metric: Metric, window: str) -> Question:
    """Return the question for a metric in one window."""
    place = "rest" if metric.asked == "phases" and window == "all" else window
    if any(metric.name == name and place in places for name, places in MAIN_QUESTIONS):
        found = replace(_main_question(metric.name, (place,)), windows=(window,))
        at = "" if metric.asked == "phases" or window == "all" else f", {window}"
        return replace(found, title=found.title + at)
    return _question(metric, (window,), metric.title if window == "all" else f"{metric.title}, {window}")


def _question(metric: Metric, windows: tuple[str, ...], title: str, main: bool = True) -> Question:
    return Question(metric.name, windows, title, metric.unit, metric.better, metric.scale, main)


def _main_question(name: str, windows: tuple[str, ...]) -> Question:
    """Return a main question, titled by noun: ``Tilt error``, ``Noise added in hover``."""
    metric = named(definitions().values(), name)
    noun = metric.wording.noun if metric.wording is not None else metric.title
    added = " added" if windows[0] != "rest" else ""
    place = f"{added} {SHORT_PLACES[windows[0]]}" if metric.asked == "phases" else ""
    return replace(_question(metric, windows, f"{noun[:1].upper()}{noun[1:]}{place}"), metric=name)


def _metric_questions(metric: Metric, windows: tuple[str, ...] | None, main: bool) -> list[Question]:
    """Return a metric's questions: one per phase, at rest, or first in flight."""
    in_flight = dict(MAIN_QUESTIONS).get(metric.name) if metric.scale == "ratio" and metric.asked == "flight" else None
    if windows or in_flight:
        return [_question(metric, windows or in_flight or (), metric.title, main)]
    if metric.asked == "phases":
        return [_question(metric, (phase,), f"{metric.title}, {phase}", main) for phase in PHASES]
    places = REST if metric.asked == "rest" else (*AIR, *(w for w in (*ALL, *FALLBACK_WINDOWS) if w not in AIR))
    return [_question(metric, places, metric.title, main)]


@dataclass(slots=True)
class ConfigurationSummary:
    """One configuration of a comparison.

    ``name``: of its rows. ``label``: in sentences. ``text``: for the command line. ``parameters``: set by the user.
    ``before``: settings of the samples ahead of the filter.
    """

    name: str
    label: str
    text: str
    parameters: dict[str, str] = field(default_factory=dict)
    before: dict[str, str] = field(default_factory=dict)


@dataclass(slots=True)
class LogLine:
    """One log and its reference, or ``code`` and ``reason`` why it is unusable.

    ``same_as``: another log of the same flight, which replaces it where logs are pooled. ``mode``: of a re-run onboard
    filter, ``own`` or ``flown``.
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
    mode: str = ""


@dataclass(slots=True)
class ConfigurationSentences:
    """Sentences on a configuration against the first.

    The lead comes first, then one sentence per further question.
    """

    configuration: str
    lead: str
    more: list[str] = field(default_factory=list)


@dataclass(slots=True)
class Comparison:
    """Comparison of settings over logs and metrics, each with the first configuration.

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

    @property
    def first(self) -> ConfigurationSummary:
        """Return the configuration that all others are compared with."""
        return self.configurations[0]

    @property
    def is_what_if(self) -> bool:
        """Return whether all configurations re-run a filter that flew."""
        return all(c.text.partition(":")[0] in FLOWN for c in self.configurations)

    @property
    def mode_text(self) -> str:
        """Return in one phrase the modes of re-run onboard filters, empty without any."""
        return modes_text(line.mode for line in self.used)

    @property
    def labels(self) -> dict[str, str]:
        """Return the label of each configuration by its name."""
        return {c.name: c.label for c in self.configurations}

    @property
    def used(self) -> list[LogLine]:
        """Return the logs that could be used."""
        return [line for line in self.logs if not line.code]

    @property
    def without_answer(self) -> dict[str, str]:
        """Return logs that could be used but answer no question, with the commonest reason."""
        by_log: dict[str, list[Difference]] = {line.name: [] for line in self.used}
        for found in (d for q in self.questions for c in q.contrasts for d in c.logs if d.log in by_log):
            by_log[found.log].append(found)
        return {
            log: commonest_reason(d.reason for d in found)
            for log, found in by_log.items()
            if all(d.value is None for d in found)
        }

    @property
    def answers(self) -> bool:
        """Return whether a log answers a question."""
        return len(self.used) > len(self.without_answer)

    def to_json(self) -> str:
        """Return the JSON text; characters that cannot be encoded are replaced."""
        text = json.dumps(to_plain(self), ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"
        return text.encode("utf-8", "surrogatepass").decode("utf-8", "replace")


def modes_text(modes: Iterable[str]) -> str:
    """Return the modes of re-runs on several logs in one phrase, empty without any."""
    every = [mode for mode in modes if mode]
    counts = {mode: every.count(mode) for mode in ("own", "flown") if mode in every}
    if len(counts) < 2:
        return "".join(map(mode_phrase, counts))
    return f"{mode_phrase('own')} on {counts['own']} of {counted(len(every), 'log')}, else as logged"


def commonest_reason(reasons: Iterable[str]) -> str:
    """Return the most frequent reason, empty without any."""
    given = [reason for reason in reasons if reason]
    return max(dict.fromkeys(given), key=given.count) if given else ""
