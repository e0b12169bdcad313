"""The boot clock of DataFlash records in every era.

``TimeUS`` since 3.3; before that ``TimeMS``, except in GPS records, whose TimeMS
is the time of the GPS week and ``T`` the boot clock. Records without time (EV,
MODE, MSG of 3.x) get the time of the record before them in the file. In 3.1 and
older no record but GPS carries a time: all others get theirs from their place in
the file between GPS records, as pymavlink does, good to about one GPS interval.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np

from attlog.core.timestamps import Stamps
from attlog.flight.builder import LogBuilder, columns
from attlog.flight.imu import ImuCandidate, drop_unpaired, low_pass_delay, resample_vectors, validate_candidates
from attlog.flight.model import Array
from attlog.flight.timestamps import read_stamps
from attlog.formats.table import Messages, ParamChange, Table


def own_time(table: Table) -> Stamps | None:
    """The stamps (n,) in us that the records carry themselves, None where they carry none (or text in its place)."""
    column, us = "TimeUS", 1
    if column not in table:
        column, us = "T" if ("Week" in table or "GWk" in table) and "T" in table else "TimeMS", 1000
    if column not in table and table.name == "GPS":
        column = "Time"  # of the GPS week, in 3.0
    if column not in table:
        return None
    try:
        return read_stamps(table, column, us)
    except ValueError:
        return None


class RecordClock:
    """Times of any record of a log by its place in the file."""

    def __init__(self, messages: Messages) -> None:
        self.messages = messages
        self._offsets: Stamps | None = None
        self._times: Stamps = np.zeros(0, np.int64)

    @cached_property
    def known(self) -> bool:
        """Whether any record carries a time."""
        return bool(self._timed)

    @cached_property
    def interpolates(self) -> bool:
        """Whether GPS records alone carry a time (3.1 and older)."""
        return self.known and all(table.name == "GPS" for table, _ in self._timed)

    @cached_property
    def _timed(self) -> list[tuple[Table, Stamps]]:
        """The tables that carry a time, with their stamps."""
        return [(t, own) for t in self.messages.values() if (own := own_time(t)) is not None]

    def of_samples(self, table: Table) -> Stamps | None:
        """Stamps (n,) in us that are good enough for a stream: the records' own or interpolated; else None."""
        own = own_time(table)
        return self.at(table.offsets) if own is None and self.interpolates else own

    def of(self, table: Table) -> Stamps:
        """Stamps (n,) in us: the records' own, else what their place in the file tells."""
        own = own_time(table)
        return self.at(table.offsets) if own is None else own

    def at(self, offsets: Stamps) -> Stamps:
        """The time of the last timed record before each place in the file, between GPS records where only they
        carry a time; 0 in a log without any."""
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
    """Stamps (n,) in us at places in a file, from those (m,) at ``known`` places; beyond both ends at the mean pace."""
    valid = times >= 0
    known, times = known[valid], times[valid]
    if len(known) < 2 or times[-1] <= times[0]:
        return np.full(len(offsets), times[0] if len(times) else 0, np.int64)
    pace = (times[-1] - times[0]) / (known[-1] - known[0])
    inside = np.interp(offsets, known, times.astype(np.float64))
    outside = np.minimum(offsets - known[0], 0) + np.maximum(offsets - known[-1], 0)
    stamps: Stamps = np.maximum(np.round(inside + pace * outside), 0).astype(np.int64)
    return stamps


# Inertial data of ArduPilot logs, best source first (docs/flight.md).
#
# RISI (LOG_REPLAY) > IMT increments >= 100 Hz > GYR/ACC raw >= 400 Hz > IMU. Batches
# (ISBD) are never a continuous input.

MIN_INCREMENTS_HZ = 100.0
MIN_RAW_HZ = 400.0
MAX_CUTOFF_HZ = 10_000.0
"""No filter of an autopilot reaches further; other values are damage."""
GYRO_COLUMNS, ACC_COLUMNS = ("GyrX", "GyrY", "GyrZ"), ("AccX", "AccY", "AccZ")


def unit_tables(messages: Messages, name: str) -> dict[int, Table]:
    """Tables of a message by unit, numbered by instance column (4.1 on) or by name (IMU, IMU2, IMU3)."""
    found: dict[int, Table] = {}
    for instance in messages.instances(name):
        found[instance] = messages[name, instance]
    for extra in range(2, 10):
        table = messages.tables.get((f"{name}{extra}", 0))
        if table is not None and extra - 1 not in found:
            found[extra - 1] = table
    return found


