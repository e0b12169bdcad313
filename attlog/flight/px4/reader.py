"""PX4 logs (ULog) as a FlightLog: which topic means what, in every era from 1.5 to 1.18.

Topics are told apart by their fields and types, never by a version number: old
logs have none and development builds carry the next one.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from attlog.flight import inertial, magnetic
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.clock.timing import Stamps, on_a_clock
from attlog.flight.model import Array, Attitude, Firmware, FlightLog
from attlog.flight.parameters import history as parameters
from attlog.flight.px4 import imus, mags, state
from attlog.flight.px4.advice import OtherLogging, Px4Logging
from attlog.flight.px4.imus import sample_stamps, stamps
from attlog.formats.base import Messages

POSES = ("vehicle_visual_odometry", "vehicle_mocap_odometry")
"""Topics with an attitude and a position that others measured."""


def is_px4(firmware: Firmware, messages: Messages) -> bool:
    """Whether PX4, or a fork that logs its topics, wrote a ULog; other programs write this format as well."""
    known = any(name in ("vehicle_status", "sensor_combined", "vehicle_attitude") for name, _ in messages.tables)
    return known or not firmware.name or "px4" in firmware.name.lower()


def read(messages: Messages, imu: int | None = None, mag: int | str | None = None) -> FlightLog:
    """The flight in a PX4 ULog; ``imu`` and ``mag`` ask for an instance instead of the one that flew."""
    builder = LogBuilder(messages)
    values = parameters.values(messages.params)
    nothing: tuple[Stamps, list[int], str] = (np.zeros(0, np.int64), [], "")
    when, units, source = builder.attempt("The choice of IMU", lambda: imus.selected_units(builder), nothing)
    flew = builder.attempt("The choice of IMU", lambda: inertial.longest_held(when, units), None)
    why = f"it flew ({source})" if source else "the only source of the voted unit"
    found = imus.candidates(builder, values, 0 if flew is None else flew)
    chosen = inertial.best_per_unit(builder, found)
    if flew is None and len(chosen) > 1:
        flew, why = next((c.index for c in chosen if c.source == "sensor_combined"), None), "it is the voted unit"
    firmware = builder.attempt("The firmware", lambda: state.firmware(messages), Firmware(""))
    logging = Px4Logging(firmware.version, values) if is_px4(firmware, messages) else OtherLogging(firmware.name)
    position = inertial.choose_unit(builder, chosen, flew, why, imu, logging)
    begin = builder.attempt("The first time stamp", lambda: first_stamp(builder, chosen, position), 0)
    builder.t0_us = on_a_clock(begin)

    log = FlightLog(messages.path, messages.format, messages.size, builder.t0_us, firmware, "")
    log.logging = logging
    log.imus = [inertial.build(builder, c) for c in chosen]
    log.imu = position
    log.imu_that_flew = builder.attempt(source, lambda: builder.time_line(when, units, source), None)
    flying = None if position is None else log.imus[position]
    flew_line = log.imu_that_flew
    if flew_line is not None and len(flew_line.value) > 1 and flying is not None:
        if flying.gyro.source == "sensor_combined":
            builder.problem(
                "imu_switched",
                "warning",
                f"The autopilot changed its gyro ({' -> '.join(str(u) for u in flew_line.value[:6])}): "
                "sensor_combined jumps from one sensor to the other.",
                t=float(flew_line.t[1]),
                count=len(flew_line.value) - 1,
            )
    log.mags = builder.attempt("The magnetometer", lambda: mags.magnetometers(builder, values), [])
    used = builder.attempt("The choice of compass", lambda: mags.flown(builder, log.mags), None)
    log.mag = builder.attempt(
        "The compass", lambda: magnetic.choose(builder, log.mags, flying, used, "it flew", mag, logging), None
    )
    log.attitudes = attitudes(builder)
    log.onboard = "vehicle_attitude" if "vehicle_attitude" in log.attitudes else None
    truth = "vehicle_attitude_groundtruth"
    log.truth = builder.attempt(truth, lambda: attitude_of(builder, truth, 0, ()), None)
    log.params = builder.attempt("Parameters", lambda: parameters.time_lines(builder, messages.params, "parameter"), {})
    log.param_defaults = parameters.defaults(messages.params)
    log.declination_param, log.declination_source = parameters.declination(log, state.DECLINATION)
    state.fill(builder, log)
    log.problems, log.choices = builder.problems, builder.choices
    return log


def first_stamp(builder: LogBuilder, chosen: list[inertial.ImuCandidate], position: int | None) -> int:
    """The boot time in us that becomes t = 0: the replayed IMU's first sample, else the first sample of anything."""
    if chosen:
        return int(chosen[0 if position is None else position].t_us[0])
    for name in ("vehicle_attitude", "vehicle_status", "vehicle_gps_position"):
        table = builder.messages.tables.get((name, 0))
        if table is not None and "timestamp" in table:
            return int(np.median(stamps(table)[:5]))
    first = [stamps(t)[0] for t in builder.messages.tables.values() if "timestamp" in t and len(t)]
    return int(min(first)) if first else 0


