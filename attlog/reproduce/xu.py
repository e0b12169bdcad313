"""Xu: which gain of Mahony's filter, judged by how much the attitude oscillates; and a gain that adapts.

Gains of Mahony's filter run over simulated waypoint missions, and over logs of real flights.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
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
    AXES,
    COST_METHOD,
    FLOWN_ON_TRUTH,
    SPECTRUM_WINDOW_S,
    FilterOutput,
    FlightSamples,
    Spectrum,
    flight_samples,
    rms,
    run_each,
    run_filter,
    run_seeds,
    spectrum,
    spectrum_of_windows,
    time_updates,
)
from attlog.reproduce.page import filter_lines, points_line, truth_lines
from attlog.reproduce.paper import (
    Claim,
    FigureLine,
    Paper,
    PaperFigure,
    PaperNumber,
    PaperOptions,
    PaperSetting,
    PaperTable,
    Verdict,
    above,
    below,
    combine_verdicts,
    geometric_mean,
    mean,
    numbers_text,
    put_first,
    ratio,
    settings,
    smallest_and_largest,
)
from attlog.simulate.fly import fly
from attlog.simulate.scenario import Scenario, load_scenario
from attlog.simulate.sensor_settings import ImuSettings, MagSettings, SensorSettings
from attlog.words.numbers import counted, listed, number, quantity

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
    return estimators.estimate(
        row, t, case.gyro_of(imu), imu.acc.x, field, sampling=imu.gyro.sampling, dt=imu.dt, check_units=False
    )


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


def slow_claim(missions: Flights) -> Claim:
    """Judge the slow error below the best gain."""
    smallest, next_one = SWEPT[0], SWEPT[1]
    best = best_gain(missions, "tilt")
    slow = "slow error of roll and pitch"
    grown, printed = (
        _over(missions, f"{slow}, kp {kp:g} over {next_one:g}", "slow", None, gain(kp), gain(next_one))
        for kp in (smallest, 0.6)
    )
    sizes = [
        mean(f"{slow}, kp {kp:g}, {missions.called}", missions.values("slow", gain(kp)), "deg")
        for kp in (smallest, next_one, 0.6)
    ]
    return Claim(
        "slow",
        "A gain that is too small lets slow errors of the gyro in.",
        "section 4",
        f"RMS error of roll and pitch averaged over {1.0 / BAND_HZ[0]:g} s, in the air. Holds if it grows from kp "
        f"{next_one:g} down to {smallest:g}: the interval of the ratio is above 1.",
        (grown, printed, *sizes, best.over),
        above(grown, 1.0),
        f"Too small is far below the paper's gains: in our simulation kp {best.kp:g} errs least in tilt. The slow "
        f"error with 0.6 is {numbers_text([printed])} that with {next_one:g}. Lasting accelerations are slow too.",
    )


def cost_claim(spent: dict[str, list[float]]) -> Claim:
    """Judge the time per update; ``spent`` of :func:`time_updates`."""
    quaternion, matrix = COSTED
    one = ratio("time per update, rotation matrix over quaternion", spent[matrix], spent[quaternion])
    each = [
        mean(f"time per update, {name}", spent[row], "ns")
        for name, row in (("quaternion (mahony)", quaternion), ("matrix (mahony_dcm)", matrix))
    ]
    return Claim(
        "cost",
        "The quaternion needs less computation than the direction cosine matrix.",
        "section 0.1",
        f"{COST_METHOD} The same filter and gains in both forms. Holds if the interval of the ratio is above 1.",
        (one, *each),
        above(one, 1.0),
        "The matrix is renormalised, and a quaternion is made of it for the output. Times are of this machine.",
    )


CALLED = {row: f"kp {kp:g}" for kp, row in FIXED.items()} | {ADAPTIVE: "adaptive (our law)"}


def paper_figures(sets: Sequence[Flights], seed: int = 0) -> tuple[PaperFigure, ...]:
    """Draw the mission, its errors, oscillation and error against the gain."""
    s = flown(seed)
    return (
        PaperFigure(
            "mission",
            "fig. 1 to 3",
            "A waypoint mission",
            "The first seed, between take-off and landing.",
            "time, s",
            tuple(f"{a}, deg" for a in AXES),
            (*truth_lines(s, air_span()), *filter_lines(s, CALLED, span=air_span())),
            height=480,
        ),
        PaperFigure(
            "errors",
            "fig. 1 to 3",
            "How far off",
            "The same mission: what was found minus the truth.",
            "time, s",
            tuple(f"{a} error, deg" for a in AXES),
            tuple(filter_lines(s, CALLED, errors=True, span=air_span())),
            height=480,
        ),
        PaperFigure(
            "oscillation",
            "fig. 1 to 3",
            "How much it oscillates, by gain",
            "Geometric means over flights with their intervals, 0.2 to 5 Hz: of the error in simulation, on logs of "
            "what the filter pushes in beyond the gyro alone.",
            "kp, 1/s",
            tuple(f"{a}, deg" for a in AXES),
            tuple(_gain_line(flights, "rms", axis, axis) for flights in sets for axis in range(3)),
            "points",
            height=480,
            x_log=True,
        ),
        PaperFigure(
            "best",
            "section 4",
            "How far off, by gain",
            "Geometric means of RMS errors over flights with their intervals; logs against their reference.",
            "kp, 1/s",
            ("tilt, deg", "heading, deg"),
            tuple(
                _gain_line(flights.complete("heading"), what, None, panel)
                for flights in map(Flights.complete, sets)
                for panel, what in enumerate(("tilt", "heading"))
                if flights.complete("heading").runs
            ),
            "points",
            height=400,
            x_log=True,
        ),
    )


def _gain_line(flights: Flights, what: str, axis: int | None, panel: int) -> FigureLine:
    numbers = [geometric_mean(flights.values(what, gain(kp), axis)) for kp in SWEPT]
    return points_line(flights.called, SWEPT, numbers, panel)


def oscillation_table(sets: Sequence[Flights]) -> PaperTable:
    """Return oscillation and errors of the paper's gains and of the adaptive one."""
    measures = (*(("rms", axis) for axis in range(3)), ("tilt", None), ("heading", None))
    rows = []
    for row, name in CALLED.items():
        for flights in sets:
            cells = [geometric_mean(flights.values(what, row, axis)) for what, axis in measures]
            called = flights.called.removeprefix("simulated ")
            rows.append((f"{name}, {called}", *(quantity(n.value, "deg") for n in cells)))
    head = ("gain", *(f"{a}, 0.2 to 5 Hz" for a in AXES), "error of tilt", "error of heading")
    return PaperTable("Oscillation and error", head, tuple(rows), "Geometric means over flights of RMS values.")


