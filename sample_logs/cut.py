"""Cut a log to a time window at record boundaries.

Kept outside the window: everything that is not dated data (definitions, units,
parameters, subscriptions) and the autopilot's texts. Works for ULog, DataFlash
binary and tlog: ``python sample_logs/cut.py LONG SHORT --from 20 --to 80``, seconds
from the first dated record.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from attlog import formats
from attlog.formats import Messages, Table

KEPT = {
    "ulog": set(),
    "dataflash": {"FMT", "FMTU", "UNIT", "MULT", "PARM", "MSG", "VER", "MODE", "EV", "ARM"},
    "tlog": {"PARAM_VALUE", "STATUSTEXT", "AUTOPILOT_VERSION"},
}
"""Messages that are kept outside the window; in a ULog they are not data records anyway."""


def cut(source: Path, target: Path, begin_s: float, end_s: float) -> None:
    """Write the records of ``source`` between two times (s from its first dated record) to ``target``."""
    log = formats.open(source)
    if log.format not in KEPT:
        raise SystemExit(f"{source}: {log.format} logs cannot be cut")
    raw = np.fromfile(source, np.uint8)
    lengths = _dataflash_lengths(log) if log.format == "dataflash" else {}
    times = {key: time_us(table, log.format) for key, table in log.items()}
    zero = min(int(t.min()) for t in times.values() if t is not None)
    keep = np.ones(len(raw), bool)
    for (name, instance), table in log.items():
        t = times[name, instance]
        if name in KEPT[log.format] or t is None:
            continue
        seconds = (t - zero) / 1e6
        for start in table.offsets[(seconds < begin_s) | (seconds >= end_s)].tolist():
            first, end = _extent(raw, start, log.format, lengths)
            keep[first:end] = False
    target.write_bytes(raw[keep].tobytes())


def time_us(table: Table, log_format: str) -> np.ndarray | None:
    """When each record was logged, None for messages without a time."""
    clock = {"ulog": "timestamp", "dataflash": "TimeUS", "tlog": "_t_us"}[log_format]
    return table[clock].astype(np.int64) if clock in table and len(table) else None


def _dataflash_lengths(log: Messages) -> dict[int, int]:
    formats_of = log["FMT", 0]
    return dict(zip(formats_of["Type"].tolist(), formats_of["Length"].tolist(), strict=True))


def _extent(raw: np.ndarray, start: int, log_format: str, lengths: dict[int, int]) -> tuple[int, int]:
    """First byte of a record and the byte behind it."""
    if log_format == "ulog":
        return start, start + 3 + int(raw[start]) + 256 * int(raw[start + 1])
    if log_format == "dataflash":
        return start, start + lengths[int(raw[start + 2])]
    payload = int(raw[start + 1])
    return start - 8, start + payload + (8 if raw[start] == 0xFE else 12 + 13 * int(raw[start + 2] & 1))


def main() -> None:
    parser = argparse.ArgumentParser(description="Cut a flight log to a time window at record boundaries.")
    parser.add_argument("source", type=Path)
    parser.add_argument("target", type=Path)
    parser.add_argument("--from", dest="begin_s", type=float, default=0.0, help="s from the first dated record")
    parser.add_argument("--to", dest="end_s", type=float, default=float("inf"))
    options = parser.parse_args()
    cut(options.source, options.target, options.begin_s, options.end_s)


if __name__ == "__main__":
    main()
