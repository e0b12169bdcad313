"""GPS time as Unix time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

GPS_EPOCH_S = 315_964_800
"""1980-01-06 00:00 UTC as Unix time."""
LEAP_SECONDS = ((1_230_768_000, 15), (1_341_100_800, 16), (1_435_708_800, 17), (1_483_228_800, 18))
"""(Unix time of the start, GPS minus UTC in s), IERS Bulletin C; none was added since 2017."""


def gps_time_us(week: NDArray[np.int64], milliseconds: NDArray[np.int64]) -> NDArray[np.int64]:
    """Unix time in us of GPS week and milliseconds of the week; 0 where the week is unset or impossible."""
    known = (week > 0) & (week < 5000) & (milliseconds >= 0) & (milliseconds < 604_800_000)
    gps_us = (GPS_EPOCH_S + np.where(known, week, 0) * 604_800) * 1_000_000 + np.where(known, milliseconds, 0) * 1000
    leap = np.full(len(week), LEAP_SECONDS[0][1])
    for start, seconds in LEAP_SECONDS:  # in the middle of a GPS week, as on 2015-07-01
        leap = np.where(gps_us >= (start + seconds) * 1_000_000, seconds, leap)
    return np.where(known, gps_us - leap * 1_000_000, 0)
