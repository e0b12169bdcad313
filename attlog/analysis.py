"""The one pipeline: a log in, a :class:`~attlog.result.Result` out, in two halves.

prepare: read -> segments -> reference -> heading references. evaluate: estimators ->
rows -> metrics -> best -> verdicts, as often as wanted on what was prepared once.
Each stage lives in its own room; this file only hands things on and keeps the time.
"""

from __future__ import annotations

import logging
import math
import os
import platform
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import attlog
from attlog import estimators, metrics, reference, replay, segments, story
from attlog.base.errors import AttlogError, LogUnusable, PluginError, PluginTimeout, UsageError
from attlog.base.freed import give_back
from attlog.config import Config
from attlog.estimators.base import Estimate
from attlog.estimators.registry import BUILT_IN
from attlog.flight import memory as room
from attlog.flight import read
from attlog.flight.model import FlightLog, Imu, Problem, part_of
from attlog.health import Check, answerable, audit
from attlog.health.findings import OpenQuestion, contradiction, findings, unusable
from attlog.metrics.base import Case, per_case
from attlog.metrics.evidence.common_bias import common_bias
from attlog.metrics.evidence.common_bias import none as no_bias
from attlog.metrics.figures.trace import Trace
from attlog.metrics.ranking.alike import Likeness
from attlog.metrics.ranking.best import Ranking
from attlog.present.sentences import verdicts
from attlog.reference.model import AlignmentStep, HeadingReference, Reference, Row
from attlog.result import TIMED_OUT, EstimatorRow, ReferenceSummary, Result
from attlog.segments.model import WINDOWS, Segments
from attlog.segments.once import once
from attlog.summary import describe

STAGES = logging.getLogger("attlog.stages")
"""Tells what is being done; who wants to know adds a handler."""
SAID = {
    "read": "reading the log",
    "segments": "finding rest and flight",
    "reference": "aligning the reference",
    "smoother": "smoothing the whole flight",
    "estimators": "running filters",
    "metrics": "measuring",
    "audit": "checking against physics",
}


@once()
def prepare(source: str | Path | FlightLog, config: Config | Mapping[str, Any] | None = None) -> Case:
    """A log made ready for :func:`evaluate`: all that does not depend on which filters are compared.

    ``source`` is a path or a :class:`FlightLog` from :func:`attlog.read`; a mapping is
    checked like a configuration file. LogUnreadable or LogUnusable (no inertial data,
    encrypted, not a log) if there is nothing to analyse, UsageError for a sensor,
    reference or window that is not there.
    """
    config = Config.of(config)
    clock = Stopwatch()
    with clock("read"):
        log = _given(source, config) if isinstance(source, FlightLog) else _read(source, config)
    if log.imu is None:
        raise LogUnusable(_why_no_imu(log))
    room.check_rest(log, room.ANALYSIS)
    with clock("segments"):
        phases = segments.build(log)
        windows = _windows(config, phases)
    with clock("reference"):
        options = reference_options(config)
        ref = part_of(
            log,
            "The reference",
            lambda: reference.choose(log, phases, options, smooth=_smoothing(log, phases, options, clock)),
            lambda: reference.choose(log, phases, replace(options, reference="none")),
        )
        headings = part_of(log, "Other headings", lambda: reference.heading_references(log, phases, ref), _no_headings)
    imus = _imus(log, config)
    give_back(len(log.imus[log.imu].gyro.t))
    return Case(
        log,
        phases,
        ref,
        heading_references=headings,
        imus=imus,
        gyro_bias={
            imu.index: part_of(log, "The gyro bias", partial(common_bias, log, phases, imu, config.gyro_bias), no_bias)
            for imu in imus.values()
        },
        windows=windows,
        settings=config.resolved(),
        timing=clock.seconds,
    )