# Flights of the source tree; an installed package has none.
SAMPLE_LOGS = Path(__file__).parents[2] / "sample_logs"
BAND = f"{BAND_HZ[0]:g} to {BAND_HZ[1]:g} Hz"
PAIRS = ((1.1, 0.6), (2.0, 1.1))
FREQUENCIES = {"crossing": "zero crossings", "hz": "dominant frequency"}
# Range of the paper's best gain.
LEAST_KP, MOST_KP = 0.6, 1.1
# A gain below those of the paper.
CALMER = 0.3
# Less than 10 % more is no fluctuation that begins.
LITTLE_RATIO = 1.1
BETTER_RATIO = 0.98


def paper(options: PaperOptions) -> Paper:
    """Measure Xu's claims on simulated missions and on logs."""
    missions = Flights("simulated missions", run_seeds("missions", one_seed, options))
    paths = options.logs or tuple(sorted(p for p in SAMPLE_LOGS.glob("*") if p.suffix in (".ulg", ".bin")))
    logs = run_each("logs", oscillation_on_log, [(path, ROWS) for path in paths], options)
    used = [log for log in logs if not log.why_not]
    runs = [missions, *([Flights("logs", used)] if used else [])]
    return Paper(
        "xu",
        "Attitude by the Mahony filter and its application",
        "Xu Ensong, Lu Wenhua, Liu Yunfei, Li Baolei, Feng Wang, Shanghai University of Engineering Science "
        "(in Chinese)",
        _settings(len(used)),
        (
            _oscillation_claim(runs),
            _heading_claim(runs),
            *_best_gain_claims(runs),
            slow_claim(missions),
            cost_claim(time_updates(COSTED)),
            _adaptive_claim(runs),
        ),
        paper_figures(runs),
        (oscillation_table(runs),),
        _notes(logs),
        seeds=options.seeds,
        logs=tuple(log.name for log in used),
    )


def _settings(logs: int) -> tuple[PaperSetting, ...]:
    return settings(
        paper={"kp": "0.6, 1.1, 2"},
        ours={
            "ki": "0: none is printed",
            "adaptive gain": (
                "kp 0.6, faded where the specific force (low-passed over 0.1 s in earth axes) is "
                "10 to 20 % off g (after Valenti 2015)"
            ),
            "mission": (
                "the library's waypoints: a square of 30 m at up to 6 m/s, nose ahead, wind of 3 m/s; flown "
                "on the true attitude, so that no filter changes the flight"
            ),
            "sensors": "IMU 200 Hz with rotor vibration, gyro bias 0.1 deg/s (1 sigma); magnetometer 50 Hz",
            "flights": f"the paper has Pixhawk logs; here simulated missions and {counted(logs, 'log')}",
            "oscillation": (
                f"RMS from {BAND}: in simulation of the error; on logs of what the filter pushes in "
                "beyond the gyro alone, in windows of 10 s within 20 deg of their mean attitude"
            ),
        },
    )


