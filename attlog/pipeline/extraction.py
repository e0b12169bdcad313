"""Extract messages, SI streams or estimates of a log to CSV or Parquet.

Every table begins with ``time_s``: s on the log's clock (0 = first IMU sample). Column names carry the unit
(``gyro_x_rad_s``, ``roll_deg``); messages keep the names of their log. Frames, units, the log's hash and the version
are in the schema metadata of a Parquet file under the key ``attlog``, or in ``NAME.csv.json`` beside a CSV.
"""

from __future__ import annotations

import difflib
import io
import json
import os
import re
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from attlog import formats
from attlog.core import rotation
from attlog.core.csv_rows import csv_rows, csv_texts
from attlog.core.errors import LogUnusable, OutputError, UsageError
from attlog.core.files import file_names, sha256, staging_folder, write_all_atomic
from attlog.core.limits import EXTRACT_ANYWAY_BYTES, MAX_EXTRACT_RATIO
from attlog.core.own_files import DATA
from attlog.flight.model import FlightLog
from attlog.flight.signals import NAME, parts_of, vehicle_instance, without_part
from attlog.flight.timestamps import record_clock
from attlog.formats import Field, Messages, Table

if TYPE_CHECKING:
    import pandas

# ``MAG.0`` and ``IMU[1]``.
INSTANCE = re.compile(r"(?P<name>.+?)(?:\.(?P<dot>\d{1,9})|\[(?P<bracket>\d{1,9})\])")
# Approximate bytes of a column before its first value, and of a number in a CSV file.
COLUMN_BYTES, CELL_BYTES = 200, 8


@dataclass(slots=True)
class Extract:
    """One table to write: columns of equal length by name; ``units`` of some."""

    name: str
    columns: dict[str, NDArray[Any]]
    units: dict[str, str] = field(default_factory=dict)
    note: str = ""

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(next(iter(self.columns.values()), ()))

    def between(self, start: float | None, end: float | None) -> Extract:
        """Select rows with start <= time_s <= end; all rows without a time."""
        if "time_s" not in self.columns:
            return self
        t = self.columns["time_s"]
        inside = (t >= (-np.inf if start is None else start)) & (t <= (np.inf if end is None else end))
        return Extract(self.name, {k: v[inside] for k, v in self.columns.items()}, self.units, self.note)

    def frame(self) -> pandas.DataFrame:
        """Return the table as a pandas DataFrame."""
        import pandas

        return pandas.DataFrame(self.columns)


def messages(log: FlightLog, names: Collection[str], system: int | None = None) -> Iterator[Extract]:
    """Yield the named messages of a log, scaled by the factors of their format.

    Without names all messages. Names as of :func:`select_tables`. ``system``: the MAVLink vehicle that ``log`` was read
    for. UsageError for names that the log does not have, LogUnusable where the definitions of a small log would fill a
    disk.
    """
    opened = log.messages or formats.open(log.path, system).boot(log.boot)
    clock = record_clock(opened, system)
    size, limit = 0, max(EXTRACT_ANYWAY_BYTES, MAX_EXTRACT_RATIO * log.path.stat().st_size)
    for (name, instance), wanted, part in _selected_parts(opened, names):
        table = opened[name, instance]
        if part:
            table = _rows_of_part(table, part)
        columns: dict[str, NDArray[Any]] = {}
        stamps = clock(table)
        if stamps is not None:
            columns["time_s"] = (stamps - log.t0_us) / 1e6
        for column in wanted or table.fields:
            spec = field_of(table, column)
            columns.update(_flat(column, table.value(column) if spec.scale != 1.0 else table[column]))
        size += sum(COLUMN_BYTES + len(c) + CELL_BYTES * len(values) for c, values in columns.items())
        if size > limit:
            raise LogUnusable(
                f"{log.path}: what was asked for would take more than {limit >> 20} MB; "
                "name the messages that are wanted"
            )
        units = {c: unit for c in wanted or table.fields if (unit := field_of(table, c).unit)}
        several = len(opened.instances(name)) > 1
        title = f"{name}_{instance}" if several else name
        yield Extract(f"{title}_{part.replace('=', '_')}" if part else title, columns, units | {"time_s": "s"})


def _selected_parts(opened: Messages, names: Collection[str]) -> list[tuple[tuple[str, int], list[str], str]]:
    """Return tables with the fields that are wanted, and the sensor whose records are, empty for all records."""
    by_part: dict[str, list[str]] = {} if names else {"": []}
    for whole, part in map(without_part, names):
        by_part.setdefault(part, []).append(whole)
    return [(key, fields, part) for part, own in by_part.items() for key, fields in select_tables(opened, own).items()]


