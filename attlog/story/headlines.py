"""Write the headline: up to three sentences of 30 words on what flew, when, what went wrong first, and how it ended."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.brief import first_part
from attlog.core.sorting import quantile
from attlog.core.spans import Span, inside
from attlog.flight.model import FlightLog
from attlog.flight.vehicle import VehicleKind
from attlog.segments.airborne import MAX_IDLE_POWER
from attlog.segments.flight_signs import speed_at, true_runs
from attlog.segments.heights import highest_level
from attlog.segments.impacts import CrashEvent
from attlog.segments.model import Segments
from attlog.story import causes, drive_events, failsafe_events
from attlog.story.flight_events import (
    FULL_PEAK_HZ,
    MOTOR_TEST,
    Event,
    format_significant,
    format_size,
    format_time,
    impact_limit_text,
    matching_texts,
    overturn_word,
)

Array = NDArray[np.float64]

# --- flight ------------------------------------------------------------------------------------------------------

# Throttle-up spans closer than this are merged.
MAX_THROTTLE_PAUSE_S = 5.0
# Time armed before lift-off above which it is mentioned, and least speed of a vehicle that does not stand.
STOOD_S, TAXI_M_S = 10.0, 3.0
# Fewer flights than this are listed with their times; more are only counted.
LISTED = 3
# Throttle counts as up above this share of its maximum.
OF_FLIGHT = 0.5
# Largest tilt of a vehicle that ended upright.
UPRIGHT_DEG = 30.0
# Ranges while throttle is up that show the rangefinder unmoved.
MIN_RANGES = 10
# On the ground, above this speed a vehicle moves. Below, it moves where its speed stays above MIN_SPEED_M_S and four
# times the lowest quarter, which is the scatter of a receiver that stands, for 3 s.
FAST_M_S, MIN_SPEED_M_S, SPEED_SCATTERS, MIN_MOVING_S = 0.5, 0.2, 4.0, 3
# Smallest turn that is mentioned, and turn of a second that is more than the heading's drift.
MIN_TURNED_DEG, TURNING_DPS = 20.0, 2.0


def flight_phrases(log: FlightLog, segments: Segments, events: Sequence[Event]) -> list[str]:
    """Return phrases on flights, height and tilt, or why none was flown; longest first."""
    flights = segments.spans("airborne")
    crashed = any(e.is_crash for e in events)
    if not flights:
        return _grounded_phrases(log, segments, events)
    counted = f"{number_word(len(flights))} flights from {flights[0][0]:.0f} s"
    few = len(flights) < LISTED
    listed = f"flew {format_spans(flights)}" if few else counted
    begun = flights[0][0] - min((s.t0 for s in segments.of("continuous")), default=0.0) < 0.5
    if begun and len(flights) == 1:
        listed = f"flying as the log begins, to {flights[0][1]:.0f} s"
    slow = segments.air is not None and segments.air.grid.slow
    rate = max((imu.acc.rate for imu in log.imus), default=0.0)
    listed = f"telemetry at {rate:.0f} Hz, {listed}" if slow and rate else listed
    stood = (
        f"stood armed to {flights[0][0]:.0f} s, "
        if few and not begun and _stood_armed(log, segments, flights[0][0])
        else ""
    )
    sizes = [] if crashed else _size_phrases(log, segments, flights)
    unended = crashed or has_open_end(events) or any(e.kind == "hard_landing" for e in events)
    unended = unended or (segments.air is not None and not segments.air.known)
    safe = "" if unended else ending_of_slow(log, flights[-1][1]) if slow else ", landed safely"
    said = [f"{listed}{extra}{safe}." for extra in (*sizes, "")]
    if 1 < len(flights) < LISTED:
        said.append(f"{counted}{safe}.")
    return [f"{stood}{said[0]}", *said] if stood else said


def ending_of_slow(log: FlightLog, t: float) -> str:
    """Return the final tilt as a phrase, for an IMU too slow to show the landing."""
    tilt = largest_tilt(log, [(t + 2.0, t + 5.0)])
    return "" if tilt is None else ", ended upright" if tilt < UPRIGHT_DEG else f", ended at {tilt:.0f}° of tilt"


def number_word(n: int) -> str:
    return ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")[n] if n < 10 else str(n)


def _size_phrases(log: FlightLog, segments: Segments, flights: Sequence[Span]) -> list[str]:
    """Return phrases on maximum height and tilt, longest first."""
    air = segments.air
    found = None if air is None else highest_level(air.levels, inside(air.grid.t, flights))
    top = None if found is None else found[1]
    tilt = largest_tilt(log, flights)
    high = "" if top is None else f"{top:.0f} m" if top >= 2.0 else f"{top:.1f} m"
    tilted = "" if tilt is None or tilt < 1.0 else f"{tilt:.0f}° of tilt"
    both = " and ".join(x for x in (high, tilted) if x)
    return [f", up to {x}" for x in dict.fromkeys((both, high)) if x]


def largest_tilt(log: FlightLog, spans: Sequence[Span]) -> float | None:
    """Return the largest tilt (deg) of the onboard attitude within spans, None without one."""
    attitude = log.onboard_attitude or log.truth
    mine = None if attitude is None else inside(attitude.t, spans)
    if attitude is None or mine is None or not mine.any():
        return None
    return float(np.degrees(np.max(rotation.tilt_angle(attitude.q[mine]))))


def _stood_armed(log: FlightLog, segments: Segments, liftoff: float) -> bool:
    """Return whether the vehicle was armed for more than 10 s before lift-off and did not taxi."""
    begin = next((a for a, b in segments.spans("armed") if a < liftoff <= b and liftoff - a > STOOD_S), None)
    return begin is not None and not np.any(speed_at(log, np.arange(begin, liftoff - STOOD_S, 1.0)) > TAXI_M_S)


def _grounded_phrases(log: FlightLog, segments: Segments, events: Sequence[Event]) -> list[str]:
    """Return phrases for a log without flight."""
    # the duration includes failsafes after the last sample, but not other texts
    seconds = max([log.seconds, *(e.t for e in events if e.kind in ("failsafe", "battery"))])
    total = f"{seconds:.0f} s"
    if not log.kind.flies:
        return [_ground_phrase(log, segments, total)]
    if "airborne" in segments.unknown:
        return [f"{f'{total}; ' if seconds > 0 else ''}nothing in the log shows whether it flew."]
    if any(e.is_crash for e in events):
        return ["never flew."]
    armed = sum(e.kind == "armed" for e in events)
    refused = next((e for e in events if e.kind == "arming_refused" and e.severity == "warning"), None)
    if refused is not None:
        return [f"not armed in {total}. {refused.text}", f"not armed: “{refused.quote}”."]
    pushed = _throttle_spans(segments)
    if not pushed:
        if not armed:
            never = "never armed" if log.state.armed is not None else _undriven_phrase(segments)
            never = "only motor tests" if matching_texts(log, MOTOR_TEST) else never
            tilt = largest_tilt(log, [(-1e9, 1e9)])
            return [f"{never} in {total}" + (f", tilted up to {tilt:.0f}° by hand." if tilt and tilt > 15 else ".")]
        return [f"armed{_times(armed)} but never left the ground in {total}."]
    up = f"throttle up {format_spans(pushed)}" if len(pushed) < LISTED else f"throttle up {how_often(len(pushed))}"
    reason = _still_reason(log, segments, pushed)
    often = f"armed {how_often(armed)}, " if armed > 1 else ""
    return [f"never left the ground in {total}; {often}{up}{x}." for x in (reason, "")] + [
        f"never left the ground; {up}."
    ]


def _undriven_phrase(segments: Segments) -> str:
    """Return the phrase on a vehicle without arming that did not fly: by its drive, where one was logged."""
    air = segments.air
    driven = air is not None and air.power_source not in ("", "arming")
    return "motors never ran" if driven else "never left the ground"


def _ground_phrase(log: FlightLog, segments: Segments, total: str) -> str:
    """Return how a vehicle on the ground or in water moved and turned, by its speed every second."""
    t = np.arange(0.0, max(log.seconds, 1.0), 1.0)
    speed = speed_at(log, t)
    if not np.isfinite(speed).any():
        return _armed_phrase(log, segments, total)
    speed = np.nan_to_num(speed)
    slow = max(MIN_SPEED_M_S, SPEED_SCATTERS * float(quantile(speed, 0.25)))
    runs = [(a, b) for a, b in true_runs(speed > min(slow, FAST_M_S)) if b - a >= MIN_MOVING_S]
    top = float(speed.max())
    if not runs and top <= FAST_M_S:
        return f"stood still for {total}."
    fast = f"at up to {format_significant(top)} m/s"
    if not runs or top > FAST_M_S:
        return f"moved {fast} in {total}."
    metres = sum(float(speed[a:b].sum()) for a, b in runs)
    begin, end = float(t[runs[0][0]]), min(float(t[runs[-1][1] - 1]) + 1.0, max(log.seconds, 1.0))
    turned = _turned_deg(log, segments, t)
    turn = f", turned by {turned:.0f}°" if turned > MIN_TURNED_DEG else ""
    return f"moved {format_significant(metres)} m {fast} from {begin:.0f} to {end:.0f} s of {total}{turn}."


def _turned_deg(log: FlightLog, segments: Segments, t: Array) -> float:
    """Return the net turn of the heading in deg at times ``t`` (n,) s, 0 where it is unknown or was reset."""
    attitude = log.onboard_attitude
    if attitude is None or len(attitude.t) < 2 or segments.of("reset"):
        return 0.0
    heading = np.degrees(np.unwrap(rotation.to_euler(attitude.q)[:, 2]))
    steps = np.diff(np.interp(t, attitude.t, heading))
    return abs(float(steps[np.abs(steps) > TURNING_DPS].sum()))


def _armed_phrase(log: FlightLog, segments: Segments, total: str) -> str:
    """Return when a vehicle without a logged speed was armed."""
    armed = segments.spans("armed")
    if log.state.armed is None:
        return f"logged for {total}."
    if not armed:
        return f"never armed in {total}."
    return (
        f"armed {format_spans(armed)} of {total}." if len(armed) < LISTED else f"armed{_times(len(armed))} in {total}."
    )


def _times(n: int) -> str:
    return f" {how_often(n)}" if n > 1 else ""


def how_often(n: int) -> str:
    return "twice" if n == 2 else f"{number_word(n)} times"


def _throttle_spans(segments: Segments) -> list[Span]:
    """Return spans of at least 1 s with throttle up, merged across pauses of 5 s."""
    air = segments.air
    if air is None or not air.driven.any() or air.power_source == "arming":
        return []
    up = air.driven & (air.power > max(OF_FLIGHT * float(air.power[air.driven].max()), MAX_IDLE_POWER))
    found: list[Span] = []
    for a, b in true_runs(up):
        t0, t1 = float(air.grid.t[a]), float(air.grid.t[b - 1])
        if found and t0 - found[-1][1] < MAX_THROTTLE_PAUSE_S:
            found[-1] = found[-1][0], t1
        else:
            found.append((t0, t1))
    return [s for s in found if s[1] - s[0] >= 1.0]


def _still_reason(log: FlightLog, segments: Segments, pushed: Sequence[Span]) -> str:
    """Return the evidence against flight: unchanged rangefinder, small tilt."""
    tilt = largest_tilt(log, pushed)
    levels = segments.air.levels if segments.air is not None else []
    near = np.zeros(0) if log.rangefinder is None else log.rangefinder.x[inside(log.rangefinder.t, pushed)]
    ranged = np.count_nonzero(np.isfinite(near)) >= MIN_RANGES and all(level.sensor != "range" for level in levels)
    said = ["rangefinder unmoved"] if ranged else []
    said += [f"tilt under {max(np.ceil(tilt), 1):.0f}°"] if tilt is not None and tilt < 15.0 else []
    return f"; {', '.join(said)}" if said else ""


def format_spans(spans: Sequence[Span]) -> str:
    """Format spans as "11 to 103 s and 120 to 130 s"."""
    return " and ".join(f"{a:.0f} to {b:.0f} s" for a, b in spans)


def has_open_end(events: Sequence[Event]) -> bool:
    return any(e.kind == "ends_in_air" for e in events)


# Most words of a headline.
WORDS = 30
# Crash events closer than this are one crash.
MAX_CRASH_GAP_S = 5.0
# Longest time from the kill switch to the hard landing that it caused.
KILLED_S = 5.0
# Impacts above this height are not with the ground.
HIGH_M = 5.0
NAMES = {"Copter": "ArduCopter", "Plane": "ArduPlane", "Rover": "ArduRover", "Sub": "ArduSub"}
# Event kinds that may explain a crash.
TOLD_FIRST = (
    *drive_events.LASTING,
    "clipping",
    "vibration",
    "radio_lost",
    "failsafe",
    "battery",
    "realigned",
    "lane_switch",
    "compass_switch",
    "aid_rejected",
    "gnss_lost",
    "gnss_jump",
    "gnss_interference",
    "device_error",
    "parameter_changed",
    "sensor_fault",
)
# Kinds that go before an earlier alignment of the yaw, which metal near the ground causes at many a take-off.
BEFORE_REALIGNED = ("clipping", "failsafe", "battery", "gnss_lost", "parameter_changed", "sensor_fault")
# Longest time from a changed parameter to a fault that it may explain; before that it was tuned without harm.
CHANGED_S = 10.0
# Margin after the first lift-off and before the last landing for an angle wrong throughout.
THROUGHOUT_S = 10.0


class WrongAngle(NamedTuple):
    """Wrong angle (tilt, heading) of the onboard attitude from ``t`` to ``t_end`` s; ``why`` empty where unknown."""

    angle: str
    size_deg: float
    t: float
    t_end: float
    why: str = ""


def headline(
    log: FlightLog,
    segments: Segments,
    events: Sequence[Event],
    sound: bool = True,
    wrong: WrongAngle | None = None,
    trouble: str = "",
) -> str:
    """Return the longest headline of at most 30 words, without whole sentences where all are too long.

    ``events``: of the flight, in time order. ``sound``: no finding is a warning. ``wrong``: angle of the onboard
    attitude that was wrong in flight. ``trouble``: name of the first serious finding, for a log without flight.
    """
    who = f"{_vehicle(log)}, {_firmware(log)}" if _firmware(log) else _vehicle(log)
    flew, end = flight_phrases(log, segments, events), _ending_phrases(log, segments, events, sound)
    if trouble and not segments.spans("airborne") and not any(e.severity == "serious" for e in events):
        end = [f"{text} Serious: {trouble}.".strip() for text in end]
    broken = drive_events.drive_phrase(events)
    if broken:
        # The size of an impact goes before the part that broke.
        end = [*end, *(re.sub(r" \([^()]*\)", "", text) for text in end)]
    fault = failsafe_events.failsafe_phrases(_first_fault(segments, events), log, segments, events)
    first = _with_angle(fault, wrong, segments, broken)
    for a, c, b in _wordings(flew, first, end, bool(broken)):
        # a part that failed after the first crash explains a later one
        parts = (a, b, c) if broken and not drive_events.fails_before_crash(events) else (a, c, b)
        said = f"{who}: " + " ".join(x for x in parts if x)
        if len(said.split()) <= WORDS and (a or b or c):
            return said
    return f"{who}: {end[-1] or flew[-1]}"


def _wordings(
    flew: Sequence[str], first: Sequence[str], end: Sequence[str], broken: bool
) -> Iterator[tuple[str, str, str]]:
    """Yield flight, first fault and ending in shorter and shorter wordings, then without whole sentences.

    What went wrong first goes before the flights, a ``broken`` part after them; the ending stays.
    """
    kept = ([""], first) if broken else (flew, [""])
    gone = (flew, [""]) if broken else ([""], first)
    for a, c in ((flew, first), kept, gone, ([""], [""])):
        yield from ((x, y, z) for z, y, x in itertools.product(end, c, a))


def _vehicle(log: FlightLog) -> str:
    """Return the vehicle's usual name, with "simulated" for a simulation."""
    name = log.vehicle if log.vehicle not in ("unknown", "generic", "") else "vehicle"
    name = name[0].upper() + name[1:]
    return f"{name} (simulated)" if log.simulated else name


