"""Read firmware, vehicle, state over time, and reported faults of an ArduPilot log.

Subsystems and codes of ERR records: the list "Subsystem and error codes" at
ardupilot.org/copter/docs/common-diagnosing-problems-using-logs.html, and the enumerations of
``libraries/AP_Logger/AP_Logger.h``. Code 0 ends a fault, except of subsystem 24, whose code is the core that took over.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from attlog.core.sorting import is_in
from attlog.core.timestamps import Stamps
from attlog.flight import limits
from attlog.flight.ardupilot.imu import DataflashBuilder
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.model import Array, Firmware, Problem, Severity, Stream, TimeLine
from attlog.flight.parameters import boot_values
from attlog.flight.vehicle import ardupilot_mode, version_number
from attlog.formats.table import Messages, Table

BANNER = re.compile(
    r"(?:APM:|Ardu|APM|Antenna|\b)(Copter|Plane|Rover|rover2?|Sub|Tracker|Blimp)\s+"
    r"[Vv]?(\d[\w.\-]*)(?:\s*\(([0-9a-fA-F]+)\))?"
)
BOARD = re.compile(r"^(\S+) [0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8}$")
# Texts of an operating system of a board, and of the simulator.
BOARD_TEXT = re.compile(r"\b(nuttx|chibios): ?[0-9a-f]|^\S+ [0-9A-F]{8} [0-9A-F]{8} [0-9A-F]{8}$", re.IGNORECASE)
SIMULATOR_TEXT = re.compile(r"^rc protocol: sitl|\bsitl is running|^sim hit ground", re.IGNORECASE)
# Vehicles by FRAME_CLASS of Copter.
FRAME_CLASSES = {
    1: "quadrotor",
    2: "hexarotor",
    3: "octorotor",
    4: "octorotor",
    5: "hexarotor",
    6: "helicopter",
    7: "tricopter",
    8: "single rotor",
    9: "coaxial helicopter",
    11: "helicopter",
    12: "dodecarotor",
    13: "helicopter",
}
# Firmware families by SYSID_SW_TYPE.
SOFTWARE_TYPES = {0: "plane", 10: "copter", 20: "rover", 40: "sub"}
# Records that only one family writes.
FAMILY_RECORDS = (("copter", ("MOTB", "PSCD", "PSC")), ("plane", ("AETR", "TECS", "LAND")), ("rover", ("STER", "THR")))


# Vehicles by the first letters of the frame in a message such as "Frame: QUAD/X".
FRAME_WORDS = (
    ("QUAD", "quadrotor"),
    ("HEXA", "hexarotor"),
    ("OCTA", "octorotor"),
    ("Y6", "hexarotor"),
    ("TRI", "tricopter"),
    ("HELI", "helicopter"),
)


# --- vehicle ----------------------------------------------------------------------------------------------------


def read_banner(messages: Messages) -> tuple[str, str, str]:
    """Return family, version and git hash from the firmware's banner, empty without one."""
    texts = [t.text for t in messages.texts]
    texts += [str(v) for v in messages.info.values() if isinstance(v, str)]
    own = messages.info.get("VER")
    if isinstance(own, dict):
        texts.insert(0, str(own.get("FWS", "")))
    texts += [str(line) for line in messages.info.get("banner", ()) or ()]
    matches = [m for m in map(BANNER.search, texts) if m]
    if not matches:
        return "", "", ""
    best = next((m for m in matches if m[3]), matches[0])  # only the firmware's own banner has a hash
    family = best[1].lower()
    return ("rover" if family.startswith("rover") else family), best[2], best[3] or ""


def read_firmware(messages: Messages) -> Firmware:
    """Return the firmware; its version starts with the vehicle (``Copter 4.6.2``)."""
    family, version, git = read_banner(messages)
    board = next((m[1] for t in messages.texts if (m := BOARD.match(t.text.strip()))), "")
    return Firmware("ArduPilot", f"{family.capitalize()} {version}".strip(), git, board)


def is_simulated(records: bool, texts: Iterable[tuple[float, int, str]], parameters: Iterable[str]) -> bool:
    """Return whether a flight was simulated.

    ``records``: the simulator's own are logged. Without them and its texts, parameters SIM_* count only where no text
    names a board: AP_HAL of 3.5 has SIM_HITL on every board.
    """
    said = [text.strip() for _, _, text in texts]
    if records or any(SIMULATOR_TEXT.search(text) for text in said):
        return True
    return any(n.startswith("SIM_") for n in parameters) and not any(BOARD_TEXT.search(text) for text in said)


