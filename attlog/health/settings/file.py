"""The settings of a log as a file that ground stations load, with what each was when the log was flown."""

from __future__ import annotations

from collections.abc import Sequence

from attlog import __version__
from attlog.flight.parameters import writing
from attlog.health.assessments.model import Setting

WARNING = (
    "These values hold only for the vehicle of this log, and only where its parameters are still those named below.",
    "Check each old value before you load the file, and the headings on the ground before you fly.",
)


def param_file(firmware: str, log_name: str, settings: Sequence[Setting], vehicle: int = 1) -> str:
    """The file's text; of a parameter that is named twice the first counts. Empty without settings.

    ``firmware``: PX4 or ArduPilot; ``vehicle``: its MAVLink id.
    """
    first: dict[str, Setting] = {}
    for setting in settings:
        first.setdefault(setting.name, setting)
    if not first:
        return ""
    head = f"attlog {__version__}: what to set, found in {log_name} ({firmware or 'unknown firmware'})"
    values = {name: setting.new for name, setting in first.items()}
    beside = {name: _before(setting) for name, setting in first.items()}
    return writing.text(firmware, values, [" ".join(head.split()), *WARNING], beside, vehicle)


def _before(setting: Setting) -> str:
    """What a parameter was when the log was flown."""
    if setting.old is None:
        return f"{setting.name}: its value is not in the log"
    unit = f" {setting.unit}" if setting.unit else ""
    return f"{setting.name} was {setting.old:.6g}{unit} when the log was flown"
