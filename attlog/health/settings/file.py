"""The settings of a log as a file that ground stations load, with what each was when the log was flown.

Mission Planner's and MAVProxy's form, or QGroundControl's. Comments stand in lines of their own: Mission Planner skips
every line that holds more than a name and a value. Both take values as decimals. QGroundControl wants the vehicle's id,
its component and the type of each value.
"""

from __future__ import annotations

from collections.abc import Sequence

from attlog import __version__
from attlog.flight.parameters import ranges
from attlog.health.assessments.model import Setting

WARNING = (
    "These values hold only for the vehicle of this log, and only where its parameters are still those named below.",
    "Check each old value before you load the file, and the headings on the ground before you fly.",
)
LEARNT = "PX4 may have moved compass offsets at disarming: old values are those that flew."
INT32, FLOAT = 6, 9
"""MAV_PARAM_TYPE_INT32 and MAV_PARAM_TYPE_REAL32."""
AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
ORDER = "COMPASS_PRIO"
"""Parameters of this name swap the slots of compasses at the next boot."""
BY_SLOT = ("COMPASS_OFS", "COMPASS_MOT", "COMPASS_DIA", "COMPASS_ODI", "COMPASS_SCALE")


def param_file(firmware: str, log_name: str, settings: Sequence[Setting], vehicle: int = 1) -> str:
    """The file's text; of a parameter that is named twice the first counts. Empty without settings.

    ``firmware``: PX4 or ArduPilot; ``vehicle``: its MAVLink id. Where the file holds calibrations of compasses, their
    order is left to a file of its own: after it all slots are others'.
    """
    first: dict[str, Setting] = {}
    for setting in settings:
        first.setdefault(setting.name, setting)
    if not first:
        return ""
    calibrates = any(name.startswith(BY_SLOT) for name in first)
    head = f"attlog {__version__}: what to set, found in {log_name} ({firmware or 'unknown firmware'})"
    lines = [f"# {' '.join(head.split())}", *(f"# {line}" for line in WARNING)]
    if firmware == "PX4":
        lines += [f"# {LEARNT}", "# Vehicle-Id\tComponent-Id\tName\tValue\tType"]
    for setting in first.values():
        if calibrates and setting.name.startswith(ORDER):
            lines.append(f"# left out: {setting.name} {setting.new:.0f} swaps the compasses at a boot. Set it alone,")
            lines.append("# reboot, fly.")
            continue
        lines += [f"# {_before(setting)}", _line(setting, firmware, vehicle)]
    return "\n".join(lines) + "\n"


def _line(setting: Setting, firmware: str, vehicle: int) -> str:
    whole = ranges.is_whole(setting.name)
    number = f"{setting.new:.0f}" if whole else f"{setting.new:.9g}"
    if firmware == "PX4":
        return f"{vehicle}\t{AUTOPILOT}\t{setting.name}\t{number}\t{INT32 if whole else FLOAT}"
    return f"{setting.name},{number}"


def _before(setting: Setting) -> str:
    """What a parameter was when the log was flown."""
    if setting.old is None:
        return f"{setting.name}: its value is not in the log"
    unit = f" {setting.unit}" if setting.unit else ""
    return f"{setting.name} was {setting.old:.6g}{unit} when the log was flown"