def _notes(logs: Sequence[GainRun]) -> tuple[str, ...]:
    left_out = [f"{log.name} ({log.why_not})" for log in logs if log.why_not]
    kinds = {log.reference for log in logs if not log.why_not}
    found = [
        "In section 2 gradient descent turns the accelerometer into a quaternion rate, which is added to the gyro's. "
        "Here mahony's cross product does; the filter with the gradient step is madgwick.",
        "With ki = 0 the filter is of first order and cannot oscillate by itself. With kp grows how much of "
        "accelerations, vibration and field disturbances reaches the attitude.",
        "Which gain errs least depends on the gyro's bias: with ki = 0 it becomes a tilt of bias / kp. "
        "On logs the bias at rest is subtracted first where there is one.",
    ]
    if kinds:
        found.append(f"Errors on logs are against the reference of an analysis: {listed(sorted(kinds))}.")
    if left_out:
        found.append(f"Logs not used: {'; '.join(left_out)}.")
    if not logs:
        found.append("No log was given (--logs) and none came with this installation. So all flights are simulated.")
    return tuple(found)


def _over(runs: Flights, what: str, field: str, axis: int | None, row: str, other: str) -> PaperNumber:
    """Return the ratio of a field of two rows."""
    return ratio(f"{what}, {runs.called}", runs.values(field, row, axis), runs.values(field, other, axis))


def _step(runs: Flights, axis: int, high: float, low: float) -> PaperNumber:
    return _over(runs, f"{AXES[axis]} in the band, kp {high:g} over {low:g}", "rms", axis, gain(high), gain(low))


def _frequency(runs: Flights, field: str, axis: int, high: float, low: float) -> PaperNumber:
    what = f"{FREQUENCIES[field]} of {AXES[axis]}, kp {high:g} over {low:g}"
    return _over(runs, what, field, axis, gain(high), gain(low))


def _verdict(runs: Sequence[Flights], parts: Mapping[str, list[Verdict]]) -> Verdict:
    """Combine the verdicts on simulated missions, and on logs where there are enough for an interval."""
    return combine_verdicts([v for r in runs if r is runs[0] or len(r.runs) > 1 for v in parts[r.called]])


def _oscillation_claim(runs: Sequence[Flights]) -> Claim:
    steps = {r.called: [_frequency(r, "crossing", axis, *pair) for axis in (0, 1) for pair in PAIRS] for r in runs}
    peaks = {r.called: [_frequency(r, "hz", axis, 2.0, 0.6) for axis in (0, 1)] for r in runs}
    each = [
        mean(f"{kind} of {AXES[axis]}, kp {kp:g}, {r.called}", r.values(field, row, axis), "1/s")
        for field, kind in FREQUENCIES.items()
        for r in runs
        for axis in (0, 1)
        for kp, row in FIXED.items()
    ]
    size = [_step(r, axis, 2.0, 0.6) for r in runs for axis in (0, 1)]
    low, high = smallest_and_largest([n for numbers in steps.values() for n in numbers])
    dominant = [n.value for n in each if n.value is not None and n.what.startswith(FREQUENCIES["hz"])]
    first = [steps[r.called][0] for r in runs]
    judged = [n for found in (steps, peaks) for r in runs for n in found[r.called]]
    return Claim(
        "oscillates",
        "The frequency at which roll and pitch oscillate grows with the gain.",
        "fig. 1 to 3, section 4",
        f"Zero crossings (upwards) per second of roll and pitch from {BAND} at kp 0.6, 1.1 and 2. Beside them the "
        "frequency with most power per octave (dominant). Holds if the intervals of all ratios are above 1.",
        (*put_first((*first, peaks[runs[0].called][0]), judged), *each, *size),
        _verdict(runs, {r.called: [above(n, 1.0) for n in (*steps[r.called], *peaks[r.called])] for r in runs}),
        f"A step changes the zero crossings by {number(low.value, 'ratio')} to {quantity(high.value, 'ratio')}. The "
        f"dominant frequency is {min(dominant):.2f} to {max(dominant):.2f} Hz with every gain. With ki = 0 the filter "
        f"has none of its own. The size grows more: from kp 0.6 to 2 the RMS of roll is {numbers_text(size[:1])}.",
        paper="kp 0.6, 1.1, 2",
        shown=len(first) + 1,
    )


