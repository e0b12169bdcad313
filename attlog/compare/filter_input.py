"""Prepare a log's samples for a configuration, and run its filter on them.

Samples are calibrated, filtered, resampled, delayed. The log itself and its known delays stay unchanged: a low-pass
makes a row late, and the row's lag includes the delay.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.compare.setting import SETTINGS, Configuration, Value, flown_filter, numbers_text
from attlog.core import rotation, signal
from attlog.core.errors import LogUnusable, UsageError
from attlog.core.sorting import median
from attlog.flight.model import FlightLog, Imu, Mag, Stream
from attlog.flight.parameters import read_parameter_file
from attlog.flight.recalibration import recorrected_units
from attlog.flight.vehicle import version_number
from attlog.metrics.metric import Case
from attlog.pipeline import replay
from attlog.pipeline.onboard_rerun import check_changes, flown_inputs, rerun_row, start_parameters
from attlog.pipeline.recalibrated_inputs import recalibrate_inputs
from attlog.reference.model import Reproduction, Track
from attlog.result import EstimatorRow, ParameterValue
from attlog.segments import model
from attlog.words.flight import reproduction_text

Array = NDArray[np.float64]
Settings = Mapping[str, Value]

# Lowest rotor frequency with a notch, in widths of the notch.
MIN_CENTRE_WIDTHS = 1.0
TESLA_PER_UT = 1e-6
# Largest ratio of a requested rate to the log's rate: up to a third above, rounding still gives one sample per output.
MIN_RATE_SHARE = 0.75
IMU_CALIBRATION = ("imu_rotation", "gyro_offset", "gyro_scale", "acc_offset", "acc_scale")


@dataclass(frozen=True, slots=True)
class FilterInput:
    """Input of a configuration's filter on one log, shared by its parameter sets."""

    case: Case
    configuration: Configuration
    suffix: str
    imu: Imu
    mag: Mag | None
    facts: estimators.LogFacts
    aids: estimators.Aids

    @classmethod
    def of(cls, case: Case, configuration: Configuration, suffix: str | None = None) -> FilterInput:
        """Return the prepared samples of an IMU (default: the first).

        UsageError for settings that this log does not allow.
        """
        suffix = next(iter(case.imus)) if suffix is None else suffix
        imu, mag = case.imus[suffix], None if case.log.mag is None else case.log.mags[case.log.mag]
        facts = replay.log_facts(case, suffix)
        if configuration.params is not None:
            given = read_parameter_file(configuration.params)
            facts = replace(facts, given={**facts.given, **given})
            imu, mag = recorrected_units(case.log, configuration.params.name, given, imu, mag)
        before = {name: value for name, value in configuration.before.items() if name != "params"}
        if before:  # otherwise keep the log's own IMU, whose metrics are cached
            imu, mag = prepare_input(before, case.log, imu, mag)
        return cls(case, configuration, suffix, imu, mag, facts, replay.aids_of(case, suffix))

    @property
    def values(self) -> dict[str, float | str]:
        """Return every parameter of the filter on this log."""
        return {name: value for name, (value, _) in self.configuration.row.resolved(self.facts).items()}

    def rows(self, settings: Sequence[Mapping[str, float | str]]) -> list[Track]:
        """Return one row per parameter set, which overrides the configuration's own."""
        row = self.configuration.row
        if self.configuration.is_flown:
            specs = [replace(row, params={**row.params, **setting}) for setting in settings]
            runs = [ConfiguredFilter(replace(self.configuration, row=spec, name=spec.name)) for spec in specs]
            return [run.run(self.case, self.case.imus[self.suffix], "")[0] for run in runs]
        return replay.batch(self.case, self.imu, self.mag, row, settings, self.facts, self.aids)

    def row(self) -> tuple[Track, EstimatorRow]:
        """Return the configuration's row and its line of the table."""
        c = self.configuration
        return replay.replayed(self.case, self.imu, self.mag, c.row, self.facts, self.aids, c.name + self.suffix)


