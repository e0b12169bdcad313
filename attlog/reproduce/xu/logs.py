"""What gains of Mahony's filter do on a real flight: how much the attitude oscillates, how far off it is.

Nobody knows the true attitude of a real flight. What a filter pushes into its attitude beyond the gyro alone
(:mod:`attlog.metrics.noise.injection`) needs none: true motion is in both and cancels. How far off it is, is told
against the log's reference, which is truth in simulation and else what the autopilot found, or a smoother.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.base import rotation
from attlog.base.errors import AttlogError
from attlog.flight.vehicle import VehicleKind
from attlog.metrics.base import Case
from attlog.metrics.noise import injection
from attlog.reproduce import band
from attlog.reproduce.xu.runs import BAND_HZ, Triple, three

Array = NDArray[np.float64]
GRID_S = 0.04
LEAST_WINDOWS = 1
SETTLED_S = 10.0
"""Windows begin so long after a filter's start."""


@dataclass(frozen=True, slots=True)
class LogOscillation:
    """One log. By row of ``rows``: RMS of (roll, pitch, heading) within the band in deg, the dominant frequency of each
    in Hz, errors (inclination, heading) against ``reference`` in deg where there is one. Or ``why_not``.
    """

    name: str
    why_not: str = ""
    windows: int = 0
    reference: str = ""
    rms: dict[str, Triple] = field(default_factory=dict)
    hz: dict[str, Triple] = field(default_factory=dict)
    crossing: dict[str, Triple] = field(default_factory=dict)
    errors: dict[str, tuple[float, float]] = field(default_factory=dict)


def on_log(path: Path, rows: tuple[str, ...]) -> LogOscillation:
    """What the rows (``mahony@xu-0.6``) do on one log; a log that cannot tell says why instead."""
    from attlog.analysis import prepare
    from attlog.analysis.config import Config

    try:
        case = prepare(path, Config.build({}))
        if case.log.kind is not VehicleKind.MULTIROTOR:
            return LogOscillation(path.name, f"no multirotor but a {case.log.kind.value}")
        if case.log.mag is None:
            return LogOscillation(path.name, "no magnetometer")
        return _measured(case, rows)
    except AttlogError as error:
        return LogOscillation(path.name, str(error))


def _measured(case: Case, rows: tuple[str, ...]) -> LogOscillation:
    name = case.log.path.name
    gyro = _run(case, "gyro")
    if gyro is None:
        return LogOscillation(name, "no inertial samples")
    alone = injection.GyroAttitude(gyro.t, gyro.q, _segments(gyro))
    windows = _windows(case, float(gyro.t[0]))
    pushed: dict[str, list[Array]] = {row: [] for row in rows}
    runs = {row: _run(case, row) for row in rows}
    used = 0
    for t in windows:
        parts = {row: _residual(t, run, alone) for row, run in runs.items()}
        if any(part is None for part in parts.values()):
            continue
        used += 1
        for row, part in parts.items():
            if part is not None:
                pushed[row].append(part)
    if used < LEAST_WINDOWS:
        limit = f"within {injection.TURN_DEG:g} deg of their mean attitude"
        return LogOscillation(name, f"no {band.WINDOW_S:g} s in the air {limit}")
    seen = {
        row: [band.of_windows(GRID_S, [p[:, axis] for p in parts]) for axis in range(3)]
        for row, parts in pushed.items()
    }
    return LogOscillation(
        name,
        "",
        used,
        case.reference.kind,
        {row: three([s.rms(BAND_HZ) for s in axes]) for row, axes in seen.items()},
        {row: three([s.dominant_hz(BAND_HZ) for s in axes]) for row, axes in seen.items()},
        {row: three([s.crossing_hz(BAND_HZ) for s in axes]) for row, axes in seen.items()},
        _errors(case, rows) if case.reference.kind != "none" else {},
    )


def _run(case: Case, row: str) -> estimators.Estimate | None:
    imu, mag = case.log.replay_imu, None if case.log.mag is None else case.log.mags[case.log.mag]
    if imu is None:
        return None
    t = imu.gyro.t_best
    field = estimators.place(t, mag.field.t_best, mag.field.x) if mag is not None and row != "gyro" else None
    return estimators.estimate(row, t, case.gyro_of(imu), imu.acc.x, field, sampling=imu.gyro.sampling, dt=imu.dt)


def _segments(found: estimators.Estimate) -> NDArray[np.int64]:
    return np.zeros(len(found.t), np.int64) if found.segment is None else found.segment


def _windows(case: Case, start: float) -> list[Array]:
    size = round(band.WINDOW_S / GRID_S)
    found: list[Array] = []
    for t0, t1 in case.segments.spans("airborne"):
        begin = max(t0, start + SETTLED_S)
        for k in range(int((t1 - begin) // band.WINDOW_S)):
            found.append(np.asarray(begin + k * band.WINDOW_S + GRID_S * np.arange(size), np.float64))
    return found


def _residual(t: Array, run: estimators.Estimate | None, gyro: injection.GyroAttitude) -> Array | None:
    if run is None or t[0] < run.t[0] or t[-1] > run.t[-1]:
        return None
    q = rotation.slerp(run.t, run.q, t)
    return injection.residual(t, q, gyro, injection.TURN_DEG) if np.isfinite(q).all() else None


def _errors(case: Case, rows: tuple[str, ...]) -> dict[str, tuple[float, float]]:
    from attlog.analysis import evaluate

    found = {}
    for row in evaluate(case, list(rows)).estimators:
        metrics = row.metrics.get("airborne", {})
        pair = [metrics[m].value if m in metrics else None for m in ("inclination_rmse_deg", "heading_rmse_deg")]
        if row.name in rows:
            found[row.name] = (_nan(pair[0]), _nan(pair[1]))
    return found


def _nan(value: float | None) -> float:
    return float("nan") if value is None else float(value)
