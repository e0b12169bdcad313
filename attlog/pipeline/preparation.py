"""Timed stages of an analysis; sensors and reference chosen by its configuration."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from attlog import reference
from attlog.core.errors import LogUnusable, UsageError
from attlog.core.machine import release_memory
from attlog.flight import read
from attlog.flight.model import FlightLog, Imu
from attlog.pipeline.config import Config
from attlog.segments.model import WINDOWS, Segments

# Logs the name of each stage as it begins.
STAGES = logging.getLogger("attlog.stages")
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
        reasons = [p.text for p in log.problems if p.severity == "error"]
        raise LogUnusable(f"{log.path}: " + (" ".join(reasons) or "no inertial data: nothing to replay"))


def _read(path: str | Path, config: Config) -> FlightLog:
    """Read the flight in a file. UsageError for a sensor that the log lacks."""
    imu = config.imu if isinstance(config.imu, int) else None
    log = read(path, imu=imu, mag=config.mag, boot=config.boot, system=config.system, params=config.params)
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
