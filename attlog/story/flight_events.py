"""Events of movement, clipping and vibration, and the autopilot's texts by kind."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from attlog.core import rotation
from attlog.core.brief import brief, counted
from attlog.core.sorting import median, quantile
from attlog.core.spans import Span, between, inside, merge
from attlog.flight.model import VIBRATION_LIMITS, Array, Clipping, FlightLog, Stream
from attlog.segments.airborne import FLIGHT_SHARE, InAir
from attlog.segments.flight_signs import G
from attlog.segments.heights import height_stream
from attlog.segments.impacts import CrashEvent, shows_impacts
from attlog.segments.model import Segments
from attlog.segments.rest import vibration_levels

EventSeverity = Literal["info", "note", "warning", "serious"]
KINDS = (
    "power_up",
    "armed",
    "disarmed",
    "liftoff",
    "landing",
    "hard_landing",
    "impact",
    "overturn",
    "tumble",
    "wreck_moved",
    "ends_in_air",
    "motor_no_thrust",
    "motor_off",
    "motor_frozen",
    "motors_off",
    "no_thrust_left",
    "yaw_backwards",
    "rate_tracking",
    "oscillation",
    "clipping",
    "vibration",
    "realigned",
    "reset",
    "lane_switch",
    "sensor_switch",
    "compass_switch",
    "aid_rejected",
    "gnss_lost",
    "gnss_jump",
    "gnss_interference",
    "full_stick",
    "radio_lost",
    "failsafe",
    "battery",
    "arming_refused",
    "device_error",
    "parameter_changed",
    "sensor_fault",
    "message",
)
# Kinds of crash events, with severity ``serious``.
CRASHES = ("impact", "overturn", "tumble")


@dataclass(frozen=True, slots=True)
class Cause:
    """Earlier event that caused an event: its kind, time and text, and the evidence that joins them."""

    kind: str
    t: float
    text: str
    evidence: str


@dataclass(frozen=True, slots=True)
class Event:
    """Event at ``t`` s, or from ``t`` to ``t_end`` s, with its size and evidence.

    ``evidence``: sensors with their values, flags, and the autopilot's texts. ``quote``: the autopilot's own words,
    empty without any. ``about``: rejected aid, cause of a failsafe, "fix" or "messages" of lost GNSS, "air" of an
    impact above the ground, "pilot input" of a lost radio or joystick. ``cause``: None where no evidence shows one.
    ``part``: what failed (motor, motor output, thrust, propellers, control); ``motor``: its number from 1,
    ``position``: as "rear left".
    """

    kind: str
    t: float
    severity: EventSeverity
    text: str
    t_end: float | None = None
    value: float | None = None
    unit: str = ""
    evidence: list[str] = field(default_factory=list)
    quote: str = ""
    about: str = ""
    cause: Cause | None = None
    part: str = ""
    motor: int | None = None
    position: str = ""
    __repr__ = brief

    @property
    def is_crash(self) -> bool:
        """True if control or the vehicle was lost."""
        return self.kind in CRASHES and self.severity == "serious"


def format_significant(x: float, count: int = 2) -> str:
    """Format a size with at least ``count`` significant figures, no exponent: 4.6, 13, 250."""
    if x == 0.0:
        return "0"
    digits = count - len(str(int(abs(x)))) if abs(x) >= 1.0 else count
    return f"{x:.{max(digits, 0)}f}"


def format_time(t: float) -> str:
    """Format a time as ``at 12.3 s``; times just below zero become 0.0."""
    return f"at {max(t, 0.0) if t > -0.05 else t:.1f} s"


# --- texts of the autopilot --------------------------------------------------------------------------------------

Text = tuple[float, int, str]

# Syslog level (0 emergency to 7 debug) up to which a text is a warning.
WARNING = 4
# Words that make a text a warning: ArduPilot sends most texts with one level.
WARNING_WORDS = re.compile(
    r"fail|crash|glitch|variance|unhealthy|not healthy|inconsistent|error|lost|bad |emergency|terminat|estop|"
    r"thrust loss|imbalance|vibration comp|clipping|parachute|forced reset|stopped aiding|re-aligned|lane switch|"
    r"not safe|land now|too |needs calibration|low batt|battery \d? ?(is )?(low|critical)|rejected|timeout|breach|"
    r"dead reckon|kill.?switch|thrust|throttle not",
    re.IGNORECASE,
)
HARMLESS_WORDS = re.compile(
    r"failsafe (cleared|deactivated)|glitch cleared|autotest|^SRC=|^scenario: |no error|fail.?safe.*(off|disabled)",
    re.I,
)
REALIGNED = re.compile(r"yaw re-?aligned|yaw align|yaw reset|emergency yaw", re.IGNORECASE)
ANOMALY = re.compile(r"anomaly|re-?aligned|reset|emergency", re.IGNORECASE)
LANE = re.compile(r"lane switch|primary EKF changed|primary changed", re.IGNORECASE)
COMPASS = re.compile(r"switching to compass|(mag|compass).*(switch|failed|failover)", re.IGNORECASE)
JUMP = re.compile(r"gps glitch(?! cleared)|gnss.*jump", re.IGNORECASE)
INTERFERENCE = re.compile(r"(gps|gnss).*(jamm|spoof)", re.IGNORECASE)
CLIPS = re.compile(r"clipping", re.IGNORECASE)
CRASHED = re.compile(r"\bcrash(ed)?\b(?!.{0,2}(check|dump|log|catcher))|crash: disarm", re.IGNORECASE)
KILLED = re.compile(
    r"kill(.?switch)? engaged|motor ?e-?stop(ped)?( |:)*(high|on|engaged)?$|emergency stop", re.IGNORECASE
)
FAILSAFE = re.compile(r"failsafe", re.IGNORECASE)
BATTERY = re.compile(r"batt", re.IGNORECASE)
MOTOR_TEST = re.compile(r"^starting motor test", re.IGNORECASE)
# Reasons for not arming; in flight PX4 reports faults by the same words.
PREARM = re.compile(r"pre-?arm|preflight|^arm:|arming denied|arming_checks", re.IGNORECASE)
# Module of PX4 before a text, and maximum length of a quoted text.
PREFIX = re.compile(r"^\[[\w ]+\]\s*")
MAX_TEXT = 110


# Begin of evidence that quotes the autopilot.
QUOTED = "text at "


def clean_text(text: str) -> str:
    """Return a text in one line without its module prefix."""
    return PREFIX.sub("", " ".join(text.split()))[:MAX_TEXT].strip()


def quote_text(text: Text) -> str:
    """Format a text as evidence."""
    return f"{QUOTED}{text[0]:.1f} s: {clean_text(text[2])}"


def matching_texts(log: FlightLog, pattern: re.Pattern[str]) -> list[Text]:
    """Return the texts that match a pattern, in time order, without those of arming."""
    return sorted((x for x in log.texts if pattern.search(x[2]) and not PREARM.search(x[2])), key=lambda x: x[0])


def is_warning(text: Text) -> bool:
    """Return whether a text is a warning, or a reason for not arming."""
    if HARMLESS_WORDS.search(text[2]):
        return False
    return text[1] <= WARNING or bool(WARNING_WORDS.search(text[2]) or PREARM.search(clean_text(text[2])))


# --- movement ----------------------------------------------------------------------------------------------------

# The log ends in flight where the flight lasts to within this time of its end.
END_S = 1.0
# Time before a log's end in which a disarming, land detector or text shows a landing.
LANDING_KNOWN_S = 3.0
# Below LOW_M contact with the ground for this share of the last second is a landing, and below TOUCHING_M no drive.
LOW_M, TOUCHING_M, TOUCHING_SHARE = 5.0, 0.5, 0.5
# Above LOW_M a flag of landing is false where the vehicle was driven as in flight until then, falls free (share of
# gravity), or moves so fast over ground or downwards; else the site is higher, or the barometer drifted.
FREE_FALL_SHARE, MAX_LANDED_M_S = 0.5, 3.0
# The log begins in flight where the flight starts within this time of its begin.
BEGUN_S = 0.5
# Longest time since power-up that a clock shows; a larger one does not begin there.
BOOT_S = 3600.0
# Minimum IMU rate that resolves an impact peak; slower ones give a lower bound.
FULL_PEAK_HZ = 100.0
# Texts of lift-off and landing, and their largest distance from it.
TAKE_OFF = re.compile(r"takeoff detected", re.IGNORECASE)
LANDED = re.compile(r"landing detected|land complete", re.IGNORECASE)
TEXT_MARGIN_S = 5.0
# Dynamics and total time of a wreck that is moved.
MOVES, MOVES_S = 0.4, 2.0
# Tilt above which an overturned vehicle did not only fall to its side.
OVER_DEG = 90.0


def movement_events(log: FlightLog, segments: Segments) -> tuple[list[Event], list[Text]]:
    """Return arming, flight and crash events, unordered, and the texts that they quote."""
    quoted: list[Text] = []
    found = [*_power_up(log), *_arming(log)]
    flights = segments.spans("airborne")
    crashes = [e for e in segments.crash_events if e.is_crash]
    end = max((s.t1 for s in segments.of("continuous")), default=log.seconds)
    begin = min((s.t0 for s in segments.of("continuous")), default=0.0)
    for a, b in flights:
        if a - begin > BEGUN_S:
            found.append(_flown_event(log, "liftoff", a, "Lifted off", matching_texts(log, TAKE_OFF), quoted))
        ended = [e for e in segments.crash_events if abs(e.t - b) <= TEXT_MARGIN_S]
        if not ended and end - b < END_S and is_still_flying(log, segments, end):
            text = f"{_what_ends(log, end)} in the air, at {b:.1f} s."
            found.append(Event("ends_in_air", b, "note", text, evidence=_flight_sources(log)))
        elif not ended:
            found.append(_flown_event(log, "landing", b, "Landed", matching_texts(log, LANDED), quoted))
    said = matching_texts(log, CRASHED)
    reported = [p for p in log.problems if p.code == "crash" and p.t is not None]
    for ending in segments.crash_events:
        evidence = [f"{source}: {ending.why}" for source in ending.sources[:2]] or [ending.why]
        near = [x for x in said if -2.0 <= x[0] - ending.t <= 10.0] if ending.is_crash else []
        quoted += near
        evidence += [quote_text(x) for x in near[:1]]
        evidence += [
            p.text for p in reported if p.t is not None and ending.is_crash and -2.0 <= p.t - ending.t <= 10.0
        ][:1]
        found.append(_crash_event(ending, evidence))
    found += _wreck_moved(segments, crashes, end)
    return found, quoted


def _what_ends(log: FlightLog, end: float) -> str:
    """Return the log, or the sensors alone where its states go on."""
    lines = (log.state.armed, log.state.landed, log.state.mode)
    later = any(line is not None and len(line.t) and line.t[-1] > end + LANDING_KNOWN_S for line in lines)
    return "The sensor records end" if later else "The log ends"


def is_still_flying(log: FlightLog, segments: Segments, end: float) -> bool:
    """Return whether nothing in the last seconds of a log shows a landing."""
    air = segments.air
    above = np.nan if air is None or not air.levels else air.levels[0].above[air.grid.index(end)]
    flagged = _landing_flag_s(log, end)
    if flagged is not None:
        return air is not None and above >= LOW_M and _moves_on(air, flagged, end)
    if air is None or not above < LOW_M:
        return True
    last = between(air.grid.t, end - END_S, end + END_S)
    gone = above < TOUCHING_M and not air.driven[last][-1:].any()
    return not gone and bool(air.grid.contact[last].mean() < TOUCHING_SHARE)


def _landing_flag_s(log: FlightLog, end: float) -> float | None:
    """Return the first time near a log's end of a disarming, the land detector or its text; None without any."""
    since, until = end - LANDING_KNOWN_S, end + END_S
    found = [t for t, _, _ in matching_texts(log, LANDED)]
    for line, landed in ((log.state.armed, False), (log.state.landed, True)):
        changes = [] if line is None else zip(line.t.tolist(), line.value, strict=True)
        found += [t for t, value in changes if bool(value) is landed]
    return min((t for t in found if since <= t <= until), default=None)


