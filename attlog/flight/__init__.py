"""Read a log as a flight: one clock, SI units, body axes forward-right-down, earth axes north-east-down."""

from __future__ import annotations

from copy import copy
from functools import partial
from pathlib import Path

import numpy as np

from attlog import formats
from attlog.core.brief import counted
from attlog.core.errors import LogUnusable, TooLittleMemory, UsageError
from attlog.core.limits import MAX_ATTITUDES
from attlog.core.machine import available_bytes
from attlog.flight import limits as parameter_limits
from attlog.flight import parameters as parameter_file
from attlog.flight.frozen import drop_stuck_attitudes
from attlog.flight.model import FlightLog, Problem, Severity, guarded_part
from attlog.flight.recalibration import recorrect
from attlog.flight.timestamps import describe_other_boots, foreign_clocks, logged_seconds
from attlog.formats import Messages
from attlog.formats.table import OTHER_DIALECT

__all__ = ["FlightLog", "flight_in", "read"]


MAX_EMPTY = 5  # messages without a record, by name
# Messages with inertial data, and with the onboard attitude; their records are counted.
INERTIAL_MESSAGES = ("sensor_combined", "IMU", "GYR", "RISI", "RAW_IMU", "HIGHRES_IMU", "SCALED_IMU")
ATTITUDE_MESSAGES = ("ATT", "vehicle_attitude")
# Share of unusable bytes, and sum of dropouts in ms, above which the problem is a warning.
SERIOUS_DAMAGE_SHARE, SERIOUS_DROPOUTS_MS = 0.001, 100
# Below this size damage at the end of a file is a record cut while it was written.
MAX_CUT_BYTES = 4096
# Below this time in s a cut is a warning, because what happened may be behind it; another power-up as long is one.
MAX_SHORT_S = 10.0
# Messages on another clock that are named, and what to do.
MAX_NAMED_CLOCKS = 4
DIALECT_REMEDY = "Check the MAVLink dialect of its sender; if it is right, take the vehicle's own log."
CLOCK_REMEDY = "Compare nothing in it with the rest; have its writer use the autopilot's time since boot."
# Bytes per inertial sample of the flight (with attitudes and truth), and of its analysis or ``info``. Measured on logs
# of 2 to 18 million samples (``docs/formats.md``).
FLIGHT_BYTES, ANALYSIS_BYTES = 170, 550
# Up to this number of samples memory is not checked.
ALWAYS_ALLOWED_SAMPLES = 500_000


def check_flight_memory(messages: Messages) -> None:
    """Raise TooLittleMemory if the machine cannot hold the flight of a log's inertial samples."""
    counts = [len(table) for (name, _), table in messages.items() if name in INERTIAL_MESSAGES]
    _check_memory(messages.path, max(counts, default=0), FLIGHT_BYTES)


def check_analysis_memory(log: FlightLog, each: int) -> None:
    """Raise TooLittleMemory if the machine cannot hold an analysis of the flight, ``each`` bytes a sample."""
    imu = log.replay_imu
    _check_memory(log.path, 0 if imu is None else len(imu.gyro.t), each)


def _check_memory(path: Path, samples: int, each: int) -> None:
    needed, free = each * samples, available_bytes()
    if samples > ALWAYS_ALLOWED_SAMPLES and free is not None and needed > free:
        raise TooLittleMemory(
            f"{path}: needs some {needed / 1e9:.1f} GB of memory for its {samples:,} inertial samples, and "
            f"{free / 1e9:.1f} GB are free; close other programs, choose one power-up of several (--boot), or take a "
            "machine with more memory"
        )


def read(
    path: str | Path,
    *,
    imu: int | None = None,
    mag: int | str | None = None,
    boot: int | None = None,
    system: int | None = None,
    params: str | Path | None = None,
    key: str | Path | None = None,
) -> FlightLog:
    """Read a flight log on one clock in s, in SI units, body FRD and earth NED.

    ``path``: a ULog, DataFlash (``.bin``, ``.log``), tlog or ROS 2 bag, also gzipped. ``imu`` and ``mag``: an instance
    in place of the one that flew (``mag="none"``: no magnetometer). ``boot``: one of several power-ups in a file.
    ``system``: one of several vehicles in a tlog. ``params``: a ground station's parameter file. It supplies parameters
    that the log lacks, all parameters of filters named after a firmware's, and the calibration of compasses and
    accelerometers. ``key``: PEM file of the vehicle's private key for an encrypted ULog (default: the environment
    variable ATTLOG_KEY).

    NotALog or LogUnusable if the file holds no flight, LogUnreadable if it cannot be opened, TooLittleMemory if the
    machine cannot hold it, UsageError for an invalid parameter file or key. Without a usable IMU ``imu`` is None and
    ``problems`` gives the reason.
    """
    return flight_in(formats.open(path, system, key=key), imu=imu, mag=mag, boot=boot, system=system, params=params)