@dataclass(frozen=True, slots=True)
class ConfiguredFilter:
    """Configuration in the form of a filter for :func:`attlog.pipeline.evaluate`."""

    configuration: Configuration

    @property
    def name(self) -> str:
        """Return the row's name."""
        return self.configuration.name

    @property
    def row(self) -> estimators.EstimatorSpec:
        """Return the filter that runs."""
        return self.configuration.row

    def __str__(self) -> str:
        return self.configuration.text

    def run(self, case: Case, imu: Imu, suffix: str) -> tuple[Track, EstimatorRow]:
        """Return the row and its table line, including settings of the samples."""
        c = self.configuration
        if replay.is_recorded(c.row):
            if c.before:
                raise UsageError(
                    f"{', '.join(c.before)}: nothing can come before an attitude that was computed elsewhere"
                )
            return replay.recorded_row(case, imu, c.row, c.name + suffix)
        if c.is_flown:
            changes = flown_changes(case, c)
            spec = estimators.EstimatorSpec(c.row.estimator, c.row.preset, changes.parameters)
            return rerun_row(case, imu, spec, c.name + suffix, calibration=changes.calibration, study=True)
        row, line = FilterInput.of(case, c, suffix).row()
        for name, value in c.before.items():
            setting = SETTINGS[name]
            shown = ParameterValue(numbers_text(value), "option", setting.unit, setting.meaning)
            line.parameters[f"before.{name}"] = shown
        return row, line


@dataclass(frozen=True, slots=True)
class FlownChanges:
    """Changes of a flown filter on one log: parameters and calibrations; ``remarks`` on what is not applied."""

    parameters: dict[str, float | str]
    calibration: dict[str, float]
    remarks: list[str]


def flown_changes(case: Case, c: Configuration) -> FlownChanges:
    """Return what a configuration of a flown filter changes on a log.

    From a parameter file only values that differ from the log's. UsageError for settings of the samples, because the
    filter runs on its onboard inputs, and for parameters of another version.
    """
    estimator, log = c.row.estimator, case.log
    others = [name for name in c.before if name != "params"]
    if others:
        raise UsageError(f"{', '.join(others)}: nothing comes before {estimator.name}, it runs on its own inputs")
    given = {} if c.params is None else read_parameter_file(c.params)
    parameters: dict[str, float | str] = {}
    remarks = []
    for name, value in given.items():
        flew = log.param(name)
        equal = flew is not None and math.isclose(value, flew, rel_tol=1e-6, abs_tol=1e-9)
        if equal or flown_filter(f"{name}=") != estimator.name:
            continue
        try:
            parameter = estimator.parameter(name)
            check_changes(estimator.name, [parameter.name], version_number(log.firmware.version))
        except UsageError as why:
            remarks.append(f"{why} It is not applied." if str(why).endswith(".") else f"{why}; it is not applied")
        else:
            parameters[parameter.name] = parameter.check(value, str(c.params))
    return FlownChanges({**parameters, **c.row.params}, given, remarks)


def change_remarks(case: Case, c: Configuration, start: str) -> list[str]:
    """Return a remark on each change of a flown filter that is not applied, and on calibrations that are.

    ``start``: of its re-run, "warm" or "cold". UsageError where no change has an effect.
    """
    check_changes(c.row.estimator.name, c.row.params, version_number(case.log.firmware.version))
    changes = flown_changes(case, c)
    remarks = [*changes.remarks]
    if changes.calibration:
        inputs = flown_inputs(case, next(iter(case.imus.values())))
        remarks += recalibrate_inputs(case.log, inputs, changes.calibration)[1]
    names = [n for n in changes.parameters if n in start_parameters(c.row.estimator.name)]
    if start == "warm" and names:
        why = f"{', '.join(names)}: acts on a cold start alone, and this re-run begins from logged states"
        if len(names) == len(changes.parameters) and not changes.calibration:
            raise UsageError(why)
        remarks.append(why)
    return remarks