def _moves_on(air: InAir, flagged: float, end: float) -> bool:
    """Return whether drive until a flag of landing, or motion until the end, shows flight in spite of it."""
    grid = air.grid
    before, last = between(grid.t, flagged - END_S, flagged), between(grid.t, end - END_S, end + END_S)
    usual = [float(median(air.power[between(grid.t, a, b)])) for a, b in air.spans if a <= flagged]
    driven = bool(usual and before.stop > before.start) and air.power_source != "arming"
    driven = driven and float(median(air.power[before])) > FLIGHT_SHARE * usual[-1]
    touching = bool(before.stop > before.start and grid.contact[before].mean() >= TOUCHING_SHARE)
    falls = bool((grid.size[last] < FREE_FALL_SHARE * G).any())
    fast = bool((grid.speed[last] > MAX_LANDED_M_S).any() or (air.climb[last] < -MAX_LANDED_M_S).any())
    return (driven and not touching) or falls or fast


def _power_up(log: FlightLog) -> list[Event]:
    """Return the power-up of the autopilot by its clock."""
    at = -1e-6 * log.t0_us
    if not 0 <= log.t0_us < 1e6 * BOOT_S:
        return []
    before = f"{-at:.0f} s before the log’s first sample" if at <= -0.5 else "as the log begins"
    text = f"Switched on {before}."
    return [Event("power_up", at, "info", text, evidence=["boot clock"])]


