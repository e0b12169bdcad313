"""Evaluate filters on a prepared log: estimators, metrics, ranking, checks, findings."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from attlog import estimators, metrics, reference, segments, story
from attlog.core.errors import AttlogError, PluginError, PluginTimeout, UsageError, suggestion
from attlog.core.log_cache import log_cache
from attlog.core.machine import versions
from attlog.estimators.filters.smoother import OWN_HEADING
from attlog.estimators.rerun import INNOVATION
from attlog.flight.model import FlightLog, Problem, guarded_part
from attlog.flight.parameters import ParameterHistory, parameter_histories
from attlog.health import (
    Check,
    Finding,
    HealthCase,
    MotionAttitude,
    OpenQuestion,
    answerable,
    contradiction,
    nothing_wrong,
    run_checks,
    unusable_gyro,
)
from attlog.health.attitude import wrong_angle
from attlog.health.consistency import with_sensor_events
from attlog.health.figures import traces
from attlog.health.findings import findings, first_serious, problem_finding
from attlog.metrics.flight_data import flight_data
from attlog.metrics.metric import Case, per_case
from attlog.metrics.ranking import DuplicateSearch, Ranking
from attlog.metrics.trace import Trace, height_trace
from attlog.pipeline import onboard_rerun, replay
from attlog.pipeline.config import Config, Options
from attlog.pipeline.preparation import (
    KNOWN,
    Stages,
    flight_of,
    prepared,
    reference_options,
    require_imu,
    samples_of,
    with_next_reference,
)
from attlog.pipeline.proven_settings import prove_settings
from attlog.pipeline.replay import Chosen
from attlog.pipeline.signal_traces import signal_traces
from attlog.pipeline.summary import describe
from attlog.reference.model import AlignmentStep, Reference, Track
from attlog.result import REFERENCE_NAME, TIMED_OUT, AttitudeTracks, Duplicates, EstimatorRow, ReferenceSummary, Result
from attlog.segments.model import Segments
from attlog.words.answers import ONLY_BASELINE, QUESTIONS, verdicts


def checks_of(
    log: FlightLog, phases: Segments, case: Case | None = None, *, drawn: list[Trace] | None = None
) -> list[Check]:
    """Run every check of a log.

    ``case``: None for a log that cannot be replayed. ``drawn``: receives the arrays of figures.
    """
    ref = None if case is None else case.reference
    asked = HealthCase(log, phases, ref, lambda: None if case is None else motion_attitude(case))
    with log_cache():
        found = guarded_part(log, "The checks", lambda: run_checks(asked), list[Check])
        if case is not None:
            found = guarded_part(log, "Settings run again", partial(prove_settings, case, found), lambda: found)
        if drawn is not None:
            drawn += traces(asked, found)
    return found


@dataclass(frozen=True, slots=True)
class Assessment:
    """What a log shows before any filter runs; ``drawn``: arrays of figures."""

    log: dict[str, Any]
    headline: str
    events: list[story.Event]
    findings: list[Finding]
    checks: list[Check]
    drawn: list[Trace]


def assess(
    log: FlightLog, phases: Segments, happened: list[story.Event], case: Case | None = None, *, traces: bool = False
) -> Assessment:
    """Assess a log with its events: checks, findings, headline.

    ``case``: None for a log that cannot be replayed. ``traces``: also collect the arrays of the checks' figures.
    """
    drawn: list[Trace] = []
    checks = checks_of(log, phases, case, drawn=drawn if traces else None)
    described = describe(log, phases) if case is None else _described(case)  # before the findings: has its own errors
    found = findings(log, checks, [] if case is None else contradiction(case.reference), events=happened)
    happened = with_sensor_events(happened, checks, phases)
    return Assessment(dict(described), _headline(log, phases, happened, checks, found), happened, found, checks, drawn)


def _headline(
    log: FlightLog, phases: Segments, happened: list[story.Event], checks: list[Check], found: list[Finding]
) -> str:
    sound, wrong, trouble = nothing_wrong(found), wrong_angle(checks), first_serious(found)
    return guarded_part(log, "The headline", lambda: story.headline(log, phases, happened, sound, wrong, trouble), str)


@per_case
def _assessed(case: Case, traces: bool) -> Assessment:
    return assess(case.log, case.segments, _events(case), case, traces=traces)


def motion_attitude(case: Case) -> MotionAttitude | None:
    """Run the smoother without compass; None without GNSS velocity or on failure."""
    if not any(np.isfinite(receiver.vel_ned).any() for receiver in case.log.gnss):
        return None
    try:
        found = replay.smoother(
            case.log, case.segments, reference_options(Config.trusted(case.settings)), compass=False
        )
    except UsageError:
        return None
    segment = np.zeros(len(found.t), np.int64) if found.segment is None else np.asarray(found.segment, np.int64)
    heading = found.aux.get(OWN_HEADING, found.aux["sigma_heading"])
    return MotionAttitude(found.t, found.q, segment, found.aux["sigma_tilt"], heading, dict(found.quality))


def problems_of_reference_and_filters(
    ref: Reference,
    lines: Iterable[EstimatorRow],
    failed: Mapping[str, AttlogError],
    chosen: Mapping[str, Chosen],
    rows: Iterable[Track],
) -> list[Problem]:
    """Return problems of the reference, and of filters that failed or are slow.

    ``failed``: errors by row. A sensor that a filter needs and the log lacks is a note.
    """
    late = {name for name, error in failed.items() if isinstance(error, PluginTimeout)}
    broken = [
        Problem(
            TIMED_OUT if line.name in late else "estimator_failed",
            "note" if isinstance(failed.get(line.name), UsageError) else "error",
            f"{line.name}: {line.reason}",
        )
        for line in lines
        if line.status == "failed"
    ]
    return [*contradiction(ref), *broken, *_slow(chosen, rows)]


def all_of(case: Case, result: Result, rows: Sequence[Track], known: Sequence[Problem]) -> list[Finding]:
    """Return every finding of a log and its analysis, worst first.

    ``known``: problems of reference and filters.
    """
    own = [*known, *_unmeasured(result.estimators), *_late_field(rows)]
    unanswered = guarded_part(
        case.log, "What would answer open questions", partial(_unanswered, case, result), list[OpenQuestion]
    )
    return guarded_part(
        case.log,
        "The findings",
        lambda: findings(case.log, result.checks, own, unanswered, result.events),
        lambda: [problem_finding(problem) for problem in (*case.log.problems, *own)],
    )


def _unanswered(case: Case, result: Result) -> list[OpenQuestion]:
    """Return questions without an answer, each with its remedy."""
    silent = [v for v in result.verdicts if not v.answered and ONLY_BASELINE not in v.sentence]
    remedies = {a.question: a.setting for a in answerable(case.log, case)} if silent else {}
    return [
        OpenQuestion(QUESTIONS[verdict.question].capitalize(), remedies.get(verdict.question, "")) for verdict in silent
    ]


def _unmeasured(lines: Iterable[EstimatorRow]) -> list[Problem]:
    """Return a problem for each bug in a metric."""
    answers = [a for line in lines for window in line.metrics.values() for a in window.values()]
    sentences = dict.fromkeys(a.reason for a in answers if a.code == "part_failed" and a.reason)
    return [Problem("part_failed", "error", sentence) for sentence in sentences]


def _slow(chosen: Mapping[str, Chosen], rows: Iterable[Track]) -> list[Problem]:
    """Return plug-ins that ran in plain Python, or whose process died in a metric."""
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


def _late_field(rows: Iterable[Track]) -> list[Problem]:
    """Report the time before the first magnetometer sample, without any heading."""
    waited = max((float(s.value or 0.0) for row in rows for s in row.steps if s.name == "late_field"), default=0.0)
    text = (
        f"The magnetometer's first sample came late: for {waited:.1f} s no filter knew its heading. "
        "It is set from the first field; nothing before is scored."
    )
    return [Problem("late_field", "note", text)] if waited else []


def common_tracks(case: Case) -> AttitudeTracks:
    """Return tracks with the reference alone, at its times; without one at those of the onboard attitude or the IMU."""
    ref, imu = case.reference, case.log.replay_imu
    if ref.kind != "none":
        tracks = AttitudeTracks.at_times_of(ref.t)
        tracks.add(REFERENCE_NAME, ref.t, ref.q, ref.segment)
        return tracks
    flown = case.log.onboard_attitude
    t = imu.gyro.t if flown is None and imu is not None else flown.t if flown is not None else np.zeros(0)
    return AttitudeTracks.at_times_of(t[np.isfinite(t)])


class RowMeasurer:
    """Measure rows one by one and release their samples, to bound memory.

    A row that is needed whole later is run again.
    """

    def __init__(
        self,
        case: Case,
        chosen: Mapping[str, replay.Chosen],
        onboard: list[Track],
        unusable: str,
        *,
        traces: bool,
        only: Collection[str],
    ) -> None:
        """Prepare to measure the chosen rows.

        ``unusable``: name of the sensor whose fault makes every filter unusable, or empty.
        """
        self.case = case.with_rows([])
        self._unusable, self._traces, self._only = unusable, traces, only
        expected = len(case.imus) * sum(not isinstance(spec, PluginError) for spec in chosen.values())
        self._drawing = metrics.Drawing(self.case, expected, onboard)
        self._drawn: list[Trace] = []
        self.tracks = (
            guarded_part(case.log, "Attitudes", partial(common_tracks, case), lambda: None) if traces else None
        )

        def again(row: Track) -> Track:
            return replay.run_again(case, chosen, row.name)

        self._likeness = DuplicateSearch(again)
        imu, choice = case.log.replay_imu, str(case.settings.get("reference", "auto"))
        check = reference.ReferenceCheck
        self._check = None if imu is None else check(case.log, imu, case.reference, again, choice)

    def add(self, row: Track, line: EstimatorRow) -> None:
        """Compute the metrics of a row into its table line; release its samples."""
        case, log = self.case, self.case.log
        if row.reproduction is not None and self._traces:
            self._drawn += guarded_part(log, "Figures", partial(onboard_rerun.traces_of, case, row), list[Trace])
        # metrics read innovations only; other outputs are as large as the attitude
        row.aux = {name: table for name, table in row.aux.items() if name.startswith(INNOVATION)}
        case.rows.append(row)
        if self._check is not None:
            guarded_part(log, "What filters say against the reference", partial(self._check.add, row), lambda: None)
        reference.withhold(row, self._unusable)
        line.status, line.reason = row.status, row.reason
        guarded_part(log, "Which rows are alike", partial(self._likeness.add, row), lambda: None)
        line.metrics = metrics.compute(case, row, case.windows, only=self._only)
        if self.tracks is not None:
            guarded_part(log, "Attitudes", partial(self.tracks.add, row.name, row.t, row.q, row.segment), lambda: None)
        if self._traces:
            self._drawn += guarded_part(log, "Figures", partial(self._drawing.of_row, row), list[Trace])
        case.done_with(row)

    def contradiction(self) -> tuple[str, AlignmentStep] | None:
        """Return why filters that agree contradict the reference, else None."""
        if self._check is None:
            return None
        what = "What filters say against the reference"
        return guarded_part(self.case.log, what, self._check.contradicted, lambda: None)

    def alike(self) -> list[Duplicates]:
        """Return groups of rows with the same equation or equal attitudes."""
        return guarded_part(self.case.log, "Which rows are alike", self._likeness.found, list)

    def drawn(self) -> list[Trace]:
        """Return the traces of all rows, sensors and segments."""
        if not self._traces:
            return []
        log = self.case.log
        first = guarded_part(log, "Figures", partial(self._drawing.first, self.case.rows), list[Trace])
        last = partial(self._drawing.last, _events(self.case))
        return [*first, *self._drawn, *guarded_part(log, "Figures", last, list[Trace])]


def without_replay(
    log: FlightLog, config: Config, stage: Stages, command: str = "", case: Case | None = None
) -> Result:
    """Return a result without filters: headline, events, segments, checks, findings.

    ``case``: the prepared log, if it can be replayed.
    """
    log = log if case is None else case.log
    with stage("segments"):
        phases = segments.build(log) if case is None else case.segments
        happened = story.events(log, phases) if case is None else _events(case)
    with stage("checks"):
        found = assess(log, phases, happened, case, traces=case is None)
        if case is None and log.messages is not None:
            height = guarded_part(log, "Height", partial(height_trace, log, phases), list[Trace])
            data = partial(flight_data, log, phases.spans("airborne"), happened)
            found.drawn.extend([*height, *guarded_part(log, "Figures", data, list[Trace])])
    return Result(
        attlog=versions(),
        command=command,
        config=config.resolved(),
        log=found.log,
        headline=found.headline,
        events=found.events,
        findings=found.findings,
        checks=found.checks,
        traces=found.drawn,
        segments=sorted(phases.segments, key=lambda s: (s.t0, s.t1, s.kind)),
        gyro_bias=[] if case is None else list(case.gyro_bias.values()),
        parameters=guarded_part(log, "Parameters", partial(parameter_histories, log), list[ParameterHistory]),
        timing=stage.seconds,
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
    """Evaluate filters on a prepared log.

    ``case`` may serve many calls. ``specs``: filters, default those of the configuration. ``command`` is stored in the
    result. ``traces``: keep the arrays of figures. ``cost``: add the processor time of each filter. ``only``: metrics
    as of ``metrics.compute``; the result then has no verdicts, and only findings of reference and filters. UsageError
    for an unknown estimator or parameter. A plug-in that fails becomes a row with ``status = "failed"``, the others
    finish.
    """
    if not isinstance(case, Case):
        raise UsageError(f"evaluate takes a prepared log, case = attlog.prepare(log), not {type(case).__name__}")
    if isinstance(specs, str):
        specs = estimators.items(specs)
    only = _known_metrics(only)
    names = [spec if isinstance(spec, str) else spec.name for spec in specs or ()]
    settings = case.settings if specs is None else case.settings | {"estimators": names}
    stage = Stages(case.timing, samples_of(case.log))
    with log_cache():
        with stage("estimators"):
            asked = case.settings["estimators"] if specs is None else specs
            chosen = replay.select_rows(asked, case.log)
            onboard = _onboard(case)
        unusable = _unusable_gyro(case)
        found = None
        if not only:
            with stage("checks"):
                found = _assessed(case, traces)
    measurement = RowMeasurer(case, chosen, onboard, unusable, traces=traces, only=only)
    lines: list[EstimatorRow] = []
    failed: dict[str, AttlogError] = {}
    flown, not_rerun = replay.rerun_by_default(asked, case.log), ""
    with stage("estimators"):
        for row, line in replay.replays(case, chosen, failed):
            if line.name.partition("/imu")[0] == flown and isinstance(failed.get(line.name), UsageError):
                not_rerun = line.reason
                continue
            lines.append(line)
            if row is not None:
                with stage("metrics"):
                    measurement.add(row, line)
    refusal = measurement.contradiction()
    if refusal is not None:
        second = with_next_reference(case, *refusal)
        return evaluate(second, specs, traces=traces, cost=cost, only=only, command=command)
    with stage("metrics"):
        for row in onboard:
            lines.append(replay.table_row(row))
            measurement.add(row, lines[-1])
        rows, table = measurement.case.rows, {line.name: line.metrics for line in lines}
        metrics.finish(measurement.case, table, cost=cost, only=only)
        drawn = measurement.drawn()
        ranking = guarded_part(case.log, "Who is best", partial(metrics.rank, table, rows), Ranking)
    own = problems_of_reference_and_filters(case.reference, lines, failed, chosen, rows)
    result = Result(
        attlog=versions(),
        command=command,
        config=settings,
        log=dict(_described(case)),
        events=_events(case),
        findings=[problem_finding(problem) for problem in own],
        segments=sorted(case.segments.segments, key=lambda s: (s.t0, s.t1, s.kind)),
        reference=summarize(case.reference),
        gyro_bias=list(case.gyro_bias.values()),
        parameters=guarded_part(case.log, "Parameters", partial(parameter_histories, case.log), list),
        estimators=lines,
        not_rerun=not_rerun,
        alike=measurement.alike(),
        best=ranking.best,
        worst=ranking.worst,
        ranked=ranking.ranked,
        checks=[] if found is None else list(found.checks),
        traces=drawn if found is None else drawn + found.drawn,
        tracks=measurement.tracks,
        timing=stage.seconds,
    )
    if found is not None:
        result.verdicts = guarded_part(case.log, "The verdicts", lambda: verdicts(result), list)
        result.findings = all_of(case, result, rows, own)
        result.events, result.headline = list(found.events), found.headline
        if nothing_wrong(found.findings) and not nothing_wrong(result.findings):  # a part of attlog failed since
            result.headline = _headline(case.log, case.segments, result.events, result.checks, result.findings)
    return result


def analyze(
    source: str | Path | FlightLog,
    config: Config | Mapping[str, Any] | None = None,
    *,
    command: str = "",
    **options: Unpack[Options],
) -> Result:
    """Analyse one log as ``attlog analyze`` does, with the traces of its figures.

    ``source``: a path or a :class:`FlightLog` from :func:`attlog.read`. ``options``: fields of :class:`Config` by their
    names, such as ``estimators=["default", "mahony:kp=0.3"], reference="onboard"``. ``config``: a :class:`Config` or a
    mapping of the same options, which keywords override. ``command`` is stored in the result. Combines :func:`prepare`
    and :func:`evaluate` with traces and costs, and raises their errors: LogUnreadable, LogUnusable, NotALog,
    TooLittleMemory, UsageError. A log that cannot be replayed but has an attitude, a position or arming gives a result
    without the comparison. The logger ``attlog.known`` receives records with a ``result`` as far as it is known: name
    and vehicle of the log, then its headline with events, checks and findings.
    """
    settings, stage = Config.of(config, options), Stages()
    with log_cache():
        with stage("read"):
            log = flight_of(source, settings)
        if log.imu is None and has_a_story(log):
            return with_signals(without_replay(log, settings, stage, command), log, settings)
        require_imu(log)
        replay.select_rows(settings.estimators, log)  # an unknown name is an error before anything is known
        case = prepared(log, settings, stage)
        with stage("checks"):  # here, where they share what was computed for the reference
            known = _assessed(case, True)
        if not _may_refuse(case):
            so_far = Result(
                versions(),
                command,
                case.settings,
                known.log,
                known.headline,
                list(known.events),
                list(known.findings),
                checks=list(known.checks),
            )
            KNOWN.info("headline: %s", known.headline, extra={"result": so_far})
    return with_signals(evaluate(case, traces=True, cost=True, command=command), case.log, settings)


def with_signals(result: Result, log: FlightLog, config: Config) -> Result:
    """Return the result with the samples of the signals that its page can draw."""
    begin, known = time.perf_counter(), len(log.problems)
    result.traces += guarded_part(log, "Signals", partial(signal_traces, log, config.signals), list[Trace])
    result.findings += [problem_finding(problem) for problem in log.problems[known:]]
    result.timing["signals"] = time.perf_counter() - begin
    return result


def health(
    source: str | Path | FlightLog,
    config: Config | Mapping[str, Any] | None = None,
    *,
    command: str = "",
    **options: Unpack[Options],
) -> Result:
    """Check one log as ``attlog health`` does: headline, checks and findings; no filter runs.

    Arguments, errors and logger as of :func:`analyze`.
    """
    settings, stage = Config.of(config, options), Stages()
    with log_cache():
        with stage("read"):
            log = flight_of(source, settings)
        replayable = log.imu is not None or not has_a_story(log)
        return without_replay(log, settings, stage, command, prepared(log, settings, stage) if replayable else None)


def has_a_story(log: FlightLog) -> bool:
    """Return whether a log has an attitude, GNSS data or arming times."""
    armed = log.state.armed is not None and len(log.state.armed.t) > 1 and log.state.armed.t[-1] > log.state.armed.t[0]
    return bool(log.attitudes or log.gnss or armed)


def _known_metrics(only: Collection[str]) -> Collection[str]:
    """Return names of metrics, one as a list. UsageError for an unknown one."""
    asked = [only] if isinstance(only, str) else only
    known = dict.fromkeys(part for name in metrics.definitions() for part in (name, name.partition(".")[0]))
    for name in asked:
        if name not in known:
            raise UsageError(f"only: no metric {name!r}{suggestion(name, known)}")
    return asked


@per_case
def _onboard(case: Case) -> list[Track]:
    make = partial(reference.onboard_rows, case.log, case.segments, case.reference)
    return guarded_part(case.log, "What the vehicle estimated", make, list)


def _may_refuse(case: Case) -> bool:
    """Return whether filters might refuse the reference, on which the headline rests."""
    log, imu, choice = case.log, case.log.replay_imu, str(case.settings.get("reference", "auto"))
    if imu is None:
        return False
    check = reference.ReferenceCheck(log, imu, case.reference, lambda row: row, choice)
    return guarded_part(log, "What filters say against the reference", check.may_refuse, lambda: True)


@per_case
def _unusable_gyro(case: Case) -> str:
    return unusable_gyro(case.log, case.segments, case.reference)


@per_case
def _events(case: Case) -> list[story.Event]:
    return story.events(case.log, case.segments)


@per_case
def _described(case: Case) -> dict[str, Any]:
    return describe(case.log, case.segments)


def summarize(ref: Reference) -> ReferenceSummary:
    """Summarise the reference for the result."""
    return ReferenceSummary(
        ref.kind,
        ref.source,
        ref.rate,
        ref.alignment.floor_deg,
        reference.meaning(ref),
        ref.alignment.steps,
        ref.scoring.start,
        ref.scoring.end if math.isfinite(ref.scoring.end) else None,
        reference.own_sigma_deg(ref, "tilt"),
        reference.own_sigma_deg(ref, "heading"),
        ref.heading.by,
        reference.caveat(ref),
        ref.faults.refused,
        ref.fit,
    )