def raw_units(messages: Messages, name: str) -> dict[int, Table]:
    """GYR or ACC tables by unit: an instance column, or before 4.1 the names GYR1, GYR2, GYR3."""
    numbered = {k: messages.tables.get((f"{name}{k + 1}", 0)) for k in range(9)}
    named = {k: t for k, t in numbered.items() if t is not None}
    return named or {i: messages[name, i] for i in messages.instances(name)}


def imu_candidates(builder: LogBuilder, clock: RecordClock, params: list[ParamChange]) -> list[ImuCandidate]:
    """Every inertial source of the log, cleaned."""
    sources: dict[str, Callable[[], list[ImuCandidate]]] = {
        "RISI": lambda: replay_records(builder),
        "IMT": lambda: increment_records(builder, clock),
        "GYR": lambda: raw_records(builder, clock, params),
        "IMU": lambda: imu_records(builder, clock, params),
    }
    found = [c for name, source in sources.items() for c in builder.attempt(name, source, [])]
    return validate_candidates(builder, found)


def imu_records(builder: LogBuilder, clock: RecordClock, params: list[ParamChange]) -> list[ImuCandidate]:
    """``IMU`` records: calibrated, body frame, after the firmware's low-pass filters, at one instant."""
    found = []
    for unit, table in unit_tables(builder.messages, "IMU").items():
        if missing := [c for c in (*GYRO_COLUMNS, *ACC_COLUMNS) if c not in table]:
            text = f"{source_name(table, unit)}: its {len(table):,} records hold no {', '.join(missing)}."
            builder.problem("unreadable_message", "warning", text, count=len(table))
            continue
        t = clock.of(table)
        timed = own_time(table) is not None
        if not timed:
            builder.problem(
                "imu_without_time",
                "error",
                f"The records of IMU {unit} carry no time stamp (ArduPilot 3.0 and older): they cannot be replayed.",
            )
            continue
        gyro_cut, acc_cut = filter_cutoffs(params, int(t[0]) if len(t) else 0)
        temperature = next((table.value(c) for c in ("T", "Temp") if c in table), None)
        found.append(
            ImuCandidate(
                unit,
                3,
                t,
                columns(table, *GYRO_COLUMNS),
                columns(table, *ACC_COLUMNS),
                source_name(table, unit),
                "instant",
                filtered=f"low-pass {gyro_cut:.0f} Hz" if gyro_cut else "unknown",
                gyro_delay=low_pass_delay(gyro_cut),
                acc_delay=low_pass_delay(acc_cut),
                temperature=temperature,
            )
        )
    return found


def source_name(table: Table, unit: int) -> str:
    """The source as people find it in the log: ``IMU:1`` with instances, ``IMU2`` by name."""
    return f"{table.name}:{unit}" if table.instance == unit and "I" in table else table.name


