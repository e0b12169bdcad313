"""Whose clock an attitude is compared on, and attitudes made fit for comparison."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.flight.model import Attitude, FlightLog
from attlog.reference.model import AlignmentStep
from attlog.segments import gaps

Array = NDArray[np.float64]
Clock = Literal["sample", "publication"]


def times(attitude: Attitude, clock: Clock) -> Array:
    """The times (n,) of an attitude: of measurement where the log tells them and ``clock`` is sample."""
    return attitude.t if clock == "publication" or attitude.t_sample is None else attitude.t_sample


def usable(attitude: Attitude, clock: Clock) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Times (m,), unit quaternions (m, 4) and the mask (n,) of the samples they come from.

    Left out are samples without a finite attitude and those whose time does not rise.
    """
    t = times(attitude, clock)
    norm = rotation.length(attitude.q)
    good = np.isfinite(t) & np.isfinite(norm) & (norm > 0.5) & (norm < 2.0)
    highest = np.maximum.accumulate(np.where(good, t, -np.inf))
    good[1:] &= highest[1:] > highest[:-1]
    t, q = gaps.only(good, t, attitude.q)
    return t, q if attitude.normal else rotation.normalize(q), good


def step(log: FlightLog, attitude: Attitude, clock: Clock, own: bool = False) -> AlignmentStep:
    """What the clock is, and how much later than measured the attitude was published (``own``: made of the IMU)."""
    if own:
        text = "made at the IMU's stamps, without the delay of its filter"
        return AlignmentStep("clock", text, "sample", source=attitude.source, option="config: clock")
    if attitude.t_sample is None:
        text = f"{attitude.source} has one time stamp; it is taken for the time of the attitude"
        return AlignmentStep("clock", text, "stamp", source=attitude.source, option="config: clock")
    delays = attitude.t - times(attitude, "sample")
    delay = float(np.median(delays[~np.isnan(delays)])) * 1e3 if len(delays) else 0.0
    used = "the time of measurement" if clock == "sample" else "the time of publication"
    text = f"{attitude.source} is compared at {used}; it was published {delay:.1f} ms after the measurement (median)"
    return AlignmentStep("clock", text, delay, "ms", attitude.source, clock == "sample", "config: clock")