def evaluate(
    case: Case,
    specs: str | Sequence[str | replay.Runnable] | None = None,
    *,
    traces: bool = False,
    cost: bool = False,
    only: Collection[str] = (),
    command: str = "",
) -> Result:
    """What the filters of ``specs`` (those of the configuration if None) are worth on a prepared log.

    ``case``: what :func:`prepare` gave; it may serve many calls. ``command`` stands in the result. ``traces``: keep the
    arrays that figures are drawn from. ``cost``: measure what each filter costs, which takes longer than running it.
    ``only``: the metrics that are wanted (as in ``metrics.compute``); the result then has no verdicts, and no problems
    but those of reference and filters. UsageError for an unknown estimator or parameter; a plug-in that fails becomes a
    row with ``status = "failed"``, the others finish.
    """
    if isinstance(specs, str):
        specs = estimators.items(specs)
    settings = case.settings if specs is None else case.settings | {"estimators": list(map(str, specs))}
    clock = Stopwatch(case.timing)
    lines: list[EstimatorRow] = []
    failed: dict[str, AttlogError] = {}
    with once():
        with clock("estimators"):
            chosen = replay.chosen(case.settings["estimators"] if specs is None else specs, case.log)
            onboard = _onboard(case)
        with clock("audit"):
            checks = _checks(case)
    give_back(0 if case.log.replay_imu is None else len(case.log.replay_imu.gyro.t))
    passing = Passing(case, chosen, onboard, unusable(checks), traces=traces, only=only)
    with clock("estimators"):
        for row, line in replay.replays(case, chosen, failed):
            lines.append(line)
            if row is not None:
                with clock("metrics"):
                    passing.hear(row, line)
    refusal = passing.contradicted()
    if refusal is not None:
        refused = _without_that_reference(case, *refusal)
        return evaluate(refused, specs, traces=traces, cost=cost, only=only, command=command)
    with clock("metrics"):
        for row in onboard:
            lines.append(replay.table_row(row, title=row.estimator))
            passing.hear(row, lines[-1])
        rows, table = passing.seen.rows, {line.name: line.metrics for line in lines}
        metrics.settle(passing.seen, table, cost=cost, only=only)
        drawn = passing.drawn() if traces else []
        ranking = part_of(case.log, "Who is best", partial(metrics.rank, table, rows), Ranking)
    result = Result(
        attlog=versions(),
        command=command,
        config=settings,
        log=dict(_described(case)),
        events=_events(case),
        audit=list(checks),
        segments=sorted(case.segments.segments, key=lambda s: (s.t0, s.t1, s.kind)),
        reference=summarize(case.reference),
        gyro_bias=list(case.gyro_bias.values()),
        estimators=lines,
        alike=part_of(case.log, "Which rows are alike", passing.likeness.found, list),
        best=ranking.best,
        worst=ranking.worst,
        ranked=ranking.ranked,
        traces=drawn,
    )
    result.timing = clock.seconds
    failures = _problems(case.reference, lines, failed) + _slow(chosen, rows)
    if only:
        result.problems = failures
        return result
    result.verdicts = part_of(case.log, "The verdicts", lambda: verdicts(result), list)
    own = failures + _unmeasured(lines) + _late_field(rows)
    open_questions = part_of(
        case.log, "What would answer open questions", partial(_unanswered, case, result), list[OpenQuestion]
    )
    result.problems = part_of(
        case.log,
        "The order of the problems",
        lambda: findings(case.log, checks, own, open_questions),
        lambda: [*case.log.problems, *own],
    )
    sound = story.nothing_wrong(result.problems)
    told = partial(story.headline, case.log, case.segments, result.events, sound)
    result.headline = part_of(case.log, "The headline", told, str)
    return result


