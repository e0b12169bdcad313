"""Parameters as time lines, with the defaults that the log states."""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Mapping, Sequence
from itertools import accumulate, chain
from pathlib import Path

import numpy as np

from attlog.core.errors import UsageError
from attlog.core.files import read_settings_bytes
from attlog.flight import limits
from attlog.flight.builder import LogBuilder
from attlog.flight.limits import broken_limits
from attlog.flight.model import FlightLog, Problem, TimeLine
from attlog.formats.table import Messages, ParamChange


def boot_values(changes: list[ParamChange]) -> dict[str, float]:
    """The first value of each parameter: what the vehicle booted with."""
    first: dict[str, float] = {}
    for change in changes:
        if not change.is_default and change.name not in first and math.isfinite(change.value):
            first[change.name] = change.value
    return first


def logged_defaults(changes: list[ParamChange]) -> dict[str, float]:
    """The last default value that the log states of each parameter."""
    return {c.name: c.value for c in changes if c.is_default and math.isfinite(c.value)}


def parameter_lines(builder: LogBuilder, changes: list[ParamChange], source: str) -> dict[str, TimeLine]:
    """Every parameter's changes on the log's clock; values from before the data hold from the first stamp known.

    Repetitions of the same value (a table written again at each arming) are one entry.
    """
    told = (c.t_us for c in changes if c.t_us is not None and builder.is_near(c.t_us))
    begin = min(told, default=builder.t0_us)
    begin = min(begin, builder.t0_us)
    lines: dict[str, tuple[list[int], list[float]]] = {}
    for change in changes:
        if change.is_default or not math.isfinite(change.value):
            continue
        t, v = lines.setdefault(change.name, ([], []))
        if change.t_us is not None and not builder.is_near(change.t_us):
            continue
        if not v or v[-1] != change.value:
            t.append(begin if change.t_us is None else change.t_us)
            v.append(change.value)
    seconds = builder.seconds(np.fromiter(chain.from_iterable(t for t, _ in lines.values()), np.int64))
    begins = accumulate((len(t) for t, _ in lines.values()), initial=0)
    return {
        name: TimeLine(seconds[a : a + len(v)], v, source)
        for a, (name, (_, v)) in zip(begins, lines.items(), strict=False)
    }


UNSET_DECLINATION_DEG = 1e-6
"""A declination of 0 is "not set", not "0 deg": on almost all of the earth 0 is wrong."""


def declination(log: FlightLog, names: Mapping[str, float]) -> tuple[float | None, str]:
    """Declination in deg and the name of the first parameter (``names``: factor to deg) that is set; None without."""
    for name, to_deg in names.items():
        value = log.param(name)
        if value is not None and UNSET_DECLINATION_DEG < abs(value * to_deg) <= 180.0:
            return float(value) * to_deg, name
    return None, ""


DECLINATION_LOOKUP = {"EKF2_DECL_TYPE": 1, "ATT_MAG_DECL_A": 1, "COMPASS_AUTODEC": 1}
"""Parameters whose lowest bit lets the autopilot look the declination up by its position."""


def looks_up_declination(log: FlightLog) -> bool:
    """Whether the autopilot takes the declination from its own map once it has a position, whatever it was told."""
    return any((value := log.param(name)) is not None and int(value) & bit for name, bit in DECLINATION_LOOKUP.items())


# Parameters from a ground station's file: they fill in what a log lacks, and filters take them before the log's.
#
# Three spellings: Mission Planner ``NAME,VALUE``, MAVProxy ``NAME VALUE`` and
# QGroundControl (tabs: vehicle, component, name, value, type). ``#`` begins a comment.

MAX_SHOWN = 6
"""So many names stand in a sentence, so many bad lines of a file are told."""


def read_parameter_file(path: str | Path) -> dict[str, float]:
    """Values by name. LogUnreadable if the file cannot be opened, UsageError with every line that is no parameter."""
    lines = read_settings_bytes(Path(path)).decode("utf-8-sig", "replace").splitlines()
    values: dict[str, float] = {}
    stands: dict[str, int] = {}
    wrong = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        name, text = (words[2], words[3]) if len(words) == 5 else (words[0], words[1]) if len(words) == 2 else ("", "")
        value = _parse_number(text)
        limits = broken_limits(name, value)
        if not name or not math.isfinite(value):
            wrong.append(f"{path}, line {number}: {line.strip()[:60]!r} is not NAME,VALUE")
        elif limits is not None:
            wrong.append(f"{path}, line {number}: {name} is {value:g}; the {limits.name} lies within {limits.limits}")
        elif values.setdefault(name, value) != value:
            wrong.append(f"{path}, line {number}: {name} is {value:g}, in line {stands[name]} it was {values[name]:g}")
        stands.setdefault(name, number)
    if wrong:
        more = [f"{path}: {len(wrong) - MAX_SHOWN} more lines like these"] if len(wrong) > MAX_SHOWN else []
        raise UsageError("\n".join([*wrong[:MAX_SHOWN], *more]))
    if not values:
        raise UsageError(f"{path}: holds no parameter")
    return values


