"""Which sensors misled whoever believed them? What physics tells before anything is made of them.

A smoother that believes a compass with mirrored axes, a gyro with spikes or a late accelerometer is sure of an
attitude that is degrees off. So each is held against what it cannot have in common with the others, and
where it is contradicted no smoother is made of it.
"""

from __future__ import annotations

from collections.abc import Callable

from attlog.flight.model import FlightLog, part_of
from attlog.reference.model import SensorFault
from attlog.reference.physics import compass, dip, late_force, spikes
from attlog.segments import Segments
from attlog.segments.once import asked_once

GYRO, COMPASS, LATE, FRAME = "gyro spikes", "compass axes", "accelerometer delay", "accelerometer axes"


def found(log: FlightLog, segments: Segments) -> dict[str, SensorFault]:
    """The faults of the sensors that would be replayed, by name; empty where physics contradicts none."""
    attitude = log.onboard_attitude
    source = "" if log.mag is None else log.mags[log.mag].field.source
    seen = part_of(log, "The dip of the field", lambda: _dips(log, segments), lambda: None)
    asked: dict[str, Callable[[], SensorFault | None]] = {
        GYRO: lambda: _spikes(log),
        COMPASS: lambda: _fault(compass.other_axes(log) or dip.compass_contradicted(seen, attitude, source)),
        LATE: lambda: _late(log),
        FRAME: lambda: _fault(wrong_frame(log, segments)),
    }
    made = {name: part_of(log, f"The check {name}", ask, lambda: None) for name, ask in asked.items()}
    return {name: fault for name, fault in made.items() if fault is not None}


def wrong_frame(log: FlightLog, segments: Segments) -> str:
    """Why the force of the replayed accelerometer is in wrong axes; empty where the field does not say so."""
    return dip.accelerometer_contradicted(_dips(log, segments), log.onboard_attitude)


@asked_once
def _dips(log: FlightLog, segments: Segments) -> dip.DipAngles | None:
    return dip.dips(log, segments, log.onboard_attitude)


def _fault(why: str) -> SensorFault | None:
    return SensorFault(why) if why else None


def _spikes(log: FlightLog) -> SensorFault | None:
    counted = None if log.replay_imu is None else spikes.of(log.replay_imu)
    if counted is None or not counted.why:
        return None
    turned = round(counted.deg_per_min, 1)
    return SensorFault(counted.why, turned, "deg/min", counted.t, counted.count, misleads=counted.misleads)


def _late(log: FlightLog) -> SensorFault | None:
    late = late_force.seconds(log)
    if late is None:
        return None
    why = (
        f"the specific force fits the change of the GNSS velocity only when it is taken {abs(late):.1f} s "
        f"{'later' if late > 0 else 'earlier'}: the accelerometer's times are wrong"
    )
    return SensorFault(why, round(late, 1), "s")