def flight_in(
    messages: Messages,
    *,
    imu: int | None = None,
    mag: int | str | None = None,
    boot: int | None = None,
    system: int | None = None,
    params: str | Path | None = None,
) -> FlightLog:
    """Read a flight from opened messages; options and errors as for :func:`read`."""
    boots = max(len(messages.boots), 1)
    chosen = choose_boot(messages) if boot is None else boot
    if not 0 <= chosen < boots:
        raise UsageError(f"{messages.path}: there is no boot {boot}; the log holds boots 0 to {boots - 1}")
    part = messages.boot(chosen) if boots > 1 else messages
    part, empty = _without_empty(part)
    check_flight_memory(part)
    given = {} if params is None else parameter_file.read_parameter_file(params)
    refused = parameter_limits.drop_impossible(part)
    filled = parameter_file.add_missing(part, given)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        # damaged records hold NaN and absurd numbers, which are rejected later
        log = read_messages(part, imu, mag, system)
    limit_attitudes(log)
    drop_stuck_attitudes(log)
    log.boot, log.boots = chosen, boots
    log.problems += [*empty, *refused]
    log.parameters.given, log.parameters.filled = given, filled
    log.seconds = flight_seconds(log, part)
    log.problems += guarded_part(log, "The clocks of messages", partial(foreign_clock_problems, part), list)
    if params is not None:
        own = {name: v for name in log.parameters.lines if name not in filled and (v := log.param(name)) is not None}
        corrected = partial(recorrect, log, Path(params).name, given)
        applied: set[str] = guarded_part(log, "The calibration of the parameter file", corrected, set)
        log.problems += parameter_file.compare_with_log(params, given, own, applied)
    if boots > 1:
        which = f"this is number {chosen}{' (the one with most sensor records)' if boot is None else ''}"
        text = (
            f"The file holds {boots} power-ups; {which}, {log.seconds:.0f} s. {describe_other_boots(messages, chosen)}"
        )
        longest = max(logged_seconds(messages.boot(k)) for k in range(boots) if k != chosen)
        severity: Severity = "warning" if longest >= MAX_SHORT_S else "note"
        log.problems.insert(0, Problem("several_boots", severity, f"{text}. --boot chooses another.", count=boots))
    # Remarks come last, because columns are read late.
    remarks = [Problem(r.code, "warning", r.text, offset=r.offset, count=r.count) for r in messages.remarks]
    log.problems[:0] = [*damage_problems(messages, log.seconds), *dropout_problems(messages), *remarks]
    return log


def _without_empty(messages: Messages) -> tuple[Messages, list[Problem]]:
    """Return messages that hold a record, and a note on the others: nothing is wrong with them, nothing is in them."""
    names = list(dict.fromkeys(table.name for table in messages.values() if not len(table)))
    if not names:
        return messages, []
    shown = ", ".join(names[:MAX_EMPTY]) + (f" and {len(names) - MAX_EMPTY} more" if len(names) > MAX_EMPTY else "")
    text = f"Without a record: {shown}."
    part = copy(messages)
    part.tables = {key: table for key, table in messages.items() if len(table)}
    return part, [Problem("unreadable_message", "note", text, count=len(names))]


def read_messages(messages: Messages, imu: int | None, mag: int | str | None, system: int | None) -> FlightLog:
    """Read the flight in one power-up's messages by the reader of their format."""
    if messages.format == "ulog":
        from attlog.flight.px4 import reader as px4

        return px4.read(messages, imu, mag)
    if messages.format in ("dataflash", "dataflash_text"):
        from attlog.flight.ardupilot import reader as ardupilot

        return ardupilot.read(messages, imu, mag)
    if messages.format == "ros":
        from attlog.flight import ros

        return ros.read(messages, imu, mag)
    if messages.format in ("tlog", "mavlink"):
        from attlog.flight import mavlink

        return mavlink.read(messages, imu, mag, system)
    raise LogUnusable(f"{messages.path}: there is no flight reader for the format {messages.format!r}")


