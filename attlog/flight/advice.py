"""What a vehicle's logging settings are asked for; each firmware answers in its own folder."""

from __future__ import annotations

import re
from typing import Literal, Protocol

What = Literal["imu", "fast_imu", "attitude", "mag", "rest"]
"""Inertial data at all, inertial data faster than now, the attitude that flew, a magnetometer, time before arming."""

REST_WANTED_S = 30


class LoggingAdvice(Protocol):
    """The logging settings of the vehicle that wrote a log."""

    def advice(self, what: What, rate: float | None = None) -> str:
        """A sentence on what would log ``what``; ``rate`` (Hz) of the records that are there, None without any.

        Never names a setting that is already made or that this version does not have.
        """
        ...


def stand_still(why: str = "", setting: str = "") -> str:
    """The advice to rest: after a ``setting`` that is missing, or because (``why``) none is."""
    how = f"let the vehicle stand still with motors off for {REST_WANTED_S} s"
    if setting:
        return f"{setting} and {how}."
    return f"{why}: {how}." if why else f"{how[0].upper()}{how[1:]}."


def version_number(version: str) -> tuple[int, int]:
    """Major and minor number in a version text, (0, 0) where it holds none."""
    match = re.search(r"(\d+)\.(\d+)", version)
    return (int(match[1]), int(match[2])) if match else (0, 0)


def bits_of(value: float | None) -> int | None:
    """A bit mask from a parameter's value (two's complement where it is negative), None where it is unknown."""
    return None if value is None or not abs(value) < 2**53 else int(value)
