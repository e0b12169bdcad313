"""Is there memory for a log of hours? Said before the work begins, instead of being ended in its middle."""

from __future__ import annotations

from attlog.errors import TooLittleMemory
from attlog.formats import Messages
from attlog.free_memory import free_bytes

BYTES_PER_SAMPLE = 330
"""What an analysis takes for each inertial sample, attitude, reference and what is made of them included: measured on
logs of 2 to 18 million samples (``docs/formats.md``)."""
SMALL = 500_000
"""Samples that every machine has room for."""
INERTIAL = ("sensor_combined", "IMU", "RAW_IMU", "SCALED_IMU", "HIGHRES_IMU")
"""Messages whose records become the samples of a replay, by firmware; where there are none, nothing is foretold."""


def check(messages: Messages) -> None:
    """TooLittleMemory if the machine cannot hold what is made of a log's inertial samples."""
    samples = max((len(table) for (name, _), table in messages.items() if name in INERTIAL), default=0)
    if samples <= SMALL:
        return
    needed, free = BYTES_PER_SAMPLE * samples, free_bytes()
    if free is not None and needed > free:
        raise TooLittleMemory(
            f"{messages.path}: needs some {needed / 1e9:.1f} GB of memory for its {samples:,} inertial samples, and "
            f"{free / 1e9:.1f} GB are free; close other programs, choose one power-up of several (--boot), or take a "
            "machine with more memory"
        )