def _firmware(log: FlightLog) -> str:
    """Return firmware and version as usually written: ArduCopter 4.7-dev, PX4 1.14.3."""
    version = log.firmware.version
    family, _, number = version.partition(" ")
    if log.firmware.name == "ArduPilot" and family in NAMES:
        said = f"{NAMES[family]} {number}"
    else:
        said = f"{log.firmware.name} {version}"
    return re.sub(r"(\d+\.\d+)\.0[- ]dev\b", r"\1-dev", said).replace(" dev", "-dev").strip()


def _first_fault(segments: Segments, events: Sequence[Event]) -> list[str]:
    """Return phrases on the first fault, before a crash if any; longest first."""
    crash = next((e.t for e in events if e.is_crash), np.inf)
    found = [e for e in events if e.severity == "warning" and e.kind in TOLD_FIRST and e.t <= crash]
    found = [e for e in found if e.about != failsafe_events.KILL]
    if not found:
        return [""]
    first = next((e for e in found if e.kind == "clipping"), None) if found[0].kind == "vibration" else None
    if found[0].kind == "realigned":
        first = next((e for e in found if e.kind in BEFORE_REALIGNED), None)
    fault = next((e for e in found if e.kind != "parameter_changed"), None)
    if found[0].kind == "parameter_changed" and fault is not None:
        change = [e for e in found if e.kind == "parameter_changed" and e.t <= fault.t][-1]
        first = change if fault.t - (change.t_end or change.t) <= CHANGED_S else fault
    first = first or found[0]
    since = f"{first.t:.0f} s" if first.t_end else f"{first.t:.1f} s"
    shaken = next((e for e in found if e.kind == "vibration" and e.value), None)
    words = {
        "clipping": f"Accelerometer clipped from {first.t:.0f} s",
        "vibration": f"Strong vibration ({format_significant(first.value or 0.0)} m/s²) from {first.t:.0f} s",
        "radio_lost": f"No {first.about or 'radio signal'} from {first.t:.0f} s",
        "failsafe": first.text.rstrip("."),
        "battery": first.text.rstrip("."),
        "realigned": _realigned([e for e in found if e.kind == "realigned"]),
        "lane_switch": f"EKF switched lanes at {since}",
        "compass_switch": f"Compass changed at {since}",
        "aid_rejected": f"The EKF rejected its {first.about} from {since}",
        "gnss_lost": f"GNSS {'messages missing' if first.about == 'messages' else 'lost'} from {since}",
        "gnss_interference": f"“{first.quote}” {format_time(first.t)}",
        "device_error": first.quote,
        "parameter_changed": _changed_parameters(first),
        "sensor_fault": first.text.rstrip("."),
        **dict.fromkeys(drive_events.LASTING, first_part(first.text, ": ").rstrip(".")),
        "gnss_jump": first_part(first.text, ",").rstrip("."),
    }[first.kind]
    more = f" (vibration {format_significant(shaken.value or 0.0)} m/s²)" if first.kind == "clipping" and shaken else ""
    so = _effect_phrase(first, events)
    return [*dict.fromkeys((f"{words}{more}{so}.", f"{words}{so}.", f"{words}{more}.", f"{words}.")), ""]


