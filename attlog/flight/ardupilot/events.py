"""What ERR and EV records report, in plain words.

Subsystems and codes: the list "Subsystem and error codes" at
ardupilot.org/copter/docs/common-diagnosing-problems-using-logs.html, and the
enumerations of ``libraries/AP_Logger/AP_Logger.h``. Code 0 says that a fault is over,
but for subsystem 24, whose code is the core that took over.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from attlog.flight.ardupilot.clock import Clock
from attlog.flight.builder import LogBuilder
from attlog.flight.model import Problem, Severity

EKF_PRIMARY, FLIGHT_MODE = 24, 10
MOST_KINDS = 100
"""A firmware has about 70 kinds of reports in all; a flight has a few."""


@dataclass(frozen=True, slots=True)
class EventMeaning:
    """What a record says: a sentence, how bad it is, why it comes, what to do."""

    text: str
    severity: Severity = "warning"
    cause: str = ""
    remedy: str = ""
    code: str = ""


_NO_GNSS = EventMeaning(
    "GNSS was lost for more than 5 s while it was needed",
    cause="Bad view of the sky or a disturbed receiver.",
    remedy="Raise the antenna above power wires and transmitters.",
)
_BAD_COMPASS = "The compass does not answer: wiring, bus or the compass itself."
_CHECK_COMPASS = "Check wiring and supply of the compass."

ERRORS: dict[tuple[int, int], EventMeaning] = {
    (1, 1): EventMeaning("The main loop waited for the inertial sensor", "note"),
    (2, 2): EventMeaning("Radio frames came late for 2 s", "note"),
    (3, 1): EventMeaning("The compass failed to start", cause=_BAD_COMPASS, remedy=_CHECK_COMPASS),
    (3, 4): EventMeaning("The compass was not healthy", cause=_BAD_COMPASS, remedy=_CHECK_COMPASS),
    (5, 1): EventMeaning(
        "Radio failsafe: no signal from the transmitter",
        cause="Out of range, transmitter off or antenna shadowed.",
        remedy="Check antennas and range.",
    ),
    (6, 1): EventMeaning(
        "Battery failsafe: voltage or capacity below its limit",
        cause="The battery was empty or weak.",
        remedy="Land earlier or change the battery.",
    ),
    (7, 1): replace(_NO_GNSS, text="GNSS failsafe: no good position for 5 s while armed"),
    (8, 1): EventMeaning(
        "Ground station failsafe: no heartbeat from it",
        cause="The radio link was lost.",
        remedy="Check the telemetry link.",
    ),
    (11, 2): EventMeaning(
        "GNSS glitch: its position jumped away from the prediction",
        cause="Bad reception, or an attitude and acceleration that predict a wrong position.",
        remedy="Raise the antenna above power wires and transmitters.",
        code="gnss_glitch",
    ),
    (12, 1): EventMeaning("Crash check: tilted and out of control, the motors were stopped", "error", code="crash"),
    (12, 2): EventMeaning("Loss of control was detected, as for the parachute", "error", code="crash"),
    (13, 2): EventMeaning("A flip was abandoned", "note"),
    (14, 2): EventMeaning("Autotune was refused or its gains were bad", "note"),
    (15, 2): EventMeaning("The parachute was not released: too low", "error"),
    (15, 3): EventMeaning("The parachute was not released: landed", "note"),
    (16, 2): EventMeaning(
        "EKF check: two test ratios of the EKF stayed above their limit for 1 s",
        cause="Sensors contradict each other: vibration, a disturbed compass or bad GNSS.",
        code="ekf_check",
    ),
    (17, 1): EventMeaning(
        "EKF failsafe: the EKF was given up",
        "error",
        cause="Sensors contradict each other: vibration, a disturbed compass or bad GNSS.",
        code="ekf_failsafe",
    ),
    (18, 1): EventMeaning("The barometer failed to start"),
    (18, 2): EventMeaning("The barometer jumped", "note"),
    (18, 4): EventMeaning("The barometer was not healthy"),
    (19, 1): EventMeaning("The main loop stood still for 2 s and more", "error", cause="The processor was overloaded."),
    (20, 1): EventMeaning("Another aircraft came near", "note"),
    (21, 2): EventMeaning("Terrain data were missing", "note"),
    (22, 2): EventMeaning("A destination could not be set", "note"),
    (22, 3): EventMeaning("Return to launch was restarted", "note"),
    (22, 4): EventMeaning("The circle mode could not start", "note"),
    (22, 5): EventMeaning("A destination outside the fence was refused", "note"),
    (22, 6): EventMeaning("Return to launch lacked its range finder", "note"),
    (23, 1): EventMeaning("Terrain failsafe: no terrain data for 5 s"),
    (25, 1): EventMeaning(
        "Thrust loss: full throttle and still falling",
        "error",
        cause="A motor, propeller or the battery gave way.",
        remedy="Check motors, propellers and battery; compare the motor outputs.",
    ),
    (26, 1): EventMeaning("Sensor failsafe"),
    (27, 1): EventMeaning("Leak failsafe: water inside", "error"),
    (28, 1): EventMeaning("No input from the pilot"),
    (29, 1): EventMeaning(
        "Vibration failsafe: height is held without the vertical accelerometer",
        cause="Vibration that the accelerometer turns into a constant offset.",
        remedy="Balance propellers, check bearings and arms, mount the autopilot softer.",
        code="vibration_failsafe",
    ),
    (30, 1): EventMeaning("An internal error of the firmware", "warning", remedy="Report it with this log."),
    (31, 1): EventMeaning("Dead reckoning failsafe: no position for too long", cause="GNSS was lost."),
}
"""By subsystem and code."""
FENCE = {1: "height", 2: "circle", 4: "polygon", 8: "lowest height"}
EVENTS: dict[int, EventMeaning] = {
    19: _NO_GNSS,
    51: EventMeaning("The parachute was released", "error", cause="By the pilot or by the crash check.", code="crash"),
    54: EventMeaning("The pilot stopped the motors (emergency stop)"),
    60: EventMeaning("The EKF set its height anew", "note", cause="Its height source changed or drifted."),
}
"""By the id of EV records; yaw resets stand among the jumps of the attitude."""


def report(builder: LogBuilder, clock: Clock) -> None:
    """Add to the builder's problems what ERR and EV records say: one entry for each kind, with its first time."""
    for record, columns in (("ERR", ("Subsys", "ECode")), ("EV", ("Id",))):
        table = builder.messages.first(record)
        if table is None or not all(c in table for c in columns):
            continue
        stamps = clock.of(table)
        near = builder.near(stamps)
        table, t = table.rows(near), builder.seconds(stamps[near])
        numbers = np.column_stack([table[c].astype(np.int64) for c in columns])
        kinds, first, counts = np.unique(numbers, axis=0, return_index=True, return_counts=True)
        told = 0
        for k in np.argsort(first):
            key = tuple(kinds[k].tolist())
            meaning = of_error(*key) if record == "ERR" else EVENTS.get(key[0])
            if meaning is None:
                continue
            told += 1
            if told > MOST_KINDS:
                text = (
                    f"{record} holds {len(kinds):,} kinds of reports, more than firmwares have; {MOST_KINDS} are shown."
                )
                builder.problem("damaged_reports", "warning", text, count=len(kinds))
                break
            what = f"{record} {'/'.join(map(str, key))}"
            builder.problems.append(
                Problem(
                    meaning.code or what.lower().replace(" ", "_").replace("/", "_"),
                    meaning.severity,
                    f"{meaning.text} ({what}).",
                    t=float(t[first[k]]),
                    count=int(counts[k]),
                    cause=meaning.cause,
                    remedy=meaning.remedy,
                )
            )


def of_error(subsystem: int, code: int) -> EventMeaning | None:
    """What an ERR record means, None for one that ends a fault."""
    if subsystem == EKF_PRIMARY:
        text = f"The EKF changed its primary core to {code}"
        return EventMeaning(text, cause="Another core agreed better with its sensors.", code="lane_switch")
    if code == 0:
        return None
    if subsystem == FLIGHT_MODE:
        text = f"The change to flight mode {code} was refused"
        return EventMeaning(text, "note", cause="The mode needs a position or an arming state that was not there.")
    if subsystem == 9:
        crossed = " and ".join(n for bit, n in FENCE.items() if code & bit) or f"code {code}"
        return EventMeaning(f"The fence was crossed ({crossed})")
    return ERRORS.get((subsystem, code), EventMeaning(f"Subsystem {subsystem} reported error {code}", "note"))
