"""Events that only the autopilot reports: refused arming, failing devices, other texts, changed parameters."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from attlog.core.spans import Span, inside
from attlog.flight.model import FlightLog
from attlog.segments.model import Segments
from attlog.story.flight_events import (
    PREARM,
    PREFIX,
    Event,
    EventSeverity,
    Text,
    clean_text,
    format_time,
    is_warning,
    quote_text,
)

# Time around a flight within which a text belongs to it.
MESSAGE_MARGIN_S = 2.0
# Maximum number of messages: a flight has a few dozen, a damaged log any number.
MAX_MESSAGES = 100
# Errors of one driver from which its device failed, and not single transfers.
MIN_DEVICE_ERRORS = 20
# Modules of PX4 that are no drivers: their repeated errors are messages.
NO_DRIVER = re.compile(r"^(commander|navigator|health_and_arming_checks|mavlink|logger|dataman)")
# Number of texts quoted of a device, and time after its first error from which a text has its own begin.
MAX_DEVICE_TEXTS, LATER_S = 3, 1.0
# Syslog level of errors.
ERROR = 3
# Answer to an attempt to arm: ArduPilot's "Arm:" (AP_Arming::check_failed; it says "PreArm:" unasked), and PX4's.
REFUSED = re.compile(r"^(arm: *|arming denied[:!,.]* *)", re.IGNORECASE)
# Faults in flight that PX4 reports with the words of a check before take-off.
FAULT_IN_FLIGHT = re.compile(r"preflight.*(fault|failure|terminat)", re.IGNORECASE)
# The autopilot's computer, of which a flight feels nothing.
COMPUTER = re.compile(r"timesync|low on stack|ram usage", re.IGNORECASE)
# Measured values such as times and voltages, and cores of a lane switch, but no numbers of sensors.
MEASURED = re.compile(r"[-+]?\d+\.\d+|[-+]?\d{3,}|(?<=changed )\d|(?<=-> )\d|\d+(?= ?(us|ms|s|V|m|m/s|deg|%)(\W|$))")


def message_events(log: FlightLog, quoted: Iterable[Text], segments: Segments) -> list[Event]:
    """Return warnings and errors of the autopilot that no other event quotes, one event for each cause.

    Severity is warning in flight, or while armed for a vehicle that may have flown or does not fly, else note.
    """
    taken = {(t, text) for t, _, text in quoted}
    texts = sorted((x for x in log.texts if is_warning(x) and (x[0], x[2]) not in taken), key=lambda x: x[0])
    in_use = _spans_in_use(log, segments)
    refused, failing = _refusals(texts), _device_errors(texts)
    apart = {id(x) for group in (*refused, *failing.values()) for x in group}
    found = [_refused_event(group, log, segments) for group in refused]
    found += [_device_event(module, group, in_use) for module, group in failing.items()]
    left = _by_cause(x for x in texts if id(x) not in apart)
    return [*found, *(_message_event(group, in_use) for group in left[:MAX_MESSAGES])]


def _spans_in_use(log: FlightLog, segments: Segments) -> list[Span]:
    """Return flights, or armed spans where flights are unknown or the vehicle does not fly."""
    flights = segments.spans("airborne")
    if not flights and (not log.kind.flies or "airborne" in segments.unknown):
        flights = armed_spans(log, segments)
    return [(a - MESSAGE_MARGIN_S, b + MESSAGE_MARGIN_S) for a, b in flights]


def armed_spans(log: FlightLog, segments: Segments) -> list[Span]:
    """Return the armed spans, as logged where a log has no segments."""
    line = log.state.armed
    if segments.spans("armed") or line is None or not len(line.t):
        return segments.spans("armed")
    begins = line.t.tolist()
    return [(a, b) for a, b, on in zip(begins, [*begins[1:], log.seconds], line.value, strict=True) if on and b > a]


def motors_never_ran(segments: Segments) -> bool:
    """Return whether the drive is logged and stayed at rest: the vehicle never armed then, or to no effect."""
    air = segments.air
    return air is not None and air.power_source not in ("", "arming") and not bool(np.any(air.driven))


def _by_cause(texts: Iterable[Text], cause: Callable[[Text], str] | None = None) -> list[list[Text]]:
    """Group texts that are equal without their measured values, or of one ``cause``."""
    groups: dict[str, list[Text]] = {}
    for text in texts:
        groups.setdefault(MEASURED.sub("#", clean_text(text[2])) if cause is None else cause(text), []).append(text)
    return list(groups.values())


def _any_inside(texts: Sequence[Text], spans: list[Span]) -> bool:
    return bool(inside(np.array([t for t, _, _ in texts]), spans).any())


def _end(texts: Sequence[Text]) -> float | None:
    return texts[-1][0] if len(texts) > 1 else None


def _counted(n: int) -> str:
    """Format a number of repetitions, empty for one."""
    return f" ({n:,} times)" if n > 1 else ""


# --- arming ------------------------------------------------------------------------------------------------------


def _reason(text: Text) -> str:
    said = clean_text(text[2])
    return REFUSED.sub("", said) or said


def _refusals(texts: Iterable[Text]) -> list[list[Text]]:
    """Return the answers to attempts to arm, by reason."""
    return _by_cause((x for x in texts if REFUSED.search(clean_text(x[2]))), _reason)


def _refused_event(texts: Sequence[Text], log: FlightLog, segments: Segments) -> Event:
    """Return the refusals of arming for one reason: a warning where the vehicle is known not to arm afterwards."""
    t, reason = texts[0][0], _reason(texts[0])
    unknown = "armed" in segments.unknown and not motors_never_ran(segments)
    armed_later = unknown or any(end > t for _, end in armed_spans(log, segments))
    text = f"Arming was refused {format_time(t)}: “{reason}”{_counted(len(texts))}."
    weight: EventSeverity = "note" if armed_later else "warning"
    return Event("arming_refused", t, weight, text, _end(texts), evidence=[quote_text(texts[0])], quote=reason)


# --- devices -----------------------------------------------------------------------------------------------------


def _device_errors(texts: Iterable[Text]) -> dict[str, list[Text]]:
    """Return the errors of drivers by module of PX4, where a driver reports many."""
    modules: dict[str, list[Text]] = {}
    for text in texts:
        prefix = PREFIX.match(" ".join(text[2].split()))
        module = "" if prefix is None else prefix.group().strip("[] ")
        if module and text[1] <= ERROR and not (NO_DRIVER.search(module) or PREARM.search(clean_text(text[2]))):
            modules.setdefault(module, []).append(text)
    return {module: errors for module, errors in modules.items() if len(errors) >= MIN_DEVICE_ERRORS}


def _device_event(module: str, texts: Sequence[Text], in_use: list[Span]) -> Event:
    """Return the errors of one driver as one event: the most frequent ones with their number."""
    t = texts[0][0]
    kinds = sorted(_by_cause(texts), key=len, reverse=True)
    parts = []
    for same in kinds[:MAX_DEVICE_TEXTS]:
        since = f" from {same[0][0]:.1f} s" if same[0][0] > t + LATER_S else ""
        parts.append(f"“{clean_text(same[0][2])}” {len(same):,} times{since}")
    text = f"{module} reported errors {format_time(t)} and later: {', '.join(parts)}."
    weight: EventSeverity = "warning" if _any_inside(texts, in_use) else "note"
    evidence = [f"{quote_text(same[0])}{_counted(len(same))}" for same in kinds[:MAX_DEVICE_TEXTS]]
    return Event("device_error", t, weight, text, _end(texts), float(len(texts)), "texts", evidence, parts[0])


# --- others ------------------------------------------------------------------------------------------------------


def _message_event(texts: Sequence[Text], in_use: list[Span]) -> Event:
    """Return a message with the number of its repetitions."""
    first = texts[0]
    on_ground = PREARM.search(clean_text(first[2])) and not FAULT_IN_FLIGHT.search(first[2])
    harmless = on_ground or COMPUTER.search(first[2])
    weight: EventSeverity = "warning" if _any_inside(texts, in_use) and not harmless else "note"
    words = clean_text(first[2])
    text = f"“{words}”{_counted(len(texts))}."
    return Event("message", first[0], weight, text, _end(texts), evidence=[quote_text(first)], quote=words)


# --- parameters --------------------------------------------------------------------------------------------------

# Time after the start of log or flight from which a change is no late record of an older value, and time between
# changes of one event.
SETTLED_S, TOGETHER_S = 1.0, 60.0
# Changes named in an event.
MAX_CHANGES = 3
# Parameters that firmware or ground station write by themselves: statistics, ground pressure, learned hover throttle,
# servo trim and ratio of airspeed, stream rates, flight counters; and those of a simulator.
BY_ITSELF = re.compile(
    r"^(STAT_|(BARO|GND_)\w*PRESS|(Q_M|MOT)_THST_HOVER|SERVO\d+_TRIM|ARSPD\d?_RATIO|SR\d_|COM_FLIGHT_UUID|LND_FLIGHT_T|"
    r"MIS_TOTAL|FENCE_TOTAL)"
)
OF_SIMULATOR = re.compile(r"^SIM_")


def parameter_events(log: FlightLog, segments: Segments) -> list[Event]:
    """Return changes of parameters in flight, those within a minute as one event; a simulator's are notes."""
    flown = [(a + SETTLED_S, b) for a, b in segments.spans("airborne") if b - a > SETTLED_S]
    changes: list[tuple[float, str, float, float]] = []
    for name, line in log.parameters.lines.items():
        if len(line.value) > 1 and not BY_ITSELF.search(name):
            steps = zip(line.t.tolist()[1:], line.value, line.value[1:], strict=False)
            changes += [(t, name, before, after) for t, before, after in steps if t > SETTLED_S]
    kept = [c for c, use in zip(changes, inside(np.array([c[0] for c in changes]), flown), strict=True) if use]
    groups: list[list[tuple[float, str, float, float]]] = []
    for change in sorted(kept):
        simulator = bool(OF_SIMULATOR.search(change[1]))
        near = groups and change[0] - groups[-1][-1][0] <= TOGETHER_S
        if near and simulator == bool(OF_SIMULATOR.search(groups[-1][-1][1])):
            groups[-1].append(change)
        else:
            groups.append([change])
    return [_parameter_event(group) for group in groups]


def _parameter_event(changes: Sequence[tuple[float, str, float, float]]) -> Event:
    """Return changed parameters as one event, with old and new values."""
    said = [f"{name} from {before:g} to {after:g} at {t:.1f} s" for t, name, before, after in changes]
    more = f" and {len(said) - MAX_CHANGES} more" if len(said) > MAX_CHANGES else ""
    t, name = changes[0][0], changes[0][1]
    what = "Parameters" if len(said) > 1 else "Parameter"
    text = f"{what} changed in flight: {', '.join(said[:MAX_CHANGES])}{more}."
    weight: EventSeverity = "note" if OF_SIMULATOR.search(name) else "warning"
    t_end = changes[-1][0] if len(changes) > 1 else None
    return Event("parameter_changed", t, weight, text, t_end, float(len(said)), "parameters", said)
