"""DataFlash logs against pymavlink's reader: every message, field and row of every undamaged log in hand."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from attlog.formats.base import Messages
from attlog.formats.dataflash import reader
from attlog.formats.mapping import text_of
from tests.conftest import corpus_logs

# joined from two firmwares, without formats, or not from ArduPilot: pymavlink reads other or no values there
NOT_COMPARABLE = ("two_boots", "nofmt", "px4log")

LOGS = [p for p in corpus_logs(".bin") if not any(word in p.name for word in NOT_COMPARABLE)]
SMALL = 200_000  # bytes; larger ones take pymavlink seconds


def by_size(paths: list[Path]) -> list[Any]:
    """The logs as parameters, the larger ones marked slow."""
    return [pytest.param(p, id=p.name, marks=[pytest.mark.slow] if p.stat().st_size > SMALL else []) for p in paths]


def read_with_pymavlink(path: Path) -> dict[str, dict[str, list[Any]]]:
    """Name -> column -> values of all records, as pymavlink returns them."""
    from pymavlink.DFReader import DFReader_binary

    reader = DFReader_binary(str(path))
    rows: dict[str, dict[str, list[Any]]] = defaultdict(lambda: defaultdict(list))
    while (message := reader.recv_msg()) is not None:
        for column in message.get_fieldnames():
            rows[message.get_type()][column].append(getattr(message, column))
    reader.filehandle.close()
    return rows


def in_file_order(messages: Messages, name: str, column: str) -> list[Any]:
    """All values of a column over the instances, ordered as in the file and scaled as printed."""
    tables = [messages[name, i] for i in messages.instances(name)]
    order = np.argsort(np.concatenate([t.offsets for t in tables]))
    kind = tables[0].fields[column].dtype
    if kind.base.kind == "S":
        return [text_of(raw) for raw in np.concatenate([t[column] for t in tables])[order].tolist()]
    stored = kind.shape or (kind.base.kind in "iu" and tables[0].fields[column].scale == 1.0)
    return list(np.concatenate([t[column] if stored else t.value(column) for t in tables])[order])


def close(a: np.ndarray, b: np.ndarray) -> bool:
    """Equal, NaN included, or one unit in the last place apart."""
    unequal = ~((a == b) | (np.isnan(a) & np.isnan(b)))
    a, b = a[unequal], b[unequal]
    return bool(np.all(np.isfinite(a) & np.isfinite(b))) and bool(np.all(np.abs(a - b) <= np.spacing(np.abs(b))))


def differences(messages: Messages, theirs: dict[str, dict[str, list[Any]]]) -> list[str]:
    """What differs, one sentence each."""
    found = [f"{name} is not in pymavlink's reading" for name in messages.names() if name not in theirs]
    for name, columns in theirs.items():
        for column, values in columns.items():
            if name == "FMT":
                continue  # the format of FMT itself is built in
            if not column or (name, column) == ("FILE", "Data"):
                continue
            if name not in messages.names():
                found.append(f"{name} missing")
                break
            ours = in_file_order(messages, name, column)
            if isinstance(values[0], str) or np.ndim(values[0]):
                equal = len(ours) == len(values) and all(
                    np.array_equal(a, b) for a, b in zip(ours, values, strict=True)
                )
            elif isinstance(values[0], int):
                equal = ours == values
            else:
                a, b = np.array(ours, float), np.array(values, float)
                # pymavlink divides by 100 or 1e7 where we multiply: one unit in the last place
                equal = len(a) == len(b) and close(a, b)
            if not equal:
                found.append(f"{name}.{column}: {len(ours)} against {len(values)} rows")
    return found


@pytest.mark.parametrize("path", by_size([p for p in LOGS if "garbage" not in p.name and "4.0_aux" not in p.name]))
def test_every_value_equals_what_pymavlink_reads(path: Path) -> None:
    assert differences(reader.read(path), read_with_pymavlink(path)) == []


def test_the_head_of_a_flight_equals_what_pymavlink_reads(samples: Path, tmp_path: Path) -> None:
    head = tmp_path / "head.bin"
    head.write_bytes((samples / "copter_steps_stabilize.bin").read_bytes()[:400_001])
    log = reader.read(head)
    assert len(log["IMU", 0]) > 400
    assert differences(log, read_with_pymavlink(head)) == []
    assert [log["MAG", 0].fields[c].unit for c in ("TimeUS", "I", "MagX", "OfsX")] == ["us", None, "mGauss", "mGauss"]
    assert [log["GPS", 0].fields[c].unit for c in ("Lat", "Alt", "GMS")] == ["deglatitude", "m", "ms"]
