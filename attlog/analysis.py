"""The one pipeline: a log in, a :class:`~attlog.result.Result` out.

read -> segments -> reference -> estimators -> rows -> metrics -> best -> verdicts.
Each stage lives in its own room; this file only hands things on and keeps the time.
"""

from __future__ import annotations

import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import attlog
from attlog import estimators, metrics, reference, segments
from attlog.audit import audit
from attlog.config import Config
from attlog.errors import AttlogError, LogUnusable
from attlog.estimators.base import Estimate, Estimator
from attlog.flight import read
from attlog.flight.model import FlightLog, Imu, Mag, Problem
from attlog.reference.model import Reference, Row
from attlog.result import EstimatorRow, ParameterValue, ReferenceSummary, Result
from attlog.segments.model import WINDOWS, Segments
from attlog.summary import describe
from attlog.verdicts import verdicts


def analyze(source: str | Path | FlightLog, config: Config | None = None, *, command: str = "") -> Result:
    """Everything attlog can say about one log.

    ``source`` is a path or a :class:`FlightLog` from :func:`attlog.read`. LogUnreadable
    or LogUnusable (no inertial data, encrypted, not a log) if there is nothing to
    analyse, UsageError for an unknown estimator, parameter, reference or window. A
    plug-in that fails becomes a row with ``status = "failed"``; the others finish.
    """
    config = config or Config()
    clock = Stopwatch()
    with clock("read"):
        log = source if isinstance(source, FlightLog) else read(
            source, imu=config.imu if isinstance(config.imu, int) else None,
            mag=config.mag if isinstance(config.mag, int) else None, boot=config.boot, system=config.system,
        )
    if log.imu is None:
        raise LogUnusable(_why_no_imu(log))
    with clock("segments"):
        phases = segments.build(log)
        windows = _windows(config, phases)
    with clock("reference"):
        ref = reference.choose(log, phases, reference_options(config))
    rows, estimator_rows = [], []
    with clock("estimators"):
        for row, table_row in _replays(log, phases, ref, config):
            estimator_rows.append(table_row)
            if row is not None:
                rows.append(row)
        for row in reference.onboard_rows(log, phases, ref):
            rows.append(row)
            estimator_rows.append(_table_row(row))
    with clock("metrics"):
        trial = metrics.Trial(log, phases, ref, rows, reference.witnesses(log, phases, ref, rows))
        by_name = {row.name: row for row in rows}
        for table_row in estimator_rows:
            if table_row.name in by_name:
                table_row.metrics = metrics.compute(trial, by_name[table_row.name], windows)
        best = metrics.best({r.name: r.metrics for r in estimator_rows}, rows)
    with clock("audit"):
        checks = audit(log, phases)
    result = Result(
        attlog=versions(),
        command=command,
        config=config.resolved(),
        log=describe(log, phases),
        problems=log.problems + [Problem("estimator_failed", "error", f"{r.name}: {r.reason}")
                                 for r in estimator_rows if r.status == "failed"],
        audit=checks,
        segments=sorted(phases.segments, key=lambda s: (s.t0, s.t1, s.kind)),
        reference=summarize(ref),
        estimators=estimator_rows,
        best=best,
        definitions={
            name: {"title": m.title, "unit": m.unit, "better": m.better, "text": m.definition}
            for name, m in metrics.definitions(estimator_rows and [r.metrics for r in estimator_rows]).items()
        },
        traces=metrics.traces(trial, rows),
    )
    result.verdicts = verdicts(result)
    result.timing = clock.seconds
    return result


class Stopwatch:
    """Seconds of wall time per stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        begin = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - begin


def reference_options(config: Config) -> reference.Options:
    """The part of a configuration that choosing and aligning the reference needs."""
    return reference.Options(
        reference=config.reference, clock=config.clock, declination=config.declination,
        trim=config.trim, input_delay=config.input_delay, score_from=config.score_from,
    )


def versions() -> dict[str, str]:
    """What computed the numbers."""
    return {
        "version": attlog.__version__, "python": platform.python_version(),
        "numpy": np.__version__, "cpu": platform.processor() or platform.machine(),
    }


def summarize(ref: Reference) -> ReferenceSummary:
    """The reference as the result shows it: what agreement with it proves, and every step."""
    texts = {
        "truth": "Truth: errors are errors.",
        "smoother": "Smoother: the best estimate from all sensors of the log; errors below its own sigma mean nothing.",
        "onboard": "The autopilot's own attitude: agreement, not truth.",
        "none": "Nothing to compare with: only questions at rest can be answered.",
    }
    return ReferenceSummary(ref.kind, ref.source, ref.rate, ref.floor_deg, texts[ref.kind], ref.steps)


def replay(
    log: FlightLog, imu: Imu, mag: Mag | None, estimator: Estimator, parameters: dict[str, Any],
) -> Estimate:
    """One estimator over one IMU of a flight, with the magnetometer at its own pace."""
    t = imu.gyro.t
    field = None if mag is None else estimators.place(t, mag.field.t_best, mag.field.x)
    return estimators.estimate(
        estimator, t, imu.gyro.x, imu.acc.x, field, sampling=imu.gyro.sampling, **parameters
    )
