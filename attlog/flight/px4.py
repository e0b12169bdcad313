"""PX4 logs (ULog) as a FlightLog: which topic means what, in every era from 1.5 to 1.18.

Topics are told apart by their fields and types, never by a version number: old
logs have none and development builds carry the next one (LOGS 2).
"""

from __future__ import annotations

import numpy as np

from attlog.flight import inertial, magnetic, parameters, px4_imu, px4_state
from attlog.flight.model import Attitude, FlightLog, Mag
from attlog.flight.px4_calibration import calibrate, priority, slot_of
from attlog.flight.px4_imu import device, stamps
from attlog.flight.reading import Reading, columns
from attlog.flight.settings import how_to_log
from attlog.flight.timing import Stamps
from attlog.formats.base import Messages, Table


def read(messages: Messages, imu: int | None = None, mag: int | str | None = None) -> FlightLog:
    """The flight in a PX4 ULog; ``imu`` and ``mag`` ask for an instance instead of the one that flew."""
    reading = Reading(messages)
    values = parameters.values(messages.params)
    nothing: tuple[Stamps, list[int], str] = (np.zeros(0, np.int64), [], "")
    when, units, source = reading.attempt("The choice of IMU", lambda: px4_imu.selected_units(reading), nothing)
    flew = inertial.longest_held(when, units)
    why = f"it flew ({source})" if source else "the only source of the voted unit"
    found = px4_imu.candidates(reading, values, 0 if flew is None else flew)
    chosen = inertial.best_per_unit(reading, found)
    if flew is None and len(chosen) > 1:
        flew, why = next((c.index for c in chosen if c.source == "sensor_combined"), None), "it is the voted unit"
    firmware = px4_state.firmware(messages)
    missing = how_to_log(firmware.name, firmware.version, "imu")
    position = inertial.choose_unit(reading, chosen, flew, why, imu, missing)
    reading.t0_us = first_stamp(reading, chosen, position)

    log = FlightLog(messages.path, messages.format, messages.size, reading.t0_us, firmware, "")
    log.imus = [inertial.build(reading, c) for c in chosen]
    log.imu = position
    log.imu_that_flew = reading.time_line(when, units, source)
    flying = None if position is None else log.imus[position]
    if len(set(units)) > 1 and flying is not None and flying.gyro.source == "sensor_combined":
        reading.problem(
            "imu_switched",
            "warning",
            f"The autopilot changed its gyro in flight ({' -> '.join(str(u) for u in log.imu_that_flew.value)}): "
            "sensor_combined jumps from one sensor to the other.",
            t=float(log.imu_that_flew.t[-1]),
        )
    log.mags = reading.attempt("The magnetometer", lambda: magnetometers(reading, values), [])
    used = reading.attempt("The choice of compass", lambda: flown_mag(reading, log.mags), None)
    log.mag = magnetic.choose(reading, log.mags, flying, used, "it flew", mag)
    log.attitudes = attitudes(reading)
    log.onboard = "vehicle_attitude" if "vehicle_attitude" in log.attitudes else None
    truth = "vehicle_attitude_groundtruth"
    log.truth = reading.attempt(truth, lambda: attitude_of(reading, truth, 0, ()), None)
    log.params = parameters.time_lines(reading, messages.params, "parameter")
    log.param_defaults = parameters.defaults(messages.params)
    px4_state.fill(reading, log)
    log.problems, log.choices = reading.problems, reading.choices
    return log


def first_stamp(reading: Reading, chosen: list[inertial.Candidate], position: int | None) -> int:
    """The boot time in us that becomes t = 0: the replayed IMU's first sample, else the first sample of anything."""
    if chosen:
        return int(chosen[0 if position is None else position].t_us[0])
    for name in ("vehicle_attitude", "vehicle_status", "vehicle_gps_position"):
        table = reading.messages.tables.get((name, 0))
        if table is not None and "timestamp" in table:
            return int(np.median(stamps(table)[:5]))
    first = [stamps(t)[0] for t in reading.messages.tables.values() if "timestamp" in t and len(t)]
    return int(min(first)) if first else 0


# --- attitude ---------------------------------------------------------------------------------------------------


def attitudes(reading: Reading) -> dict[str, Attitude]:
    """Every attitude in the log: the published one, each EKF instance, and cameras or motion capture."""
    found: dict[str, Attitude] = {}
    switches = reading.attempt("estimator_selector_status", lambda: instance_changes(reading), ())
    for name in (
        "vehicle_attitude",
        "estimator_attitude",
        "vehicle_vision_attitude",
        "vehicle_visual_odometry",
        "vehicle_mocap_odometry",
    ):
        instances = reading.messages.instances(name)
        for i in instances:
            times = switches if name == "vehicle_attitude" else ()
            attitude = reading.attempt(name, lambda n=name, i=i, t=times: attitude_of(reading, n, i, t), None)
            if attitude is not None:
                single = name != "estimator_attitude" and i == 0
                found[name if single else f"{name}.{i}"] = attitude
    return found