def _heading_claim(runs: Sequence[Flights]) -> Claim:
    grows = {r.called: [_step(r, 2, *pair) for pair in PAIRS] for r in runs}
    calm = {r.called: _step(r, 2, 0.6, CALMER) for r in runs}
    parts = {r.called: [*(above(n, 1.0) for n in grows[r.called]), below(calm[r.called], LITTLE_RATIO)] for r in runs}
    first = runs[0].called
    return Claim(
        "heading",
        "Heading fluctuates strongly from a gain of 1.1 on.",
        "fig. 1 to 3, section 4",
        f"RMS of heading from {BAND}. It must grow from 0.6 to 1.1 to 2: all intervals above 1. From {CALMER:g} to 0.6 "
        f"it must grow by less than {100 * (LITTLE_RATIO - 1):.0f} %.",
        tuple(n for r in runs for n in (*grows[r.called], calm[r.called])),
        _verdict(runs, parts),
        f"On {first} the steps from 0.6 over 1.1 to 2 are {numbers_text(grows[first])}. Nothing need begin there: the "
        f"step from {CALMER:g} to 0.6 is {numbers_text([calm[first]])}.",
        paper="from kp 1.1 on",
        shown=3,
    )


def _best_gain_claims(runs: Sequence[Flights]) -> tuple[Claim, Claim]:
    """Judge both ends of the paper's range by themselves: together they would read as half true."""
    measured = [r for r in runs if r.complete().runs]
    best = {r.called: [best_gain(r, what) for what in ("tilt", "heading")] for r in measured}
    larger = {r.called: [_tilt_over(r, kp, LEAST_KP) for kp in (MOST_KP, 2.0)] for r in measured}
    words = " ".join(f"On {called} {b.words}." for called, found in best.items() for b in found)
    method = f"RMS error of tilt and heading in the air for gains from {SWEPT[0]:g} to {SWEPT[-1]:g}. "

    def verdict(within: Callable[[BestGain], bool]) -> Verdict:
        ends: dict[str, list[Verdict]] = {
            called: ["holds" if within(b) else "does not hold" for b in found if b.decides]
            for called, found in best.items()
        }
        return _verdict(measured, ends)

    first = measured[0].called
    return (
        Claim(
            "best_at_least",
            f"The best gain is at least {LEAST_KP:g}.",
            "section 4",
            f"{method}A gain of {LEAST_KP:g} or more must be best or not significantly different.",
            tuple(b.over for found in best.values() for b in found),
            verdict(lambda b: b.alike[-1] >= LEAST_KP),
            words,
            paper=f"kp {LEAST_KP:g} to {MOST_KP:g}",
            shown=2,
        ),
        Claim(
            "best_at_most",
            f"The best gain is at most {MOST_KP:g}.",
            "section 4",
            f"{method}A gain of {MOST_KP:g} or less must be best or not significantly different.",
            tuple(n for found in larger.values() for n in found),
            verdict(lambda b: b.alike[0] <= MOST_KP),
            f"Tilt errors with {MOST_KP:g} and 2 are {numbers_text(larger[first])} that of {LEAST_KP:g} on {first}.",
            paper=f"kp {LEAST_KP:g} to {MOST_KP:g}",
            shown=2,
        ),
    )


def _tilt_over(runs: Flights, kp: float, other: float) -> PaperNumber:
    return _over(runs, f"error of tilt, kp {kp:g} over {other:g}", "tilt", None, gain(kp), gain(other))


def _adaptive_claim(runs: Sequence[Flights]) -> Claim:
    numbers: dict[str, list[PaperNumber]] = {}
    for r in runs:
        tilt, roll = (
            _over(r, f"{name}, adaptive over fixed 0.6", what, axis, ADAPTIVE, gain(0.6))
            for name, what, axis in (("error of tilt", "tilt", None), ("roll in the band", "rms", 0))
        )
        numbers[r.called] = [n for n in (tilt, roll) if n.value is not None]
    complete = [f"{numbers_text(found[:1])} on {called}" for called, found in numbers.items()]
    return Claim(
        "adaptive",
        "A gain that adapts is better than a fixed one.",
        "abstract",
        "The paper prints no law, so this judges ours. Error of tilt and RMS of roll in the band over those of the "
        f"fixed gain 0.6. Holds if the intervals are below {BETTER_RATIO:g}.",
        tuple(n for found in numbers.values() for n in found),
        _verdict(runs, {called: [below(n, BETTER_RATIO) for n in found] for called, found in numbers.items()}),
        f"Over the fixed gain's the error of tilt is {listed(complete)}. The law sees the size of the "
        "specific force alone. Accelerations across gravity pass it up to 0.46 g, where the size is 10 % off.",
        shown=2,
    )
