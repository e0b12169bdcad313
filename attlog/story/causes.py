"""Join events to the earlier events that caused them, by rules that each need evidence.

A rule joins two events only where something beside their order shows the cause: the text or mode that the autopilot
gives as reason, a loss that lasts when its effect comes, samples clipped just before, motors at zero in a free fall.
Without it events stay in time order. Rates of the rules: docs/story.md.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from attlog.core.brief import counted, first_part
from attlog.core.sorting import median
from attlog.core.spans import between
from attlog.flight.model import FlightLog
from attlog.story.drive_events import BROKEN, LASTING
from attlog.story.flight_events import CRASHES, Cause, Event, format_significant
from attlog.story.motor_faults import CAUSE_S

# Indices of cause and effect in a list of events, with the evidence.
Link = tuple[int, int, str]
Rule = Callable[[FlightLog, Sequence[Event]], Iterator[Link]]


def link(log: FlightLog, events: list[Event]) -> list[Event]:
    """Return the events, in time order, with the cause of each where evidence shows one."""
    causes: dict[int, tuple[int, str]] = {}
    for rule in RULES:
        for cause, effect, evidence in rule(log, events):
            if cause != effect and effect not in causes and not _explains(causes, effect, cause):
                causes[effect] = cause, evidence
    return [
        event if k not in causes else replace(event, cause=_cause(events[causes[k][0]], causes[k][1]))
        for k, event in enumerate(events)
    ]


def _explains(causes: dict[int, tuple[int, str]], first: int, last: int) -> bool:
    """Return whether ``first`` is already a cause of ``last``, at any distance."""
    while last in causes:
        last = causes[last][0]
        if last == first:
            return True
    return False


def _cause(event: Event, evidence: str) -> Cause:
    return Cause(event.kind, event.t, event.text, evidence)


def follows(event: Event, earlier: Event) -> bool:
    """Return whether ``earlier`` is the direct cause of an event."""
    cause = event.cause
    return cause is not None and (cause.kind, cause.t, cause.text) == (earlier.kind, earlier.t, earlier.text)


def root(event: Event, events: Sequence[Event]) -> Event:
    """Return the first cause of an event among ``events``, the event itself without one."""
    for _ in events:
        earlier = next((e for e in events if follows(event, e)), None)
        if earlier is None:
            break
        event = earlier
    return event


def effects(event: Event, events: Sequence[Event]) -> list[Event]:
    """Return the events that an event caused, directly or not, in time order."""
    return [other for other in events if other is not event and root(other, events) is event]


def effect_phrase(text: str, t: float, lasts: bool = False) -> str:
    """Return the sentence of an event at ``t`` s as a clause with its time, without capital and full stop.

    ``lasts``: the sentence gives a span or a duration, of which the clause has the begin alone.
    """
    text = first_part(text.rstrip("."), ". ", ": ")
    if lasts:
        text = first_part(text, " for ", " from ") + f" from {t:.1f} s"
    elif not re.search(r"\b(at|from) [\d.]+", text):
        text += f" at {t:.1f} s"
    return text[:1].lower() + text[1:] if text[1:2].islower() or text[1:2] == " " else text


def _of(events: Sequence[Event], *kinds: str) -> Iterator[tuple[int, Event]]:
    """Yield index and event of the given kinds."""
    return ((k, event) for k, event in enumerate(events) if event.kind in kinds)


def _words(event: Event) -> str:
    return " ".join((event.text, *event.evidence))


# --- lost position ----------------------------------------------------------------------------------------------

# Time from a loss of GNSS to an effect: PX4 coasts for 1 to 7 s (COM_POS_FS_DELAY, EKF2_NOAID_TOUT), ArduPilot for 7
# to 10 s; messages about it end with the loss.
MIN_COAST_S, AFTER_LOSS_S = 0.5, 2.0
POSITION_WORDS = re.compile(
    r"invalid set-?points?|blind land|no (valid )?(local |global )?position|position (lost|estimate|unstable)|"
    r"bad position|requires position|EKF variance|EKF failsafe|stopped aiding|dead reckoning|(GNSS|GPS) failsafe",
    re.I,
)
# Failsafes with another cause: what the event is about, or the autopilot's words.
OTHER_FAILSAFES = frozenset({"kill switch", "radio", "ground station", "battery", "terrain", "vibration"})
OTHER_WORDS = re.compile(r"kill switch|radio|ground station|battery|terrain|vibration|attitude failure|crash", re.I)


def lost_position(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join lost GNSS to reports of a lost position while it lasts."""
    for k, lost in _of(events, "gnss_lost"):
        end = lost.t if lost.t_end is None else lost.t_end
        during = [
            (n, e)
            for n, e in _of(events, "failsafe", "message")
            if lost.t + MIN_COAST_S <= e.t <= end + AFTER_LOSS_S and not _has_other_cause(e)
        ]
        reported = [e.t for _, e in during if POSITION_WORDS.search(_words(e))]
        for n, event in during:
            unnamed = event.kind == "failsafe" and any(abs(event.t - t) <= AFTER_LOSS_S for t in reported)
            if unnamed or POSITION_WORDS.search(_words(event)):
                yield k, n, f"GNSS had been missing for {event.t - lost.t:.1f} s"