def _arming(log: FlightLog) -> list[Event]:
    """Return arming and disarming from changes of the flag, and an initially armed state."""
    line = log.state.armed
    if line is None or not line.value:
        return []
    found = []
    before: bool | None = None
    for t, value in zip(line.t.tolist(), line.value, strict=True):
        armed = bool(value)
        if (before is not None and armed != before) or (before is None and armed):
            kind, word = ("armed", "Armed") if armed else ("disarmed", "Disarmed")
            since = " before the log begins" if before is None else f" at {t:.1f} s"
            found.append(Event(kind, t, "info", f"{word}{since}.", evidence=[line.source]))
        before = armed
    return found


def _flown_event(log: FlightLog, kind: str, t: float, word: str, texts: list[Text], quoted: list[Text]) -> Event:
    """Return a lift-off or landing with the autopilot's text."""
    near = [x for x in texts if abs(x[0] - t) <= TEXT_MARGIN_S]
    quoted += near
    return Event(
        kind, t, "info", f"{word} at {t:.1f} s.", evidence=[*_flight_sources(log), *(quote_text(x) for x in near[:1])]
    )


def _flight_sources(log: FlightLog) -> list[str]:
    """Return the source that shows flight: the IMU, else a height, else throttle."""
    if log.imu is not None:
        return ["IMU"]
    stream = height_stream(log)
    return ["throttle" if stream is None else stream.source]