def filter_cutoffs(params: list[ParamChange], t_us: int) -> tuple[float, float]:
    """Cutoff frequencies in Hz of the gyro and accelerometer low-pass at a time, 0 where unknown.

    3.3 and later: INS_GYRO_FILTER, INS_ACCEL_FILTER. Before, INS_MPU6K_FILTER set the
    low-pass inside the sensor, whose delay is not that of a second-order filter.
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


def raw_records(builder: LogBuilder, clock: RecordClock, params: list[ParamChange]) -> list[ImuCandidate]:
    """``GYR`` with ``ACC``: every sample of the sensors at their own clock ``SampleUS``."""
    gyros, accs = raw_units(builder.messages, "GYR"), raw_units(builder.messages, "ACC")
    options = next((int(p.value) for p in params if p.name == "INS_RAW_LOG_OPT" and not p.is_default), 0)
    after = bool(options & 4)
    gyro_cut, acc_cut = filter_cutoffs(params, 0) if after else (0.0, 0.0)
    found = []
    for unit, table in gyros.items():
        partner = accs.get(unit)
        if partner is None or not all(c in table for c in GYRO_COLUMNS) or not all(c in partner for c in ACC_COLUMNS):
            continue
        t, t_acc = sample_time(table, clock), sample_time(partner, clock)
        rising = np.concatenate([[True], np.diff(t_acc) > 0])
        acc = columns(partner, *ACC_COLUMNS)[rising]
        one = ImuCandidate(
            unit,
            2,
            t,
            columns(table, *GYRO_COLUMNS),
            resample_vectors(t, t_acc[rising], acc),
            f"{table.name}:{unit}",
            "instant",
            filtered=f"low-pass {gyro_cut:.0f} Hz" if after else "none",
            gyro_delay=low_pass_delay(gyro_cut),
            acc_delay=low_pass_delay(acc_cut),
            acc_source=f"{partner.name}:{unit}",
        )
        one = drop_unpaired(one)
        one.usable = one.rate >= MIN_RAW_HZ
        found.append(one)
    return found


def sample_time(table: Table, clock: RecordClock) -> Stamps:
    """The sensor's own stamps in us; they may start anew or be unset, then the record's stamp counts."""
    t = clock.of(table)
    if "SampleUS" not in table:
        return t
    sample = table["SampleUS"].astype(np.int64)
    return sample if len(t) and abs(int(np.median(t - sample))) < 1_000_000 else t


def increment_records(builder: LogBuilder, clock: RecordClock) -> list[ImuCandidate]:
    """``IMT``: delta angles and velocities with their own integration times."""
    found = []
    for unit, table in unit_tables(builder.messages, "IMT").items():
        needed = ("DelvT", "DelaT", "DelAX", "DelAY", "DelAZ", "DelVX", "DelVY", "DelVZ")
        if all(c in table for c in needed):
            one = candidate_from_increments(
                unit,
                1,
                clock.of(table),
                table.value("DelaT"),
                columns(table, "DelAX", "DelAY", "DelAZ"),
                table.value("DelvT"),
                columns(table, "DelVX", "DelVY", "DelVZ"),
                source_name(table, unit),
            )
            one.usable = one.rate >= MIN_INCREMENTS_HZ
            found.append(one)
    return found


def replay_records(builder: LogBuilder) -> list[ImuCandidate]:
    """``RISI`` (LOG_REPLAY) of every unit: the increments that the EKF was given."""
    frames = builder.messages.first("RFRH")
    if frames is None or "TimeUS" not in frames:
        return []
    return [
        candidate_from_increments(
            unit,
            0,
            replay_frame_stamps(frames, table),
            table.value("DADT"),
            columns(table, "DAX", "DAY", "DAZ"),
            table.value("DVDT"),
            columns(table, "DVX", "DVY", "DVZ"),
            f"RISI:{unit}",
        )
        for unit, table in unit_tables(builder.messages, "RISI").items()
    ]


def replay_frame_stamps(frames: Table, table: Table) -> Stamps:
    """Stamps (n,) in us of replay records: that of the frame header (RFRH) before each; -1 before the first."""
    k = np.searchsorted(frames.offsets, table.offsets) - 1
    time = frames["TimeUS"].astype(np.int64)
    return np.where(k >= 0, time[np.maximum(k, 0)], -1)


def candidate_from_increments(
    unit: int, rank: int, t: Stamps, dt: Array, angle: Array, dt_v: Array, velocity: Array, source: str
) -> ImuCandidate:
    """Rates from increments by their own integration times; records without a time are left out."""
    good = (dt > 1e-5) & (dt < 1.0) & (dt_v > 1e-5) & (dt_v < 1.0)
    return ImuCandidate(
        unit,
        rank,
        t[good],
        angle[good] / dt[good, None],
        velocity[good] / dt_v[good, None],
        source,
        "interval",
        filtered="none",
        dt=dt[good],
    )


def primary_core(messages: Messages, clock: RecordClock, ekf_type: float | None) -> tuple[str, Stamps, list[int]]:
    """The EKF family that flew (XK, NK or empty), and when which of its cores was primary.

    Both may run; AHRS_EKF_TYPE 2 means that EKF2 (NK) flies.
    """
    for family in ("NK", "XK") if ekf_type == 2 else ("XK", "NK"):
        table = messages.first(f"{family}F4")
        if table is not None and "PI" in table:
            primary = table["PI"].astype(np.int64)
            good = (primary >= 0) & (primary < 6)
            return family, clock.of(table)[good], primary[good].tolist()
    return "", np.zeros(0, np.int64), []


def unit_of_core(core: int, mask: float | None, have: list[int]) -> int:
    """The IMU that an EKF core uses: cores take the set bits of EKx_IMU_MASK in ascending order."""
    bits = [k for k in range(8) if int(mask or 0) >> k & 1]
    return bits[core] if core < len(bits) else (core if core in have else 0)
