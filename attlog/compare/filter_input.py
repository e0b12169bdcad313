"""The samples of a log as a configuration wants them: calibrated, filtered, thinned out, late.

The log itself is not changed, nor is what is known of its delay: a low-pass makes a row late, and its
lag shows it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog import estimators
from attlog.compare.setting import SETTINGS, Configuration, Value
from attlog.core import rotation, signal
from attlog.core.errors import UsageError
from attlog.flight.model import FlightLog, Imu, Mag, Stream
from attlog.flight.parameters import read_parameter_file
from attlog.flight.recalibration import recorrected_units
from attlog.metrics.metric import Case
from attlog.pipeline import replay
from attlog.reference.model import Row
from attlog.result import EstimatorRow, ParameterValue
from attlog.segments import model

Array = NDArray[np.float64]
Settings = Mapping[str, Value]

MIN_CENTRE_WIDTHS = 1.0
"""A rotor whose frequency is below so many widths of its notch gets none: it stands or starts."""
TESLA_PER_UT = 1e-6


def prepare_input(settings: Settings, log: FlightLog, imu: Imu, mag: Mag | None) -> tuple[Imu, Mag | None]:
    """The unit and the magnetometer as the filter is to see them. UsageError for what this log cannot do."""
    if settings.get("mag") == "off":
        mag = None
    imu = _calibrate_imu(settings, imu)
    gyro, acc = _filter_imu(settings, log, imu)
    imu = replace(imu, gyro=gyro, acc=acc)
    imu = _resample_imu(settings, imu)
    if mag is not None:
        mag = replace(mag, field=_calibrate_mag(settings, mag.field))
    late = float(settings.get("latency", (0.0,))[0]) / 1000.0
    if late:
        imu = replace(imu, gyro=_delay_stream(imu.gyro, late), acc=_delay_stream(imu.acc, late))
        mag = None if mag is None else replace(mag, field=_delay_stream(mag.field, late))
    return imu, mag


def calibrate(settings: Settings, sensor: Literal["gyro", "acc", "mag"], x: Array) -> Array:
    """Vectors (n, 3) of a sensor in SI units: R(roll, pitch, yaw) (scale * (x - offset))."""
    unit = {"gyro": np.pi / 180.0, "acc": 1.0, "mag": TESLA_PER_UT}[sensor]
    out = x - unit * np.array(settings.get(f"{sensor}_offset", (0.0, 0.0, 0.0)), np.float64)
    out = out * np.array(settings.get(f"{sensor}_scale", (1.0,)), np.float64)
    turn = settings.get("mag_rotation" if sensor == "mag" else "imu_rotation")
    if turn is not None:
        out = rotation.rotate(rotation.from_euler(*np.radians(np.array(turn, np.float64))), out)
    return np.asarray(out)


def _calibrate_imu(settings: Settings, imu: Imu) -> Imu:
    if not any(name in settings for name in ("imu_rotation", "gyro_offset", "gyro_scale", "acc_offset", "acc_scale")):
        return imu
    return replace(
        imu,
        gyro=replace(imu.gyro, x=calibrate(settings, "gyro", imu.gyro.x)),
        acc=replace(imu.acc, x=calibrate(settings, "acc", imu.acc.x)),
    )


def _filter_imu(settings: Settings, log: FlightLog, imu: Imu) -> tuple[Stream, Stream]:
    """Gyro and accelerometer behind notches and low-passes; each stretch between gaps begins anew."""
    both, gyro, acc = (settings.get(name) for name in ("lowpass", "gyro_lowpass", "acc_lowpass"))
    notches = [settings[name] for name in ("notch", "rpm_notch") if name in settings]
    streams = []
    for stream, cutoff in ((imu.gyro, gyro or both), (imu.acc, acc or both)):
        if cutoff is None and not notches:
            streams.append(stream)
            continue
        x, t = np.array(stream.x, np.float64), stream.t_best
        for part in _unbroken_slices(t):
            rate = 1.0 / float(np.median(np.diff(t[part]))) if part.stop - part.start > 1 else 0.0
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
    """Samples behind one notch per rotor and harmonic, each at the rotor speed that was logged last."""
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


def _resample_imu(settings: Settings, imu: Imu) -> Imu:
    """The unit at a lower rate: means over n samples, or each n-th."""
    asked = settings.get("rate") or settings.get("pick")
    if asked is None:
        return imu
    t = imu.gyro.t_best
    own = imu.gyro.rate
    n = round(own / float(asked[0])) if own else 1
    if n < 1 or own < 0.75 * float(asked[0]):
        raise UsageError(f"a rate of {float(asked[0]):g} Hz is above that of the log, {own:.0f} Hz")
    if n == 1:
        return imu
    ends = np.concatenate(
        [np.arange(s.start + n - 1, s.stop, n) for s in _unbroken_slices(t)] or [np.zeros(0, np.int64)]
    )
    if "pick" in settings:
        gyro, acc = (
            replace(s, t=s.t[ends], x=s.x[ends], t_sample=None if s.t_sample is None else s.t_sample[ends])
            for s in (imu.gyro, imu.acc)
        )
        return replace(imu, gyro=gyro, acc=acc, dt=None)
    step = np.diff(t, prepend=t[:1]) if imu.dt is None else imu.dt
    step = np.where(np.isfinite(step) & (step > 0.0), step, np.median(np.diff(t)))
    members = ends[:, None] - np.arange(n)
    weight = step[members][:, :, None]
    means = []
    for stream in (imu.gyro, imu.acc):
        x = stream.x
        if stream.sampling == "instant":
            x = np.vstack([x[:1], 0.5 * (x[1:] + x[:-1])])
        mean = np.sum(weight * x[members], axis=1) / np.sum(weight, axis=1)
        t_sample = None if stream.t_sample is None else stream.t_sample[ends]
        means.append(replace(stream, t=stream.t[ends], x=mean, t_sample=t_sample, sampling="interval"))
    dt = np.sum(step[members], axis=1) if imu.dt is not None else None
    return replace(imu, gyro=means[0], acc=means[1], dt=dt)


def _calibrate_mag(settings: Settings, field: Stream) -> Stream:
    out = replace(field, x=calibrate(settings, "mag", field.x))
    asked = settings.get("mag_rate")
    if asked is None:
        return out
    n = round(field.rate / float(asked[0])) if field.rate else 1
    if n < 1 or field.rate < 0.75 * float(asked[0]):
        raise UsageError(f"a magnetometer rate of {float(asked[0]):g} Hz is above that of the log, {field.rate:.0f} Hz")
    kept = slice(0, None, n)
    return replace(out, t=out.t[kept], x=out.x[kept], t_sample=None if out.t_sample is None else out.t_sample[kept])


def _delay_stream(stream: Stream, seconds: float) -> Stream:
    t_sample = None if stream.t_sample is None else stream.t_sample + seconds
    return replace(stream, t=stream.t + seconds, t_sample=t_sample)


def _unbroken_slices(t: Array) -> list[slice]:
    """Index ranges between gaps."""
    return model.segment_slices(np.ones(len(t), bool), model.number_segments(t))


# A configuration over a case: its samples prepared, its filter run, what comes out as a row of the comparison.


@dataclass(frozen=True, slots=True)
class ConfiguredFilter:
    """What :func:`attlog.pipeline.evaluate` takes in place of a filter's name."""

    configuration: Configuration

    @property
    def name(self) -> str:
        """What the row is called."""
        return self.configuration.name

    @property
    def row(self) -> estimators.EstimatorSpec:
        """The filter that runs."""
        return self.configuration.row

    def __str__(self) -> str:
        return self.configuration.text

    def run(self, case: Case, imu: Imu, suffix: str) -> tuple[Row, EstimatorRow]:
        """The row, and its line of the table with what comes before the filter among its parameters.

        UsageError where the log cannot be prepared so; errors of the filter as they come.
        """
        c, log = self.configuration, case.log
        if replay.is_recorded(c.row):
            if c.before:
                raise UsageError(
                    f"{', '.join(c.before)}: nothing can come before an attitude that was computed elsewhere"
                )
            return replay.recorded_row(case, imu, c.row, c.name + suffix)
        mag = None if log.mag is None else log.mags[log.mag]
        settings = {name: value for name, value in c.before.items() if name != "params"}
        facts = replay.facts(case, suffix)
        if c.params is not None:
            given = read_parameter_file(c.params)
            facts = replace(facts, given={**facts.given, **given})
            imu, mag = recorrected_units(log, c.params.name, given, imu, mag)
        if settings:  # else the log's own unit, for which metrics find what they need once
            imu, mag = prepare_input(settings, log, imu, mag)
        row, line = replay.replayed(case, imu, mag, c.row, facts, replay.aids_of(case, suffix), c.name + suffix)
        for name, value in c.before.items():
            shown = value if isinstance(value, str) else "/".join(f"{x:g}" for x in value)
            setting = SETTINGS[name]
            line.parameters[f"before.{name}"] = ParameterValue(shown, "option", setting.unit, setting.meaning)
        return row, line
