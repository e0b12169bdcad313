"""Read parameters: those of a log over time, and files of ground stations.

Three spellings of files: Mission Planner ``NAME,VALUE``, MAVProxy ``NAME VALUE`` and QGroundControl (tabs: vehicle,
component, name, value, type). ``#`` begins a comment.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import accumulate, chain
from pathlib import Path
from typing import Literal

import numpy as np

from attlog.core.errors import UsageError
from attlog.core.files import read_settings_bytes
from attlog.flight.builder import LogBuilder
from attlog.flight.limits import broken_limits
from attlog.flight.model import FlightLog, Problem, TimeLine
from attlog.formats.table import Messages, ParamChange

# A declination up to this size counts as not set.
UNSET_DECLINATION_DEG = 1e-6
# Parameters with the bit that enables the autopilot's own declination map.
DECLINATION_LOOKUP = {"EKF2_DECL_TYPE": 1, "ATT_MAG_DECL_A": 1, "COMPASS_AUTODEC": 1}
# Difference below which a parameter sent again by telemetry is the same value, rounded: ground stations write and read
# back six decimals, or six significant digits (`%f`, `%g`).
ROUNDED_DECIMALS, ROUNDED_SHARE = 5e-7, 5e-6
# Most names in a sentence, and most invalid lines of a file in a message.
MAX_SHOWN = 6
# Names at least this similar are suggested (difflib's ratio).
MIN_SIMILARITY = 0.8


# --- parameters of a log ----------------------------------------------------------------------------------------


def boot_values(changes: list[ParamChange]) -> dict[str, float]:
    """Return the first logged value of each parameter."""
    first: dict[str, float] = {}
    for change in changes:
        if not change.is_default and change.name not in first and math.isfinite(change.value):
            first[change.name] = change.value
    return first


def parameter_lines(builder: LogBuilder, source: str) -> dict[str, TimeLine]:
    """Return the changes of every parameter on the log's clock.

    Values without a time apply from the first stamp on. Repeated equal values (a table written at each arming), in
    telemetry also rounded ones, are merged.
    """
    changes = builder.messages.params
    rounds = builder.messages.format in ("tlog", "mavlink")
    near = (c.t_us for c in changes if c.t_us is not None and builder.is_near(c.t_us))
    begin = min(min(near, default=builder.t0_us), builder.t0_us)
    lines: dict[str, tuple[list[int], list[float]]] = {}
    for change in changes:
        if change.is_default or not math.isfinite(change.value):
            continue
        t, v = lines.setdefault(change.name, ([], []))
        if change.t_us is not None and not builder.is_near(change.t_us):
            continue
        if not v or not (v[-1] == change.value or (rounds and _is_rounding(v[-1], change.value))):
            t.append(begin if change.t_us is None else change.t_us)
            v.append(change.value)
    seconds = builder.seconds(np.fromiter(chain.from_iterable(t for t, _ in lines.values()), np.int64))
    begins = accumulate((len(t) for t, _ in lines.values()), initial=0)
    return {
        name: TimeLine(seconds[a : a + len(v)], v, source)
        for a, (name, (_, v)) in zip(begins, lines.items(), strict=False)
    }


def _is_rounding(a: float, b: float) -> bool:
    """Return whether two values differ by no more than a ground station's rounding."""
    whole = float(a).is_integer() and float(b).is_integer()
    return (
        not whole and a != 0.0 and b != 0.0 and abs(a - b) <= max(ROUNDED_DECIMALS, ROUNDED_SHARE * max(abs(a), abs(b)))
    )


def add_values(builder: LogBuilder, declinations: Mapping[str, float]) -> None:
    """Add the logged defaults and the declination setting to the log.

    ``declinations``: parameters of the declination with their factor to deg, preferred first.
    """
    log = builder.log
    changes = builder.messages.params
    logged = [c for c in changes if c.is_default and math.isfinite(c.value)]
    of_vehicle = {c.name: c.value for c in logged if not c.firmware_only}
    of_firmware = {c.name: c.value for c in logged if c.firmware_only}
    log.parameters.defaults = of_firmware | of_vehicle
    log.parameters.of_airframe = frozenset(of_firmware) - frozenset(of_vehicle)
    for name, to_deg in declinations.items():
        value = log.param(name)
        if value is not None and UNSET_DECLINATION_DEG < abs(value * to_deg) <= 180.0:
            log.parameters.declination, log.parameters.declination_source = float(value) * to_deg, name
            return


