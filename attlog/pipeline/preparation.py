"""Prepare a log for filters: read, segments, reference, heading references, gyro bias."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Unpack

from attlog import flight, reference, segments
from attlog.core.errors import LogUnusable, UsageError
from attlog.core.log_cache import log_cache
from attlog.core.machine import release_memory
from attlog.core.truncation import truncation_of
from attlog.estimators.interface import Estimate
from attlog.flight.model import FlightLog, Imu, guarded_part
from attlog.metrics.gyro_bias import common_bias, no_common_bias
from attlog.metrics.metric import Case
from attlog.pipeline import replay
from attlog.pipeline.config import Config, Options
from attlog.pipeline.summary import name_and_vehicle
from attlog.reference.model import AlignmentStep, HeadingReference
from attlog.result import Result
from attlog.segments.model import WINDOWS, Segments

# Logs the name of each stage as it begins.
STAGES = logging.getLogger("attlog.stages")
# Logs the result as far as it is known, as ``result`` of the record.
KNOWN = logging.getLogger("attlog.known")
SENTENCES = {
    "read": "reading the log",
    "segments": "finding rest and flight",
    "reference": "aligning the reference",
    "smoother": "smoothing the whole flight",
    "estimators": "running filters",
    "metrics": "measuring",
    "checks": "checking sensors and estimator",
}


class Stages:
    """Wall time in s by stage, excluding nested stages, added to earlier times.

    ``samples``: number of inertial samples, once known. After a stage of a long log freed memory is returned to the
    system.
    """

    def __init__(self, earlier: Mapping[str, float] | None = None, samples: int = 0) -> None:
        self.seconds: dict[str, float] = dict(earlier or {})
        self.samples = samples
        self._within = 0.0

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        begin, before, self._within = time.perf_counter(), self._within, 0.0
        STAGES.info(SENTENCES[stage])
        try:
            yield
        finally:
            release_memory(self.samples)
            spent = time.perf_counter() - begin
            self.seconds[stage] = self.seconds.get(stage, 0.0) + spent - self._within
            self._within = before + spent


# Parts of a log chosen by the configuration: sensors, units to replay, windows, alignment of the reference.


def flight_of(source: str | Path | FlightLog, config: Config) -> FlightLog:
    """Return the flight with the configured sensors and truth. Errors as of :func:`attlog.analyze`."""
    log = _given(source, config) if isinstance(source, FlightLog) else _read(source, config)
    if config.truth is None:
        return log
    from attlog.external import attitude

    require_imu(log)
    return attitude.attach_truth(log, config.truth)


def require_imu(log: FlightLog) -> None:
    """Raise LogUnusable, with the reason, for a log that cannot be replayed."""
    if log.imu is None:
        reasons = [f"{p.text} {p.remedy}".strip() for p in log.problems if p.severity == "error"]
        raise LogUnusable(f"{log.path}: " + (" ".join(reasons) or "no inertial data: nothing to replay"))


def _read(path: str | Path, config: Config) -> FlightLog:
    """Read the flight in a file. UsageError for a sensor that the log lacks."""
    imu = config.imu if isinstance(config.imu, int) else None
    log = flight.read(path, imu=imu, mag=config.mag, boot=config.boot, system=config.system, params=config.params)
    for what, asked, units in (("imu", imu, log.imus), ("mag", config.mag, log.mags)):
        present = [unit.index for unit in units]
        if isinstance(asked, int) and present and asked not in present:
            raise UsageError(f"{path}: there is no {what} {asked}; the log holds {', '.join(map(str, present))}")
    return log


def _given(log: FlightLog, config: Config) -> FlightLog:
    """Check a flight that was read before. UsageError for options of the reader."""
    chosen = {"boot": log.boot, "imu": None if log.imu is None else log.imus[log.imu].index}
    chosen["mag"] = None if log.mag is None else log.mags[log.mag].index
    for name in ("boot", "imu", "mag", "system", "params"):
        asked = getattr(config, name)
        if asked not in (None, "all", chosen.get(name)) and not (asked == "none" and log.mag is None):
            raise UsageError(f"{name} is chosen when the log is read: attlog.read(path, {name}={asked!r})")
    return log


def units(log: FlightLog, config: Config) -> dict[str, Imu]:
    """Return the units to replay by the suffix of their rows."""
    assert log.imu is not None
    if config.imu != "all":
        return {"": log.imus[log.imu]}
    return {f"/imu{imu.index}": imu for imu in log.imus}


def windows(config: Config, segments: Segments) -> tuple[str, ...]:
    """Return the standard windows and the configured one. UsageError for an unknown one."""
    if config.window is None or config.window in WINDOWS:
        return WINDOWS
    try:
        segments.spans(config.window)
    except ValueError as error:
        raise UsageError(str(error)) from None
    return (*WINDOWS, config.window)


def reference_options(config: Config) -> reference.ReferenceOptions:
    """Return the options for choosing and aligning the reference."""
    return reference.ReferenceOptions(
        reference=config.reference,
        clock=config.clock,
        declination=config.declination,
        trim=config.trim,
        input_delay=config.input_delay,
        score_from=config.score_from,
    )


def untruncated(log: FlightLog) -> FlightLog:
    """Return the log with half a step put back where a gyro's readings are cut towards zero, in the whole log."""
    found = [truncation_of(imu.gyro.x) for imu in log.imus]
    if not any(found):
        return log
    imus = [
        replace(imu, gyro=replace(imu.gyro, x=cut.restore(imu.gyro.x)), truncation=cut) if cut else imu
        for imu, cut in zip(log.imus, found, strict=True)
    ]
    return replace(log, imus=imus)


