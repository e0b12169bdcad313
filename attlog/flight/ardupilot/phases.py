"""Armed, on the ground, which mode: the time lines of an ArduPilot log."""

from __future__ import annotations

import numpy as np

from attlog.flight.ardupilot.clock import Clock
from attlog.flight.builder import LogBuilder
from attlog.flight.model import TimeLine
from attlog.flight.modes import ardupilot_mode

ARMED, DISARMED, LANDED, NOT_LANDED = 10, 11, 18, 28
"""Event ids of EV records (ArduPilot AP_Logger LogEvent). 17, LAND_COMPLETE_MAYBE, comes in flight: it lands nobody."""


def armed(builder: LogBuilder, clock: Clock) -> TimeLine | None:
    """Armed or not: ARM records (4.x), events 10 and 11, or STAT of planes."""
    messages = builder.messages
    arm = messages.first("ARM")
    if arm is not None and "ArmState" in arm:
        return with_start(builder, clock.of(arm), (arm["ArmState"] != 0).tolist(), "ARM")
    events = messages.first("EV")
    if events is not None and "Id" in events:
        ids = events["Id"].astype(np.int64)
        mine = (ids == ARMED) | (ids == DISARMED)
        if mine.any():
            return with_start(builder, clock.of(events)[mine], (ids[mine] == ARMED).tolist(), "EV")
    status = messages.first("STAT")
    if status is not None and "Armed" in status:
        return builder.time_line(clock.of(status), (status["Armed"] != 0).tolist(), "STAT")
    return None


def landed(builder: LogBuilder, clock: Clock, arming: TimeLine | None) -> TimeLine | None:
    """On the ground or not: copter events 18 and 28, or STAT.isFlying of planes.

    Before the first event a disarmed vehicle stands on the ground.
    """
    messages = builder.messages
    events = messages.first("EV")
    if events is not None and "Id" in events:
        ids = events["Id"].astype(np.int64)
        mine = np.isin(ids, (LANDED, NOT_LANDED))
        if mine.any():
            line = with_start(builder, clock.of(events)[mine], (ids[mine] != NOT_LANDED).tolist(), "EV")
            if line is not None and arming is not None and not arming.at(float(line.t[0])) and not line.value[0]:
                line.value[0] = True
            return line
    status = messages.first("STAT")
    if status is not None and "isFlying" in status:
        return builder.time_line(clock.of(status), (status["isFlying"] == 0).tolist(), "STAT")
    return None


def mode(builder: LogBuilder, clock: Clock, family: str) -> TimeLine | None:
    """Flight modes by name; text logs hold the name, binary ones a number whose meaning depends on the family."""
    table = builder.messages.first("MODE")
    if table is None or "Mode" not in table:
        return None
    if table["Mode"].dtype.kind in "SU":
        names = [x.decode("latin-1") if isinstance(x, bytes) else str(x) for x in table["Mode"].tolist()]
        names = [
            ardupilot_mode(family, int(n)) if n.strip().isdigit() else n.strip().upper().replace(" ", "_")
            for n in names
        ]
    else:
        names = [ardupilot_mode(family, int(n)) for n in table["Mode"].tolist()]
    return builder.time_line(clock.of(table), names, "MODE")


def with_start(builder: LogBuilder, t_us: np.ndarray, values: list[bool], source: str) -> TimeLine | None:
    """A time line of events; before the first one the opposite held, from the log's first sample on."""
    line = builder.time_line(t_us, values, source)
    if line is not None and line.t[0] > 0:
        line.t = np.concatenate([[0.0], line.t])
        line.value = [not line.value[0], *line.value]
    return line
