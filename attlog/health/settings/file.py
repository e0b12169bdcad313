"""The settings of a log as a file that ground stations load, with what each was when the log was flown."""

from __future__ import annotations

from collections.abc import Sequence

from attlog import __version__
from attlog.flight.model import FlightLog
from attlog.flight.parameters import writing
from attlog.health.assessments.model import Setting

WARNING = (
    "These values hold only for the vehicle of this log, and only where its parameters are still those named below.",
    "Check each old value before you load the file, and the headings on the ground before you fly.",
)


def text(log: FlightLog, settings: Sequence[Setting]) -> str:
    """A parameter file's text; of a parameter that is named twice the first counts. Empty without settings."""
    if not settings:
        return ""
    first: dict[str, Setting] = {}
    for setting in settings:
        first.setdefault(setting.name, setting)
    head = [f"attlog {__version__}: what to set, found in {log.path.name} ({log.firmware})", *WARNING]
    values = {name: setting.new for name, setting in first.items()}
    return writing.text(log, values, head, {name: _before(log, setting) for name, setting in first.items()})


def _before(log: FlightLog, setting: Setting) -> str:
    """What a parameter was: when the log was flown, and at the log's end where the firmware changed it."""
    unit = f" {setting.unit}" if setting.unit else ""
    if setting.old is None:
        return f"{setting.name}: its value is not in the log"
    line = log.params.get(setting.name)
    end = float(line.value[-1]) if line is not None and line.value else setting.old
    changed = f", {end:.6g} at its end" if abs(end - setting.old) > 1e-6 * max(abs(end), 1.0) else ""
    return f"{setting.name} was {setting.old:.6g}{unit} when the log was flown{changed}"
