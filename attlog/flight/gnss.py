"""Build a GNSS receiver on the log's clock, without impossible values."""

from __future__ import annotations

import time
from collections.abc import Mapping
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import median
from attlog.core.timestamps import Stamps
from attlog.flight import limits
from attlog.flight.builder import LogBuilder, finite_within
from attlog.flight.model import Array, Gnss, Reception
from attlog.formats.table import FieldError

# Least fix type with a position.
MIN_FIX_TYPE = 2
NOT_ON_EARTH = (
    f"whose place is none ({limits.LATITUDE.limits}, {limits.LONGITUDE.limits}) "
    "or over 100 km from those before and behind"
)
# Distance on the unit sphere (100 km) from the median of so many records around one, beyond which it is damage. Places
# that stay away are spoofing, which is reported.
MAX_AWAY, PLACES_AROUND = 100.0 / 6371.0, 7
# Days by which a date may lie ahead of this computer's clock, the least time of that clock (the day of a release), and
# the period of the GPS week number.
MAX_AHEAD_S, RELEASED_S, WEEK_TURN_S = 2 * 86_400.0, 1_795_000_000.0, 1024 * 604_800.0
# Longest time from reception of a record to its logging.
MAX_WRITE_DELAY_US = 1e6


def build_gnss(
    builder: LogBuilder,
    unit: int,
    t_us: Stamps,
    source: str,
    *,
    place: Array,
    velocity: Array,
    fix: NDArray[np.int64],
    accuracy: tuple[Array, Array, Array],
    yaw: Array | None = None,
    utc_us: NDArray[np.int64] | None = None,
    repeats: bool = False,
    received_us: Array | None = None,
    reception: Mapping[str, Array] | None = None,
) -> Gnss | None:
    """Build the receiver ``unit`` from its records, None if no record is left.

    ``place`` (n, 3): latitude and longitude in deg, height in m. ``velocity`` (n, 3): m/s north-east-down.
    ``accuracy``: horizontal, vertical (m), speed (m/s), each (n,). ``yaw`` (n,): rad. ``utc_us`` (n,): Unix time.
    ``repeats``: records are repeated until the next fix, so repeated times are not reported. ``received_us`` (n,):
    arrival in us, NaN where unknown. ``reception``: columns (n,) of :class:`Reception`. ValueError if a column is no
    number per record, as after damage of its definition.
    """
    if not all(len(t_us) == len(x) and x.ndim == 1 for x in (fix, *accuracy, yaw, utc_us) if x is not None):
        raise FieldError(f"{source} does not hold one value per record")
    own = builder.quiet()
    on_earth = finite_within(place[:, :1], limits.LATITUDE.high) & finite_within(place[:, 1:2], limits.LONGITUDE.high)
    on_earth &= ~_away_and_back(place, on_earth & (fix >= MIN_FIX_TYPE))
    index = own.select_records(t_us, source, on_earth, wrong=NOT_ON_EARTH, fastest_hz=limits.AIDING_HZ)
    if repeats:
        builder.add_value_problems(own)
    else:
        builder.problems.extend(own.problems)
    if len(index) == 0:
        return None
    place, velocity, fix = place[index], velocity[index], fix[index]
    fixed = fix >= MIN_FIX_TYPE
    place[~fixed], velocity[~fixed] = np.nan, np.nan
    place[:, 2] = builder.within(place[:, 2], limits.HEIGHT, source)
    velocity = builder.within(velocity, limits.SPEED, source)
    quantities = (limits.PLACE_ACCURACY, limits.PLACE_ACCURACY, limits.SPEED_ACCURACY)
    # Without a fix, drivers log their largest number as accuracy.
    unknown = [~fixed & quantity.outside(x[index]) for x, quantity in zip(accuracy, quantities, strict=True)]
    h_acc, v_acc, s_acc = (
        builder.within(np.where(hidden, np.nan, x[index]), quantity, source)
        for x, quantity, hidden in zip(accuracy, quantities, unknown, strict=True)
    )
    if yaw is not None:
        yaw = builder.within(yaw[index], limits.GNSS_YAW, source)
        yaw = yaw if np.isfinite(yaw).any() and yaw.any() else None
    if utc_us is not None:
        utc_us = _valid_dates(builder, utc_us[index], fix, source)
    received = _reception_times(builder, t_us[index], None if received_us is None else received_us[index])
    signals = None if reception is None else _reception({name: x[index] for name, x in reception.items()})
    lat, lon, alt = place[:, 0], place[:, 1], place[:, 2]
    t = builder.seconds(t_us[index])
    return Gnss(
        unit, t, source, lat, lon, alt, velocity, h_acc, v_acc, s_acc, fix, yaw, utc_us, received, signals
    )  # fmt: skip


