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
    if not flight.scenario.logging.truth:
        messages = {key: x for key, x in found.messages.items() if not is_truth(key[0])}
        layouts = {name: x for name, x in found.layouts.items() if not is_truth(name)}
        found = replace(found, messages=messages, layouts=layouts)
    timed = parameter_changes(flight, name, found)
    if timed:
        found = replace(found, params=[*found.params, *timed])
    if not params:
        return found
    own = {p.name: p for p in found.params if not p.is_default and p.t_us is None}
    whole = {name for name, p in own.items() if isinstance(p.value, int)}
    for known, value in params.items():
        own[known] = ParamChange(known, value if known in whole or known not in own else float(value))
    return replace(found, params=[*own.values(), *(p for p in found.params if p.is_default), *timed])


def parameter_changes(flight: Flight, name: str, made: Recording) -> list[ParamChange]:
    """Return the scenario's parameters set in flight as the log ``name`` of a firmware holds them."""
    firmware = {"ulog": "px4", "dataflash": "ardupilot", "tlog": "ardupilot"}.get(name)
    kinds = {p.name: type(p.value) for p in made.params}
    return [
        ParamChange(c.name, kinds.get(c.name, float)(c.value), (made.start_us or 0) + round(c.t * 1e6))
        for c in flight.scenario.parameter
        if c.firmware == firmware
    ]


def is_truth(name: str) -> bool:
    """Return whether a message holds the simulator's truth."""
    return name in ("SIM", "SIM2", "SIM_STATE") or name.endswith("_groundtruth")


def write(path: Path | str, flight: Flight, params: Mapping[str, float | int] | None = None) -> None:
    """Write the flight in the format of the path's suffix; ``params`` as in :func:`recording`.

    UsageError for another suffix, OutputError where the file cannot be written.
    """
    entry = formats.format_for(path)
    entry.write(Path(path), recording(flight, entry.name, params))
