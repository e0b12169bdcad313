"""A file of parameters that a ground station loads: Mission Planner's and MAVProxy's form, or QGroundControl's.

Comments stand in lines of their own: Mission Planner skips every line that holds more than a name and a value. Both
take values as decimals. QGroundControl wants the vehicle's id, its component and the type of each value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from attlog.flight.model import FlightLog
from attlog.flight.parameters import ranges

INT32, FLOAT = 6, 9
"""MAV_PARAM_TYPE_INT32 and MAV_PARAM_TYPE_REAL32."""
AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
ORDER = "COMPASS_PRIO"
"""Parameters of this name swap the slots of compasses at the next boot."""
BY_SLOT = ("COMPASS_OFS", "COMPASS_MOT", "COMPASS_DIA", "COMPASS_ODI", "COMPASS_SCALE")


def text(log: FlightLog, values: Mapping[str, float], head: Sequence[str], beside: Mapping[str, str]) -> str:
    """The file's text: ``head`` as comments, then the parameters ``values``, each with what ``beside`` says above it.

    Where it holds calibrations of compasses, their order is left to a file of its own: after it all slots are others'.
    """
    own_vehicle = int(log.param("MAV_SYS_ID") or 1)
    calibrates = any(name.startswith(BY_SLOT) for name in values)
    lines = [f"# {line}" for line in head]
    if log.firmware.name == "PX4":
        lines.append("# Vehicle-Id\tComponent-Id\tName\tValue\tType")
    for name, value in values.items():
        if calibrates and name.startswith(ORDER):
            lines.append(f"# left out: {name} {value:.0f} swaps the compasses at a boot. Set it alone, reboot, fly.")
            continue
        lines += [f"# {beside[name]}"] if beside.get(name) else []
        own = log.params.get(name)
        whole = ranges.is_whole(name) or (own is not None and isinstance(own.at(0.0), int))  # as the log stores it
        number = f"{value:.0f}" if whole else f"{value:.9g}"
        if log.firmware.name == "PX4":
            lines.append(f"{own_vehicle}\t{AUTOPILOT}\t{name}\t{number}\t{INT32 if whole else FLOAT}")
        else:
            lines.append(f"{name},{number}")
    return "\n".join(lines) + "\n"
