"""A flight as the log that an autopilot would have written: one module per format, ``recording(flight)``."""

from __future__ import annotations

from pathlib import Path

from attlog import formats
from attlog.formats import Recording
from attlog.simulate.flight import Flight


def recording(flight: Flight, name: str) -> Recording:
    """The flight as the messages of a format (``ulog``, ``dataflash``, ``tlog``). KeyError for another one."""
    from attlog.simulate.logs import ardupilot, mavlink, px4

    made = {"ulog": px4.recording, "dataflash": ardupilot.recording, "tlog": mavlink.recording}
    return made[name](flight)


def write(path: Path | str, flight: Flight) -> None:
    """Write the flight in the format of the path's suffix. UsageError for another suffix, OutputError if it cannot."""
    entry = formats.format_for(path)
    entry.write(Path(path), recording(flight, entry.name))