def detect_family(messages: Messages) -> str:
    """Return the firmware family (copter, plane, rover, sub) by message, parameters or records, empty if unknown."""
    family, software = read_banner(messages)[0], boot_values(messages.params).get("SYSID_SW_TYPE")
    if family:
        return family
    if software in SOFTWARE_TYPES:
        return SOFTWARE_TYPES[int(software)]
    names = set(messages.names())
    for known, records in FAMILY_RECORDS:
        if names & set(records):
            return known
    control = messages.first("CTUN")
    if control is not None and any(c in control for c in ("AngBst", "ABst", "ThrIn")):
        return "copter"
    return ""


def vehicle_type(builder: DataflashBuilder) -> str:
    """Return the vehicle's usual name."""
    values, family = builder.values, builder.family
    if family == "plane":
        return "VTOL" if values.get("Q_ENABLE", 0) > 0 else "fixed wing"
    if family == "rover":
        return "boat" if values.get("FRAME_CLASS") == 2 else "rover"
    if family == "sub":
        return "submarine"
    if family == "copter":
        if int(values.get("FRAME_CLASS", 0)) in FRAME_CLASSES:
            return FRAME_CLASSES[int(values["FRAME_CLASS"])]
        for text in builder.messages.texts:
            match = re.search(r"[Ff]rame: (\w+)", text.text)
            for word, name in FRAME_WORDS if match else ():
                if match and match[1].upper().startswith(word):
                    return name
        return "helicopter" if any(n.startswith("H_SV") for n in values) else "multirotor"
    return family or "unknown"


# --- state ------------------------------------------------------------------------------------------------------

# Event ids of EV records (AP_Logger LogEvent). 17, LAND_COMPLETE_MAYBE, also comes in flight.
ARMED_EVENT, DISARMED_EVENT, LANDED_EVENT, NOT_LANDED_EVENT = 10, 11, 18, 28


def armed_line(builder: DataflashBuilder) -> TimeLine | None:
    """Return arming over time: ARM records (4.x), events 10 and 11, or STAT of planes."""
    arm = builder.messages.first("ARM")
    if arm is not None and "ArmState" in arm:
        return _event_line(builder, builder.stamps(arm), arm["ArmState"] != 0, "ARM")
    t_us, ids = _events(builder, (ARMED_EVENT, DISARMED_EVENT))
    if len(ids):
        return _event_line(builder, t_us, ids == ARMED_EVENT, "EV")
    status = builder.messages.first("STAT")
    if status is not None and "Armed" in status:
        return builder.time_line(builder.stamps(status), (status["Armed"] != 0).tolist(), "STAT")
    return None


def landed_line(builder: DataflashBuilder) -> TimeLine | None:
    """Return ground contact over time: copter events 18 and 28, or STAT.isFlying of planes.

    Before the first event a disarmed vehicle counts as landed.
    """
    armed = builder.log.state.armed
    t_us, ids = _events(builder, (LANDED_EVENT, NOT_LANDED_EVENT))
    if len(ids):
        line = _event_line(builder, t_us, ids != NOT_LANDED_EVENT, "EV")
        if line is not None and armed is not None and not armed.at(float(line.t[0])) and not line.value[0]:
            line.value[0] = True
        return line
    status = builder.messages.first("STAT")
    if status is not None and "isFlying" in status:
        return builder.time_line(builder.stamps(status), (status["isFlying"] == 0).tolist(), "STAT")
    return None


def mode_line(builder: DataflashBuilder) -> TimeLine | None:
    """Return flight modes by name over time; numbers in binary logs are decoded by firmware family."""
    table = builder.messages.first("MODE")
    if table is None or "Mode" not in table:
        return None
    logged = [x.decode("latin-1") if isinstance(x, bytes) else str(x) for x in table["Mode"].tolist()]
    if table["Mode"].dtype.kind not in "SU":
        logged = [str(int(n)) for n in table["Mode"].tolist()]
    names = [
        ardupilot_mode(builder.family, int(n)) if n.strip().isdigit() else n.strip().upper().replace(" ", "_")
        for n in logged
    ]
    return builder.time_line(builder.stamps(table), names, "MODE")


# Failsafes that set a mode, by MODE.Rsn (ModeReason.h; in 3.4 to 3.6 Copter alone has these numbers).
MODE_REASONS = {
    3: "radio failsafe",
    4: "battery failsafe",
    5: "ground station failsafe",
    6: "EKF failsafe",
    7: "GNSS glitch",
    10: "fence",
    11: "terrain failsafe",
    44: "dead reckoning failsafe",
}
COMMON_REASONS_VERSION = (4, 0)


