"""Read the clock and the inertial data of ArduPilot logs.

Records carry ``TimeUS`` since 3.3, before that ``TimeMS``, except GPS records, whose TimeMS is the time of the GPS week
and ``T`` the boot clock. Records without time (EV, MODE, MSG of 3.x) get the time of the record before them in the
file. In 3.1 and older only GPS records carry a time: all others are placed between them, good to a GPS interval.

Inertial sources, best first (docs/flight.md): RISI (LOG_REPLAY), IMT increments from 100 Hz, GYR/ACC raw from 400 Hz,
IMU. Batches (ISBD) are never a continuous input.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from attlog.core.sorting import median
from attlog.core.timestamps import Stamps
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.imu import ImuCandidate, drop_unpaired, low_pass_delay, read_candidates, resample_vectors
from attlog.flight.model import Array
from attlog.flight.parameters import boot_values
from attlog.flight.timestamps import read_stamps
from attlog.formats.table import Messages, ParamChange, Table

# Rates in Hz from which IMT and GYR are preferred to IMU.
MIN_INCREMENTS_HZ, MIN_RAW_HZ = 100.0, 400.0
# Highest plausible cutoff frequency.
MAX_CUTOFF_HZ = 10_000.0
# SampleUS is used if its median difference from the record's stamp is smaller than this.
MAX_SENSOR_CLOCK_US = 1_000_000
# Bit of INS_RAW_LOG_OPT: GYR and ACC are logged behind the filters.
RAW_AFTER_FILTERS_BIT = 4
GYRO_COLUMNS, ACC_COLUMNS = ("GyrX", "GyrY", "GyrZ"), ("AccX", "AccY", "AccZ")


class IncrementColumns(NamedTuple):
    """Columns of delta angles and delta velocities, with those of their integration times."""

    angle_time: str
    velocity_time: str
    angle: tuple[str, ...]
    velocity: tuple[str, ...]


IMT_COLUMNS = IncrementColumns("DelaT", "DelvT", ("DelAX", "DelAY", "DelAZ"), ("DelVX", "DelVY", "DelVZ"))
RISI_COLUMNS = IncrementColumns("DADT", "DVDT", ("DAX", "DAY", "DAZ"), ("DVX", "DVY", "DVZ"))


# --- clock ------------------------------------------------------------------------------------------------------


def own_time(table: Table) -> Stamps | None:
    """Return the boot times (n,) in us logged in the records, None without a numeric column."""
    column, us = "TimeUS", 1
    if column not in table:
        column, us = "T" if ("Week" in table or "GWk" in table) and "T" in table else "TimeMS", 1000
    if column not in table and table.name == "GPS":
        column = "Time"  # time of the GPS week, in 3.0
    if column not in table:
        return None
    try:
        return read_stamps(table, column, us)
    except ValueError:
        return None


class RecordClock:
    """Boot times of all records of a log, from their own stamps or their place in the file."""

    def __init__(self, messages: Messages) -> None:
        self.messages = messages
        self._offsets: Stamps | None = None
        self._times: Stamps = np.zeros(0, np.int64)

    @cached_property
    def known(self) -> bool:
        """True if any record has a stamp."""
        return any(own_time(table) is not None for table in self.messages.values())

    @cached_property
    def interpolates(self) -> bool:
        """True if only GPS records have stamps (3.1 and older)."""
        return self.known and all(table.name == "GPS" for table, _ in self._timed)

    @cached_property
    def _timed(self) -> list[tuple[Table, Stamps]]:
        """The tables with stamps, and their stamps."""
        return [(t, own) for t in self.messages.values() if (own := own_time(t)) is not None]

    def of_samples(self, table: Table) -> Stamps | None:
        """Return stamps (n,) in us, own or interpolated between GPS records; None if neither exists."""
        own = own_time(table)
        return self.at(table.offsets) if own is None and self.interpolates else own

    def of(self, table: Table) -> Stamps:
        """Return stamps (n,) in us, the records' own or those of the records before them in the file."""
        own = own_time(table)
        return self.at(table.offsets) if own is None else own

    def at(self, offsets: Stamps) -> Stamps:
        """Return the time of the last timed record before each place in the file, 0 without any.

        If only GPS records have stamps, times are interpolated between them.
        """
        if self._offsets is None:
            parts = [(t.offsets, own) for t, own in self._timed]
            joined = np.concatenate([p[0] for p in parts]) if parts else np.zeros(0, np.int64)
            order = np.argsort(joined, kind="stable")
            self._offsets = joined[order]
            self._times = np.concatenate([p[1] for p in parts])[order] if parts else self._times
        if len(self._offsets) == 0:
            return np.zeros(len(offsets), np.int64)
        if self.interpolates:
            return interpolate_stamps(offsets, self._offsets, self._times)
        k = np.searchsorted(self._offsets, offsets) - 1
        return self._times[np.maximum(k, 0)]


