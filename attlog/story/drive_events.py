"""Events of motors, thrust and control, and which of them explains a crash."""

from __future__ import annotations

from collections.abc import Sequence

from attlog.core.brief import first_part
from attlog.flight.model import FlightLog
from attlog.segments.model import Segments
from attlog.story.control_faults import study_control
from attlog.story.flight_events import Event, EventSeverity, Text
from attlog.story.motor_faults import CAUSE_S, DriveFault, study_motors

# Faults of a part, in contrast to those of settings.
BROKEN = ("motor_no_thrust", "motor_off", "motor_frozen", "motors_off", "no_thrust_left", "yaw_backwards")
# Faults that explain a crash however long before it they began.
LASTING = ("rate_tracking", "oscillation")


def drive_events(log: FlightLog, segments: Segments) -> tuple[list[Event], list[Text]]:
    """Return an event for each fault of motors, thrust and control, and the texts that they quote."""
    faults = [*study_motors(log, segments).all_faults, *study_control(log, segments).all_faults]
    quoted = {report.t: report.text for report in (log.power.outputs.reports if log.power.outputs is not None else ())}
    near = [t for t in quoted if any(fault.t - CAUSE_S <= t <= fault.t_end + CAUSE_S for fault in faults)]
    texts = [text for text in log.texts if text[0] in near and text[2] == quoted[text[0]]]
    return [drive_event(fault) for fault in faults], texts


def drive_event(fault: DriveFault) -> Event:
    """Convert a fault to an event; a broken part is serious."""
    weight: EventSeverity = "serious" if fault.kind in BROKEN else "warning"
    return Event(
        fault.kind,
        fault.t,
        weight,
        fault.text,
        fault.t_end,
        fault.value,
        fault.unit,
        list(fault.evidence),
        part=fault.part,
        motor=fault.motor,
        position=fault.position,
    )


def crash_cause(events: Sequence[Event]) -> Event | None:
    """Return the earliest fault of motors, thrust or control within 5 s before the first crash, None without one.

    Poor control and oscillation count however early they began.
    """
    crash = next((e.t for e in events if e.is_crash), None)
    if crash is None:
        return None
    near = [e for e in events if e.kind in BROKEN and crash - CAUSE_S <= (e.t_end or e.t) and e.t <= crash]
    return next(iter(near or [e for e in events if e.kind in LASTING and e.t <= crash]), None)


def drive_phrase(events: Sequence[Event]) -> str:
    """Return the broken part behind a crash, else the first one, as a sentence for the headline; empty for none."""
    found = _broken(events)
    return "" if found is None else f"{first_part(found.text, ': ').rstrip('.')}."


def _broken(events: Sequence[Event]) -> Event | None:
    cause = crash_cause(events)
    return cause if cause is not None and cause.kind in BROKEN else next((e for e in events if e.kind in BROKEN), None)


def fails_before_crash(events: Sequence[Event]) -> bool:
    """Return whether the part of :func:`drive_phrase` failed before the first crash, or nothing crashed."""
    found = _broken(events)
    return found is None or found.t <= next((e.t for e in events if e.is_crash), found.t)