def mode_reason_line(builder: DataflashBuilder) -> TimeLine | None:
    """Return the failsafe that set the mode over time, empty where none did; None without reasons."""
    table = builder.messages.first("MODE")
    column = next((c for c in ("Rsn", "Reason") if table is not None and c in table), None)
    version = version_number(read_banner(builder.messages)[1])
    if table is None or column is None or (builder.family != "copter" and version < COMMON_REASONS_VERSION):
        return None
    reasons = [MODE_REASONS.get(int(n), "") for n in table[column].tolist()]
    return builder.time_line(builder.stamps(table), reasons, "MODE")


def _events(builder: DataflashBuilder, wanted: tuple[int, ...]) -> tuple[Stamps, NDArray[np.int64]]:
    """Return stamps and ids (n,) of the EV records with these ids."""
    events = builder.messages.first("EV")
    if events is None or "Id" not in events:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    ids = events["Id"].astype(np.int64)
    mine = is_in(ids, wanted)
    return builder.stamps(events)[mine], ids[mine]


def _event_line(builder: LogBuilder, t_us: Stamps, on: NDArray[np.bool_], source: str) -> TimeLine | None:
    """Return a time line of events, with the opposite value from the log's start to the first event."""
    line = builder.time_line(t_us, on.tolist(), source)
    if line is not None and line.t[0] > 0:
        line.t = np.concatenate([[0.0], line.t])
        line.value = [not line.value[0], *line.value]
    return line


# --- reports ----------------------------------------------------------------------------------------------------

# Subsystems of ERR records whose code is a mode, fence bits or a lane.
FLIGHT_MODE, FENCE, EKF_PRIMARY = 10, 9, 24
# Most kinds of reports shown of a log: a firmware defines about 70, a flight has a few.
MAX_EVENT_KINDS = 100


# Usual cause and remedy of a report, by key.
CAUSES = {
    "": ("", ""),
    "lane": ("Another lane agreed better with its sensors.", ""),
    "mode": ("The mode needs a position or an arming state that was not there.", ""),
    "compass": (
        "The compass does not answer: wiring, bus or the compass itself.",
        "Check wiring and supply of the compass.",
    ),
    "radio": ("Out of range, transmitter off or antenna shadowed.", "Check antennas and range."),
    "battery": ("The battery was empty or weak.", "Land earlier or change the battery."),
    "gnss": ("Bad view of the sky or a disturbed receiver.", "Raise the antenna above power wires and transmitters."),
    "link": ("The radio link was lost.", "Check the telemetry link."),
    "glitch": (
        "Bad reception, or an attitude and acceleration that predict a wrong position.",
        "Raise the antenna above power wires and transmitters.",
    ),
    "contradiction": ("Sensors contradict each other: vibration, a disturbed compass or bad GNSS.", ""),
    "processor": ("The processor was overloaded.", ""),
    "thrust": (
        "A motor, propeller or the battery gave way.",
        "Check motors, propellers and battery; compare the motor outputs.",
    ),
    "vibration": (
        "Vibration that the accelerometer turns into a constant offset.",
        "Balance propellers, check bearings and arms, mount the autopilot softer.",
    ),
    "fence": ("", "Check the fence's limits, and the margin of the route to it."),
    "report": ("", "Report it with this log."),
    "lost": ("GNSS was lost.", ""),
    "released": ("By the pilot or by the crash check.", ""),
    "height": ("Its height source changed or drifted.", ""),
}


@dataclass(frozen=True, slots=True)
class EventMeaning:
    """Meaning of an ERR or EV record; ``why`` is a key of CAUSES, ``code`` that of the problem."""

    severity: Severity
    text: str
    why: str = ""
    code: str = ""


