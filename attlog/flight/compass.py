"""Build magnetometers without spikes, choose the one to use, and find the motors' power beside it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.brief import counted
from attlog.core.sorting import median
from attlog.core.timestamps import Stamps
from attlog.flight import limits
from attlog.flight.builder import LogBuilder
from attlog.flight.frozen import turned_deg
from attlog.flight.imu import as_sentence
from attlog.flight.model import Array, FlightLog, Imu, Mag, Severity, Stream
from attlog.formats.table import FieldError

# Factor between a record's norm and the median of its neighbours above which (or below its inverse) it is a spike.
SPIKE_FACTOR = 3.0
# Spikes beyond both this number and share are a warning, fewer a note.
MAX_NOTE_SPIKES, MAX_NOTE_SPIKE_SHARE = 3, 0.01
# Turn during which a constant field shows a dead magnetometer.
MIN_TURN_DEG = 15.0


def build_mag(
    builder: LogBuilder,
    index: int,
    t_us: Stamps,
    field_t: Array,
    source: str,
    *,
    t_sample_us: Stamps | None = None,
    calibrated: bool = True,
    device: str | None = None,
    enabled: bool = True,
) -> Mag | None:
    """Build a magnetometer from ``field_t`` (n, 3) tesla; spikes and zeros become NaN.

    None if no record is left. ValueError for another shape.
    """
    if field_t.shape[1:] != (3,):
        raise FieldError(f"{source} does not hold three axes")
    stream = builder.stream(t_us, field_t, "T", source, frame="FRD", t_sample_us=t_sample_us, allow_nan=True)
    if stream is None:
        return None
    bad = field_spikes(stream.x)
    if bad.all() and stream.x[bad].any():
        text = f"{source}: all its {len(bad):,} records lie outside {limits.FIELD.limits} ({limits.FIELD.why})."
        builder.problem("values_out_of_range", "warning", text, count=len(bad))
        return None
    if bad.any() and not bad.all():
        stream.x[bad] = np.nan
        count = int(bad.sum())
        severity: Severity = "warning" if count > max(MAX_NOTE_SPIKE_SHARE * len(bad), MAX_NOTE_SPIKES) else "note"
        text = f"{source}: left out {count} of {counted(len(bad), 'record')} of the magnetometer, "
        text += f"zero or more than a factor {SPIKE_FACTOR:.0f} off their neighbours."
        builder.problem("mag_spikes", severity, text, t=float(stream.t[np.flatnonzero(bad)[0]]), count=count)
    return Mag(index, stream, calibrated, device, enabled)


def field_spikes(field_t: Array) -> NDArray[np.bool_]:
    """Mark invalid records (n,): not finite, zero, beyond the limit, or far from the local median norm."""
    norm = np.sqrt(np.sum(field_t**2, axis=1))
    bad: NDArray[np.bool_] = ~np.isfinite(norm) | (norm == 0) | (norm > limits.FIELD.high)
    good = np.flatnonzero(~bad)
    if len(good) >= 5:
        n = norm[good]
        padded = np.concatenate([n[2:0:-1], n, n[-2:-4:-1]])
        local = median(np.lib.stride_tricks.sliding_window_view(padded, 5), axis=1)
        bad[good[(n > SPIKE_FACTOR * local) | (n < local / SPIKE_FACTOR)]] = True
    return bad


def dead_reason(mag: Mag, imu: Imu | None) -> str:
    """Return the reason to consider a magnetometer dead, empty if it seems to measure."""
    x = mag.field.x[rotation.finite_rows(mag.field.x)]
    if len(x) == 0 or not x.any():
        return "all its values are zero"
    if len(x) >= 10 and not np.ptp(x, axis=0).any() and imu is not None:
        turned = turned_deg(imu.gyro, float(mag.field.t[0]), float(mag.field.t[-1]))
        if turned > MIN_TURN_DEG:
            return f"its values never change while the gyro turns by {turned:.0f} deg"
    return ""


def choose_mag(builder: LogBuilder, preferred: int | None, why: str, asked: int | str | None) -> int | None:
    """Return the position of the magnetometer to use; None and a problem if none is usable.

    ``preferred``: index of the magnetometer that flew, for the reason ``why``. ``asked``: an index, ``"none"``, or None
    to choose.
    """
    log, mags = builder.log, builder.log.mags
    if asked == "none":
        log.choices["mag"] = "None, as asked for."
        return None
    if asked is not None:
        named = [k for k, m in enumerate(mags) if m.index == int(asked)]
        if not named:
            have = ", ".join(str(m.index) for m in mags) or "none"
            text = f"There is no magnetometer {asked} in this log; it holds {have}."
            builder.problem("mag_not_in_log", "error", text)
            return None
        log.choices["mag"] = "Asked for."
        return named[0]
    usable, passed_over = [], []
    for k, mag in enumerate(mags):
        name = mag.field.source
        reason = dead_reason(mag, log.replay_imu)
        if reason:
            if not any(p.code == "mag_only_offsets" and p.source == name for p in builder.problems):
                builder.problem("mag_dead", "warning", f"{name}: {reason}; this magnetometer is not used.")
        elif not mag.enabled:
            passed_over.append(("mag_disabled", f"{name}: the parameters disable this compass", mag.index))
        elif not mag.calibrated:
            passed_over.append(("mag_uncalibrated", f"{name}: this compass was never calibrated", mag.index))
        else:
            usable.append(k)
    for code, why_not, index in passed_over:
        text = f"{why_not}, so it is not used; --mag {index} takes it anyway."
        builder.problem(code, "note" if usable else "warning", text)
    if not usable:
        if not mags:
            text = f"This log holds no magnetometer data: headings are relative. {log.advice('mag')}"
            builder.problem("no_mag", "warning", text)
        return None
    chosen = next((k for k in usable if mags[k].index == preferred), usable[0])
    log.choices["mag"] = as_sentence(why if mags[chosen].index == preferred else "the first usable one")
    return chosen


# Power of the motors, whose field a compass measures too.

MotorPower = Literal["current", "throttle"]
# Maximum time from a field sample to a power record.
MAX_POWER_DISTANCE_S = 2.0
# Minimum peak current; below it there is no current sensor.
MIN_CURRENT_A = 0.5


def motor_drives(log: FlightLog) -> dict[MotorPower, Stream]:
    """Return the logged streams of battery current (A) and throttle (0 to 1)."""
    found: dict[MotorPower, Stream] = {}
    battery, throttle = log.power.battery, log.power.throttle
    if battery is not None and battery.x.shape[1] > 1 and np.isfinite(battery.x[:, 1]).any():
        found["current"] = Stream(battery.t, battery.x[:, 1:2], "A", "", battery.source)
    if throttle is not None and len(throttle.t) > 1:
        found["throttle"] = throttle
    return found


def motor_drive(log: FlightLog) -> tuple[MotorPower, Stream | None]:
    """Return the kind and stream of the motors' power: the current, else the throttle."""
    drives = motor_drives(log)
    if "current" in drives and np.nanmax(np.abs(drives["current"].x[:, 0])) >= MIN_CURRENT_A:
        return "current", drives["current"]
    return "throttle", drives.get("throttle")


def power_at(drive: Stream | None, t: Array) -> Array:
    """Interpolate the power at ``t`` (n,) s; NaN far from any record."""
    if drive is None:
        return np.full(len(t), np.nan)
    known = np.isfinite(drive.x[:, 0])
    at, x = drive.t[known], drive.x[known, 0]
    if not len(at):
        return np.full(len(t), np.nan)
    k = np.clip(np.searchsorted(at, t), 1, max(len(at) - 1, 1))
    gap = np.minimum(np.abs(t - at[k - 1]), np.abs(at[np.minimum(k, len(at) - 1)] - t))
    return np.where(gap <= MAX_POWER_DISTANCE_S, np.interp(t, at, x), np.nan)
