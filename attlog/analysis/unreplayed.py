"""What a log tells without any filter: of telemetry, whose IMU is too slow or missing, and where none is wanted."""

from __future__ import annotations

from attlog import segments, story
from attlog.analysis.config import Config
from attlog.analysis.sensors import assessments, assessments_unreplayed
from attlog.analysis.stages import Stages
from attlog.analysis.summary import describe
from attlog.base.versions import versions
from attlog.flight.model import FlightLog
from attlog.health import audit
from attlog.health.agreement import agreed
from attlog.health.findings import contradiction, findings, nothing_wrong
from attlog.health.onboard.proven_wrong import wrong_angle
from attlog.metrics.base import Case
from attlog.result import Result, Trace


def without_replay(
    log: FlightLog, config: Config, stage: Stages, command: str = "", case: Case | None = None
) -> Result:
    """The result without the comparison: headline, events, segments, checks and assessments of sensors, findings.

    ``case``: the log as it was prepared, where it can be replayed.
    """
    with stage("segments"):
        phases = segments.build(log) if case is None else case.segments
        happened = story.events(log, phases)
    with stage("audit"):
        checks = audit(log, None) if case is None else audit(log, phases, case.reference)
    drawn: list[Trace] = []
    with stage("sensors"):
        if case is None:
            health = assessments_unreplayed(log, phases, checks, drawn=drawn)
        else:
            health = assessments(case, checks)
    others = [] if case is None else contradiction(case.reference)
    checks = agreed(log, checks, health)
    found = findings(log, checks, others, events=happened, health=health)
    return Result(
        attlog=versions(),
        command=command,
        config=config.resolved(),
        log=describe(log, phases),
        headline=story.headline(log, phases, happened, nothing_wrong(found), wrong_angle(checks)),
        events=happened,
        findings=found,
        audit=checks,
        health=health,
        traces=drawn,
        segments=sorted(phases.segments, key=lambda s: (s.t0, s.t1, s.kind)),
        gyro_bias=[] if case is None else list(case.gyro_bias.values()),
        timing=stage.seconds,
    )
