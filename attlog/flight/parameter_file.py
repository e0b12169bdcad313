"""Parameters from a ground station's file, for logs that hold none.

Three spellings: Mission Planner ``NAME,VALUE``, MAVProxy ``NAME VALUE`` and
QGroundControl (tabs: vehicle, component, name, value, type). ``#`` begins a comment.
"""

from __future__ import annotations

import math
from pathlib import Path

from attlog.errors import LogUnreadable, UsageError
from attlog.formats.base import Messages, ParamChange


def read_file(path: Path) -> dict[str, float]:
    """Values by name. LogUnreadable if the file cannot be opened, UsageError with the line that is no parameter."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise LogUnreadable(f"{path}: cannot be read ({error.strerror})") from error
    values = {}
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].replace(",", " ").split()
        if not words:
            continue
        name, value = words[2:4] if len(words) == 5 else words if len(words) == 2 else ("", "")
        try:
            values[name] = float(int(value, 16)) if value.lower().startswith("0x") else float(value)
        except ValueError:
            values[name] = math.nan
        if not name or not math.isfinite(values[name]):
            raise UsageError(f"{path}, line {number}: {line.strip()[:60]!r} is not NAME,VALUE")
    return values


def add_missing(messages: Messages, path: Path) -> None:
    """Give a log the file's parameters that it does not hold itself; what the log says counts."""
    known = {change.name for change in messages.params}
    start = messages.boots[0].start if messages.boots else 0
    added = [ParamChange(name, value, offset=start) for name, value in read_file(path).items() if name not in known]
    messages.params[:0] = added