def _rows_of_part(table: Table, part: str) -> Table:
    """Return the records of one sensor of a message. UsageError, with all, for another one."""
    parts = parts_of(table)
    if part not in parts:
        known = f"it has {', '.join(parts)}" if parts else "it serves one sensor"
        raise UsageError(f"no {part} of {table.name}; {known}")
    return table.rows(parts[part])


def other_senders(log: FlightLog, names: Iterable[str]) -> list[str]:
    """Return a sentence on each named message of telemetry that others than the vehicle send too."""
    if log.messages is None or (own := vehicle_instance(log.messages)) is None:
        return []
    found = []
    for name in (_known_name(name, log.messages.names()) for name in names):
        sent = log.messages.instances(name)
        if own in sent and len(sent) > 1:
            others = ", ".join(f"{name}[{sender}]" for sender in sent if sender != own)
            found.append(f"{name}: the vehicle's own; others sent {others}")
    return found


def select_tables(opened: Messages, asked: Collection[str]) -> dict[tuple[str, int], list[str]]:
    """Select messages and instances by names, each with the named fields; all without names.

    Names are ``ATT``, ``att``, ``MAG.0``, ``IMU[1]``, and those of signals: ``ATT.Roll``, ``BAT[0].Volt``. A message
    without fields is wanted whole. In telemetry a name without an instance is the vehicle's own message, if it sends
    it. UsageError for unknown names, each with similar ones, else with all.
    """
    known, own = opened.names(), vehicle_instance(opened) if asked else None
    found: dict[tuple[str, int], list[str]] = {}
    whole: set[tuple[str, int]] = set()
    wrong = []
    for text in list(asked) or known:
        keys, fields, reason = _selected(opened, text, known, own)
        wrong += [reason] if reason else []
        whole |= set() if fields else set(keys)
        for key in keys:
            found[key] = [*dict.fromkeys([*found.get(key, []), *fields])]
    if wrong:
        raise UsageError("\n".join(f"{opened.path}: {line}" for line in wrong))
    return {key: [] if key in whole else fields for key, fields in found.items()}


def _selected(
    opened: Messages, text: str, known: Collection[str], own: int | None
) -> tuple[list[tuple[str, int]], list[str], str]:
    """Return the tables that a name selects and the field it names, or why it selects none.

    ``own``: instance that a name without one selects where a message has it.
    """
    name, instance = _name_and_instance(text, known)
    field = ""
    if not opened.instances(_known_name(name, known)) and (signal := NAME.fullmatch(text)) is not None:
        if opened.instances(_known_name(signal["message"], known)):
            name, field = signal["message"], signal["field"]
            instance = None if signal["instance"] is None else int(signal["instance"])
    name = _known_name(name, known)
    instances = opened.instances(name)
    if not instances:
        near = difflib.get_close_matches(name.casefold(), [n.casefold() for n in known], 3)
        close = [n for n in known if n.casefold() in near]
        hint = f"did you mean {', '.join(close)}?" if close else f"it has {', '.join(sorted(known))}"
        return [], [], f"no message {text}; {hint}"
    if instance is not None and instance not in instances:
        return [], [], f"no instance {instance} of {name}; it has {', '.join(map(str, instances))}"
    chosen = own if instance is None and own in instances else instance
    keys = [(name, i) for i in instances if chosen in (None, i)]
    if not field:
        return keys, [], ""
    having = [key for key in keys if field in opened[key]]
    fields = list(dict.fromkeys(column for key in keys for column in opened[key].fields))
    return having, [field], "" if having else f"no field {field} of {name}; it has {', '.join(fields)}"


def _known_name(name: str, known: Collection[str]) -> str:
    """Return a message's name as in the log, in any case."""
    return name if name in known else next((n for n in known if n.casefold() == name.casefold()), name)


def field_of(table: Table, column: str) -> Field:
    """Return the declared field of a column, or of the array that it is an element of."""
    return table.fields.get(column) or table.fields[column.rpartition("[")[0]]


def _name_and_instance(text: str, known: Collection[str]) -> tuple[str, int | None]:
    """Split a name into message and instance: text before ``.N`` or ``[N]``, and N.

    A known name is returned whole.
    """
    match = None if text in known else INSTANCE.fullmatch(text)
    return (match["name"], int(match["dot"] or match["bracket"])) if match else (text, None)


