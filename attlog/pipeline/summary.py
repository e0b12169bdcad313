"""Description of a log in one dictionary: ``log`` of results and of ``attlog info``."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from attlog.core import earth
from attlog.core.files import sha256
from attlog.core.sorting import median
from attlog.flight.model import FlightLog, Stream, TimeLine, guarded_part
from attlog.flight.parameters import parameter_histories
from attlog.segments.model import Segments


def name_and_vehicle(log: FlightLog) -> dict[str, Any]:
    """Return what the title of a log names: file, vehicle, firmware, duration."""
    return {
        "name": log.path.name,
        "firmware": {f: getattr(log.firmware, f) for f in ("name", "version", "git", "board")},
        "vehicle": log.vehicle,
        "simulated": log.simulated,
        "duration_s": log.seconds,
    }


def describe(log: FlightLog, segments: Segments | None = None) -> dict[str, Any]:
    """Describe aircraft, sensors, times and time lines of a flight as plain values.

    Absent ones are None. A part that ends in a bug is left out and reported as a problem of the log. LogUnreadable if
    the file was deleted meanwhile.
    """

    def part(what: str, make: Callable[[], Any], absent: Any) -> Any:
        return guarded_part(log, what, make, lambda: absent)

    imu = log.replay_imu
    mag = None if log.mag is None else log.mags[log.mag]
    onboard = log.onboard_attitude
    return name_and_vehicle(log) | {
        "sha256": sha256(log.path),
        "size": log.size,
        "format": log.format,
        "date_utc": part("The date", lambda: _date(log), None),
        "t0_us": log.t0_us,
        "utc_offset": log.utc_offset,
        "boot": log.boot,
        "boots": log.boots,
        "imu": None
        if imu is None
        else _sensor(imu.gyro)
        | {
            "index": imu.index,
            "device": imu.device,
            "filtered": imu.filtered,
            "sampling": imu.gyro.sampling,
            "delay_ms": 1e3 * imu.gyro.delay,
        },
        "imus": len(log.imus),
        "mag": None if mag is None else _sensor(mag.field) | {"index": mag.index, "device": mag.device},
        "mags": len(log.mags),
        "attitude": None if onboard is None else {"source": onboard.source, "rate_hz": onboard.rate},
        "attitudes": sorted(log.attitudes),
        "truth": None if log.truth is None else {"source": log.truth.source, "rate_hz": log.truth.rate},
        "poses": sorted(log.poses),
        "place": part("The place", lambda: place(log), None),
        "seconds": None
        if segments is None
        else {kind: segments.seconds(kind) for kind in ("airborne", "rest", "armed")},
        "timeline": {
            "modes": part("Flight modes", lambda: _intervals(log.state.mode, log.seconds), []),
            "armed": [] if segments is None else [[s.t0, s.t1] for s in segments.of("armed")],
            "airborne": [] if segments is None else [[s.t0, s.t1] for s in segments.of("airborne")],
            "texts": [[t, level, text] for t, level, text in log.texts],
        },
        "advice": {"rest": part("Advice", lambda: log.advice("rest"), "")},
        "choices": dict(log.choices),
        **part("Parameters", lambda: describe_parameters(log), {key: {} for key in PARAMETER_KEYS}),
    }


PARAMETER_KEYS = ("params", "params_changed", "params_origin", "params_in_flight")


def describe_parameters(log: FlightLog) -> dict[str, Any]:
    """Return the parameters of the JSON: first values, those off their default, their origin, changes in flight.

    Without those at their default all the time. ``params_origin``: name -> ``airframe``, ``file`` or, for parameters
    set during the log, ``default``.
    """
    histories = parameter_histories(log)
    origins: dict[str, str] = {one.name: one.origin for one in histories if one.origin in ("airframe", "file")}
    origins |= {one.name: "default" for one in histories if one.changes and one.origin == "default"}
    later = {one.name: [[t, value] for t, value in one.changes] for one in histories if one.changes}
    return dict(zip(PARAMETER_KEYS, (_params(log), _changed(log), origins, later), strict=True))


def _date(log: FlightLog) -> str | None:
    """Return the start of the log by GNSS time."""
    if log.utc_offset is None:
        return None
    return datetime.fromtimestamp(log.utc_offset, UTC).isoformat(timespec="seconds")


def _params(log: FlightLog) -> dict[str, float]:
    """Return the first value of each parameter that differs from its logged default, or that was set later.

    All parameters where no defaults are logged. ULog logs no default for a parameter at its default.
    """
    found = {name: value for name in sorted(log.parameters.lines) if (value := log.param(name)) is not None}
    if not log.parameters.defaults:
        return found
    usual = {
        name: value for name, value in found.items() if name not in log.parameters.filled
    } | log.parameters.defaults
    lines = log.parameters.lines
    return {name: v for name, v in found.items() if v != usual.get(name) or len(lines[name].value) > 1}


def place(log: FlightLog) -> dict[str, float] | None:
    """Return the median position of the first receiver with a fix, else None.

    The earth's rotation rate of heading at this latitude is included.
    """
    import numpy as np

    for receiver in log.gnss:
        good = (receiver.fix >= 3) & np.isfinite(receiver.lat) & np.isfinite(receiver.lon)
        good &= (receiver.lat != 0) | (receiver.lon != 0)
        if good.any():
            alt = receiver.alt[good]
            alt = alt[np.isfinite(alt)]
            latitude = float(median(receiver.lat[good]))
            return {
                "lat": latitude,
                "lon": earth.middle_longitude(receiver.lon[good]),
                "alt_m": float(median(alt)) if len(alt) else 0.0,
                "earth_turn_deg_per_min": earth.heading_turn(latitude),
            }
    return None


def _sensor(stream: Stream) -> dict[str, Any]:
    return {"source": stream.source, "rate_hz": stream.rate}


def _intervals(line: TimeLine | None, end: float) -> list[list[Any]]:
    """Return [[t0, t1, value], ...], with equal neighbours merged."""
    out: list[list[Any]] = []
    if line is None:
        return out
    for t, value in zip(line.t.tolist(), line.value, strict=True):
        if out and out[-1][2] == value:
            continue
        if out:
            out[-1][1] = t
        out.append([t, max(end, t), value])
    return [[a, b, str(v)] for a, b, v in out if b > a]


def _changed(log: FlightLog) -> dict[str, list[Any]]:
    """Return parameters that differ from their logged default: name -> [value, default]."""
    out = {}
    for name, line in sorted(log.parameters.lines.items()):
        default = log.parameters.defaults.get(name)
        value = line.value[-1] if line.value else None
        if default is not None and value is not None and value != default:
            out[name] = [value, default]
    return out