@log_cache()
def prepare(
    source: str | Path | FlightLog, config: Config | Mapping[str, Any] | None = None, **options: Unpack[Options]
) -> Case:
    """Prepare a log for :func:`evaluate`: everything independent of the filters compared.

    ``source``: a path or a :class:`FlightLog` from :func:`attlog.read`. ``config`` and ``options`` as of
    :func:`analyze`; a mapping is checked like a configuration file.
    LogUnreadable or LogUnusable (no inertial data, encrypted, not a log) if the log cannot be analysed, UsageError for
    a missing sensor, reference or window.
    """
    config = Config.of(config, options)
    stage = Stages()
    with stage("read"):
        log = flight_of(source, config)
    return prepared(log, config, stage)


def prepared(log: FlightLog, config: Config, stage: Stages) -> Case:
    """Prepare a log that was read. LogUnusable if it cannot be replayed."""
    require_imu(log)
    flight.check_analysis_memory(log, flight.ANALYSIS_BYTES)
    log = untruncated(log)
    stage.samples = samples_of(log)
    with stage("segments"):
        phases = segments.build(log)
        shown = windows(config, phases)
    KNOWN.info("log: %s", log.path.name, extra={"result": Result({}, "", {}, name_and_vehicle(log))})
    options = reference_options(config)

    def smooth() -> Estimate:
        with stage("smoother"):
            return replay.smoother(log, phases, options)

    with stage("reference"):
        ref = guarded_part(
            log,
            "The reference",
            lambda: reference.choose(log, phases, options, smooth=smooth),
            lambda: reference.choose(log, phases, options._replace(reference="none")),
        )
        headings = guarded_part(
            log, "Other headings", lambda: reference.heading_references(log, phases, ref), dict[str, HeadingReference]
        )
    imus = units(log, config)
    biases = {
        imu.index: guarded_part(
            log, "The gyro bias", partial(common_bias, log, phases, imu, config.gyro_bias), no_common_bias
        )
        for imu in imus.values()
    }
    return Case(
        log,
        phases,
        ref,
        heading_references=headings,
        imus=imus,
        gyro_bias=biases,
        windows=shown,
        settings=config.resolved(),
        timing=stage.seconds,
    )


def samples_of(log: FlightLog) -> int:
    """Return the number of replayed inertial samples."""
    return 0 if log.replay_imu is None else len(log.replay_imu.gyro.t)


def with_next_reference(case: Case, fault: str, step: AlignmentStep) -> Case:
    """Return the case with the next best reference, or none."""
    options = reference_options(Config.trusted(case.settings))
    refused = case.reference.faults.refused | {case.reference.kind: fault}
    ref = reference.choose(case.log, case.segments, options, refused=refused, second=case.reference.second)
    ref.alignment.steps.append(step)
    headings = reference.heading_references(case.log, case.segments, ref)
    return case.compared_with(ref, headings)
