"""A log that no filter can be run on, its IMU too slow or missing, as in all telemetry: what it tells all the same."""

from __future__ import annotations

from attlog import segments, story
from attlog.analysis.config import Config
from attlog.analysis.sensors import assessments_unreplayed
from attlog.analysis.stages import Stages
from attlog.analysis.summary import describe
from attlog.base.versions import versions
from attlog.flight.model import FlightLog
from attlog.health import audit
from attlog.health.findings import findings, nothing_wrong
from attlog.result import Result, Trace


def without_replay(log: FlightLog, config: Config, stage: Stages, command: str) -> Result:
    """The result without the comparison: headline, events, segments, checks of sensors, findings."""
    with stage("segments"):
        phases = segments.build(log)
        happened = story.events(log, phases)
    with stage("audit"):
        checks = audit(log, None)
        found = findings(log, checks, events=happened)
    drawn: list[Trace] = []
    with stage("sensors"):
        health = assessments_unreplayed(log, phases, checks, drawn=drawn)
    return Result(
        attlog=versions(),
        command=command,
        config=config.resolved(),
        log=describe(log, phases),
        headline=story.headline(log, phases, happened, nothing_wrong(found)),
        events=happened,
        findings=found,
        audit=list(checks),
        health=health,
        traces=drawn,
        segments=sorted(phases.segments, key=lambda s: (s.t0, s.t1, s.kind)),
        timing=stage.seconds,
    )