def interpolate_stamps(offsets: Stamps, known: Stamps, times: Stamps) -> Stamps:
    """Interpolate stamps (n,) in us to byte ``offsets``, from ``times`` at ``known`` offsets.

    They are extrapolated with the mean time per byte.
    """
    valid = times >= 0
    known, times = known[valid], times[valid]
    if len(known) < 2 or times[-1] <= times[0]:
        return np.full(len(offsets), times[0] if len(times) else 0, np.int64)
    pace = (times[-1] - times[0]) / (known[-1] - known[0])
    inside = np.interp(offsets, known, times.astype(np.float64))
    outside = np.minimum(offsets - known[0], 0) + np.maximum(offsets - known[-1], 0)
    stamps: Stamps = np.maximum(np.round(inside + pace * outside), 0).astype(np.int64)
    return stamps


@dataclass(slots=True)
class DataflashBuilder(LogBuilder):
    """Builder of a flight log from DataFlash records; ``values``: parameters at boot, ``family``: of the firmware."""

    clock: RecordClock = field(init=False)
    values: dict[str, float] = field(init=False)
    family: str = ""

    def __post_init__(self) -> None:
        LogBuilder.__post_init__(self)
        self.clock = RecordClock(self.messages)
        self.values = boot_values(self.messages.params)

    def stamps(self, table: Table) -> Stamps:
        """Return the stamps (n,) of a table in us of the boot clock."""
        return self.clock.of(table)

    def sampled(self, name: str, *needed: str) -> Table | None:
        """Return the table of a message if it has these columns and usable stamps, else None."""
        table = self.messages.first(name)
        if table is None or not all(c in table for c in needed) or self.clock.of_samples(table) is None:
            return None
        return table

    def units(self, name: str) -> dict[int, Table]:
        """Return the tables of a message by unit."""
        return unit_tables(self.messages, name)


# --- units and EKF cores ----------------------------------------------------------------------------------------


def unit_tables(messages: Messages, name: str) -> dict[int, Table]:
    """Return the tables of a message by unit: by instance column (4.1 on) or by name (IMU, IMU2; GYR1, GYR2)."""
    found: dict[int, Table] = {i: messages[name, i] for i in messages.instances(name)}
    for number in range(1, 10):
        table = messages.tables.get((f"{name}{number}", 0))
        if table is not None:
            found.setdefault(number - 1, table)
    return found


def source_name(table: Table, unit: int) -> str:
    """Return the name of a unit's record in the log: ``IMU:1`` with instances, ``IMU2`` without."""
    return f"{table.name}:{unit}" if table.instance == unit and "I" in table else table.name


