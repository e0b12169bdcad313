"""Where and when: place, date, wind, and what disturbs the magnetic field there."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

from pydantic import BeforeValidator, Field
from pydantic.dataclasses import dataclass

from attlog.simulate.sensors.settings import STRICT, ZERO, NotNegative, Positive, Three


def _date(written: object) -> object:
    """The time that a text tells; a day alone begins at midnight."""
    if not isinstance(written, str):
        return written
    try:
        return datetime.fromisoformat(written)
    except ValueError:
        raise ValueError("must be a date, 2024-03-01 or 2024-03-01T12:00:00Z") from None


@dataclass(frozen=True, config=STRICT)
class TakeoffPlace:
    """The take-off place (earth axes begin there) and the time of the start; ``heading_deg`` of the vehicle at
    first."""

    lat_deg: Annotated[float, Field(ge=-89.9, le=89.9)] = 47.397
    lon_deg: Annotated[float, Field(ge=-180, le=180)] = 8.545
    alt_m: Annotated[float, Field(ge=-500, le=6000)] = 488.0
    heading_deg: float = 0.0
    date: Annotated[datetime, BeforeValidator(_date)] = datetime(2025, 6, 1, 10, 0, tzinfo=UTC)

    @property
    def unix_time(self) -> float:
        """The start as Unix time [s]; a date without a zone is UTC."""
        date = self.date if self.date.tzinfo else self.date.replace(tzinfo=UTC)
        return date.timestamp()


@dataclass(frozen=True, config=STRICT)
class Gust:
    """A single gust: from ``t`` on for ``seconds`` the wind grows to ``ned_m_s`` and falls again (1 - cos)."""

    t: NotNegative
    seconds: Positive
    ned_m_s: Three


@dataclass(frozen=True, config=STRICT)
class Wind:
    """``mean_ned_m_s``: where the air moves to, from 6 m above the ground on; less below. ``turbulence_m_s``:
    standard deviation per axis of a Dryden-like disturbance of length ``length_m``, which passes at the mean wind's
    speed, at least ``speed_m_s``."""

    mean_ned_m_s: Three = ZERO
    turbulence_m_s: NotNegative = 0.3
    length_m: Positive = 15.0
    speed_m_s: Positive = 4.0
    gust: tuple[Gust, ...] = ()


@dataclass(frozen=True, config=STRICT)
class Anomaly:
    """Iron at a place: adds ``field_ned_ut`` at ``ned_m``, falling off like a Gauss bell of width ``radius_m``."""

    ned_m: Three
    field_ned_ut: Three
    radius_m: Positive = 3.0