def format_size(ending: CrashEvent) -> str:
    """Format the size of a crash event, with "at least" where the IMU was too slow for its peak."""
    if ending.unit == "g":
        least = "at least " if ending.rate < FULL_PEAK_HZ else ""
        return f"{least}{format_significant(ending.size)} g"
    return f"{ending.size:.0f}°" + ("/s" if ending.unit == "deg/s" else "")


def overturn_word(ending: CrashEvent) -> str:
    """Return the verb for an overturn: up to 90 deg the vehicle fell over."""
    return "Turned over" if ending.size > OVER_DEG else "Fell over"


def _crash_event(ending: CrashEvent, evidence: list[str]) -> Event:
    lies = "" if ending.lies_deg is None else f" It then lay at {ending.lies_deg:.0f}°."
    words = {
        "impact": f"{'Struck in the air' if ending.in_air else 'Hit the ground or an obstacle'} "
        f"at {ending.t:.1f} s: {format_size(ending)}.",
        "hard_landing": f"Hard landing at {ending.t:.1f} s: {format_size(ending)}, and it stayed upright.",
        "overturn": f"{overturn_word(ending)} at {ending.t:.1f} s, to {format_size(ending)}.",
        "tumble": f"Tumbled at {ending.t:.1f} s, at up to {format_size(ending)}, uncommanded.",
    }
    weight: EventSeverity = "serious" if ending.is_crash else "warning"
    text = words[ending.kind] + (lies if ending.is_crash else "")
    unit = {"deg": "°", "deg/s": "°/s"}.get(ending.unit, ending.unit)
    t_end = ending.t_end if ending.t_end - ending.t > 0.5 else None
    about = "air" if ending.in_air else ""
    return Event(ending.kind, ending.t, weight, text, t_end, round(ending.size, 2), unit, evidence, about=about)


