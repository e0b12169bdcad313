"""ArduPilot DataFlash logs (binary and text) as a FlightLog, from 3.1 to 4.7.

Records are told apart by their columns: early logs have no version, and branches
carry any.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from attlog.flight import inertial, magnetic
from attlog.flight.ardupilot import attitude, imus, state, vehicle
from attlog.flight.ardupilot.advice import ArduPilotLogging
from attlog.flight.ardupilot.clock import Clock, own_time
from attlog.flight.ardupilot.imus import units
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.calibration.ardupilot import MILLIGAUSS, compass_device
from attlog.flight.clock.timing import Stamps, on_a_clock
from attlog.flight.model import Firmware, FlightLog, Mag, Stream
from attlog.flight.parameters import history as parameters
from attlog.formats.base import Messages


def read(messages: Messages, imu: int | None = None, mag: int | str | None = None) -> FlightLog:
    """The flight in an ArduPilot log; ``imu`` and ``mag`` ask for a unit instead of the one that flew."""
    builder = LogBuilder(messages)
    clock = Clock(messages)
    values = parameters.values(messages.params)
    _tell_clock(builder, clock)
    chosen = inertial.best_per_unit(builder, imus.candidates(builder, clock, messages.params))
    core = _core_that_flew(builder, clock, values, [c.index for c in chosen])
    flew = builder.attempt("The primary EKF core", lambda: inertial.longest_held(core.t_us, core.units), None)
    why = f"it fed the primary EKF core ({core.family}F4.PI)"
    if flew is None and chosen:
        flew, why = chosen[0].index, "the first; the log does not say which is primary"
    firmware = builder.attempt("The firmware", lambda: vehicle.firmware(messages), Firmware("ArduPilot"))
    family_of_vehicle = builder.attempt("The vehicle", lambda: vehicle.family_of(messages, values), "")
    logging = ArduPilotLogging(family_of_vehicle, firmware.version, values)
    position = inertial.choose_unit(builder, chosen, flew, why, imu, logging)
    begin = builder.attempt("The first time stamp", lambda: first_stamp(builder, clock, chosen, position), 0)
    builder.t0_us = on_a_clock(begin)

    log = FlightLog(messages.path, messages.format, messages.size, builder.t0_us, firmware, "")
    log.logging = logging
    log.imus = [inertial.build(builder, c) for c in chosen]
    log.imu = position
    log.imu_that_flew = builder.attempt(
        "The primary EKF core", lambda: builder.time_line(core.t_us, core.units, f"{core.family}F4.PI"), None
    )
    flying = None if position is None else log.imus[position]
    log.mags = builder.attempt("MAG", lambda: magnetometers(builder, clock, values), [])
    log.mag = builder.attempt(
        "The compass",
        lambda: magnetic.choose(
            builder, log.mags, flying, primary_compass(values, log.mags), "the primary compass", mag, logging
        ),
        None,
    )
    _fill_attitudes(log, builder, clock, core)
    log.params = builder.attempt("PARM", lambda: parameters.time_lines(builder, messages.params, "PARM"), {})
    log.param_defaults = parameters.defaults(messages.params)
    log.declination_param, log.declination_source = parameters.declination(log, state.DECLINATION)
    log.trim, log.trim_source = state.trim(log), ", ".join(state.TRIM)
    state.fill(builder, clock, log, values)
    log.problems, log.choices = builder.problems, builder.choices
    return log


def _tell_clock(builder: LogBuilder, clock: Clock) -> None:
    """What early logs lack: a time in any record, or in any but those of GPS."""
    if not clock.known:
        builder.problem(
            "no_clock",
            "error",
            "No record of this log carries a time stamp, as in ArduPilot 3.0 and older: nothing in it can be replayed.",
        )
    elif clock.interpolates:
        builder.problem(
            "clock_between_gps",
            "note",
            "Only GPS records carry a time, as in ArduPilot 3.1 and older: others are placed between them, to 0.2 s.",
        )


@dataclass(frozen=True, slots=True)
class PrimaryCore:
    """The EKF cores that flew: ``family`` of their messages (XK, NK), ``lanes`` from ``t_us`` (n,) on, and the
    ``units`` of the IMU that each runs on."""

    family: str
    t_us: Stamps
    lanes: list[int]
    units: list[int]


def _core_that_flew(builder: LogBuilder, clock: Clock, values: dict[str, float], have: list[int]) -> PrimaryCore:
    """The primary core over time, in a log that has the IMU units ``have``."""
    ekf = values.get("AHRS_EKF_TYPE")
    nothing: tuple[str, Stamps, list[int]] = ("", np.zeros(0, np.int64), [])
    family, t_us, lanes = builder.attempt(
        "The primary EKF core", lambda: imus.primary_core(builder.messages, clock, ekf), nothing
    )
    mask = values.get("EK3_IMU_MASK" if family == "XK" else "EK2_IMU_MASK")
    unit = {core: imus.unit_of_core(core, mask, have) for core in set(lanes)}
    return PrimaryCore(family, t_us, lanes, [unit[core] for core in lanes])


def _fill_attitudes(log: FlightLog, builder: LogBuilder, clock: Clock, core: PrimaryCore) -> None:
    """The attitudes of the log, the one that flew among them, the truth and the set-points."""
    resets = builder.attempt("Resets", lambda: attitude.resets(builder, clock, core.t_us, core.lanes), [])
    log.attitudes = attitude.attitudes(builder, clock, resets)
    log.onboard = attitude.onboard(log.attitudes, core.family, core.lanes[-1] if core.lanes else None)
    if log.onboard == "ANG":
        builder.choices["onboard"] = "ANG holds the values of ATT at loop rate"
    elif log.onboard not in (None, "ATT"):
        builder.choices["onboard"] = "the log holds neither ATT nor ANG"
    log.truth = builder.attempt("SIM", lambda: attitude.truth(builder, clock), None)
    log.poses = builder.attempt("VISP", lambda: attitude.poses(builder, clock), {})
    log.setpoints = builder.attempt("Set-points", lambda: attitude.setpoints(builder, clock, log.onboard), None)


def first_stamp(builder: LogBuilder, clock: Clock, chosen: list[inertial.ImuCandidate], position: int | None) -> int:
    """The boot time in us that becomes t = 0: the replayed IMU's first sample, else the first sample of anything."""
    if chosen:
        return int(chosen[0 if position is None else position].t_us[0])
    for name in ("ATT", "AHR2", "GPS", "CTUN"):
        table = builder.messages.first(name)
        own = None if table is None else clock.of_samples(table)
        if own is not None and len(own):
            return int(np.median(own[:5]))
    return 0


