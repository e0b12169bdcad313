"""Parameters from a ground station's file: they fill in what a log lacks, and filters take them before the log's.

Three spellings: Mission Planner ``NAME,VALUE``, MAVProxy ``NAME VALUE`` and
QGroundControl (tabs: vehicle, component, name, value, type). ``#`` begins a comment.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Collection, Mapping
from pathlib import Path

from attlog.base.errors import UsageError
from attlog.base.files.settings_file import bytes_of
from attlog.flight.model import Problem
from attlog.flight.parameters.limits import impossible
from attlog.formats.base import Messages, ParamChange

SHOWN = 6
"""So many names stand in a sentence, so many bad lines of a file are told."""


def read_file(path: str | Path) -> dict[str, float]:
    """Values by name. LogUnreadable if the file cannot be opened, UsageError with every line that is no parameter."""
    lines = bytes_of(Path(path)).decode("utf-8-sig", "replace").splitlines()
    values: dict[str, float] = {}
    stands: dict[str, int] = {}
    wrong = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        name, text = (words[2], words[3]) if len(words) == 5 else (words[0], words[1]) if len(words) == 2 else ("", "")
        value = _number(text)
        limits = impossible(name, value)
        if not name or not math.isfinite(value):
            wrong.append(f"{path}, line {number}: {line.strip()[:60]!r} is not NAME,VALUE")
        elif limits is not None:
            wrong.append(f"{path}, line {number}: {name} is {value:g}; the {limits.name} lies within {limits.limits}")
        elif values.setdefault(name, value) != value:
            wrong.append(f"{path}, line {number}: {name} is {value:g}, in line {stands[name]} it was {values[name]:g}")
        stands.setdefault(name, number)
    if wrong:
        more = [f"{path}: {len(wrong) - SHOWN} more lines like these"] if len(wrong) > SHOWN else []
        raise UsageError("\n".join([*wrong[:SHOWN], *more]))
    if not values:
        raise UsageError(f"{path}: holds no parameter")
    return values


def _number(text: str) -> float:
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


def notes(
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
        changes = _listed([f"{n} {own[n]:g} -> {given[n]:g}" for n in other])
        text = f"{name} differs from the log in {changes}. Filters with parameters of the firmware take the file's, "
        text += "everything else the log's" + (", but for the sensors named as corrected." if applied else ".")
        found.append(Problem("params_differ", "note", text))
    unknown = [n for n in given if n not in own]
    if unknown:
        near = {n: difflib.get_close_matches(n, own, n=1, cutoff=0.8) for n in unknown[:SHOWN]}
        names = _listed([n + (f" (did you mean {near[n][0]}?)" if near.get(n) else "") for n in unknown])
        text = f"{name} names parameters that the log does not hold: {names}. Typing errors, or another firmware."
        # Where most names are new the log's own table is the one with holes.
        found.append(Problem("params_unknown", "warning" if 2 * len(unknown) <= len(given) else "note", text))
    return found


def _listed(items: list[str]) -> str:
    return ", ".join(items[:SHOWN]) + (f" and {len(items) - SHOWN} more" if len(items) > SHOWN else "")