def streams(log: FlightLog) -> Iterator[Extract]:
    """Yield the flight in SI units: imuN, magN, gnssN, baroN, attitudes, truth and set-points."""
    for imu in log.imus:
        yield _table(f"imu{imu.index}", imu.gyro.t, gyro_rad_s=imu.gyro.x, acc_m_s2=imu.acc.x, note=imu.gyro.source)
    for mag in log.mags:
        yield _table(f"mag{mag.index}", mag.field.t_best, mag_ut=1e6 * mag.field.x, note=mag.field.source)
    for g in log.gnss:
        columns = {
            "time_s": g.t,
            "lat_deg": g.lat,
            "lon_deg": g.lon,
            "alt_m": g.alt,
            "fix": g.fix,
            "vel_n_m_s": g.vel_ned[:, 0],
            "vel_e_m_s": g.vel_ned[:, 1],
            "vel_d_m_s": g.vel_ned[:, 2],
            "h_acc_m": g.h_acc,
            "v_acc_m": g.v_acc,
            "s_acc_m_s": g.s_acc,
        }
        yield Extract(f"gnss{g.index}", columns, _units(columns), g.source)
    for k, baro in enumerate(log.baro):
        yield Extract(
            f"baro{k}",
            {"time_s": baro.t, f"baro_{_word(baro.unit)}": baro.x.reshape(len(baro.t), -1)[:, 0]},
            {"time_s": "s"},
            baro.source,
        )
    attitudes = dict(log.attitudes)
    if log.truth is not None:
        attitudes["truth"] = log.truth
    if log.setpoints.attitude is not None:
        attitudes["setpoint"] = log.setpoints.attitude
    for name, attitude in attitudes.items():
        yield _attitude(f"attitude_{_word(name)}", attitude.t, attitude.q, attitude.source)


def estimates(log: FlightLog, specs: list[str]) -> Iterator[Extract]:
    """Yield the attitude of each re-run estimator at IMU rate, and innovations.

    Innovations are those of an onboard filter. The gyro's bias at rest is subtracted first, as in an analysis; ``bias``
    columns include it.
    """
    from attlog.estimators.rerun import AIDS, INNOVATION_COLUMNS, innovations
    from attlog.pipeline import prepare
    from attlog.pipeline.replay import run_rows
    from attlog.reference.smoother import heading_words

    case = prepare(log, {"estimators": specs})
    for row in run_rows(case, specs):
        table = _attitude(f"estimate_{_word(row.name)}", row.t, row.q, row.name)
        taken = None if row.imu is None or row.kind == "rerun" else case.bias_of(row.imu)
        if taken is not None and taken.dps is not None:
            x, y, z = taken.dps
            table.note += f"; subtracted from the gyro first: {x:.4f}, {y:.4f}, {z:.4f} deg/s ({taken.taken})"
        if words := heading_words(row.quality):
            table.note += f"; {words}"
        if row.bias is not None:
            for k, axis in enumerate("xyz"):
                table.columns[f"bias_{axis}_rad_s"] = row.bias[:, k]
            table.units |= {f"bias_{axis}_rad_s": "rad/s" for axis in "xyz"}
        for name, values in row.aux.items():
            if len(values) != len(row.t):
                continue  # has its own time column
            wide = values.reshape(len(row.t), -1)
            ends = [""] if wide.shape[1] == 1 else [f"_{k}" for k in range(wide.shape[1])]
            table.columns |= {name + end: wide[:, k] for k, end in enumerate(ends)}
            table.units |= {name + end: "rad" for end in ends if name in ("sigma_tilt", "sigma_heading")}
        yield table
        for aid, values in innovations(row.aux).items():
            columns = {"time_s": values[:, 0]} | {n: values[:, k] for k, n in enumerate(INNOVATION_COLUMNS) if k}
            units = {"time_s": "s", "innovation": AIDS[aid], "variance": f"({AIDS[aid]})^2"}
            yield Extract(f"{table.name}_innovation_{aid}", columns, units, f"{aid} of {row.name}")


def write(tables: Iterable[Extract], log: FlightLog, path: Path, kind: str) -> list[Path]:
    """Write tables and return the files written.

    One table goes to ``path`` itself if that ends in the format's suffix and is no folder. Otherwise ``path`` is a
    folder with one file per table, all or none. OutputError if a file cannot be written or pyarrow is missing.
    """
    listed = list(tables)
    meta = _about(log)
    single = path.suffix.lower() == f".{kind}" and not os.path.isdir(path)
    if single and len(listed) > 1:
        raise UsageError(f"-o {path}: {_too_many(listed)} need a folder")
    if single:
        for table in listed:
            _write(table, path, meta, kind)
        return [path for _ in listed]
    names = [f"{name}.{kind}" for name in file_names(table.name for table in listed)]
    with staging_folder(path, DATA.of(meta["sha256"])) as stage:
        for table, name in zip(listed, names, strict=True):
            _write(table, stage / name, meta, kind)
    return [path / name for name in names]


