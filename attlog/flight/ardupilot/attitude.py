"""Attitudes of ArduPilot logs: which record holds whose attitude, with or without the vehicle's trim.

ATT, ANG, AHR2 and the Euler records of the EKFs (EKF1, NKF1, XKF1) have AHRS_TRIM
taken out; the quaternion records (NKQ, XKQ) have not (ArduPilot
NavEKF3_core::getEulerAngles, and measured on a log with 0.96 deg of trim).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from attlog.base import rotation
from attlog.flight.ardupilot.clock import Clock
from attlog.flight.builder import LogBuilder, columns, step_of
from attlog.flight.clock.timing import Stamps
from attlog.flight.model import Array, Attitude, covered_seconds
from attlog.formats.base import Messages, Table

YAW_RESET_EVENT = 62
ENOUGH_OF_ATT = 0.95
"""ANG that covers less than this part of ATT's time is not the record to replace it."""
QUATERNION = ("Q1", "Q2", "Q3", "Q4")
EULER = ("Roll", "Pitch", "Yaw")
POSE = ("R", "P", "Y")


def attitudes(builder: LogBuilder, clock: Clock, resets_us: list[int]) -> dict[str, Attitude]:
    """Every attitude of the log by its name in the comparison (``ATT``, ``XKQ.1``, ...)."""
    found: dict[str, Attitude] = {}
    for name, table, trimmed in sources(builder.messages):
        followed = resets_us if name in ("ATT", "ANG") or name.startswith(("XK", "NK", "EKF")) else ()
        attitude = builder.attempt(name, partial(of_table, builder, clock, table, name, trimmed, followed), None)
        if attitude is not None:
            found[name] = attitude
    return found


def sources(messages: Messages) -> Iterator[tuple[str, Table, bool]]:
    """(name, table, trim taken out) of every attitude record; old names NKQ2, XKF6 are cores of their family.

    XKF1 and NKF1 count only for cores without quaternion: they are the same attitude.
    """
    for name in ("ANG", "ATT", "AHR2", "DCM", "EKF1"):
        table = messages.first(name)
        if table is not None:
            yield name, table, True
    for family in ("XK", "NK"):
        quaternion: dict[int, Table] = {i: messages[f"{family}Q", i] for i in messages.instances(f"{family}Q")}
        euler: dict[int, Table] = {i: messages[f"{family}F1", i] for i in messages.instances(f"{family}F1")}
        for core, (q_name, e_name) in enumerate(((f"{family}Q1", ""), (f"{family}Q2", f"{family}F6"))):
            for place, name in ((quaternion, q_name), (euler, e_name)):
                table = messages.first(name) if name else None
                if table is not None and core not in place:
                    place[core] = table
        for core, table in sorted(quaternion.items()):
            yield f"{family}Q.{core}", table, False
        for core, table in sorted(euler.items()):
            if core in quaternion:
                continue  # the same attitude, rounded to 0.01 deg
            yield f"{family}F1.{core}", table, True


def of_table(
    builder: LogBuilder, clock: Clock, table: Table, name: str, trimmed: bool, resets_us: list[int] | tuple[()]
) -> Attitude | None:
    """The attitude in one record type: its quaternion where it has one, else its Euler angles in degrees."""
    t = clock.of_samples(table)
    if t is None:
        return None
    step = 0.0
    if all(c in table for c in QUATERNION):
        q = columns(table, *QUATERNION)
    elif all(c in table for c in EULER):
        q, step = from_euler_deg(columns(table, *EULER))
    else:
        return None
    return builder.attitude(t, q, name, reset_times_us=resets_us, has_trim=trimmed, step_deg=step)


def from_euler_deg(angles: Array) -> tuple[Array, float]:
    """Quaternions (n, 4) of Euler angles in degrees, zero where they are no angles, and the step of the angles."""
    with np.errstate(invalid="ignore"):
        good = (np.abs(angles) <= 720.0).all(axis=1)
    q = np.full((len(angles), 4), np.nan)
    q[good] = rotation.from_euler(*np.radians(angles[good]).T)
    return q, step_of(angles[good][:, :2].ravel())