def _wreck_moved(segments: Segments, crashes: list[CrashEvent], end: float) -> list[Event]:
    """Return movements of a wreck without motor drive after it lay still."""
    air = segments.air
    if air is None or not crashes or air.grid.slow:
        return []
    grid, found = air.grid, []
    for wreck in [s for kind in ("impact", "loss_of_control") for s in segments.of(kind)]:
        part = between(grid.t, wreck.t0 + TEXT_MARGIN_S, min(wreck.t1, end))
        moves = (np.nan_to_num(grid.dynamics[part]) > MOVES) & ~air.driven[part] & grid.known[part]
        still = np.flatnonzero(np.nan_to_num(grid.dynamics[part], nan=9.0) < 0.0)
        if len(still) and moves[still[0] :].sum() * 0.1 >= MOVES_S:
            t = float(grid.t[part][still[0] + int(np.argmax(moves[still[0] :]))])
            text = f"The wreck was moved or carried from {t:.0f} s."
            found.append(Event("wreck_moved", t, "info", text, evidence=["IMU, without drive"]))
    return found[:1]


def impact_limit_text(log: FlightLog) -> str:
    """Return why an upright crash is undetectable; empty where the IMU is fast enough."""
    rate = max((imu.acc.rate for imu in log.imus), default=0.0)
    if shows_impacts(log) or rate == 0.0:
        return ""
    return f"IMU at {rate:.0f} Hz: an impact shorter than {1000.0 / rate:.0f} ms would not show"


# --- clipping and vibration --------------------------------------------------------------------------------------

# Strong vibration: RMS of the logged samples for so many seconds; ArduPilot's own level (60 m/s^2 is its documented
# limit). Smallest number of own levels that show a calm flight.
STRONG_M_S2, STRONG_S = 15.0, 5
ONBOARD_M_S2, MIN_LEVELS = 60.0, 10
# Up to MAX_CHANCE_CLIPS clipped samples are ignored, up to MAX_NOTE_CLIPS are a note.
MAX_CHANCE_CLIPS, MAX_NOTE_CLIPS = 3, 10
# Time excluded before the end of a flight: clipping by a touch-down, or by the impact of a crash.
LANDING_S, BLOW_S = 1.0, 0.1


def sensor_events(log: FlightLog, segments: Segments) -> tuple[list[Event], list[Text]]:
    """Return clipping and vibration in flight, and the texts that they quote."""
    found, quoted = [], []
    if any(problem.code == "imu_mostly_refused" for problem in log.problems):
        return [], []  # most IMU data is invalid, so clipping is unknown
    within = clipping_spans(segments)
    clip, texts = _clipping_event(log, within)
    if clip is not None:
        found.append(clip)
        quoted += texts
    crashes = [e.t for e in segments.crash_events if e.is_crash]
    shaken = _vibration_event(
        log, [(a, min([b, *(t - LANDING_S for t in crashes if a < t)])) for a, b in segments.spans("airborne")]
    )
    return [*found, *([shaken] if shaken is not None else [])], quoted


def clipping_spans(segments: Segments) -> list[Span]:
    """Return flights without touch-down, or the armed spans where none was flown."""
    flights = segments.spans("airborne")
    crashes = [e.t for e in segments.crash_events if e.is_crash]
    if flights:
        landed = [e.t for e in segments.crash_events if e.kind == "hard_landing"]
        ends = [min([b, *(t for t in landed if a < t)]) for a, b in flights]
        return [
            (a, end - (BLOW_S if any(abs(end - t) < 0.5 for t in crashes) else LANDING_S))
            for (a, _), end in zip(flights, ends, strict=True)
        ]
    return merge(segments.spans("armed"))


