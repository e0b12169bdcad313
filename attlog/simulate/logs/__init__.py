"""A flight as the log that an autopilot would have written, one file per format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from attlog import formats
from attlog.formats import ParamChange, Recording
from attlog.simulate.flight import Flight


def recording(flight: Flight, name: str, params: Mapping[str, float | int] | None = None) -> Recording:
    """Return the flight as messages of a format (``ulog``, ``dataflash``, ``tlog``, ``ros``).

    ``params``: parameters in the log instead of, or beside, those of the flight. KeyError for another format.
    """
    from attlog.simulate.logs import ardupilot, mavlink, px4

    made = {
        "ulog": px4.ulog_recording,
        "dataflash": ardupilot.dataflash_recording,
        "tlog": mavlink.telemetry_recording,
        "ros": px4.bag_recording,
    }
    found = made[name](flight)
    if not params:
        return found
    own = {p.name: p for p in found.params if not p.is_default}
    whole = {name for name, p in own.items() if isinstance(p.value, int)}
    for known, value in params.items():
        own[known] = ParamChange(known, value if known in whole or known not in own else float(value))
    return replace(found, params=[*own.values(), *(p for p in found.params if p.is_default)])


def write(path: Path | str, flight: Flight, params: Mapping[str, float | int] | None = None) -> None:
    """Write the flight in the format of the path's suffix; ``params`` as in :func:`recording`.

    UsageError for another suffix, OutputError where the file cannot be written.
    """
    entry = formats.format_for(path)
    entry.write(Path(path), recording(flight, entry.name, params))