def resets(builder: LogBuilder, clock: Clock, lane_t: Stamps, lanes: list[int]) -> list[int]:
    """Boot times in us at which the attitude that flies stepped: lane switches, yaw resets, DCM to EKF."""
    messages, times = builder.messages, []
    changes = [int(lane_t[k]) for k in range(1, len(lanes)) if lanes[k] != lanes[k - 1]]
    if changes:
        often = "once" if len(changes) == 1 else f"{len(changes)} times"
        builder.problem(
            "lane_switch",
            "warning",
            f"The EKF changed its primary core {often}, first from {lanes[0]}; the attitude steps there.",
            count=len(changes),
        )
    times += changes
    events = messages.first("EV")
    if events is not None and "Id" in events:
        times += clock.of(events)[events["Id"].astype(np.int64) == YAW_RESET_EVENT].tolist()
    att = messages.first("ATT")
    if att is not None and "AEKF" in att:
        active = att["AEKF"].astype(np.int64)
        times += clock.of(att)[1:][np.diff(active) != 0].tolist()
    words = ("yaw align", "yaw reset", "lane switch", "in-flight yaw", "emergency yaw")
    times += [x.t_us for x in messages.texts if x.t_us is not None and any(w in x.text.lower() for w in words)]
    return sorted(times)


def truth(builder: LogBuilder, clock: Clock) -> Attitude | None:
    """The simulator's attitude (SIM): its quaternion, else angles that are cut to 0.01 deg."""
    table = builder.messages.first("SIM")
    if table is None or clock.of_samples(table) is None:
        return None
    return of_table(builder, clock, table, "SIM", False, ())


def poses(builder: LogBuilder, clock: Clock) -> dict[str, Attitude]:
    """What a camera or motion capture measured (VISP: degrees; the vehicle takes CTimeMS for the time of measurement),
    but for records that it ignored (Ign)."""
    table = builder.messages.first("VISP")
    t = None if table is None else clock.of_samples(table)
    if table is None or t is None or not all(c in table for c in POSE):
        return {}
    used = table["Ign"].astype(np.int64) == 0 if "Ign" in table else np.ones(len(t), bool)
    q, step = from_euler_deg(columns(table, *POSE))
    sampled = 1000 * table["CTimeMS"].astype(np.int64) if "CTimeMS" in table else None
    counter = table["Rst"][used] if "Rst" in table else None
    own = None if sampled is None else sampled[used]
    found = builder.attitude(t[used], q[used], "VISP", t_sample_us=own, counter=counter, step_deg=step)
    return {} if found is None else {"VISP": found}


def setpoints(builder: LogBuilder, clock: Clock, flew: str | None) -> Attitude | None:
    """The attitude set-point (DesRoll, DesPitch, DesYaw) beside the attitude that ``flew``, else beside ANG or ATT."""
    desired = ("DesRoll", "DesPitch", "DesYaw")
    for name in ("ATT", "ANG") if flew == "ATT" else ("ANG", "ATT"):
        table = builder.messages.first(name)
        if table is None or not all(c in table for c in desired):
            continue
        if clock.of_samples(table) is None:
            return None
        q, step = from_euler_deg(columns(table, *desired))
        good = rotation.finite(q)
        own = LogBuilder(builder.messages, t0_us=builder.t0_us)  # the stamps were reported with the attitude
        found = own.attitude(clock.of(table)[good], q[good], f"{name}.Des", has_trim=True, step_deg=step)
        builder.take_values(own)
        return found
    return None


def onboard(found: dict[str, Attitude], family: str, core: int | None) -> str | None:
    """The name of the attitude that flew: ANG > ATT > quaternion of the primary core > AHR2.

    ANG holds the values of ATT at loop rate, but a VTOL writes it in its hover modes
    only: it counts where it covers as much time as ATT, pauses left out, and is no slower.
    """
    names = ["ANG", "ATT", f"{family}Q.{core or 0}", f"{family}F1.{core or 0}", "EKF1", "AHR2", "DCM"]
    have = [n for n in names if n in found]
    if have[:2] == ["ANG", "ATT"]:
        ang, att = found["ANG"].t, found["ATT"].t
        if len(ang) < len(att) or covered_seconds(ang) < ENOUGH_OF_ATT * covered_seconds(att):
            return "ATT"
    return have[0] if have else None