def _effect_phrase(first: Event, events: Sequence[Event]) -> str:
    """Return what the first fault caused: the last failsafe, or switches of the estimator; empty for neither."""
    results = [event for event in causes.effects(first, events) if event.severity == "warning"]
    failsafes = [event for event in results if event.kind == "failsafe"]
    if failsafes:
        return f", hence {causes.effect_phrase(failsafes[-1].text, failsafes[-1].t)}"
    for kind, words in (("lane_switch", "the EKF switched lanes"), ("sensor_switch", "the autopilot changed its IMU")):
        found = [event for event in results if event.kind == kind]
        if found:
            return f", so {words} {how_often(len(found)) if len(found) > 1 else f'at {found[0].t:.1f} s'}"
    return ""


def _with_angle(first: list[str], wrong: WrongAngle | None, segments: Segments, broken: str = "") -> list[str]:
    """Add a wrong attitude angle to the phrases on the first fault; after ``broken``, a part that failed."""
    flights = segments.spans("airborne")
    if wrong is None or not flights:
        return [broken] if broken else first
    whole = wrong.t <= flights[0][0] + THROUGHOUT_S and wrong.t_end >= flights[-1][1] - THROUGHOUT_S
    when = "throughout" if whole else f"from {wrong.t:.0f} to {wrong.t_end:.0f} s"
    said = f"{wrong.angle.capitalize()} was {wrong.size_deg:.0f}° wrong {when}"
    if broken:
        return [f"{broken} {said}.", broken]
    every = [f"{said}: {wrong.why}", said] if wrong.why else [said]
    return [text for one in every for text in (*(f"{one}. {text}" for text in first if text), f"{one}.")]