# Origin of a parameter's value at the start of the log: a default, a setting, unknown, or a file of the user.
Origin = Literal["default", "airframe", "set", "unknown", "file"]


@dataclass(frozen=True, slots=True)
class ParameterHistory:
    """Parameter of a vehicle: value at the start of the log, and changes (t in s, value) after it.

    ``default``: None if unknown. ``origin``: ``airframe`` is that of the airframe's configuration, where ``default`` is
    the firmware's; ``file``: only in the user's parameter file.
    """

    name: str
    value: float
    default: float | None
    origin: Origin
    changes: list[tuple[float, float]] = field(default_factory=list)


def parameter_histories(log: FlightLog) -> list[ParameterHistory]:
    """Return every parameter of a log by name, with its default and its changes.

    ULog logs no default for a parameter at its default.
    """
    own = log.parameters
    found = []
    for name, line in sorted(own.lines.items()):
        if not line.value:
            continue
        value = line.at(0.0)
        known = own.defaults.get(name, value if own.defaults and log.format == "ulog" else None)
        default = None if name in own.filled else known
        changed = [(t, v) for t, v in zip(line.t.tolist()[1:], line.value[1:], strict=True) if t > 0.0]
        found.append(ParameterHistory(name, value, default, _origin(log, name, value, default), changed))
    return found


def _origin(log: FlightLog, name: str, value: float, default: float | None) -> Origin:
    """Return where the value of a parameter comes from."""
    if name in log.parameters.filled:
        return "file"
    if default is None:
        return "unknown"
    return "default" if value == default else "airframe" if name in log.parameters.of_airframe else "set"


def looks_up_declination(log: FlightLog) -> bool:
    """Return whether the autopilot takes the declination from its map once it has a position."""
    return any((value := log.param(name)) is not None and int(value) & bit for name, bit in DECLINATION_LOOKUP.items())


# --- files of ground stations -----------------------------------------------------------------------------------


def read_parameter_file(path: str | Path) -> dict[str, float]:
    """Read a ground station's parameter file. LogUnreadable if it cannot be opened, UsageError for invalid lines."""
    lines = read_settings_bytes(Path(path)).decode("utf-8-sig", "replace").splitlines()
    values: dict[str, float] = {}
    first_line: dict[str, int] = {}
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
            before = f"in line {first_line[name]} it was {values[name]:g}"
            wrong.append(f"{path}, line {number}: {name} is {value:g}, {before}")
        first_line.setdefault(name, number)
    if wrong:
        more = [f"{path}: {len(wrong) - MAX_SHOWN} more lines like these"] if len(wrong) > MAX_SHOWN else []
        raise UsageError("\n".join([*wrong[:MAX_SHOWN], *more]))
    if not values:
        raise UsageError(f"{path}: holds no parameter")
    return values


def _parse_number(text: str) -> float:
    """Parse a decimal or hexadecimal number, NaN if invalid."""
    try:
        return float(int(text, 16)) if text.lower().startswith("0x") else float(text)
    except (ValueError, OverflowError):
        return math.nan


def add_missing(messages: Messages, given: Mapping[str, float]) -> frozenset[str]:
    """Add given parameters that the log lacks, and return their names."""
    known = {change.name for change in messages.params}
    start = messages.boots[0].start if messages.boots else 0
    added = [ParamChange(name, value, offset=start) for name, value in given.items() if name not in known]
    messages.params[:0] = added
    return frozenset(change.name for change in added)


def compare_with_log(
    path: str | Path, given: Mapping[str, float], own: Mapping[str, float], applied: Collection[str] = ()
) -> list[Problem]:
    """Report parameters of a file that differ from the log or are not in the log.

    ``applied``: parameters that corrected sensors and are reported elsewhere.
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
        near = {n: difflib.get_close_matches(n, own, n=1, cutoff=MIN_SIMILARITY) for n in unknown[:MAX_SHOWN]}
        names = _list_names([n + (f" (did you mean {near[n][0]}?)" if near.get(n) else "") for n in unknown])
        text = f"{name} names parameters that the log does not hold: {names}. Typing errors, or another firmware."
        # If most names are unknown, the log's own table is incomplete.
        found.append(Problem("params_unknown", "warning" if 2 * len(unknown) <= len(given) else "note", text))
    return found


def _list_names(items: list[str]) -> str:
    return ", ".join(items[:MAX_SHOWN]) + (f" and {len(items) - MAX_SHOWN} more" if len(items) > MAX_SHOWN else "")
