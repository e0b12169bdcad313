"""Is there memory for a log of hours? Said before the work begins, instead of being ended in its middle."""

from __future__ import annotations

from pathlib import Path

from attlog.base.errors import TooLittleMemory
from attlog.base.memory import free_bytes
from attlog.flight.model import FlightLog
from attlog.formats import Messages

FLIGHT, INFO, ANALYSIS = 170, 200, 550
"""Bytes for each inertial sample: of the flight, attitudes and truth included; and of what ``info`` or an analysis
makes of it. Measured on logs of 2 to 18 million samples (``docs/formats.md``)."""
SMALL = 500_000
"""Samples that every machine has room for."""
INERTIAL = ("sensor_combined", "IMU", "RAW_IMU", "SCALED_IMU", "HIGHRES_IMU")
"""Messages whose records become the samples of a replay, by firmware; where there are none, nothing is foretold."""


def check(messages: Messages) -> None:
    """TooLittleMemory if the machine cannot hold what a flight keeps of a log's inertial samples."""
    _check(
        messages.path, max((len(table) for (name, _), table in messages.items() if name in INERTIAL), default=0), FLIGHT
    )


def check_rest(log: FlightLog, each: int) -> None:
    """The same for what is made of the flight, ``each`` bytes for a sample."""
    imu = log.replay_imu
    _check(log.path, 0 if imu is None else len(imu.gyro.t), each)


def _check(path: Path, samples: int, each: int) -> None:
    if samples <= SMALL:
        return
    needed, free = each * samples, free_bytes()
    if free is not None and needed > free:
        raise TooLittleMemory(
            f"{path}: needs some {needed / 1e9:.1f} GB of memory for its {samples:,} inertial samples, and "
            f"{free / 1e9:.1f} GB are free; close other programs, choose one power-up of several (--boot), or take a "
            "machine with more memory"
        )
