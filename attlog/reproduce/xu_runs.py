"""Xu's experiment: gains of Mahony's filter over a waypoint mission, or over a real flight."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.flight.vehicle import VehicleKind
from attlog.metrics import correction_noise
from attlog.metrics.metric import Case
from attlog.reproduce.bench import (
    FLOWN_ON_TRUTH,
    SPECTRUM_WINDOW_S,
    FilterOutput,
    FlightSamples,
    Spectrum,
    flight_samples,
    rms,
    run_filter,
    spectrum,
    spectrum_of_windows,
)
from attlog.reproduce.paper import PaperNumber, above, ratio
from attlog.simulate.fly import fly
from attlog.simulate.scenario import Scenario, load_scenario
from attlog.simulate.sensor_settings import ImuSettings, MagSettings, SensorSettings
from attlog.words.numbers import quantity

Array = NDArray[np.float64]
Triple = tuple[float, float, float]

FIXED = {0.6: "mahony@xu-0.6", 1.1: "mahony@xu-1.1", 2.0: "mahony@xu-2"}
ADAPTIVE = "mahony_adaptive@xu"
SWEPT = (0.03, 0.06, 0.1, 0.2, 0.3, 0.45, 0.6, 0.85, 1.1, 1.5, 2.0, 3.0)
# Below is drift and manoeuvre, above more than a logged IMU of 25 Hz shows.
BAND_HZ = (0.2, 5.0)


def gain(kp: float) -> str:
    """Return Xu's filter with another gain."""
    return FIXED.get(kp, f"mahony@xu-0.6:kp={kp:g}")


# The same filter on the quaternion and on the rotation matrix.
COSTED = (gain(0.6), "mahony_dcm:kp=0.6,ki=0,mag_gain=1,acc_form=direction,integrator=first_order")
ROWS = (*map(gain, SWEPT), ADAPTIVE)


@dataclass(frozen=True, slots=True)
class GainRun:
    """Results of one flight in the air by row: a simulated mission, or a log (``why_not``: reason for none).

    RMS of (roll, pitch, heading) within BAND_HZ in deg (errors in simulation, corrections beyond the gyro on logs),
    dominant frequency and upward zero crossings of each in Hz, RMS errors of tilt and heading in deg against
    ``reference``, of roll and pitch averaged over 1 / BAND_HZ[0].
    """

    name: str = ""
    why_not: str = ""
    reference: str = "truth"
    rms: dict[str, Triple] = field(default_factory=dict)
    hz: dict[str, Triple] = field(default_factory=dict)
    crossing: dict[str, Triple] = field(default_factory=dict)
    tilt: dict[str, float] = field(default_factory=dict)
    heading: dict[str, float] = field(default_factory=dict)
    slow: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Flights:
    """Simulated missions or logs."""

    called: str
    runs: Sequence[GainRun]

    def values(self, what: str, row: str, axis: int | None = None) -> list[float]:
        """Return a field of :class:`GainRun` of each flight, NaN without a value."""
        found = [getattr(run, what).get(row) for run in self.runs]
        return [math.nan if x is None else float(x if axis is None else x[axis]) for x in found]

    def complete(self, what: str = "tilt") -> Flights:
        """Return the flights with an error for every gain."""
        rows = [self.values(what, gain(kp)) for kp in SWEPT]
        return Flights(self.called, [run for k, run in enumerate(self.runs) if all(math.isfinite(x[k]) for x in rows)])


def mission() -> Scenario:
    """Return the library's waypoints: a square of 30 m, nose ahead, in wind, flown on the truth."""
    sensors = SensorSettings(imu=(ImuSettings(rate_hz=200.0),), mag=(MagSettings(rate_hz=50.0),))
    return load_scenario("waypoints").changed(sensors=sensors, estimator=FLOWN_ON_TRUTH)


def flown(seed: int) -> FlightSamples:
    """Return the samples of one mission."""
    return flight_samples(fly(mission(), seed))


@functools.cache
def air_span() -> tuple[float, float]:
    """Return the time from the first waypoint to the landing, s."""
    commands = mission().command
    return next(c.t for c in commands if c.do == "goto"), next(c.t for c in commands if c.do == "land")


def in_the_air(t: Array) -> NDArray[np.bool_]:
    """Return which times (n,) are between the first waypoint and the landing."""
    begin, end = air_span()
    return np.asarray((t >= begin) & (t < end))


def one_seed(seed: int) -> GainRun:
    """Run all gains over one mission."""
    s = flown(seed)
    found = {row: run_filter(row, s) for row in ROWS}
    spectra = {row: _spectra(one) for row, one in found.items()}
    air = {row: in_the_air(one.t) for row, one in found.items()}
    return GainRun(
        **_by_row(spectra),
        tilt={row: rms(one.tilt_error[air[row]]) for row, one in found.items()},
        heading={row: rms(one.heading_error[air[row]]) for row, one in found.items()},
        slow={row: slow_deg(one.t[air[row]], one.errors[air[row], :2]) for row, one in found.items()},
    )


def _by_row(spectra: Mapping[str, Sequence[Spectrum]]) -> dict[str, Any]:
    """Return RMS, dominant frequency and zero crossings in the band by row."""
    measures = {"rms": Spectrum.rms, "hz": Spectrum.dominant_hz, "crossing": Spectrum.crossing_hz}
    return {
        name: {row: tuple(measure(x, BAND_HZ) for x in axes) for row, axes in spectra.items()}
        for name, measure in measures.items()
    }


def slow_deg(t: Array, error: Array) -> float:
    """Return the RMS of both columns of an error (n, 2), averaged over 1 / BAND_HZ[0]."""
    size = round((len(t) - 1) / float(t[-1] - t[0]) / BAND_HZ[0])
    total = np.cumsum(np.vstack([np.zeros((1, 2)), error]), axis=0)
    return math.sqrt(2.0) * rms((total[size:] - total[:-size]) / size)