def require_reproduction(case: Case, name: str, *, anyway: bool = False) -> Reproduction | None:
    """Return the re-run's deviation from the flown attitude.

    LogUnusable if it is too large or unknown, unless ``anyway``.
    """
    row, _ = rerun_row(case, next(iter(case.imus.values())), estimators.parse(name), name)
    found = row.reproduction
    if (found is None or not found.follows) and not anyway:
        said = reproduction_text(name, found) if found else f"{name} cannot be compared with onboard."
        raise LogUnusable(f"{said} Its parameters are not studied; --anyway does")
    return found


def prepare_input(settings: Settings, log: FlightLog, imu: Imu, mag: Mag | None) -> tuple[Imu, Mag | None]:
    """Apply settings to an IMU and a magnetometer.

    UsageError for settings that this log does not allow.
    """
    if settings.get("mag") == "off":
        mag = None
    if any(name in settings for name in IMU_CALIBRATION):
        gyro = replace(imu.gyro, x=calibrate(settings, "gyro", imu.gyro.x))
        imu = replace(imu, gyro=gyro, acc=replace(imu.acc, x=calibrate(settings, "acc", imu.acc.x)))
    gyro, acc = _filter_imu(settings, log, imu)
    imu = _resample_imu(settings, replace(imu, gyro=gyro, acc=acc))
    if mag is not None:
        mag = replace(mag, field=_prepare_mag(settings, mag.field))
    late = float(settings.get("latency", (0.0,))[0]) / 1000.0
    if late:
        imu = replace(imu, gyro=_delay_stream(imu.gyro, late), acc=_delay_stream(imu.acc, late))
        mag = None if mag is None else replace(mag, field=_delay_stream(mag.field, late))
    return imu, mag


def calibrate(settings: Settings, sensor: Literal["gyro", "acc", "mag"], x: Array) -> Array:
    """Return R(roll, pitch, yaw) (scale * (x - offset)) of vectors (n, 3)."""
    unit = {"gyro": np.pi / 180.0, "acc": 1.0, "mag": TESLA_PER_UT}[sensor]
    out = x - unit * np.array(settings.get(f"{sensor}_offset", (0.0, 0.0, 0.0)), np.float64)
    out = out * np.array(settings.get(f"{sensor}_scale", (1.0,)), np.float64)
    turn = settings.get("mag_rotation" if sensor == "mag" else "imu_rotation")
    if turn is not None:
        out = rotation.rotate(rotation.from_euler(*np.radians(np.array(turn, np.float64))), out)
    return np.asarray(out)


def _filter_imu(settings: Settings, log: FlightLog, imu: Imu) -> tuple[Stream, Stream]:
    """Apply notches and low-passes, restarted after each gap."""
    both, gyro, acc = (settings.get(name) for name in ("lowpass", "gyro_lowpass", "acc_lowpass"))
    has_notch = "notch" in settings or "rpm_notch" in settings
    streams = []
    for stream, cutoff in ((imu.gyro, gyro or both), (imu.acc, acc or both)):
        if cutoff is None and not has_notch:
            streams.append(stream)
            continue
        x, t = np.array(stream.x, np.float64), stream.t_best
        for part in _unbroken_slices(t):
            rate = 1.0 / float(median(np.diff(t[part]))) if part.stop - part.start > 1 else 0.0
            if rate <= 0.0:
                continue
            if "notch" in settings:
                centre, width = (float(v) for v in settings["notch"])
                x[part] = signal.run_biquads([(0, signal.notch(centre, width, rate))], x[part])
            if "rpm_notch" in settings:
                x[part] = _notch_rotors(settings["rpm_notch"], log, t[part], x[part], rate)
            if cutoff is not None:
                x[part] = signal.run_biquads([(0, signal.lowpass(float(cutoff[0]), rate))], x[part])
        streams.append(replace(stream, x=x))
    return streams[0], streams[1]