def _clipping_event(log: FlightLog, within: list[Span]) -> tuple[Event | None, list[Text]]:
    """Return clipping: time by the counters of all IMUs, size by the one with most samples.

    Flags of the selected IMU, which may have been another, count without a counter; within the interval of the first
    counted record they give the time of the first sample.
    """
    found: list[tuple[int, Clipping, Array]] = []
    for clipping in log.vibration.clippings:
        mine = inside(clipping.t, within) & (clipping.new > 0)
        if clipping.sensor == "accelerometer" and mine.any():
            found.append((int(clipping.new[mine].sum()), clipping, clipping.t[mine]))
    units = [one for one in found if one[1].whole] or found
    units = [one for one in units if one[0] > MAX_CHANCE_CLIPS]
    if not units:
        return None, []
    most, end = max(n for n, _, _ in units), max(float(at[-1]) for _, _, at in units)
    t, counter = min(((float(at[0]), c) for _, c, at in units), key=lambda one: one[0])
    since = max(counter.t[counter.t < t].tolist(), default=t) if counter.whole else t
    t = min([t, *(float(x) for _, c, at in found if not c.whole for x in at[at > since][:1])])
    said = [x for x in matching_texts(log, CLIPS) if -1.0 <= x[0] - t <= end - t + 5.0]
    text = f"The accelerometer clipped from {t:.1f} s to {end:.1f} s: {counted(most, 'sample')}."
    evidence = [*(f"{c.source}: {counted(n, 'sample')}" for n, c, _ in found), *(quote_text(x) for x in said[:1])]
    weight: EventSeverity = "warning" if most > MAX_NOTE_CLIPS else "note"
    return Event("clipping", t, weight, text, end, float(most), "samples", evidence), said


def _is_calm(own: Stream | None, flown: list[Span]) -> bool:
    """Return whether the autopilot's own vibration level stays below its limit in flight."""
    if own is None:
        return False
    x = own.x[inside(own.t, flown) & rotation.finite_rows(own.x)].max(axis=1, initial=0.0)
    limits = VIBRATION_LIMITS["rest"]
    return len(x) >= MIN_LEVELS and bool(quantile(x, limits.share) <= limits.warning)


def _vibration_event(log: FlightLog, flown: list[Span]) -> Event | None:
    """Return strong vibration in flight: 15 m/s^2 RMS, or 60 m/s^2 by the autopilot.

    RMS of the worst axis of the logged samples. None where the autopilot's level, computed from all samples, stays
    below its limit: logged samples contain aliases and motion.
    """
    imu = log.replay_imu
    if imu is None or _is_calm(log.vibration.level, flown):
        return None
    t, x = vibration_levels(imu, flown)
    strong = x.max(axis=1) > STRONG_M_S2 if len(t) else np.zeros(0, bool)
    if np.count_nonzero(strong) >= STRONG_S:
        size = float(median(x[strong].max(axis=1)))
        a, b = float(t[strong][0]), float(t[strong][-1]) + 1.0
        source = f"{imu.acc.source}: {format_significant(size)} m/s² rms"
    elif log.vibration.level is not None:
        own = log.vibration.level
        mine = inside(own.t, flown)
        high = mine & rotation.finite_rows(own.x) & (np.nan_to_num(own.x).max(axis=1, initial=0.0) > ONBOARD_M_S2)
        if np.count_nonzero(high) < 3:
            return None
        size = float(median(own.x[high].max(axis=1)))
        a, b = float(own.t[high][0]), float(own.t[high][-1])
        source = f"{own.source}: {format_significant(size)} m/s²"
    else:
        return None
    text = f"Strong vibration from {a:.0f} to {b:.0f} s: {format_significant(size)} m/s²."
    return Event("vibration", a, "warning", text, b, round(size, 1), "m/s²", [source])