def limit_attitudes(log: FlightLog) -> None:
    """Limit the log to MAX_ATTITUDES: the onboard attitude and those with most records."""
    beyond = len(log.attitudes) - MAX_ATTITUDES
    if beyond <= 0:
        return
    order = sorted(log.attitudes, key=lambda name: (name != log.onboard, -len(log.attitudes[name].t)))
    kept = set(order[:MAX_ATTITUDES])
    text = f"The log holds {len(order)} attitudes; the {MAX_ATTITUDES} with most records are compared."
    log.attitudes = {name: attitude for name, attitude in log.attitudes.items() if name in kept}
    log.problems.append(Problem("log_limit", "warning", text, count=beyond))


def choose_boot(messages: Messages) -> int:
    """Return the power-up with most inertial (else attitude) records."""
    if len(messages.boots) <= 1:
        return 0
    names = INERTIAL_MESSAGES + ATTITUDE_MESSAGES
    parts = map(messages.boot, range(len(messages.boots)))
    counts = [sum(len(table) for (name, _), table in part.items() if name in names) for part in parts]
    return counts.index(max(counts))


def flight_seconds(log: FlightLog, messages: Messages) -> float:
    """Return the flight's length in s.

    By the replayed IMU, else the first IMU, else the onboard attitude, else all messages.
    """
    if log.imus:
        t = log.imus[log.imu or 0].gyro.t
    elif log.onboard is not None:
        t = log.attitudes[log.onboard].t
    else:
        return logged_seconds(messages)
    return float(t[-1] - t[0]) if len(t) else logged_seconds(messages)


def damage_problems(messages: Messages, seconds: float) -> list[Problem]:
    """Return the problem that reports damage of the file with a flight of ``seconds``, if any."""
    if not messages.damage:
        return []
    first, places, lost = messages.damage[0], messages.damage_places, messages.damage_bytes
    if places == 1 and 0 < first.length < MAX_CUT_BYTES and first.offset + first.length >= messages.size - 1:
        text = f"The last record is cut at byte {first.offset:,}, as after a power cut."
        if seconds >= MAX_SHORT_S:
            return [Problem("cut_at_end", "note", text, offset=first.offset)]
        text = f"The file is cut after {messages.size:,} bytes and {seconds:.1f} s, inside its last record."
        return [Problem("cut_at_end", "warning", text, offset=first.offset, remedy="Copy it again, or log longer.")]
    where = f"{first.lost} at byte {first.offset}"
    if places > 1:
        text = f"The file is damaged in {places} places, {counted(lost, 'byte')} are not usable; the first is {where}."
    elif first.lost.startswith(counted(lost, "byte")):
        text = f"The file is damaged in one place: {where} {'is' if lost == 1 else 'are'} not usable."
    else:
        text = f"The file is damaged in one place, {counted(lost, 'byte')} "
        text += f"{'is' if lost == 1 else 'are'} not usable: {where}."
    severity: Severity = "warning" if lost > SERIOUS_DAMAGE_SHARE * messages.size else "note"
    dialect = sum(place.length for place in messages.damage if place.lost.endswith(OTHER_DIALECT))
    remedy = DIALECT_REMEDY if dialect > 0.5 * lost else ""
    return [Problem("damage", severity, text, offset=first.offset, count=places, remedy=remedy)]


def foreign_clock_problems(messages: Messages) -> list[Problem]:
    """Return the problem that names messages on another clock than the log's, if any."""
    apart = {key: s for key, s in foreign_clocks(messages).items() if abs(s) <= parameter_limits.MAX_LOG_S}
    if not apart:
        return []
    named = [f"{name} ({s:+,.0f} s)".replace("-", "−") for (name, _), s in list(apart.items())[:MAX_NAMED_CLOCKS]]
    more = f" and {len(apart) - len(named)} more" if len(apart) > len(named) else ""
    text = f"{', '.join(named)}{more} have another clock than the records around them."
    if len(apart) == 1:
        text = f"{named[0]} has another clock than the records around it."
    return [Problem("foreign_clock", "warning", text, count=len(apart), remedy=CLOCK_REMEDY)]


def dropout_problems(messages: Messages) -> list[Problem]:
    """Return the problem that reports dropouts of the logger, if any."""
    count, total_ms = len(messages.dropouts_ms), sum(messages.dropouts_ms)
    severity: Severity = "warning" if total_ms > SERIOUS_DROPOUTS_MS else "note"
    text = f"Dropouts of the logger: {count}, {total_ms} ms in all."
    return [Problem("logger_dropouts", severity, text, count=count)] if count else []
