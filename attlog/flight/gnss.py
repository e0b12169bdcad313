"""One GNSS receiver: its records on the log's clock, without what no receiver can measure."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from attlog.core.timestamps import Stamps
from attlog.flight import limits as physics
from attlog.flight.builder import VALUE_CODES, LogBuilder, on_earth
from attlog.flight.limits import Quantity
from attlog.flight.model import Array, Gnss, Reception

MIN_FIX_TYPE = 2
"""Fix types from here on tell a place."""
NOT_ON_EARTH = f"whose place is none ({physics.LATITUDE.limits}, {physics.LONGITUDE.limits})"


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
    """The receiver ``unit``; None if no record is left.

    ``place`` (n, 3): latitude and longitude in deg, height in m. ``velocity`` (n, 3) m/s NED.
    ``accuracy``: horizontal and vertical in m, of the speed in m/s, each (n,). ``yaw`` (n,) rad,
    ``utc_us`` (n,) Unix time. Where records tell of no fix, place and velocity become NaN
    and nothing in them counts as wrong. ``repeats``: the last record is sent again until there
    is a new one, with its stamp or none, so that times tell no fault. ``received_us`` (n,) us is when the autopilot
    took a record to have come, NaN where unknown; ``reception``: columns (n,) of :class:`Reception`.
    ValueError where the log's definitions make arrays of single numbers.
    """
    if not all(len(t_us) == len(x) and x.ndim == 1 for x in (fix, *accuracy, yaw, utc_us) if x is not None):
        raise ValueError(f"{source} does not hold one value per record")
    own = LogBuilder(builder.messages, t0_us=builder.t0_us)
    index = own.keep(t_us, source, on_earth(place), wrong=NOT_ON_EARTH, fastest_hz=physics.AIDING_HZ)
    builder.problems += [p for p in own.problems if not repeats or p.code in VALUE_CODES]
    if len(index) == 0:
        return None
    place, velocity, fix = place[index], velocity[index], fix[index]
    fixed = fix >= MIN_FIX_TYPE
    place[~fixed], velocity[~fixed] = np.nan, np.nan
    place[:, 2] = builder.within(place[:, 2], physics.HEIGHT, source)
    velocity = builder.within(velocity, physics.SPEED, source)
    quantities = (physics.PLACE_ACCURACY, physics.PLACE_ACCURACY, physics.SPEED_ACCURACY)
    h_acc, v_acc, s_acc = (
        _fixed_accuracy(builder, x[index], fixed, quantity, source)
        for x, quantity in zip(accuracy, quantities, strict=True)
    )
    if yaw is not None:
        yaw = builder.within(yaw[index], physics.GNSS_YAW, source)
        yaw = yaw if np.isfinite(yaw).any() and yaw.any() else None
    if utc_us is not None:
        utc_us = _valid_dates(builder, utc_us[index], fix, source)
    return Gnss(
        unit,
        builder.seconds(t_us[index]),
        source,
        place[:, 0],
        place[:, 1],
        place[:, 2],
        velocity,
        h_acc,
        v_acc,
        s_acc,
        fix,
        yaw,
        utc_us,
        _reception_times(builder, t_us[index], None if received_us is None else received_us[index]),
        None if reception is None else _reception({name: x[index] for name, x in reception.items()}),
    )


MAX_WRITE_DELAY_US = 1e6
"""A record is not written later than this after it came."""


def _reception_times(builder: LogBuilder, t_us: Stamps, received_us: Array | None) -> Array | None:
    """When each record came (n,) s, its own stamp where that is not known; None where none is."""
    if received_us is None or received_us.shape != t_us.shape:
        return None
    since = t_us - received_us
    known = (since >= 0.0) & (since < MAX_WRITE_DELAY_US)
    if not known.any():
        return None
    return builder.seconds(t_us) - 1e-6 * np.where(known, since, 0.0)


def _reception(told: Mapping[str, Array]) -> Reception | None:
    """What a receiver tells of its signals, NaN where it tells nothing or what cannot be; None if it never does."""
    limits = {"satellites": physics.SATELLITES, "hdop": physics.HDOP}
    unknown = np.full(len(next(iter(told.values()))), np.nan)
    found = {}
    for name in Reception.__slots__:
        x = told.get(name, unknown).astype(np.float64)
        x = x if x.shape == unknown.shape else unknown  # a damaged definition makes arrays of single numbers
        found[name] = np.where(limits[name].outside(x), np.nan, x) if name in limits else x
    return Reception(**found) if any(np.isfinite(x).any() for x in found.values()) else None


def _fixed_accuracy(builder: LogBuilder, x: Array, fixed: NDArray[np.bool_], quantity: Quantity, source: str) -> Array:
    """An accuracy without impossible values. Those without a fix do not count: drivers write their largest number."""
    x = np.where(~fixed & quantity.outside(x), np.nan, x)
    return builder.within(x, quantity, source)


def _valid_dates(
    builder: LogBuilder, utc_us: NDArray[np.int64], fix: NDArray[np.int64], source: str
) -> NDArray[np.int64] | None:
    """Unix times with 0 where they are none; None if no record tells one. They count as wrong with a fix in space."""
    date = physics.UTC_US
    wrong = date.outside(utc_us.astype(np.float64)) & (utc_us != 0)
    count = int(np.count_nonzero(wrong & (fix > MIN_FIX_TYPE)))
    if count:
        text = f"{source}: left out {count:,} of {len(utc_us):,} dates, which are none of a flight ({date.why})."
        builder.problem("values_out_of_range", "warning", text, count=count)
    utc_us = np.where(wrong, 0, utc_us)
    return utc_us if utc_us.any() else None
