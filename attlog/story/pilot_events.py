"""Events of the pilot's input: lost radio, and full stick that commanded a rotation into a crash."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from attlog.core.spans import Span, between, inside
from attlog.flight.model import Array, FlightLog
from attlog.flight.vehicle import VehicleKind
from attlog.segments.flight_signs import true_runs
from attlog.segments.model import Segments
from attlog.story.flight_events import Event, EventSeverity
from attlog.story.motor_faults import Motion

# Shortest loss that counts: PX4 (COM_RC_LOSS_T) and ArduPilot report one after 0.5 s and more.
MIN_LOST_S = 0.5
# Flags of PX4 that cover joysticks too; a log with a receiver leads with input_rc.
JOYSTICK_SOURCES = ("failsafe_flags", "vehicle_status")
# Stick that is full, as share of its travel, how long, and until when before the crash it begins.
FULL_STICK, HELD_S, BEFORE_S = 0.9, 0.2, 3.0
# Rotation towards the stick between its begin and the crash, and its least share of roll and pitch together.
MIN_TURN_DEG, MIN_TURN_SHARE = 60.0, 0.7
# Modes in which full roll or pitch stick commands rotation without end; of wings and VTOL also those of direct control.
RATE_MODES = frozenset(("acro", "qacro"))
DIRECT_MODES = RATE_MODES | {"manual"}
STICK_NAMES = (("left", "right", "roll"), ("forward", "back", "pitch"))
MIN_STICK_HZ = 4.0


def pilot_events(log: FlightLog, segments: Segments) -> list[Event]:
    """Return losses of the radio while armed, and full stick before the first crash."""
    stick = full_stick_event(log, segments)
    return [*radio_events(log, segments), *([stick] if stick is not None else [])]


def radio_events(log: FlightLog, segments: Segments) -> list[Event]:
    """Return each loss of the radio that begins while armed; on the ground it is a note."""
    flown = segments.spans("airborne")
    found = []
    for t0, t1 in lost_spans(log):
        if not inside(np.array([t0]), segments.spans("armed") or flown).any():
            continue
        source = log.pilot.signal.source if log.pilot.signal is not None else ""
        joystick = source.startswith(JOYSTICK_SOURCES)
        lost = "No pilot input (radio or joystick)" if joystick else "No radio signal"
        text = f"{lost} from {t0:.1f} s for {t1 - t0:.1f} s."
        severity: EventSeverity = "warning" if any(a < t1 and t0 < b for a, b in flown) else "note"
        about = "pilot input" if joystick else ""
        found.append(Event("radio_lost", t0, severity, text, t1, round(t1 - t0, 1), "s", [source], about=about))
    return found


def lost_spans(log: FlightLog) -> list[Span]:
    """Return spans of at least 0.5 s without radio signal after it was received."""
    line = log.pilot.signal
    if line is None or True not in line.value:
        return []
    ends = [*line.t.tolist()[1:], log.seconds]
    spans = zip(line.t.tolist(), ends, line.value, strict=True)
    first = float(line.t[line.value.index(True)])
    return [(a, b) for a, b, received in spans if not received and a > first and b - a >= MIN_LOST_S]


def full_stick_event(log: FlightLog, segments: Segments) -> Event | None:
    """Return full roll or pitch stick that the vehicle followed into its first crash; None without one."""
    crash = next((e.t for e in segments.crash_events if e.is_crash), None)
    if crash is None:
        return None
    held = max(_held_sticks(log, crash), default=None)
    if held is None:
        return None
    turned, axis, side, t0, t1 = held
    direction = STICK_NAMES[axis][int(side > 0)]
    mode = str(log.state.mode.at(t0)) if log.state.mode is not None else ""
    text = f"Full {direction} stick in {mode} from {t0:.1f} s: it turned by {turned:.0f}° that way before the crash."
    evidence = [f"{STICK_NAMES[axis][2]} stick above {100.0 * FULL_STICK:.0f} % until {t1:.1f} s"]
    return Event("full_stick", t0, "note", text, t1, round(turned), "°", evidence)


def _held_sticks(log: FlightLog, crash: float) -> Iterator[tuple[float, int, float, float, float]]:
    """Yield turn in deg, axis (0 roll, 1 pitch), side, begin and end in s of each full stick that was followed."""
    sticks, mode = log.pilot.sticks, log.state.mode
    if sticks is None or mode is None or sticks.rate < MIN_STICK_HZ:
        return
    part = between(sticks.t, crash - BEFORE_S, crash)
    t, x = sticks.t[part], sticks.x[part]
    gyro_t, rates = Motion(log).rates
    modes = RATE_MODES if log.kind in (VehicleKind.MULTIROTOR, VehicleKind.HELICOPTER) else DIRECT_MODES
    for axis in (0, 1):
        for side in (-1.0, 1.0):
            for a, b in true_runs(side * x[:, axis] >= FULL_STICK):
                t0, t1 = float(t[a]), float(t[b - 1])
                if t1 - t0 < HELD_S or str(mode.at(t0)).lower() not in modes:
                    continue
                turned = _turned_deg(gyro_t, rates, t0, crash)
                if side * turned[axis] >= max(MIN_TURN_DEG, MIN_TURN_SHARE * float(np.hypot(*turned))):
                    yield side * float(turned[axis]), axis, side, t0, t1


def _turned_deg(t: Array, rates: Array, t0: float, t1: float) -> Array:
    """Return the integrals (2,) in deg of roll and pitch rate from t0 to t1 s; 0 without samples."""
    part = between(t, t0, t1)
    at, x = t[part], rates[part, :2]
    total: Array = np.sum(0.5 * (x[1:] + x[:-1]) * np.diff(at)[:, None], axis=0)
    return total