class Passing:
    """Rows that pass one by one: each is measured and drawn, and what a later step needs of it is taken.

    Then a replayed row is let go of, so that memory does not grow with the number of rows. What turns out to be
    needed whole after all is run again.
    """

    def __init__(
        self,
        case: Case,
        chosen: Mapping[str, replay.Chosen],
        onboard: list[Row],
        unusable: str,
        *,
        traces: bool,
        only: Collection[str],
    ) -> None:
        """``unusable``: why no filter can be judged, empty where they can."""
        self.seen = case.looked_at_with([])
        self._unusable, self._traces, self._only = unusable, traces, only
        expected = len(case.imus) * sum(not isinstance(spec, PluginError) for spec in chosen.values())
        self._drawing = metrics.Drawing(self.seen, expected, onboard)
        self._drawn: list[Trace] = []

        def again(row: Row) -> Row:
            return replay.again(case, chosen, row.name)

        self.likeness = Likeness(again)
        imu = case.log.replay_imu
        # filters that share a gyro which did not turn so agree in what is wrong
        asked = case.settings.get("reference", "auto") == "auto" and not case.reference.gyro_fault
        # nor does a force in wrong axes say who is right
        asked = asked and reference.FRAME not in case.reference.sensor_faults
        self.reference_check = reference.ReferenceCheck(case.log, imu, case.reference, again) if asked and imu else None

    def hear(self, row: Row, line: EstimatorRow) -> None:
        """Fill in a row's line of the table; a replayed row is empty afterwards."""
        case, log, samples = self.seen, self.seen.log, len(row.t)
        row.aux = {}  # no metric looks at it, and in a long log it is as large as the attitude
        case.rows.append(row)
        if self.reference_check is not None:
            part_of(log, "What filters say against the reference", partial(self.reference_check.add, row), lambda: None)
        _withhold(self._unusable, row, line)
        part_of(log, "Which rows are alike", partial(self.likeness.hear, row), lambda: None)
        line.metrics = metrics.compute(case, row, case.windows, cost=False, only=self._only)
        if self._traces:
            give_back(samples)
            self._drawn += part_of(log, "Figures", partial(self._drawing.of_row, row), list[Trace])
        case.done_with(row)
        give_back(samples)

    def contradicted(self) -> tuple[str, AlignmentStep] | None:
        """Why the reference is refused after all, by filters that agree; None where it is not."""
        if self.reference_check is None:
            return None
        what = "What filters say against the reference"
        return part_of(self.seen.log, what, self.reference_check.contradicted, lambda: None)

    def drawn(self) -> list[Trace]:
        """The traces of all rows and of what is drawn beside them."""
        log = self.seen.log
        first = part_of(log, "Figures", partial(self._drawing.first, self.seen.rows), list[Trace])
        return [*first, *self._drawn, *part_of(log, "Figures", self._drawing.last, list[Trace])]


def analyze(
    source: str | Path | FlightLog, config: Config | Mapping[str, Any] | None = None, *, command: str = ""
) -> Result:
    """Everything attlog can say about one log: what ``attlog analyze`` writes, with the lines of its figures.

    ``source`` is a path or a :class:`FlightLog` from :func:`attlog.read`. ``config`` is a :class:`Config` or a mapping
    of its names, such as ``{"estimators": ["default", "mahony:kp=0.3"], "reference": "onboard"}``; None: the defaults.
    ``command`` stands in the result as what was typed. :func:`prepare` and :func:`evaluate` in one call, traces and
    costs included; raises what the two raise: LogUnreadable, LogUnusable, NotALog, TooLittleMemory, UsageError.
    """
    case = prepare(source, config)
    result = evaluate(case, traces=True, cost=True, command=command)
    samples = 0 if case.log.replay_imu is None else len(case.log.replay_imu.gyro.t)
    del case
    give_back(samples)
    return result


def warm(specs: Sequence[str]) -> None:
    """Load the compiled loops of built-in filters into this process, which then forks others that have them.

    Others are left out: their code runs where a log is analysed. What fails here fails there, and is told.
    """
    t = np.arange(100) * 0.004
    rest = (np.zeros((t.size, 3)), np.tile([0.0, 0.0, -9.80665], (t.size, 1)), np.tile([2e-5, 0.0, 4e-5], (t.size, 1)))
    for item in estimators.items(",".join(specs)):
        name = item.partition(":")[0].partition("@")[0]
        for one in BUILT_IN if name == "all" else [item] if name in ("default", *BUILT_IN) else []:
            with suppress(Exception):
                for row in estimators.select(one):
                    estimators.estimate(row, t, *rest)


@per_case
def _onboard(case: Case) -> list[Row]:
    make = partial(reference.onboard_rows, case.log, case.segments, case.reference)
    return part_of(case.log, "What the vehicle estimated", make, list)


@per_case
def _checks(case: Case) -> list[Check]:
    return audit(case.log, case.segments, case.reference)


@per_case
def _events(case: Case) -> list[story.Event]:
    return story.events(case.log, case.segments)


@per_case
def _described(case: Case) -> dict[str, Any]:
    return describe(case.log, case.segments)


def _smoothing(
    log: FlightLog, phases: Segments, options: reference.ReferenceOptions, clock: Stopwatch
) -> Callable[[], Estimate]:
    """Runs the smoother where the reference asks for it, as a stage of its own."""

    def run() -> Estimate:
        with clock("smoother"):
            return replay.smoother(log, phases, options)

    return run