def _spectra(found: FilterOutput) -> list[Spectrum]:
    part = in_the_air(found.t)
    return [spectrum(found.t[part], found.errors[part, axis]) for axis in range(3)]


@dataclass(frozen=True, slots=True)
class BestGain:
    """Gain with the smallest error of ``what``, those not significantly different, and 0.6's error over its."""

    what: str
    kp: float
    alike: tuple[float, ...]
    over: PaperNumber

    @property
    def decides(self) -> bool:
        """Return whether any gain differs significantly from the best."""
        return len(self.alike) < len(SWEPT)

    @property
    def words(self) -> str:
        """Return words: ``kp 0.03 to 0.1 gives the smallest error of tilt; 0.6 gives 3.4×``."""
        if not self.decides:
            return f"no gain differs significantly in {self.what} from the best, kp {self.kp:g}"
        span = f"kp {self.alike[0]:g}" + (f" to {self.alike[-1]:g}" if len(self.alike) > 1 else "")
        return f"{span} gives the smallest error of {self.what}; 0.6 gives {quantity(self.over.value, 'ratio')}"

    def any_within(self, low: float, high: float) -> bool:
        """Return whether one of the best lies between two gains."""
        return any(low <= kp <= high for kp in self.alike)


def best_gain(flights: Flights, what: str) -> BestGain:
    """Return the gain with the smallest error of ``what`` (tilt, heading) by the mean logarithm.

    Only flights with an error for every gain count.
    """
    usable = flights.complete(what)
    found = {kp: usable.values(what, gain(kp)) for kp in SWEPT}
    best = min(SWEPT, key=lambda kp: float(np.mean(np.log(found[kp]))) if usable.runs else 0.0)
    alike = tuple(kp for kp in SWEPT if kp == best or above(ratio("", found[kp], found[best]), 1.0) != "holds")
    text = f"error of {what}, kp 0.6 over {best:g}, the best, {flights.called}"
    return BestGain(what, best, alike, ratio(text, found[0.6], found[best]))


GRID_S = 0.04
# Windows begin so long after a filter's start.
SETTLED_S = 10.0


def oscillation_on_log(path: Path, rows: tuple[str, ...]) -> GainRun:
    """Measure rows (``mahony@xu-0.6``) on one log, or return the reason for none.

    A real flight has no true attitude. The correction that a filter adds to the gyro alone
    (:mod:`attlog.metrics.noise`) needs none: true motion is in both and cancels. Errors are against the log's
    reference.
    """
    from attlog.pipeline import prepare
    from attlog.pipeline.config import Config

    try:
        case = prepare(path, Config.build({}))
        if case.log.kind is not VehicleKind.MULTIROTOR:
            return GainRun(path.name, f"no multirotor but a {case.log.kind.value}")
        if case.log.mag is None:
            return GainRun(path.name, "no magnetometer")
        return _measured(case, rows)
    except AttlogError as error:
        return GainRun(path.name, str(error))


def _measured(case: Case, rows: tuple[str, ...]) -> GainRun:
    name = case.log.path.name
    gyro = _run(case, "gyro")
    if gyro is None:
        return GainRun(name, "no inertial samples")
    alone = correction_noise.GyroAttitude(gyro.t, gyro.q, _segments(gyro))
    windows = _windows(case, float(gyro.t[0]))
    pushed: dict[str, list[Array]] = {row: [] for row in rows}
    runs = {row: _run(case, row) for row in rows}
    for t in windows:
        parts = {row: part for row, run in runs.items() if (part := _residual(t, run, alone)) is not None}
        if len(parts) == len(rows):
            for row, part in parts.items():
                pushed[row].append(part)
    if not all(pushed.values()):
        limit = f"within {correction_noise.TURN_DEG:g} deg of their mean attitude"
        return GainRun(name, f"no {SPECTRUM_WINDOW_S:g} s in the air {limit}")
    spectra = {
        row: [spectrum_of_windows(GRID_S, [p[:, axis] for p in parts]) for axis in range(3)]
        for row, parts in pushed.items()
    }
    found = _by_row(spectra) | (_errors(case, rows) if case.reference.kind != "none" else {})
    return GainRun(name, reference=case.reference.kind, **found)


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
    size = round(SPECTRUM_WINDOW_S / GRID_S)
    found: list[Array] = []
    for t0, t1 in case.segments.spans("airborne"):
        begin = max(t0, start + SETTLED_S)
        for k in range(int((t1 - begin) // SPECTRUM_WINDOW_S)):
            found.append(np.asarray(begin + k * SPECTRUM_WINDOW_S + GRID_S * np.arange(size), np.float64))
    return found


def _residual(t: Array, run: estimators.Estimate | None, gyro: correction_noise.GyroAttitude) -> Array | None:
    if run is None or t[0] < run.t[0] or t[-1] > run.t[-1]:
        return None
    q = rotation.slerp(run.t, run.q, t)
    return correction_noise.residual(t, q, gyro, correction_noise.TURN_DEG) if np.isfinite(q).all() else None


def _errors(case: Case, rows: tuple[str, ...]) -> dict[str, Any]:
    """Return RMS errors of tilt and heading by row."""
    from attlog.pipeline import evaluate

    found: dict[str, dict[str, float]] = {"tilt": {}, "heading": {}}
    for row in evaluate(case, list(rows)).estimators:
        metrics = row.metrics.get("airborne", {})
        for what, values in found.items():
            answer = metrics.get(f"{what}_rmse_deg")
            if row.name in rows and answer is not None and answer.value is not None:
                values[row.name] = float(answer.value)
    return found