def _changed_parameters(event: Event) -> str:
    """Return one changed parameter with its values, two by name, or the number of more."""
    names = [text.partition(" ")[0] for text in event.evidence]
    if len(names) == 1:
        return event.evidence[0].replace(" from ", " changed from ", 1)
    what = " and ".join(names) if len(names) == 2 else f"{len(names)} parameters"
    return f"{what} changed from {event.t:.1f} s on"


def _realigned(found: Sequence[Event]) -> str:
    times = [f"{e.t:.1f}" if e.t < 100 else f"{e.t:.0f}" for e in found]
    if len(times) > 2:
        return f"EKF re-aligned yaw {how_often(len(times))}"
    return f"EKF re-aligned yaw at {' and '.join(times)} s"


def _ending_phrases(log: FlightLog, segments: Segments, events: Sequence[Event], sound: bool) -> list[str]:
    """Return phrases on how the flight ended, longest first."""
    crashes = _crashes(segments.crash_events)
    if crashes:
        impact = next((e for e in crashes[0] if e.kind == "impact"), crashes[0][0])
        full, short = _crash_phrases(crashes[0], _crash_target(log.kind, segments, impact))
        if len(crashes) == 1:
            bare = re.sub(r"^Struck .*?, hit", "Hit", first_part(short, ", then "))
            return list(dict.fromkeys((f"{full}.", f"{short}.", f"{bare}.")))
        again = f"; crashed again at {crashes[1][0].t:.1f} s"
        sizes = f"{again}{_size(crashes[1])}"
        bare = short.partition(" (")[0]  # drop the first crash's size rather than the second crash
        return list(dict.fromkeys((f"{full}{sizes}.", f"{short}{sizes}.", f"{bare}{again}.")))
    warned = any(e.severity in ("warning", "serious") for e in events if e.kind != "hard_landing")
    hard = [e for e in segments.crash_events if e.kind == "hard_landing"]
    if hard:
        worst = max(hard, key=lambda e: e.size)
        killed = next((e for e in events if e.about == failsafe_events.KILL and 0 <= worst.t - e.t < KILLED_S), None)
        before = f"Kill switch at {killed.t:.1f} s, then hard landing" if killed else "Hard landing"
        hit = f"{before} at {worst.t:.1f} s ({format_size(worst)})"
        return [
            *([f"{hit}, upright; nothing else went wrong."] if sound and not warned else []),
            f"{hit}, upright.",
            f"{hit}.",
        ]
    if has_open_end(events):
        return [first_part(next(e.text for e in events if e.kind == "ends_in_air"), ",") + "."]
    unknown = segments.air is not None and not (segments.air.known and log.imus)
    cannot = "Impacts cannot be determined." if segments.spans("airborne") and (unknown or _too_slow(log)) else ""
    if sound and not warned and segments.spans("airborne"):
        return [cannot or "Nothing went wrong."]
    return [cannot, ""] if cannot else [""]