def primary_core(builder: DataflashBuilder) -> tuple[str, Stamps, list[int]]:
    """Return the EKF family that flew (XK, NK or empty), with stamps in us and primary cores.

    Both families may run at once; EKF2 (NK) flies with AHRS_EKF_TYPE 2.
    """
    for family in ("NK", "XK") if builder.values.get("AHRS_EKF_TYPE") == 2 else ("XK", "NK"):
        table = builder.messages.first(f"{family}F4")
        if table is not None and "PI" in table:
            primary = table["PI"].astype(np.int64)
            good = (primary >= 0) & (primary < 6)
            return family, builder.stamps(table)[good], primary[good].tolist()
    return "", np.zeros(0, np.int64), []


def unit_of_core(builder: DataflashBuilder, family: str, core: int, have: list[int]) -> int:
    """Return the IMU of an EKF core: cores use the set bits of EKx_IMU_MASK in ascending order."""
    mask = builder.values.get("EK3_IMU_MASK" if family == "XK" else "EK2_IMU_MASK")
    bits = [k for k in range(8) if int(mask or 0) >> k & 1]
    return bits[core] if core < len(bits) else (core if core in have else 0)


# --- inertial sources -------------------------------------------------------------------------------------------


def imu_candidates(builder: DataflashBuilder) -> list[ImuCandidate]:
    """Return every inertial source of the log."""
    readers = {"RISI": replay_records, "IMT": increment_records, "GYR": raw_records, "IMU": imu_records}
    return read_candidates(builder, [(name, partial(read, builder)) for name, read in readers.items()])


def imu_records(builder: DataflashBuilder) -> list[ImuCandidate]:
    """Read ``IMU``: calibrated, body frame, low-pass filtered, sampled at an instant."""
    found = []
    for unit, table in builder.units("IMU").items():
        source = source_name(table, unit)
        if missing := [c for c in (*GYRO_COLUMNS, *ACC_COLUMNS) if c not in table]:
            text = f"{source}: its {len(table):,} records hold no {', '.join(missing)}."
            builder.problem("unreadable_message", "warning", text, count=len(table))
            continue
        if own_time(table) is None:
            text = f"The records of IMU {unit} carry no time stamp (ArduPilot 3.0 and older): they cannot be replayed."
            builder.problem("imu_without_time", "error", text)
            continue
        t = builder.stamps(table)
        gyro_cut, acc_cut = filter_cutoffs(builder.messages.params, int(t[0]) if len(t) else 0)
        one = ImuCandidate(unit, 3, t, columns(table, *GYRO_COLUMNS), columns(table, *ACC_COLUMNS), source, "instant")
        one.filtered = f"low-pass {gyro_cut:.0f} Hz" if gyro_cut else "unknown"
        one.gyro_delay, one.acc_delay = low_pass_delay(gyro_cut), low_pass_delay(acc_cut)
        one.temperature = next((table.value(c) for c in ("T", "Temp") if c in table), None)
        found.append(one)
    return found


def filter_cutoffs(params: list[ParamChange], t_us: int) -> tuple[float, float]:
    """Return the cutoffs in Hz of gyro and accelerometer low-pass at a time, 0 where unknown.

    INS_GYRO_FILTER and INS_ACCEL_FILTER exist since 3.3. Before, INS_MPU6K_FILTER set the low-pass inside the sensor,
    whose delay is not that of a second-order filter.
    """
    values = {"INS_GYRO_FILTER": 0.0, "INS_ACCEL_FILTER": 0.0}
    seen: set[str] = set()
    for change in params:
        if change.is_default or change.name not in values or not 0 <= change.value <= MAX_CUTOFF_HZ:
            continue
        if change.name not in seen or change.t_us is None or change.t_us <= t_us:
            values[change.name] = float(change.value)
            seen.add(change.name)
    return values["INS_GYRO_FILTER"], values["INS_ACCEL_FILTER"]