def _away_and_back(place: Array, fixed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mark the ``fixed`` places (n, 3) in deg that are far from those before and behind."""
    away, k = np.zeros(len(place), bool), np.flatnonzero(fixed)
    if len(k) < PLACES_AROUND:
        return away
    lat, lon = np.radians(place[k, 0]), np.radians(place[k, 1])
    on_sphere = np.column_stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    padded = np.pad(on_sphere, ((PLACES_AROUND // 2, PLACES_AROUND // 2), (0, 0)), mode="reflect")
    usual = median(np.lib.stride_tricks.sliding_window_view(padded, PLACES_AROUND, axis=0), axis=2)
    away[k] = np.linalg.norm(on_sphere - usual, axis=1) > MAX_AWAY
    return away


def utc_offset(builder: LogBuilder) -> float | None:
    """Return Unix time minus log time in s by GNSS dates with a fix, None without dates."""
    for receiver in builder.log.gnss:
        if receiver.utc_us is None:
            continue
        good = (receiver.utc_us > 0) & (receiver.fix >= MIN_FIX_TYPE)
        if good.any():
            return float(median(receiver.utc_us[good] * 1e-6 - receiver.t[good]))
    return None


def _reception_times(builder: LogBuilder, t_us: Stamps, received_us: Array | None) -> Array | None:
    """Return arrival times (n,) in s, the stamp where unknown; None if all are unknown."""
    if received_us is None or received_us.shape != t_us.shape:
        return None
    since = t_us - received_us
    known = (since >= 0.0) & (since < MAX_WRITE_DELAY_US)
    if not known.any():
        return None
    return builder.seconds(t_us) - 1e-6 * np.where(known, since, 0.0)


def _reception(columns: Mapping[str, Array]) -> Reception | None:
    """Return the signal quality with NaN for impossible values, None without any value."""
    quantities = {"satellites": limits.SATELLITES, "hdop": limits.HDOP}
    unknown = np.full(len(next(iter(columns.values()))), np.nan)
    found = {}
    for name in Reception.__slots__:
        x = columns.get(name, unknown).astype(np.float64)
        x = x if x.shape == unknown.shape else unknown  # damaged definition
        found[name] = np.where(quantities[name].outside(x), np.nan, x) if name in quantities else x
    return Reception(**found) if any(np.isfinite(x).any() for x in found.values()) else None


def _valid_dates(
    builder: LogBuilder, utc_us: NDArray[np.int64], fix: NDArray[np.int64], source: str
) -> NDArray[np.int64] | None:
    """Set impossible Unix times to 0 and report those with a 3D fix; None if no date is left."""
    date = limits.UTC_US
    wrong = date.outside(utc_us.astype(np.float64)) & (utc_us != 0)
    count = int(np.count_nonzero(wrong & (fix > MIN_FIX_TYPE)))
    if count:
        text = f"{source}: left out {count:,} of {len(utc_us):,} dates, which are none of a flight ({date.why})."
        builder.problem("values_out_of_range", "warning", text, count=count)
    utc_us = np.where(wrong, 0, utc_us)
    ahead = utc_us > 1e6 * (max(time.time(), RELEASED_S) + MAX_AHEAD_S)
    if (ahead & (fix > MIN_FIX_TYPE)).any():
        s = 1e-6 * float(median(utc_us[ahead]))
        logged, likely = (datetime.fromtimestamp(x, UTC).date().isoformat() for x in (s, s - WEEK_TURN_S))
        text = f"{source}: its date, {logged}, lies in the future and is not used; 1,024 weeks earlier it is {likely}."
        count, remedy = int(np.count_nonzero(ahead)), "Update the receiver's firmware: its GPS week number is wrong."
        builder.problem("false_date", "warning", text, count=count, remedy=remedy)
    utc_us = np.where(ahead, 0, utc_us)
    return utc_us if utc_us.any() else None
