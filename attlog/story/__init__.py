"""Tell what happened in a flight: events with their evidence, in time order, and a headline."""

from __future__ import annotations

from dataclasses import replace

from attlog.flight.model import FlightLog, guarded_part
from attlog.segments.model import Segments
from attlog.story import (
    causes,
    drive_events,
    estimator_events,
    failsafe_events,
    flight_events,
    message_events,
    pilot_events,
)
from attlog.story.flight_events import CRASHES, KINDS, Event
from attlog.story.headlines import WrongAngle, headline

__all__ = ["CRASHES", "KINDS", "Event", "WrongAngle", "events", "headline"]

BEGUN_S = 0.5


def events(log: FlightLog, segments: Segments) -> list[Event]:
    """Return all events of a flight in time order, merged across sources."""
    found: list[Event] = []
    quoted: list[flight_events.Text] = []
    for what, make in (
        ("Flights and crashes", flight_events.movement_events),
        ("Clipping and vibration", flight_events.sensor_events),
        ("Motors and control", drive_events.drive_events),
        ("The pilot’s input", lambda log, segments: (pilot_events.pilot_events(log, segments), [])),
        ("Failsafes", failsafe_events.failsafe_events),
        ("The onboard estimator", estimator_events.onboard_estimator_events),
    ):
        some, texts = guarded_part(log, what, lambda make=make: make(log, segments), lambda: ([], []))  # type: ignore[misc]
        found += some
        quoted += texts
    found += guarded_part(
        log, "The autopilot’s messages", lambda: message_events.message_events(log, quoted, segments), list[Event]
    )
    found += guarded_part(
        log, "Changed parameters", lambda: message_events.parameter_events(log, segments), list[Event]
    )
    lost = [(s.t0, s.t1) for kind in ("impact", "loss_of_control") for s in segments.of(kind)]
    for k, event in enumerate(found):
        # Warnings at the start of the log (autopilot boot) and of a wreck are only notes.
        starts = event.t < BEGUN_S and event.t_end is None
        if event.severity == "warning" and (starts or any(a + 0.1 < event.t <= b for a, b in lost)):
            found[k] = replace(event, severity="note")
    found = [replace(event, t=round(event.t, 3)) for event in found]
    found.sort(key=lambda e: (e.t, KINDS.index(e.kind)))
    return guarded_part(log, "Causes of events", lambda: causes.link(log, found), lambda: found)
