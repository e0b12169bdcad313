"""A file of parameters that a ground station loads: Mission Planner's and MAVProxy's form, or QGroundControl's.

Comments stand in lines of their own: Mission Planner skips every line that holds more than a name and a value. Both
take values as decimals. QGroundControl wants the vehicle's id, its component and the type of each value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from attlog.flight.parameters import ranges

LEARNT = "PX4 may have moved compass offsets at disarming: old values are those that flew."
INT32, FLOAT = 6, 9
"""MAV_PARAM_TYPE_INT32 and MAV_PARAM_TYPE_REAL32."""
AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1."""
ORDER = "COMPASS_PRIO"
"""Parameters of this name swap the slots of compasses at the next boot."""
BY_SLOT = ("COMPASS_OFS", "COMPASS_MOT", "COMPASS_DIA", "COMPASS_ODI", "COMPASS_SCALE")


def text(
    firmware: str, values: Mapping[str, float], head: Sequence[str], beside: Mapping[str, str], vehicle: int = 1
) -> str:
    """The file's text: ``head`` as comments, then the parameters ``values``, each with what ``beside`` says above it.

    ``firmware``: PX4 or ArduPilot; ``vehicle``: its MAVLink id. Where the file holds calibrations of compasses, their
    order is left to a file of its own: after it all slots are others'.
    """
    calibrates = any(name.startswith(BY_SLOT) for name in values)
    lines = [f"# {line}" for line in head]
    if firmware == "PX4":
        lines += [f"# {LEARNT}", "# Vehicle-Id\tComponent-Id\tName\tValue\tType"]
    for name, value in values.items():
        if calibrates and name.startswith(ORDER):
            lines.append(f"# left out: {name} {value:.0f} swaps the compasses at a boot. Set it alone, reboot, fly.")
            continue
        lines += [f"# {beside[name]}"] if beside.get(name) else []
        whole = ranges.is_whole(name)
        number = f"{value:.0f}" if whole else f"{value:.9g}"
        if firmware == "PX4":
            lines.append(f"{vehicle}\t{AUTOPILOT}\t{name}\t{number}\t{INT32 if whole else FLOAT}")
        else:
            lines.append(f"{name},{number}")
    return "\n".join(lines) + "\n"