def _has_other_cause(event: Event) -> bool:
    """Return whether a failsafe or the autopilot's message has another cause than the position."""
    return event.about in OTHER_FAILSAFES or (event.kind == "message" and bool(OTHER_WORDS.search(event.quote)))


# Time from a jump of GNSS to its effect, and the smallest jump that explains one: default gate of ArduPilot's EKF
# (EK2_GLITCH_RAD, EK3_GLITCH_RAD). Less is as often the estimator's own error.
MAX_JUMP_S, MIN_JUMP_M = 10.0, 25.0


def jumped_position(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join a jump of GNSS against its own velocity to what the estimator did next."""
    for k, jump in _of(events, "gnss_jump"):
        if jump.value is None or jump.value < MIN_JUMP_M:
            continue
        for n, event in _of(events, "failsafe", "aid_rejected"):
            about = event.about == "position" or POSITION_WORDS.search(_words(event))
            if 0.0 <= event.t - jump.t <= MAX_JUMP_S and about and not _has_other_cause(event):
                yield k, n, f"GNSS position and velocity disagree by {jump.value:.0f} m"


# --- vibration --------------------------------------------------------------------------------------------------

# Time from clipped samples to the switch that they cause: an estimator's filter fault takes a second or two.
SHAKEN_S, SETTLE_S = 2.0, 0.3
# Resolution of vibration levels in time.
LEVEL_S = 1.0
VIBRATION_WORDS = re.compile(r"vibration comp|vibration failsafe|clipping", re.I)
# Time between a switch of sensor or lane and the jump of attitude that it brings.
SWITCH_S = 0.5


def shaken(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join vibration and clipping to switches of IMU and lane, and to the autopilot's reports of them."""
    for k, source in sorted(_of(events, "vibration", "clipping"), key=lambda pair: pair[1].kind):
        if source.severity == "note":
            continue
        end = source.t if source.t_end is None else source.t_end
        for n, event in _of(events, "clipping", "sensor_switch", "lane_switch", "failsafe", "message"):
            if not source.t - LEVEL_S <= event.t <= end + SHAKEN_S:
                continue
            if event.kind in ("failsafe", "message"):
                if VIBRATION_WORDS.search(event.text):
                    yield k, n, "in the autopilot’s words"
            elif event.kind != source.kind and (evidence := _shaking(log, source, event)):
                yield k, n, evidence


def _shaking(log: FlightLog, source: Event, switch: Event) -> str:
    """Return what shook just before a switch, empty if nothing did.

    Clipping shook where it has just begun, or is stronger than on the average.
    """
    if source.kind == "vibration":
        inside = source.t - LEVEL_S <= switch.t <= (source.t_end or source.t) + LEVEL_S
        return f"vibration of {format_significant(source.value or 0.0)} m/s² at that time" if inside else ""
    if not source.t - SETTLE_S <= switch.t:
        return ""
    began = switch.t - SHAKEN_S <= source.t
    seconds = max((source.t_end or source.t) - source.t, SHAKEN_S)
    for unit in _left_units(log, switch):
        settle = 0.0 if unit is None else SETTLE_S  # flags after a switch are those of the unit that took over
        count = _clipped(log, unit, switch.t - SHAKEN_S, switch.t + settle)
        usual = SHAKEN_S * _clipped(log, unit, source.t, source.t + seconds) / seconds
        if count and (began or count > usual):
            return f"{counted(count, 'sample')} clipped in the {SHAKEN_S:.0f} s before"
    return ""


def _left_units(log: FlightLog, switch: Event) -> list[int | None]:
    """Return the unit that was left, or every unit where it is unknown."""
    line = log.imu_that_flew
    if switch.kind == "sensor_switch" and line is not None:
        return [line.at(switch.t - 0.01), None]
    return list({c.unit for c in log.vibration.clippings})


def _clipped(log: FlightLog, unit: int | None, t0: float, t1: float) -> int:
    """Return the clipped samples of an accelerometer between two times."""
    counts = [
        int(c.new[between(c.t, t0, t1)].sum())
        for c in log.vibration.clippings
        if c.sensor == "accelerometer" and c.unit == unit
    ]
    return max(counts, default=0)


def jumped_by_switch(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join a switch of IMU or lane to the jump of attitude at it."""
    for k, switch in _of(events, "sensor_switch", "lane_switch"):
        for n, event in _of(events, "reset"):
            if 0.0 <= event.t - switch.t <= SWITCH_S:
                yield k, n, f"{1e3 * (event.t - switch.t):.0f} ms after it"


# --- compass ----------------------------------------------------------------------------------------------------

# Time from the end of a rejection to the new alignment: EKF3 gives a compass up after 10 s.
ALIGN_S = 2.0


def rejected_compass(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join a rejected compass to its replacement, or to a new alignment of yaw, while it lasts."""
    for k, event in _of(events, "aid_rejected"):
        if event.about != "compass":
            continue
        end = event.t if event.t_end is None else event.t_end
        for n, change in _of(events, "compass_switch", "realigned"):
            if event.t + MIN_COAST_S <= change.t <= end + ALIGN_S and change.severity == "warning":
                yield k, n, f"the EKF had rejected it from {event.t:.1f} s"


# Parameters that turn IMU or compass, or choose the source of the heading; time until the estimator reacts, and
# rounding of the times of events.
TURNING_PARAMETERS = re.compile(
    r"^(AHRS_ORIENTATION|COMPASS_(ORIENT|USE|ENABLE|EXTERN)\w*|EK[23]_(MAG_CAL|SRC\d_YAW)|EKF2_MAG_TYPE|"
    r"CAL_MAG\d_ROT|SENS_BOARD_ROT)$"
)
REACTS_S, ROUNDING_S = 3.0, 0.001


def changed_parameters(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join a parameter that turns a sensor or the heading to what the estimator did at once."""
    lines = log.parameters.lines.items()
    turned = [(t, name) for name, line in lines if TURNING_PARAMETERS.search(name) for t in line.t.tolist()[1:]]
    for k, change in _of(events, "parameter_changed"):
        end = change.t if change.t_end is None else change.t_end
        mine = [(t, name) for t, name in turned if change.t - ROUNDING_S <= t <= end + ROUNDING_S]
        for n, event in _of(events, "realigned", "reset", "compass_switch", "aid_rejected"):
            names = [name for t, name in mine if -ROUNDING_S <= event.t - t <= REACTS_S]
            if names and event.about != "height":
                yield k, n, f"{names[0]} acts on the heading"


# --- failsafes and landings -------------------------------------------------------------------------------------

# Time between a failsafe and the mode that it sets, and after landing until which the mode counts.
SET_S, LANDED_S = 1.5, 1.0
# Words of a failsafe by the reason of the mode.
REASON_WORDS = {
    "radio failsafe": "radio",
    "battery failsafe": "battery",
    "ground station failsafe": "ground station",
    "EKF failsafe": "ekf|gnss|position|vibration",
    "GNSS glitch": "ekf|gnss",
    "terrain failsafe": "terrain",
    "dead reckoning failsafe": "dead reckoning",
    "failsafe": "failsafe",
}


def ended_flight(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join a failsafe to the landing in the mode that it set, by the reason logged with the mode."""
    mode, reason = log.state.mode, log.state.mode_reason
    if mode is None or reason is None:
        return
    for n, landing in _of(events, "landing", "hard_landing"):
        last = int(np.searchsorted(mode.t, landing.t - LANDED_S, side="right")) - 1
        if last < 0:
            continue
        t, why = float(mode.t[last]), str(reason.at(float(mode.t[last])))
        words = REASON_WORDS.get(why, "")
        for k, event in _of(events, "failsafe", "battery"):
            if words and event.t <= landing.t and abs(event.t - t) <= SET_S and re.search(words, event.text, re.I):
                yield k, n, f"mode {mode.value[last]} set at {t:.1f} s, reason: {why}"


# Specific force below which a vehicle falls freely, and for how long; time from the stop of the motors to the impact.
FALL_M_S2, FALL_S, KILLED_S = 3.0, 0.1, 5.0
STOPPED = re.compile(r"emergency stop|terminat", re.I)


def stopped_motors(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join motors stopped in the air to the impact that follows, where the accelerometer shows a fall between."""
    for k, stop in _of(events, "failsafe", "disarmed"):
        if stop.kind == "failsafe" and not _stops_motors(stop):
            continue
        if any(e.kind in CRASHES and 0.0 <= stop.t - e.t <= KILLED_S for e in events):
            continue  # it was lost before
        for n, hit in _of(events, "impact", "hard_landing", "overturn"):
            if 0.0 < hit.t - stop.t <= KILLED_S and (fall := _fall_seconds(log, stop.t, hit.t)) >= FALL_S:
                yield k, n, f"free fall of {fall:.1f} s between them"


def _stops_motors(event: Event) -> bool:
    return event.about == "kill switch" or bool(STOPPED.search(event.text))


def _fall_seconds(log: FlightLog, t0: float, t1: float) -> float:
    """Return the time of free fall between two times, by the IMU with most samples."""
    forces = [np.linalg.norm(imu.acc.x[between(imu.acc.t_best, t0, t1)], axis=1) for imu in log.imus]
    most = max((force[np.isfinite(force)] for force in forces), key=len, default=np.zeros(0))
    return float((most < FALL_M_S2).mean()) * (t1 - t0) if len(most) > 1 else 0.0


# Time from the end of a loss of the radio to its failsafe.
AFTER_RADIO_S = 2.0
RADIO_WORDS = re.compile(r"radio|\brc\b|manual control", re.I)


def lost_radio(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join a lost radio to its failsafe."""
    for k, lost in _of(events, "radio_lost"):
        for n, event in _of(events, "failsafe", "message"):
            soon = lost.t <= event.t <= (lost.t_end or lost.t) + AFTER_RADIO_S
            if soon and RADIO_WORDS.search(_words(event)):
                yield k, n, f"no signal for {event.t - lost.t:.1f} s"


# --- crashes ----------------------------------------------------------------------------------------------------

# Shortest time from an overturn to the impact that it causes: tilt is slower, so within it the impact may be first.
MIN_FALL_S = 0.3
# Time after a crash in which the estimator's reports are its effects.
STRUCK_S = 2.0


def commanded_rotation(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join full stick, which the vehicle followed, to the crash, unless a part had broken just before."""
    for k, stick in _of(events, "full_stick"):
        crash = next(((n, e) for n, e in enumerate(events) if e.is_crash and e.t >= stick.t), None)
        if crash is None or any(-CAUSE_S <= e.t - crash[1].t <= 0.0 for _, e in _of(events, *BROKEN)):
            continue
        yield k, crash[0], f"it turned by {stick.value:.0f}° as commanded"


def broken_drive(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join the earliest fault of motors, thrust or control to the crash that follows within 5 s of it.

    Poor control and oscillation explain a crash only without a broken part, and only where they had just begun: a
    flight that survived them for longer was lost by something else.
    """
    crashes = [(n, e) for n, e in enumerate(events) if e.is_crash]
    since = -np.inf
    for n, crash in crashes:
        if crash.t - since <= CAUSE_S:
            since = crash.t_end or crash.t
            continue  # a later event of the same crash
        for kinds in (BROKEN, LASTING):
            near = [
                (k, e)
                for k, e in _of(events, *kinds)
                if since < e.t <= crash.t and crash.t - (e.t if kinds is LASTING else e.t_end or e.t) <= CAUSE_S
            ]
            if near:
                yield near[0][0], n, f"{crash.t - near[0][1].t:.1f} s before it"
                break
        since = crash.t_end or crash.t
    for k, fault in _of(events, "no_thrust_left"):
        for n, landing in _of(events, "hard_landing"):
            if fault.t < landing.t <= (fault.t_end or fault.t) + LANDED_S:
                yield k, n, f"it sank from {fault.t:.1f} s until then"


# Volts at a loss of thrust that show a weak battery, as share of those within RESTED_S of arming; longest time from the
# battery's report to the loss.
SAGGED_SHARE, RESTED_S, REPORTED_S = 0.9, 5.0, 120.0


def weak_battery(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join a reported low battery to a loss of thrust, where its volts have fallen by a tenth since arming."""
    battery = log.power.battery
    for n, fault in _of(events, "no_thrust_left"):
        for k, low in _of(events, "battery"):
            if battery is None or not 0.0 <= fault.t - low.t <= REPORTED_S:
                continue
            armed = max((e.t for _, e in _of(events, "armed") if e.t <= low.t), default=0.0)
            now = battery.x[between(battery.t, fault.t, fault.t_end or fault.t), 0]
            before = battery.x[between(battery.t, max(armed, 0.0) - RESTED_S, max(armed, 0.0) + RESTED_S), 0]
            if len(now) and len(before) and median(now) < SAGGED_SHARE * median(before):
                yield k, n, f"{median(now):.1f} V, {median(before):.1f} V at arming"


def lost_control(log: FlightLog, events: Sequence[Event]) -> Iterator[Link]:
    """Join an event of a crash to the next one, and a crash to reports just after it."""
    crashes = [(k, e) for k, e in _of(events, *CRASHES) if e.severity == "serious"]
    for k, crash in crashes:
        for n, hit in crashes:
            fall = MIN_FALL_S if hit.kind == "impact" else 0.0
            soon = crash.t + fall < hit.t <= (crash.t_end or crash.t) + CAUSE_S
            if k < n and crash.kind != hit.kind and soon and crash.about != "air":
                yield k, n, f"{hit.t - crash.t:.1f} s after it"
    for n, event in _of(events, "lane_switch", "sensor_switch", "reset", "failsafe", "compass_switch", "gnss_jump"):
        before = [(k, e) for k, e in crashes if 0.0 <= event.t - e.t <= STRUCK_S]
        if before and not _stops_motors(event):
            k, crash = before[-1]
            yield k, n, f"{event.t - crash.t:.1f} s after it"


RULES: tuple[Rule, ...] = (
    commanded_rotation,
    lost_radio,
    broken_drive,
    weak_battery,
    stopped_motors,
    lost_control,
    lost_position,
    jumped_position,
    shaken,
    jumped_by_switch,
    changed_parameters,
    rejected_compass,
    ended_flight,
)
