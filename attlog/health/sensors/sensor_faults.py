"""What the sensors have in common: compass and gyro turn alike, a gyro does not jump, forces change the velocity."""

from __future__ import annotations

from attlog.health.model import Check
from attlog.health.reason import as_sentence
from attlog.reference.model import Reference
from attlog.reference.physics.sensor_faults import COMPASS, FRAME, GYRO, LATE

LIMITS = {
    GYRO: "ok: fewer than 5 samples 20 times further from their neighbours than usual; fault above 20 deg/min of them",
    COMPASS: "ok: no other axes of the compass turn three times better with the gyro, and the dip is within 25 deg",
    FRAME: "ok: the field does not dip by 25 deg otherwise below its level while it is right below the attitude's",
    LATE: "ok: no other clock of the accelerometer fits the GNSS velocity nine times better (squared)",
}


def checks(reference: Reference | None) -> list[Check]:
    """What was found while the reference was chosen; nothing is said of what physics does not contradict."""
    faults = {} if reference is None else reference.sensor_faults
    return [
        Check(
            name,
            "fault" if fault.misleads else "warning",
            as_sentence(fault.why),
            fault.value,
            fault.unit,
            LIMITS[name],
            t=fault.t,
            count=fault.count,
        )
        for name, fault in faults.items()
        if name in LIMITS
    ]