def _notch_rotors(asked: Value, log: FlightLog, t: Array, x: Array, rate: float) -> Array:
    """Apply one notch per rotor and harmonic, at the last logged rotor speed."""
    if log.power.rpm is None or len(log.power.rpm.t) == 0:
        raise UsageError("rpm_notch needs rotor speeds, and this log holds none (ESC telemetry or RPM messages)")
    width = float(asked[0])
    harmonics = int(asked[1]) if len(asked) > 1 else 1
    speeds, at = log.power.rpm.x / 60.0, np.searchsorted(t, log.power.rpm.t_best)
    at[: np.count_nonzero(log.power.rpm.t_best <= t[0])] = 0
    for rotor in range(speeds.shape[1]):
        for harmonic in range(1, harmonics + 1):
            centre = harmonic * speeds[:, rotor]
            usable = np.isfinite(centre) & (centre > MIN_CENTRE_WIDTHS * width) & (centre < 0.5 * rate)
            changes: dict[int, signal.Biquad] = {0: signal.PASS_THROUGH}
            for k in np.flatnonzero(at < len(t)).tolist():
                changes[int(at[k])] = signal.notch(float(centre[k]), width, rate) if usable[k] else signal.PASS_THROUGH
            x = signal.run_biquads(sorted(changes.items()), x)
    return x


def _samples_per_output(asked: float, rate: float, what: str) -> int:
    """Return the decimation factor for a requested rate. UsageError above the log's rate."""
    n = round(rate / asked) if rate else 1
    if n < 1 or rate < MIN_RATE_SHARE * asked:
        raise UsageError(f"a {what} of {asked:g} Hz is above that of the log, {rate:.0f} Hz")
    return n


def _resample_imu(settings: Settings, imu: Imu) -> Imu:
    """Reduce the rate of an IMU: means over n samples, or every n-th sample."""
    asked = settings.get("rate") or settings.get("pick")
    if asked is None:
        return imu
    t = imu.gyro.t_best
    n = _samples_per_output(float(asked[0]), imu.gyro.rate, "rate")
    if n == 1:
        return imu
    slices = _unbroken_slices(t)
    ends = np.concatenate([np.arange(s.start + n - 1, s.stop, n) for s in slices] or [np.zeros(0, np.int64)])
    if "pick" in settings:
        return replace(imu, gyro=_take(imu.gyro, ends), acc=_take(imu.acc, ends), dt=None)
    step = np.diff(t, prepend=t[:1]) if imu.dt is None else imu.dt
    step = np.where(np.isfinite(step) & (step > 0.0), step, median(np.diff(t)))
    members = ends[:, None] - np.arange(n)
    weight = step[members][:, :, None]
    means = []
    for stream in (imu.gyro, imu.acc):
        x = stream.x
        if stream.sampling == "instant":
            x = np.vstack([x[:1], 0.5 * (x[1:] + x[:-1])])
        mean = np.sum(weight * x[members], axis=1) / np.sum(weight, axis=1)
        means.append(replace(_take(stream, ends), x=mean, sampling="interval"))
    dt = np.sum(step[members], axis=1) if imu.dt is not None else None
    return replace(imu, gyro=means[0], acc=means[1], dt=dt)


def _prepare_mag(settings: Settings, field: Stream) -> Stream:
    """Calibrate a magnetic field and reduce its rate."""
    out = replace(field, x=calibrate(settings, "mag", field.x))
    if "mag_rate" not in settings:
        return out
    n = _samples_per_output(float(settings["mag_rate"][0]), field.rate, "magnetometer rate")
    return _take(out, slice(0, None, n))


def _take(stream: Stream, kept: NDArray[np.int64] | slice) -> Stream:
    t_sample = None if stream.t_sample is None else stream.t_sample[kept]
    return replace(stream, t=stream.t[kept], x=stream.x[kept], t_sample=t_sample)


def _delay_stream(stream: Stream, seconds: float) -> Stream:
    t_sample = None if stream.t_sample is None else stream.t_sample + seconds
    return replace(stream, t=stream.t + seconds, t_sample=t_sample)


def _unbroken_slices(t: Array) -> list[slice]:
    """Return index ranges between gaps."""
    return model.segment_slices(np.ones(len(t), bool), model.number_segments(t))