def magnetometers(builder: LogBuilder, clock: Clock, values: dict[str, float]) -> list[Mag]:
    """Every compass: MAG, offsets and motor compensation already applied by the firmware (mGa, body frame)."""
    found = []
    for unit, table in units(builder.messages, "MAG").items():
        if "MagX" not in table or own_time(table) is None:
            continue
        t = clock.of(table)
        field = columns(table, "MagX", "MagY", "MagZ")
        source = imus.name_of(table, unit)
        offsets = columns(table, "OfsX", "OfsY", "OfsZ") if "OfsX" in table else None
        if offsets is not None and only_offsets(field, offsets):
            builder.problem(
                "mag_only_offsets",
                "warning",
                f"{source}: every value equals the compass offsets, so the compass itself measures nothing; "
                "it is not used.",
            )
            field = np.zeros_like(field)
        sampled = t - (t - table["S"].astype(np.int64)) % 2**32 if "S" in table else None  # S: us, 32 bits
        use = values.get("COMPASS_USE" + ("" if unit == 0 else str(unit + 1)), 1.0)
        device = compass_device(values, unit)
        mag = magnetic.build(
            builder, unit, t, field * MILLIGAUSS, source, t_sample_us=sampled, device=device, enabled=use != 0
        )
        if mag is not None:
            mag.offsets = None if offsets is None else applied_offsets(builder, t, offsets * MILLIGAUSS, source)
            found.append(mag)
    return found or replay_magnetometers(builder)


def applied_offsets(builder: LogBuilder, t_us: Stamps, offsets_t: np.ndarray, source: str) -> Stream | None:
    """The offsets (k, 3) in tesla that the records name, at the first of them and at each change."""
    new = np.concatenate([[True], np.diff(offsets_t, axis=0).any(axis=1)]) if len(t_us) else np.zeros(0, bool)
    return LogBuilder(builder.messages, t0_us=builder.t0_us).stream(t_us[new], offsets_t[new], "T", source)


def replay_magnetometers(builder: LogBuilder) -> list[Mag]:
    """Compasses as LOG_REPLAY gave them to the EKF (RMGI, mGa, body frame), at their own 32-bit microseconds."""
    found = []
    frames = builder.messages.first("RFRH")
    for unit, table in units(builder.messages, "RMGI").items():
        if frames is None or "FX" not in table or "LU" not in table:
            continue
        t = imus.frame_times(frames, table)
        updated = t - (t - table["LU"].astype(np.int64)) % 2**32
        field = columns(table, "FX", "FY", "FZ") * MILLIGAUSS
        new = np.concatenate([[True], np.diff(updated) != 0]) if len(t) else np.zeros(0, bool)
        use = bool("UFY" not in table or (table["UFY"] != 0).any())
        mag = magnetic.build(builder, unit, updated[new], field[new], f"RMGI:{unit}", enabled=use)
        found += [mag] if mag is not None else []
    return found


def only_offsets(field: np.ndarray, offsets: np.ndarray) -> bool:
    """Whether a compass shows nothing but its own offsets: a raw field of zero that never changes."""
    measured = field.any(axis=1)
    if not measured.any() or not offsets.any():
        return False
    return bool((np.abs(field - offsets)[measured] <= 1.0).all())


def primary_compass(values: dict[str, float], mags: list[Mag]) -> int | None:
    """Index of the compass that the firmware prefers: COMPASS_PRIMARY before 4.1, the first (by priority) since."""
    primary = values.get("COMPASS_PRIMARY")
    if primary is not None:
        return int(primary)
    return mags[0].index if mags else None