def attitudes(builder: LogBuilder) -> dict[str, Attitude]:
    """Every attitude in the log: the published one, each EKF instance, and cameras or motion capture."""
    found: dict[str, Attitude] = {}
    switches = builder.attempt("estimator_selector_status", lambda: instance_changes(builder), ())
    for name in (
        "vehicle_attitude",
        "estimator_attitude",
        "vehicle_vision_attitude",
        "vehicle_visual_odometry",
        "vehicle_mocap_odometry",
    ):
        instances = builder.messages.instances(name)
        for i in instances:
            times = switches if name == "vehicle_attitude" else ()
            attitude = builder.attempt(name, partial(attitude_of, builder, name, i, times), None)
            if attitude is not None and name in POSES:
                attitude.position = builder.attempt(name, partial(position_of, builder, name, i, attitude), None)
            if attitude is not None:
                single = name != "estimator_attitude" and i == 0
                found[name if single else f"{name}.{i}"] = attitude
    return found


def position_of(builder: LogBuilder, name: str, instance: int, attitude: Attitude) -> Array | None:
    """Where a pose was (n, 3) m at the times of its attitude, in axes of its own; None where the topic does not say."""
    table = builder.messages[name, instance]
    names = ("position",) if "position" in table else ("x", "y", "z")
    if not all(column in table for column in names):
        return None
    return builder.positions(stamps(table), columns(table, *names), attitude.t)


def attitude_of(builder: LogBuilder, name: str, instance: int, switches_us: tuple[int, ...]) -> Attitude | None:
    """One attitude topic, None if the log has none; resets come from its counter and from instance switches."""
    table = builder.messages.tables.get((name, instance))
    if table is None or "q" not in table:
        return None
    source = name if instance == 0 and name != "estimator_attitude" else f"{name}:{instance}"
    return builder.attitude(
        stamps(table),
        columns(table, "q"),
        source,
        t_sample_us=sample_stamps(table),
        counter=table["quat_reset_counter"] if "quat_reset_counter" in table else None,
        reset_times_us=switches_us,
    )


def instance_changes(builder: LogBuilder) -> tuple[int, ...]:
    """Boot times in us at which another EKF instance took over."""
    table = builder.messages.tables.get(("estimator_selector_status", 0))
    if table is None or "primary_instance" not in table:
        return ()
    t, primary = stamps(table), table["primary_instance"].astype(np.int64)
    at = np.flatnonzero(np.diff(primary)) + 1
    if "last_instance_change" in table:
        t = np.where(table["last_instance_change"] > 0, stamps(table, "last_instance_change"), t)
    if len(at):
        builder.problem(
            "estimator_instance_changed",
            "note",
            "The autopilot changed its estimator instance "
            + ", ".join(f"from {primary[i - 1]} to {primary[i]}" for i in at[:5])
            + ": the onboard attitude steps there.",
            count=len(at),
        )
    return tuple(int(t[i]) for i in at)