def _too_slow(log: FlightLog) -> bool:
    """Return whether every IMU is too slow to show any impact."""
    rate = max((imu.acc.rate for imu in log.imus), default=0.0)
    return bool(impact_limit_text(log)) and rate < 0.1 * FULL_PEAK_HZ


def _crashes(endings: Sequence[CrashEvent]) -> list[list[CrashEvent]]:
    """Return the events of each crash, in time order."""
    groups: list[list[CrashEvent]] = []
    for ending in (e for e in endings if e.is_crash):
        if groups and ending.t - groups[-1][-1].t_end < MAX_CRASH_GAP_S:
            groups[-1].append(ending)
        else:
            groups.append([ending])
    return groups


def _size(group: Sequence[CrashEvent]) -> str:
    impact = next((e for e in group if e.kind == "impact"), None)
    return "" if impact is None else f" ({format_size(impact)})"


def _crash_target(kind: VehicleKind, segments: Segments, impact: CrashEvent) -> str:
    """Return what was hit: the ground or an obstacle; empty if it never flew."""
    if not segments.spans("airborne"):
        return ""
    air = segments.air
    if impact.in_air:
        return "something"
    if kind.winged:
        return "the ground"
    levels = [] if air is None else [level.above[air.grid.index(impact.t)] for level in air.levels]
    high = [x for x in levels if np.isfinite(x)]
    return "something" if high and max(high) > HIGH_M else "the ground"


