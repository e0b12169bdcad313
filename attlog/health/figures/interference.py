"""Does the field follow the motors? Its size less the earth's against current, else throttle, with the fitted line."""

from __future__ import annotations

import numpy as np

from attlog.flight.model import Array, Stream
from attlog.health.assessments.model import HealthCase
from attlog.health.figures.samples import chosen, end_of
from attlog.health.sensors.interference import drives
from attlog.health.sound import in_use
from attlog.metrics.figures.trace import Trace
from attlog.reference import declination
from attlog.segments.spans import inside

FEWEST = 50
POINTS = 800
"""Points of the scatter: more lie on one another."""
NEAR_S = 1.0
"""A drive's record this near to a sample of the compass belongs to it."""


def interference(case: HealthCase) -> list[Trace]:
    """Points and line of the compass in use; nothing where no drive varies while armed."""
    log, segments = case.log, case.segments
    if log.mag is None or segments is None:
        return []
    field, model = log.mags[log.mag].field, declination.model(log)
    t = field.t_best
    size = 1e6 * np.sqrt(np.sum(field.x**2, axis=1))
    use = np.isfinite(size) & (size > 0) & (t < end_of(segments)) & in_use(log, segments, t, ("armed", "airborne"))
    use &= inside(t, segments.spans("armed") or segments.spans("airborne"))
    if np.count_nonzero(use) < FEWEST:
        return []
    residual = size - (float(np.median(size[use])) if model is None else 1e6 * model.strength_t)
    for _, drive, least in drives(log):
        power, near = _drive(drive, t)
        own = use & near
        if np.count_nonzero(own) >= FEWEST and np.ptp(np.quantile(power[own], [0.05, 0.95])) >= least:
            scale, key = (1.0, "current") if drive.unit == "A" else (100.0, "throttle")
            seconds = float(np.count_nonzero(own)) / max(field.rate, 1e-9)
            return [of_arrays(key, scale * power[own], residual[own], seconds)]
    return []


def of_arrays(key: str, power: Array, residual: Array, seconds: float) -> Trace:
    """The trace of residuals (n,) uT against a drive (n,) in A or %, with the line of least squares through all."""
    slope, start = np.polyfit(power, residual, 1) if np.ptp(power) > 0 else (0.0, float(np.mean(residual)))
    spread = float(np.std(power) * np.std(residual))
    r = float(np.mean((power - power.mean()) * (residual - residual.mean()))) / spread if spread > 0 else 0.0
    kept = chosen(power, np.ones(len(power), bool), POINTS)
    values = {"slope": float(slope), "start": float(start), "r": r, "seconds": seconds}
    return Trace("interference", "", power[kept], {"residual": residual[kept]}, key, values=values)


def _drive(drive: Stream, t: Array) -> tuple[Array, np.ndarray]:
    """The drive (n,) at ``t`` (n,) s, and where a record of it is near."""
    x = drive.x[:, 0]
    at, x = drive.t[np.isfinite(x)], x[np.isfinite(x)]
    if len(at) == 0:
        return np.full(len(t), np.nan), np.zeros(len(t), bool)
    after = np.clip(np.searchsorted(at, t), 0, len(at) - 1)
    apart = np.minimum(np.abs(at[after] - t), np.abs(at[np.maximum(after - 1, 0)] - t))
    return np.interp(t, at, x), apart < NEAR_S