def attitude_of(reading: Reading, name: str, instance: int, switches_us: tuple[int, ...]) -> Attitude | None:
    """One attitude topic, None if the log has none; resets come from its counter and from instance switches."""
    table = reading.messages.tables.get((name, instance))
    if table is None or "q" not in table:
        return None
    source = name if instance == 0 and name != "estimator_attitude" else f"{name}:{instance}"
    return reading.attitude(
        stamps(table), columns(table, "q"), source,
        t_sample_us=sample_stamps(table),
        counter=table["quat_reset_counter"] if "quat_reset_counter" in table else None,
        reset_times_us=switches_us,
    )  # fmt: skip


def sample_stamps(table: Table) -> np.ndarray | None:
    """The times of measurement of a topic in us, None where it has none."""
    return stamps(table, "timestamp_sample") if "timestamp_sample" in table else None


def instance_changes(reading: Reading) -> tuple[int, ...]:
    """Boot times in us at which another EKF instance took over."""
    table = reading.messages.tables.get(("estimator_selector_status", 0))
    if table is None or "primary_instance" not in table:
        return ()
    t, primary = stamps(table), table["primary_instance"].astype(np.int64)
    at = np.flatnonzero(np.diff(primary)) + 1
    if "last_instance_change" in table:
        t = np.where(table["last_instance_change"] > 0, stamps(table, "last_instance_change"), t)
    if len(at):
        reading.problem(
            "estimator_instance_changed",
            "note",
            "The autopilot changed its estimator instance "
            + ", ".join(f"from {primary[i - 1]} to {primary[i]}" for i in at[:5])
            + ": the onboard attitude steps there.",
            count=len(at),
        )
    return tuple(int(t[i]) for i in at)


# --- magnetometer -----------------------------------------------------------------------------------------------


def magnetometers(reading: Reading, values: dict[str, float]) -> list[Mag]:
    """Every compass: ``vehicle_magnetometer`` (calibrated), old ``sensor_combined`` fields, raw ``sensor_mag`` else."""
    messages, found, seen = reading.messages, [], set()
    for i in messages.instances("vehicle_magnetometer"):
        table = messages["vehicle_magnetometer", i]
        own = device(table)
        mag = magnetic.build(
            reading, i, stamps(table), columns(table, "magnetometer_ga") * magnetic.GAUSS, f"vehicle_magnetometer:{i}",
            t_sample_us=sample_stamps(table), device=str(own) if own else None,
        )  # fmt: skip
        if mag is not None:
            found.append(mag)
            seen.add(own)
    table = messages.tables.get(("sensor_combined", 0))
    if not found and table is not None and "magnetometer_ga" in table:
        field = columns(table, "magnetometer_ga") * magnetic.GAUSS
        t = stamps(table)
        if "magnetometer_timestamp_relative" in table:
            t = t + table["magnetometer_timestamp_relative"].astype(np.int64)
        new = magnetic.only_new(field, t)
        mag = magnetic.build(reading, 0, t[new], field[new], "sensor_combined.magnetometer_ga")
        found += [mag] if mag is not None else []
    found += raw_magnetometers(reading, values, seen, len(found))
    return found


def raw_magnetometers(reading: Reading, values: dict[str, float], seen: set[int], first: int) -> list[Mag]:
    """Compasses that are only logged raw, calibrated by their parameters where there are any."""
    messages, found = reading.messages, []
    known_devices = {d for d in seen if d}
    for i in messages.instances("sensor_mag"):
        table = messages["sensor_mag", i]
        own = device(table)
        if own in known_devices or "x" not in table or (not own and (seen or first)):
            continue
        if first and not known_devices:
            continue
        field, known = calibrate("MAG", values, own, columns(table, "x", "y", "z"))
        enabled = priority(values, own) != 0 and values.get("SYS_HAS_MAG", 1.0) != 0
        taken = {m.index for m in found} | set(range(first))
        index = i if i not in taken else max(taken) + 1
        mag = magnetic.build(
            reading, index, stamps(table), field * magnetic.GAUSS, f"sensor_mag:{i}", t_sample_us=sample_stamps(table),
            calibrated=known, device=str(own), enabled=enabled,
        )  # fmt: skip
        if mag is None:
            continue
        found.append(mag)
        state = f"calibrated with CAL_MAG{slot_of('MAG', values, own)}" if known else "never calibrated"
        reading.problem(
            "mag_raw",
            "note" if known else "warning",
            f"sensor_mag:{i} (device {own}): only raw values are logged; it is {state}"
            + ("." if enabled else " and disabled on the vehicle."),
        )
    return found


def flown_mag(reading: Reading, mags: list[Mag]) -> int | None:
    """Index of the magnetometer that the estimator used, None where the log does not tell."""
    for name in ("estimator_selector_status", "sensor_selection"):
        table = reading.messages.tables.get((name, 0))
        if table is None or "mag_device_id" not in table:
            continue
        wanted = int(table["mag_device_id"][-1])
        match = [m.index for m in mags if m.device == str(wanted)]
        if wanted and match:
            return match[0]
    return None