# Meanings of ERR records by subsystem and code.
SUBSYSTEM_ERRORS: dict[tuple[int, int], EventMeaning] = {
    (1, 1): EventMeaning("note", "The main loop waited for the inertial sensor"),
    (2, 2): EventMeaning("note", "Radio frames came late for 2 s"),
    (3, 1): EventMeaning("warning", "The compass failed to start", "compass"),
    (3, 4): EventMeaning("warning", "The compass was not healthy", "compass"),
    (5, 1): EventMeaning("warning", "Radio failsafe: no signal from the transmitter", "radio"),
    (6, 1): EventMeaning("warning", "Battery failsafe: voltage or capacity below its limit", "battery"),
    (7, 1): EventMeaning("warning", "GNSS failsafe: no good position for 5 s while armed", "gnss"),
    (8, 1): EventMeaning("warning", "Ground station failsafe: no heartbeat from it", "link"),
    (11, 2): EventMeaning(
        "warning", "GNSS glitch: its position jumped away from the prediction", "glitch", "gnss_glitch"
    ),
    (12, 1): EventMeaning("error", "Crash check: tilted and out of control, the motors were stopped", "", "crash"),
    (12, 2): EventMeaning("error", "Loss of control was detected, as for the parachute", "", "crash"),
    (13, 2): EventMeaning("note", "A flip was abandoned"),
    (14, 2): EventMeaning("note", "Autotune was refused or its gains were bad"),
    (15, 2): EventMeaning("error", "The parachute was not released: too low"),
    (15, 3): EventMeaning("note", "The parachute was not released: landed"),
    (16, 2): EventMeaning(
        "warning",
        "EKF check: two test ratios of the EKF stayed above their limit for 1 s",
        "contradiction",
        "ekf_check",
    ),
    (17, 1): EventMeaning("error", "EKF failsafe: the EKF was given up", "contradiction", "ekf_failsafe"),
    (18, 1): EventMeaning("warning", "The barometer failed to start"),
    (18, 2): EventMeaning("note", "The barometer jumped"),
    (18, 4): EventMeaning("warning", "The barometer was not healthy"),
    (19, 1): EventMeaning("error", "The main loop stood still for 2 s and more", "processor"),
    (20, 1): EventMeaning("note", "Another aircraft came near"),
    (21, 2): EventMeaning("note", "Terrain data were missing"),
    (22, 2): EventMeaning("note", "A destination could not be set"),
    (22, 3): EventMeaning("note", "Return to launch was restarted"),
    (22, 4): EventMeaning("note", "The circle mode could not start"),
    (22, 5): EventMeaning("note", "A destination outside the fence was refused"),
    (22, 6): EventMeaning("note", "Return to launch lacked its range finder"),
    (23, 1): EventMeaning("warning", "Terrain failsafe: no terrain data for 5 s"),
    (25, 1): EventMeaning("error", "Thrust loss: full throttle and still falling", "thrust"),
    (26, 1): EventMeaning("warning", "Sensor failsafe"),
    (27, 1): EventMeaning("error", "Leak failsafe: water inside"),
    (28, 1): EventMeaning("warning", "No input from the pilot"),
    (29, 1): EventMeaning(
        "warning",
        "Vibration failsafe: height is held without the vertical accelerometer",
        "vibration",
        "vibration_failsafe",
    ),
    (30, 1): EventMeaning("warning", "An internal error of the firmware", "report"),
    (31, 1): EventMeaning("warning", "Dead reckoning failsafe: no position for too long", "lost"),
}
FENCE_BITS = {1: "height", 2: "circle", 4: "polygon", 8: "lowest height"}
# Meanings of EV records by id; yaw resets are handled as resets of the attitude.
EVENTS: dict[int, EventMeaning] = {
    19: EventMeaning("warning", "GNSS was lost for more than 5 s while it was needed", "gnss"),
    51: EventMeaning("error", "The parachute was released", "released", "crash"),
    54: EventMeaning("warning", "The pilot stopped the motors (emergency stop)"),
    60: EventMeaning("note", "The EKF set its height anew", "height"),
}


# Usual channels of the sticks, and usual ends and middle of a pulse in us.
STICK_CHANNELS = (("RCMAP_ROLL", 1), ("RCMAP_PITCH", 2), ("RCMAP_YAW", 4))
# Those of ArduSub, which reads no RCMAP.
SUB_CHANNELS = (2, 1, 4)
USUAL_PULSES_US = (1100.0, 1500.0, 1900.0)
# RCI2.Flags since 4.5: the receiver's input is valid.
VALID_INPUT = 1
# Parameters that switch on the failsafe of a low throttle channel, with those of its pulse; of Copter and Rover, Plane.
THROTTLE_FAILSAFES = (("FS_THR_ENABLE", "FS_THR_VALUE"), ("THR_FAILSAFE", "THR_FS_VALUE"))


def channel_columns(table: Table, channels: Sequence[int]) -> list[str] | None:
    """Return the columns of RC channels in RCIN, None where one is not logged."""
    prefix = next((p for p in ("C", "Ch", "Chan") if f"{p}1" in table), "C")
    names = [f"{prefix}{channel}" for channel in channels]
    return names if all(name in table for name in names) else None