def _without_that_reference(case: Case, fault: str, step: AlignmentStep) -> Case:
    """The same case with the next best reference, or none: nothing computed with the refused one is kept."""
    options = reference_options(Config.of(case.settings))
    refused = case.reference.refused | {case.reference.kind: fault}
    ref = reference.choose(case.log, case.segments, options, refused=refused, second=case.reference.second)
    ref.steps.append(step)
    headings = reference.heading_references(case.log, case.segments, ref)
    return Case(
        case.log,
        case.segments,
        ref,
        heading_references=headings,
        imus=case.imus,
        gyro_bias=case.gyro_bias,
        windows=case.windows,
        settings=case.settings,
        timing=case.timing,
    )


def _withhold(why: str, *told: Row | EstimatorRow) -> None:
    """Where a sensor is beyond use (``why``, empty where it is not) no filter may be called good or bad."""
    for one in told if why else ():
        if one.kind == "replay" and one.status in ("ok", "not_converged", "diverged"):
            one.status, one.reason = "not_judged", why


def _unanswered(case: Case, result: Result) -> list[OpenQuestion]:
    """The questions that no row answers, each with its reason and what would answer it."""
    if all(verdict.bars for verdict in result.verdicts):
        return []
    by_question = {a.question: a for a in answerable(case.log, case)}
    found = []
    for verdict in result.verdicts:
        if not verdict.bars:
            could = by_question.get(verdict.question)
            found.append(OpenQuestion(verdict.title, could.setting if could is not None else ""))
    return found


def _problems(ref: Reference, rows: list[EstimatorRow], failed: Mapping[str, AttlogError]) -> list[Problem]:
    """What the analysis itself found wrong: a reference that physics contradicts, estimators that failed."""
    late = {name for name, error in failed.items() if isinstance(error, PluginTimeout)}
    return contradiction(ref) + [
        Problem(TIMED_OUT if r.name in late else "estimator_failed", "error", f"{r.name}: {r.reason}")
        for r in rows
        if r.status == "failed"
    ]


def _no_headings() -> dict[str, HeadingReference]:
    return {}


def _unmeasured(rows: Sequence[EstimatorRow]) -> list[Problem]:
    """Metrics that ended in a bug, each once."""
    answers = [a for row in rows for window in row.metrics.values() for a in window.values()]
    sentences = dict.fromkeys(a.reason for a in answers if a.code == "part_failed" and a.reason)
    return [Problem("part_failed", "error", sentence) for sentence in sentences]


def _slow(chosen: Mapping[str, replay.Chosen], rows: list[Row]) -> list[Problem]:
    """Plug-ins that ran in plain Python, or whose process was lost in a run by which a metric tries them."""
    ran = {row.name.partition("/imu")[0] for row in rows}
    text = "its step runs in plain Python, some hundred times slower, because numba cannot compile it"
    found = []
    for name, spec in chosen.items():
        if name in ran and not isinstance(spec, PluginError):
            row = spec if isinstance(spec, estimators.EstimatorSpec) else spec.row
            try:
                why = estimators.not_compiled(row.estimator)
            except PluginError as error:
                code = TIMED_OUT if isinstance(error, PluginTimeout) else "estimator_failed"
                found.append(Problem(code, "error", f"{name}: in a later run, by which metrics try it: {error}"))
                continue
            if why:
                found.append(Problem("estimator_not_compiled", "note", f"{name}: {text} ({why})."))
    return found


def _late_field(rows: Sequence[Row]) -> list[Problem]:
    """Time in which no filter could know its heading, because the magnetometer had not spoken yet."""
    waited = max((float(s.value or 0.0) for row in rows for s in row.steps if s.name == "late_field"), default=0.0)
    text = (
        f"The magnetometer's first sample came late: for {waited:.1f} s no filter knew its heading. "
        "It is set from the first field; nothing before is scored."
    )
    return [Problem("late_field", "note", text)] if waited else []


def _read(path: str | Path, config: Config) -> FlightLog:
    """The flight with the configured sensors. UsageError for a sensor that the log does not hold."""
    imu = config.imu if isinstance(config.imu, int) else None
    log = read(path, imu=imu, mag=config.mag, boot=config.boot, system=config.system, params=config.params)
    for what, asked, units in (("imu", imu, log.imus), ("mag", config.mag, log.mags)):
        present = [unit.index for unit in units]
        if isinstance(asked, int) and present and asked not in present:
            raise UsageError(f"{path}: there is no {what} {asked}; the log holds {', '.join(map(str, present))}")
    return log