def raw_records(builder: DataflashBuilder) -> list[ImuCandidate]:
    """Read ``GYR`` with ``ACC``: every sample of the sensors, stamped by ``SampleUS``."""
    params = builder.messages.params
    accs = builder.units("ACC")
    options = next((int(p.value) for p in params if p.name == "INS_RAW_LOG_OPT" and not p.is_default), 0)
    filtered = bool(options & RAW_AFTER_FILTERS_BIT)
    gyro_cut, acc_cut = filter_cutoffs(params, 0) if filtered else (0.0, 0.0)
    found = []
    for unit, table in builder.units("GYR").items():
        partner = accs.get(unit)
        if partner is None or not all(c in table for c in GYRO_COLUMNS) or not all(c in partner for c in ACC_COLUMNS):
            continue
        t, t_acc = sensor_time(builder, table), sensor_time(builder, partner)
        rising = np.concatenate([[True], np.diff(t_acc) > 0])
        acc = resample_vectors(t, t_acc[rising], columns(partner, *ACC_COLUMNS)[rising])
        one = ImuCandidate(unit, 2, t, columns(table, *GYRO_COLUMNS), acc, f"{table.name}:{unit}", "instant")
        one.filtered = f"low-pass {gyro_cut:.0f} Hz" if filtered else "none"
        one.gyro_delay, one.acc_delay = low_pass_delay(gyro_cut), low_pass_delay(acc_cut)
        one.acc_source = f"{partner.name}:{unit}"
        one = drop_unpaired(one)
        one.usable = one.rate >= MIN_RAW_HZ
        found.append(one)
    return found


def sensor_time(builder: DataflashBuilder, table: Table) -> Stamps:
    """Return ``SampleUS`` as stamps, or the records' stamps if it is missing or deviates from them."""
    t = builder.stamps(table)
    if "SampleUS" not in table:
        return t
    sample = table["SampleUS"].astype(np.int64)
    return sample if len(t) and abs(int(median(t - sample))) < MAX_SENSOR_CLOCK_US else t


def increment_records(builder: DataflashBuilder) -> list[ImuCandidate]:
    """Read ``IMT``: delta angles and delta velocities with their integration times."""
    found = []
    for unit, table in builder.units("IMT").items():
        needed = (IMT_COLUMNS.angle_time, IMT_COLUMNS.velocity_time, *IMT_COLUMNS.angle, *IMT_COLUMNS.velocity)
        if all(c in table for c in needed):
            t, source = builder.stamps(table), source_name(table, unit)
            one = candidate_from_increments(unit, 1, t, table, IMT_COLUMNS, source)
            one.usable = one.rate >= MIN_INCREMENTS_HZ
            found.append(one)
    return found


def replay_records(builder: DataflashBuilder) -> list[ImuCandidate]:
    """Read ``RISI`` (LOG_REPLAY) of every unit: the increments that the EKF received."""
    frames = builder.messages.first("RFRH")
    if frames is None or "TimeUS" not in frames:
        return []
    return [
        candidate_from_increments(unit, 0, replay_frame_stamps(frames, table), table, RISI_COLUMNS, f"RISI:{unit}")
        for unit, table in builder.units("RISI").items()
    ]


def replay_frame_stamps(frames: Table, table: Table) -> Stamps:
    """Return stamps (n,) in us of replay records by the preceding frame header (RFRH), -1 without one."""
    k = np.searchsorted(frames.offsets, table.offsets) - 1
    time = frames["TimeUS"].astype(np.int64)
    return np.where(k >= 0, time[np.maximum(k, 0)], -1)


def candidate_from_increments(
    unit: int, rank: int, t: Stamps, table: Table, names: IncrementColumns, source: str
) -> ImuCandidate:
    """Convert increments to rates by their integration times; records without a plausible time are left out."""
    dt, dt_v = table.value(names.angle_time), table.value(names.velocity_time)
    good = (dt > 1e-5) & (dt < 1.0) & (dt_v > 1e-5) & (dt_v < 1.0)
    gyro: Array = columns(table, *names.angle)[good] / dt[good, None]
    acc: Array = columns(table, *names.velocity)[good] / dt_v[good, None]
    return ImuCandidate(unit, rank, t[good], gyro, acc, source, "interval", filtered="none", dt=dt[good])