# Verbs for an overturn before an impact, by its axis.
TURNED = {"roll": "Rolled", "pitch": "Pitched", "": "Tilted"}


def _crash_phrases(group: Sequence[CrashEvent], what: str) -> tuple[str, str]:
    """Return a long and a short phrase for a crash; ``what`` is the object hit or empty."""
    impact, over, spun = (next((e for e in group if e.kind == kind), None) for kind in ("impact", "overturn", "tumble"))
    if impact is not None:
        hit = f"hit {what or 'something'} at {impact.t:.1f} s ({format_size(impact)})"
        ground = next((e for e in group if e.kind == "impact" and not e.in_air), impact)
        if impact.in_air and ground is not impact:
            hit = f"struck in the air at {impact.t:.1f} s, hit the ground at {ground.t:.1f} s ({format_size(ground)})"
        harder = max((e for e in group if e.kind == "impact"), key=lambda e: e.size)
        hit += f", then {format_size(harder)} at {harder.t:.1f} s" if harder not in (impact, ground) else ""
        short = hit[0].upper() + hit[1:]
        if over is None:
            return f"{short}{_rest_phrase(impact)}", short
        if over.t <= impact.t:
            return f"{TURNED[over.axis]} to {over.size:.0f}° at {over.t:.1f} s and {hit}", short
        return f"{short} and turned over to {over.size:.0f}°", short
    if over is not None:
        last = [e for e in group if e.kind == "overturn"][-1]
        text = f"{overturn_word(over) if what else 'Flipped over at take-off'} at {over.t:.1f} s ({over.size:.0f}°)"
        later = f" and turned over at {last.t:.1f} s ({last.size:.0f}°)" if last is not over else ""
        return f"{text}{later}{_rest_phrase(last)}", text
    spin = spun or group[0]
    text = f"Tumbled at {spin.t:.1f} s ({spin.size:.0f}°/s)"
    return text, text


def _rest_phrase(ending: CrashEvent) -> str:
    """Return the phrase on the vehicle's tilt at rest after a crash."""
    angle = ending.lies_deg
    if angle is None:
        return ""
    return ", lay upside down" if angle > 150.0 else f", lay at {angle:.0f}°" if angle > 15.0 else ", upright"