def _given(log: FlightLog, config: Config) -> FlightLog:
    """A flight that was read before. UsageError for settings that reading it would have needed."""
    chosen = {"boot": log.boot, "imu": None if log.imu is None else log.imus[log.imu].index}
    chosen["mag"] = None if log.mag is None else log.mags[log.mag].index
    for name in ("boot", "imu", "mag", "system", "params"):
        asked = getattr(config, name)
        if asked not in (None, "all", chosen.get(name)) and not (asked == "none" and log.mag is None):
            raise UsageError(f"{name} is chosen when the log is read: attlog.read(path, {name}={asked!r})")
    return log


class Stopwatch:
    """Seconds of wall time per stage, added to those of earlier stages; a stage within another counts for itself."""

    def __init__(self, earlier: Mapping[str, float] | None = None) -> None:
        self.seconds: dict[str, float] = dict(earlier or {})
        self.within = 0.0

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        begin, before, self.within = time.perf_counter(), self.within, 0.0
        STAGES.info(SAID[stage])
        try:
            yield
        finally:
            spent = time.perf_counter() - begin
            self.seconds[stage] = self.seconds.get(stage, 0.0) + spent - self.within
            self.within = before + spent


def reference_options(config: Config) -> reference.ReferenceOptions:
    """The part of a configuration that choosing and aligning the reference needs."""
    return reference.ReferenceOptions(
        reference=config.reference,
        clock=config.clock,
        declination=config.declination,
        trim=config.trim,
        input_delay=config.input_delay,
        score_from=config.score_from,
    )


def versions() -> dict[str, str]:
    """What computed the numbers."""
    return {
        "version": attlog.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        # ``platform.processor`` starts ``uname``, whose answer on Linux is this one or none.
        "cpu": os.environ.get("PROCESSOR_IDENTIFIER") or platform.machine(),
    }


def summarize(ref: Reference) -> ReferenceSummary:
    """The reference as the result shows it: what agreement with it proves, and every step."""
    texts = {
        "truth": "Truth: errors are errors.",
        "smoother": _smoothed_text(ref),
        "onboard": "The autopilot's own attitude: agreement, not truth.",
        "none": "Nothing to compare with: only questions at rest can be answered.",
    }
    end = ref.end if math.isfinite(ref.end) else None
    tilt, heading = (_sigma(ref, angle) for angle in ("inclination", "heading"))
    return ReferenceSummary(
        ref.kind,
        ref.source,
        ref.rate,
        ref.floor_deg,
        texts[ref.kind],
        ref.steps,
        ref.scoring_start,
        end,
        tilt,
        heading,
        ref.heading_by,
        ref.refused,
    )


def _sigma(ref: Reference, angle: str) -> float | None:
    """How wrong a reference says it may be, deg; None for one that does not tell."""
    own = reference.sigma_deg(ref, angle)
    return own if ref.kind == "smoother" and math.isfinite(own) else None


def _smoothed_text(ref: Reference) -> str:
    """What agreement with a smoother proves."""
    tilt, heading = (_sigma(ref, angle) or 0.0 for angle in ("inclination", "heading"))
    whose = {
        "own": f"{heading:.2g} deg in heading",
        "onboard": "headings are compared with onboard",
        "nobody": "headings are not compared",
    }[ref.heading_by]
    return (
        "Smoother: an estimate from both sides of each moment, from all sensors of the log, with the same IMU as the "
        "filters and the model of ESKF (without GNSS of MEKF). "
        f"Differences below its own sigma mean nothing: {tilt:.2g} deg in tilt, {whose}."
    )


def _imus(log: FlightLog, config: Config) -> dict[str, Imu]:
    """The units to replay, by what their rows are called after the estimator's name."""
    assert log.imu is not None
    if config.imu != "all":
        return {"": log.imus[log.imu]}
    return {f"/imu{imu.index}": imu for imu in log.imus}


def _windows(config: Config, phases: Segments) -> tuple[str, ...]:
    """The standard windows and the one asked for. UsageError for an unknown one."""
    if config.window is None or config.window in WINDOWS:
        return WINDOWS
    try:
        phases.spans(config.window)
    except ValueError as error:
        raise UsageError(str(error)) from None
    return (*WINDOWS, config.window)


def _why_no_imu(log: FlightLog) -> str:
    """The sentence for a log that cannot be replayed."""
    reasons = [p.text for p in log.problems if p.severity == "error"]
    return f"{log.path}: " + (" ".join(reasons) or "no inertial data: nothing to replay")