def stick_share(pulse: Array, values: Mapping[str, float], channel: int) -> Array:
    """Return the stick of a channel, -1 to 1, from its pulses (n,) in us and its calibration."""
    name = f"RC{channel}_"
    low, middle, high = (
        values.get(f"{name}{end}") or usual for end, usual in zip(("MIN", "TRIM", "MAX"), USUAL_PULSES_US, strict=True)
    )
    if not low < middle < high:
        low, middle, high = USUAL_PULSES_US
    share: Array = np.where(pulse >= middle, (pulse - middle) / (high - middle), (pulse - middle) / (middle - low))
    reversed_ = values.get(f"{name}REVERSED") == 1.0 or values.get(f"{name}REV") == -1.0
    return -share if reversed_ else share


def stick_stream(builder: DataflashBuilder) -> Stream | None:
    """Return roll, pitch (nose up) and yaw sticks (n, 3), from RCIN; a rover has none."""
    if builder.family == "rover":
        return None
    table = builder.sampled("RCIN")
    channels = [int(builder.values.get(name) or usual) for name, usual in STICK_CHANNELS]
    if builder.family == "sub":
        channels = list(SUB_CHANNELS)
    names = None if table is None else channel_columns(table, channels)
    if table is None or names is None:
        return None
    pulses = columns(table, *names)
    shares = [stick_share(pulse, builder.values, channel) for pulse, channel in zip(pulses.T, channels, strict=True)]
    x = np.where(pulses > 0.0, np.column_stack(shares), np.nan)  # 0 is no pulse
    return builder.quiet().stream(builder.stamps(table), x, "1", "RCIN", within=limits.STICK, allow_nan=True)


def radio_signal(builder: DataflashBuilder) -> TimeLine | None:
    """Return whether the radio is received: by RCI2.Flags, else by the throttle channel against its failsafe."""
    table = builder.sampled("RCI2", "Flags")
    if table is not None:
        valid = table["Flags"].astype(np.int64) & VALID_INPUT != 0
        return builder.time_line(builder.stamps(table), valid.tolist(), "RCI2.Flags")
    table = builder.sampled("RCIN")
    names = None if table is None else channel_columns(table, [int(builder.values.get("RCMAP_THROTTLE") or 3)])
    for enabled, pulse in THROTTLE_FAILSAFES:
        if table is not None and names is not None and builder.values.get(enabled) and builder.values.get(pulse):
            valid = columns(table, *names)[:, 0] >= builder.values[pulse]
            return builder.time_line(builder.stamps(table), valid.tolist(), f"{table.name}.{names[0]} below {pulse}")
    return None


def report_events(builder: DataflashBuilder) -> None:
    """Add a problem for each kind of ERR and EV record, at its first time."""
    for record, names in (("ERR", ("Subsys", "ECode")), ("EV", ("Id",))):
        table = builder.messages.first(record)
        if table is None or not all(c in table for c in names):
            continue
        table, t = builder.near_rows(table)
        numbers = np.column_stack([table[c].astype(np.int64) for c in names])
        kinds, first, counts = np.unique(numbers, axis=0, return_index=True, return_counts=True)
        shown = 0
        for k in np.argsort(first):
            key = tuple(kinds[k].tolist())
            meaning = error_meaning(*key) if record == "ERR" else EVENTS.get(key[0])
            if meaning is None:
                continue
            shown += 1
            if shown > MAX_EVENT_KINDS:
                text = f"{record} holds {len(kinds):,} kinds of reports, more than firmwares have; "
                builder.problem("damaged_reports", "warning", f"{text}{MAX_EVENT_KINDS} are shown.", count=len(kinds))
                break
            what = f"{record} {'/'.join(map(str, key))}"
            code = meaning.code or what.lower().replace(" ", "_").replace("/", "_")
            at, (cause, remedy) = float(t[first[k]]), CAUSES[meaning.why]
            problem = Problem(code, meaning.severity, f"{meaning.text} ({what}).", at, count=int(counts[k]))
            builder.problems.append(replace(problem, cause=cause, remedy=remedy))


def error_meaning(subsystem: int, code: int) -> EventMeaning | None:
    """Return the meaning of an ERR record, None if it reports the end of a fault."""
    if subsystem == EKF_PRIMARY:
        text = f"The EKF switched to lane {code}"
        return EventMeaning("warning", text, "lane", "lane_switch")
    if code == 0:
        return None
    if subsystem == FLIGHT_MODE:
        text = f"The change to flight mode {code} was refused"
        return EventMeaning("note", text, "mode")
    if subsystem == FENCE:
        crossed = " and ".join(n for bit, n in FENCE_BITS.items() if code & bit) or f"code {code}"
        return EventMeaning("warning", f"The fence was crossed: {crossed}", "fence", "fence")
    return SUBSYSTEM_ERRORS.get((subsystem, code), EventMeaning("note", f"Subsystem {subsystem} reported error {code}"))