def _parse_number(text: str) -> float:
    """A decimal or hexadecimal number, NaN if it is none."""
    try:
        return float(int(text, 16)) if text.lower().startswith("0x") else float(text)
    except (ValueError, OverflowError):
        return math.nan


def add_missing(messages: Messages, given: Mapping[str, float]) -> frozenset[str]:
    """Give a log the parameters that it does not hold itself; the names of those."""
    known = {change.name for change in messages.params}
    start = messages.boots[0].start if messages.boots else 0
    added = [ParamChange(name, value, offset=start) for name, value in given.items() if name not in known]
    messages.params[:0] = added
    return frozenset(change.name for change in added)


def compare_with_log(
    path: str | Path, given: Mapping[str, float], own: Mapping[str, float], applied: Collection[str] = ()
) -> list[Problem]:
    """What is to be said of a file beside a log with parameters of its own: what differs, and what it does not know.

    ``applied``: parameters by which sensors were corrected, which is said elsewhere.
    """
    if not own:
        return []
    name = Path(path).name
    found = []
    differ = [n for n, v in given.items() if n in own and not math.isclose(v, own[n], rel_tol=1e-6, abs_tol=1e-9)]
    other = [n for n in differ if n not in applied]
    if other:
        changes = _list_names([f"{n} {own[n]:g} -> {given[n]:g}" for n in other])
        text = f"{name} differs from the log in {changes}. Filters with parameters of the firmware take the file's, "
        text += "everything else the log's" + (", but for the sensors named as corrected." if applied else ".")
        found.append(Problem("params_differ", "note", text))
    unknown = [n for n in given if n not in own]
    if unknown:
        near = {n: difflib.get_close_matches(n, own, n=1, cutoff=0.8) for n in unknown[:MAX_SHOWN]}
        names = _list_names([n + (f" (did you mean {near[n][0]}?)" if near.get(n) else "") for n in unknown])
        text = f"{name} names parameters that the log does not hold: {names}. Typing errors, or another firmware."
        # Where most names are new the log's own table is the one with holes.
        found.append(Problem("params_unknown", "warning" if 2 * len(unknown) <= len(given) else "note", text))
    return found


def _list_names(items: list[str]) -> str:
    return ", ".join(items[:MAX_SHOWN]) + (f" and {len(items) - MAX_SHOWN} more" if len(items) > MAX_SHOWN else "")


# A file of parameters that a ground station loads: Mission Planner's and MAVProxy's form, or QGroundControl's.
#
# Comments stand in lines of their own: Mission Planner skips every line that holds more than a name and a value. Both
# take values as decimals. QGroundControl wants the vehicle's id, its component and the type of each value.

LEARNED_OFFSETS_NOTE = "PX4 may have moved compass offsets at disarming: old values are those that flew."
INT32, FLOAT = 6, 9
"""MAV_PARAM_TYPE_INT32 and MAV_PARAM_TYPE_REAL32."""
AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
COMPASS_ORDER_PREFIX = "COMPASS_PRIO"
"""Parameters of this name swap the slots of compasses at the next boot."""
COMPASS_SLOT_PREFIXES = ("COMPASS_OFS", "COMPASS_MOT", "COMPASS_DIA", "COMPASS_ODI", "COMPASS_SCALE")


def parameter_file_text(
    firmware: str, values: Mapping[str, float], head: Sequence[str], beside: Mapping[str, str], vehicle: int = 1
) -> str:
    """The file's text: ``head`` as comments, then the parameters ``values``, each with what ``beside`` says above it.

    ``firmware``: PX4 or ArduPilot; ``vehicle``: its MAVLink id. Where the file holds calibrations of compasses, their
    order is left to a file of its own: after it all slots are others'.
    """
    calibrates = any(name.startswith(COMPASS_SLOT_PREFIXES) for name in values)
    lines = [f"# {line}" for line in head]
    if firmware == "PX4":
        lines += [f"# {LEARNED_OFFSETS_NOTE}", "# Vehicle-Id\tComponent-Id\tName\tValue\tType"]
    for name, value in values.items():
        if calibrates and name.startswith(COMPASS_ORDER_PREFIX):
            lines.append(f"# left out: {name} {value:.0f} swaps the compasses at a boot. Set it alone, reboot, fly.")
            continue
        lines += [f"# {beside[name]}"] if beside.get(name) else []
        whole = limits.is_integer(name)
        number = f"{value:.0f}" if whole else f"{value:.9g}"
        if firmware == "PX4":
            lines.append(f"{vehicle}\t{AUTOPILOT}\t{name}\t{number}\t{INT32 if whole else FLOAT}")
        else:
            lines.append(f"{name},{number}")
    return "\n".join(lines) + "\n"


# Parameters of the vehicle: their history, files of them, their limits.
