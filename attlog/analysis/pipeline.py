"""The one pipeline: a log in, a :class:`~attlog.result.Result` out, in two halves.

prepare: read -> segments -> reference -> heading references. evaluate: estimators ->
rows -> metrics -> best -> verdicts, as often as wanted on what was prepared once.
Each stage lives in its own room; this file only hands things on.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from attlog import estimators, metrics, reference, segments, story
from attlog.analysis import choices, problems, replay
from attlog.analysis.config import Config
from attlog.analysis.measurement import Measurement
from attlog.analysis.sensors import assessments
from attlog.analysis.stages import Stages
from attlog.analysis.summary import describe
from attlog.analysis.unreplayed import without_replay
from attlog.base.errors import AttlogError
from attlog.base.versions import versions
from attlog.estimators.base import Estimate
from attlog.flight import memory
from attlog.flight.model import FlightLog, part_of
from attlog.health import Check, audit
from attlog.health.agreement import agreed
from attlog.health.findings import nothing_wrong, unusable
from attlog.health.findings.finding import of_problem
from attlog.health.onboard.proven_wrong import wrong_angle
from attlog.metrics.base import Case, per_case
from attlog.metrics.evidence.common_bias import common_bias
from attlog.metrics.evidence.common_bias import none as no_bias
from attlog.metrics.ranking.best import Ranking
from attlog.present.sentences import verdicts
from attlog.reference.model import AlignmentStep, HeadingReference, Reference, Row
from attlog.result import EstimatorRow, ReferenceSummary, Result
from attlog.segments.once import once


@once()
def prepare(source: str | Path | FlightLog, config: Config | Mapping[str, Any] | None = None) -> Case:
    """A log made ready for :func:`evaluate`: all that does not depend on which filters are compared.

    ``source`` is a path or a :class:`FlightLog` from :func:`attlog.read`; a mapping is
    checked like a configuration file. LogUnreadable or LogUnusable (no inertial data,
    encrypted, not a log) if there is nothing to analyse, UsageError for a sensor,
    reference or window that is not there.
    """
    config = Config.of(config)
    stage = Stages()
    with stage("read"):
        log = choices.flight_of(source, config)
    return _prepared(log, config, stage)


def _prepared(log: FlightLog, config: Config, stage: Stages) -> Case:
    """The case of a log. LogUnusable where it cannot be replayed."""
    choices.require_imu(log)
    memory.check_rest(log, memory.ANALYSIS)
    stage.samples = samples_of(log)
    with stage("segments"):
        phases = segments.build(log)
        windows = choices.windows(config, phases)
    options = choices.reference_options(config)

    def smooth() -> Estimate:
        with stage("smoother"):
            return replay.smoother(log, phases, options)

    with stage("reference"):
        ref = part_of(
            log,
            "The reference",
            lambda: reference.choose(log, phases, options, smooth=smooth),
            lambda: reference.choose(log, phases, replace(options, reference="none")),
        )
        headings = part_of(
            log, "Other headings", lambda: reference.heading_references(log, phases, ref), dict[str, HeadingReference]
        )
    imus = choices.units(log, config)
    biases = {
        imu.index: part_of(log, "The gyro bias", partial(common_bias, log, phases, imu, config.gyro_bias), no_bias)
        for imu in imus.values()
    }
    return Case(
        log,
        phases,
        ref,
        heading_references=headings,
        imus=imus,
        gyro_bias=biases,
        windows=windows,
        settings=config.resolved(),
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
    """What the filters of ``specs`` (those of the configuration if None) are worth on a prepared log.

    ``case``: what :func:`prepare` gave; it may serve many calls. ``command`` stands in the result. ``traces``: keep the
    arrays that figures are drawn from. ``cost``: measure what each filter costs, which takes longer than running it.
    ``only``: the metrics that are wanted (as in ``metrics.compute``); the result then has no verdicts, and no findings
    but those of reference and filters. UsageError for an unknown estimator or parameter; a plug-in that fails becomes a
    row with ``status = "failed"``, the others finish.
    """
    if isinstance(specs, str):
        specs = estimators.items(specs)
    settings = case.settings if specs is None else case.settings | {"estimators": list(map(str, specs))}
    stage = Stages(case.timing, samples_of(case.log))
    with once():
        with stage("estimators"):
            chosen = replay.chosen(case.settings["estimators"] if specs is None else specs, case.log)
            onboard = _onboard(case)
        with stage("audit"):
            checks = _checks(case)
    measurement = Measurement(case, chosen, onboard, unusable(checks), traces=traces, only=only)
    lines: list[EstimatorRow] = []
    failed: dict[str, AttlogError] = {}
    with stage("estimators"):
        for row, line in replay.replays(case, chosen, failed):
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
            lines.append(replay.table_row(row, title=row.estimator))
            measurement.add(row, lines[-1])
        rows, table = measurement.case.rows, {line.name: line.metrics for line in lines}
        metrics.settle(measurement.case, table, cost=cost, only=only)
        drawn = measurement.drawn()
        ranking = part_of(case.log, "Who is best", partial(metrics.rank, table, rows), Ranking)
    own = problems.of_reference_and_filters(case.reference, lines, failed, chosen, rows)
    result = Result(
        attlog=versions(),
        command=command,
        config=settings,
        log=dict(_described(case)),
        events=_events(case),
        findings=[of_problem(problem) for problem in own],
        audit=list(checks),
        segments=sorted(case.segments.segments, key=lambda s: (s.t0, s.t1, s.kind)),
        reference=summarize(case.reference),
        gyro_bias=list(case.gyro_bias.values()),
        estimators=lines,
        alike=measurement.alike(),
        best=ranking.best,
        worst=ranking.worst,
        ranked=ranking.ranked,
        traces=drawn,
        timing=stage.seconds,
    )
    if not only:
        with stage("sensors"):
            result.health = assessments(case, checks, drawn=result.traces if traces else None)
            result.audit = agreed(case.log, checks, result.health)
        result.verdicts = part_of(case.log, "The verdicts", lambda: verdicts(result), list)
        result.findings = problems.all_of(case, result, checks, rows, own)
        sound = nothing_wrong(result.findings)
        wrong = wrong_angle(checks)
        told = partial(story.headline, case.log, case.segments, result.events, sound, wrong)
        result.headline = part_of(case.log, "The headline", told, str)
    return result


def analyze(
    source: str | Path | FlightLog, config: Config | Mapping[str, Any] | None = None, *, command: str = ""
) -> Result:
    """Everything attlog can say about one log: what ``attlog analyze`` writes, with the lines of its figures.

    ``source`` is a path or a :class:`FlightLog` from :func:`attlog.read`. ``config`` is a :class:`Config` or a mapping
    of its names, such as ``{"estimators": ["default", "mahony:kp=0.3"], "reference": "onboard"}``; None: the defaults.
    ``command`` stands in the result as what was typed. :func:`prepare` and :func:`evaluate` in one call, traces and
    costs included; raises what the two raise: LogUnreadable, LogUnusable, NotALog, TooLittleMemory, UsageError. A log
    that cannot be replayed but holds an attitude, a position or arming gives a result without the comparison.
    """
    settings, stage = Config.of(config), Stages()
    with once():
        with stage("read"):
            log = choices.flight_of(source, settings)
        if log.imu is None and has_a_story(log):
            return without_replay(log, settings, stage, command)
        case = _prepared(log, settings, stage)
    return evaluate(case, traces=True, cost=True, command=command)


def health(
    source: str | Path | FlightLog, config: Config | Mapping[str, Any] | None = None, *, command: str = ""
) -> Result:
    """What ``attlog health`` tells: headline, checks, assessments of the sensors and findings; no filter runs.

    Arguments and errors as of :func:`analyze`.
    """
    settings, stage = Config.of(config), Stages()
    with once():
        with stage("read"):
            log = choices.flight_of(source, settings)
        replayable = log.imu is not None or not has_a_story(log)
        return without_replay(log, settings, stage, command, _prepared(log, settings, stage) if replayable else None)


def has_a_story(log: FlightLog) -> bool:
    """Whether a log that cannot be replayed holds something that happened at a known time."""
    armed = log.armed is not None and len(log.armed.t) > 1 and log.armed.t[-1] > log.armed.t[0]
    return bool(log.attitudes or log.gnss or armed)


def samples_of(log: FlightLog) -> int:
    """How many inertial samples are replayed."""
    return 0 if log.replay_imu is None else len(log.replay_imu.gyro.t)


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


def with_next_reference(case: Case, fault: str, step: AlignmentStep) -> Case:
    """The same case with the next best reference, or none: nothing computed with the refused one is kept."""
    options = choices.reference_options(Config.trusted(case.settings))
    refused = case.reference.refused | {case.reference.kind: fault}
    ref = reference.choose(case.log, case.segments, options, refused=refused, second=case.reference.second)
    ref.steps.append(step)
    headings = reference.heading_references(case.log, case.segments, ref)
    return case.compared_with(ref, headings)


def summarize(ref: Reference) -> ReferenceSummary:
    """The reference as the result shows it: what agreement with it proves, and every step."""
    return ReferenceSummary(
        ref.kind,
        ref.source,
        ref.rate,
        ref.floor_deg,
        reference.meaning(ref),
        ref.steps,
        ref.scoring_start,
        ref.end if math.isfinite(ref.end) else None,
        reference.own_sigma_deg(ref, "inclination"),
        reference.own_sigma_deg(ref, "heading"),
        ref.heading_by,
        reference.caveat(ref),
        ref.refused,
        ref.fit,
    )