def _write(table: Extract, target: Path, meta: dict[str, Any], kind: str) -> None:
    """Write one table into one file, CSV with a JSON file beside it."""
    content, about = _encoded(table, meta, kind)
    beside = {target.with_name(target.name + ".json"): about + "\n"} if kind == "csv" else {}
    write_all_atomic({target: content, **beside}, DATA.of(meta["sha256"]))


def write_stream(tables: Iterable[Extract], log: FlightLog, stream: BinaryIO, kind: str) -> None:
    """Write a single table to an open stream. UsageError if there are several."""
    listed = list(tables)
    if len(listed) != 1:
        raise UsageError(f"-o -: standard output takes one table, not {_too_many(listed)}")
    stream.write(_encoded(listed[0], _about(log), kind)[0])
    stream.flush()


def _encoded(table: Extract, meta: dict[str, Any], kind: str) -> tuple[bytes, str]:
    """Return the content of a file, and the table's metadata as JSON."""
    about = json.dumps(meta | {"table": table.name, "units": table.units, "source": table.note}, indent=1)
    return (_csv(table) if kind == "csv" else _parquet(table, about)), about


def _too_many(tables: list[Extract]) -> str:
    names = ", ".join(t.name for t in tables[:6])
    return f"{len(tables)} tables ({names}{' ...' if len(tables) > 6 else ''})"


def _about(log: FlightLog) -> dict[str, Any]:
    """Return the metadata that every file has of its log."""
    from attlog import __version__

    return {
        "log": log.path.name,
        "sha256": sha256(log.path),
        "attlog": __version__,
        "frame": "body FRD, earth NED",
        "t0_us": log.t0_us,
        "utc_offset_s": log.utc_offset,
    }


def _csv(table: Extract) -> bytes:
    head = b",".join(csv_texts(list(table.columns))) + b"\n"
    return b"".join([head, *csv_rows(list(table.columns.values()))])


def _parquet(table: Extract, about: str) -> bytes:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise OutputError("Parquet needs pyarrow: pip install pyarrow, or use --format csv") from None
    arrow = pyarrow.Table.from_pandas(table.frame(), preserve_index=False)
    arrow = arrow.replace_schema_metadata((arrow.schema.metadata or {}) | {b"attlog": about.encode()})
    buffer = io.BytesIO()
    pyarrow.parquet.write_table(arrow, buffer)
    return buffer.getvalue()


def _table(name: str, t: NDArray[np.float64], note: str, **vectors: NDArray[np.float64]) -> Extract:
    columns: dict[str, NDArray[Any]] = {"time_s": t}
    for label, x in vectors.items():
        quantity, _, unit = label.partition("_")
        for k, axis in enumerate("xyz"):
            columns[f"{quantity}_{axis}_{unit}"] = x[:, k]
    return Extract(name, columns, _units(columns), note)


def _attitude(name: str, t: NDArray[np.float64], q: NDArray[np.float64], note: str) -> Extract:
    euler = np.degrees(rotation.to_euler(q))
    columns: dict[str, NDArray[Any]] = {"time_s": t}
    columns |= {f"q_{c}": q[:, k] for k, c in enumerate("wxyz")}
    columns |= {f"{c}_deg": euler[:, k] for k, c in enumerate(("roll", "pitch", "yaw"))}
    return Extract(name, columns, _units(columns), note)


def _units(columns: Iterable[str]) -> dict[str, str]:
    """Return the unit at the end of each column's name."""
    endings = {"_rad_s": "rad/s", "_m_s2": "m/s^2", "_m_s": "m/s", "_ut": "uT", "_deg": "deg", "_m": "m", "_s": "s"}
    return {c: unit for c in columns for unit in [next((u for e, u in endings.items() if c.endswith(e)), "")] if unit}


def _flat(name: str, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return an array column as scalar columns ``name[0]``, bytes as str."""
    if values.dtype.kind == "S":
        return {name: np.array([v.split(b"\0")[0].decode("utf-8", "replace") for v in values.tolist()], dtype=object)}
    if values.ndim == 1:
        return {name: values}
    return {f"{name}[{k}]": values[:, k] for k in range(values.shape[1])}


def _word(text: str) -> str:
    """Return text as part of a file or column name."""
    return "".join(c if c.isalnum() or c in "-." else "_" for c in text)
