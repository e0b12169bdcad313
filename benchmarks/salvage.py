"""Print the share of intact records that attlog keeps of damaged logs.

Damage is seeded and put on short cuts of ``sample_logs``. A record is intact when
no damage touches its bytes; a false record is one that a reader returns although
the undamaged log has no such record. ``python benchmarks/salvage.py [--seconds 10] [--seeds 2]``.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from attlog import formats
from attlog.core.errors import AttlogError
from attlog.formats import Messages
from attlog.formats.mavlink.layout import STAMP_COLUMN

SAMPLES = Path(__file__).resolve().parent.parent / "sample_logs"
LOGS = {"px4_hover.ulg": 60.0, "copter_steps_stabilize.bin": 60.0, "copter_steps_stabilize.tlog": 40.0}
"""Sample logs and where (s) the cut begins: in flight."""

Rows = Counter[tuple[str, ...]]
Injury = Callable[[np.ndarray, int, np.random.Generator], tuple[np.ndarray, np.ndarray]]
"""Bytes, first byte that may be hurt, dice -> damaged bytes and which of the old bytes are untouched."""


def overwritten(raw: np.ndarray, begin: int, dice: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """20 places of 1 to 400 random bytes."""
    return _overwrite(raw, begin, dice, 20, lambda: dice.integers(0, 256, dice.integers(1, 400)))


def zero_blocks(raw: np.ndarray, begin: int, dice: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """4 flash blocks of 4096 zeros."""
    return _overwrite(raw, begin, dice, 4, lambda: np.zeros(4096))


def erased_blocks(raw: np.ndarray, begin: int, dice: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """4 flash blocks of 4096 bytes 0xff."""
    return _overwrite(raw, begin, dice, 4, lambda: np.full(4096, 255))


def inserted(raw: np.ndarray, begin: int, dice: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """10 times up to 3000 random bytes in between; the record that is torn apart is lost."""
    return _join(raw, begin, dice, 10, lambda: dice.integers(0, 256, dice.integers(1, 3000)), 0)


def removed(raw: np.ndarray, begin: int, dice: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """10 times up to 3000 bytes gone."""
    return _join(raw, begin, dice, 10, lambda: np.zeros(0), 3000)


def spliced(raw: np.ndarray, begin: int, dice: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Other bytes of the same log in between, cut at any byte: 10 times."""
    return _join(raw, begin, dice, 10, lambda: _excerpt(raw, begin, dice), 0)


KINDS: list[Injury] = [overwritten, zero_blocks, erased_blocks, inserted, removed, spliced]


def _excerpt(raw: np.ndarray, begin: int, dice: np.random.Generator) -> np.ndarray:
    start = int(dice.integers(begin, len(raw) - 500))
    return raw[start : start + int(dice.integers(10, 500))]


def _overwrite(
    raw: np.ndarray, begin: int, dice: np.random.Generator, count: int, junk: Callable[[], np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    hurt, untouched = raw.copy(), np.ones(len(raw), bool)
    for _ in range(count):
        bytes_ = junk()
        at = int(dice.integers(begin, len(raw) - len(bytes_)))
        hurt[at : at + len(bytes_)] = bytes_
        untouched[at : at + len(bytes_)] = False
    return hurt, untouched


def _join(
    raw: np.ndarray, begin: int, dice: np.random.Generator, count: int, junk: Callable[[], np.ndarray], longest_gap: int
) -> tuple[np.ndarray, np.ndarray]:
    """The log with junk in between. A torn record is marked by its first byte behind the tear: see ``intact``."""
    untouched, parts, last = np.ones(len(raw), bool), [], 0
    for at in np.sort(dice.choice(np.arange(begin, len(raw) - longest_gap - 1), count, replace=False)).tolist():
        at = max(at, last)
        gap = int(dice.integers(1, longest_gap)) if longest_gap else 0
        parts += [raw[last:at], junk().astype(np.uint8)]
        last = at + gap
        untouched[at : max(last, at + 1)] = False
    return np.concatenate([*parts, raw[last:]]), untouched


def extents(log: Messages, raw: np.ndarray) -> dict[tuple[str, int], np.ndarray]:
    """Start and end byte of every record (n, 2); a record ends at the latest where the next begins."""
    starts = np.sort(np.concatenate([table.offsets for table in log.values()]))
    found = {}
    for key, table in log.items():
        if log.format == "ulog":
            length = 3 + raw[table.offsets].astype(int) + 256 * raw[table.offsets + 1].astype(int)
        elif log.format == "tlog":
            length = raw[table.offsets + 1].astype(int) + np.where(raw[table.offsets] == 0xFE, 8, 12)
        else:
            after = np.append(starts, len(raw))[np.searchsorted(starts, table.offsets) + 1]
            length = np.minimum(after - table.offsets, _dataflash_length(log, raw, table.offsets))
        found[key] = np.stack([table.offsets, table.offsets + length], axis=1)
    return found


def _dataflash_length(log: Messages, raw: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    described = log["FMT", 0]
    lengths = np.zeros(256, int)
    lengths[described["Type"]] = described["Length"]
    return lengths[raw[offsets + 2]]


def intact_rows(log: Messages, raw: np.ndarray, untouched: np.ndarray) -> Rows:
    """The records of the undamaged log that no damage touches."""
    hurt = np.concatenate([[0], np.cumsum(~untouched)])
    alive = {key: hurt[e[:, 1]] == hurt[e[:, 0]] for key, e in extents(log, raw).items()}
    tables = {key: table.rows(alive[key]) for key, table in log.items()}
    return rows_of(Messages(log.path, log.format, log.size, {k: t for k, t in tables.items() if len(t)}))


def rows_of(log: Messages) -> Rows:
    """Return all records of a log as texts, without the receiver's stamps, which no checksum covers."""
    rows: Rows = Counter()
    for key, table in log.items():
        if key[0] in ("FMT", "FILE"):
            continue
        columns = [list(map(str, table[name].tolist())) for name in sorted(table.fields) if name != STAMP_COLUMN]
        rows.update((key[0], str(key[1]), *row) for row in zip(*columns, strict=True))
    return rows


@dataclass(frozen=True)
class Salvage:
    """Records of one log with one kind of damage over all seeds: intact, kept and false ones."""

    log: str
    damage: str
    intact: int
    kept: int
    false: int
    files: int

    @property
    def kept_pct(self) -> float:
        return 100.0 * self.kept / max(self.intact, 1)


def measure(name: str, begin_s: float, damage: Injury, seconds: float, seeds: int, folder: Path) -> Salvage:
    """Read damaged files of one log."""
    short = folder / name
    _cutter()(SAMPLES / name, short, begin_s, begin_s + seconds)
    log, raw = formats.open(short), np.fromfile(short, np.uint8)
    begin, everything = _data_begin(log), rows_of(log)
    count = kept = false = 0
    for seed in range(seeds):
        hurt, untouched = damage(raw, begin, np.random.default_rng(seed))
        path = folder / f"hurt{short.suffix}"
        hurt.astype(np.uint8).tofile(path)
        intact = intact_rows(log, raw, untouched)
        try:
            rows = rows_of(formats.open(path))
        except AttlogError:
            rows = Counter()
        count += intact.total()
        kept += (intact & rows).total()
        false += sum(n for row, n in rows.items() if row not in everything)
    return Salvage(name, damage.__name__, count, kept, false, seeds)


def _data_begin(log: Messages) -> int:
    """Where dated data begins: definitions before it are not hurt (what they define is lost)."""
    first = {"ulog": "sensor_combined", "dataflash": "IMU", "tlog": "RAW_IMU"}[log.format]
    table = log.first(first)
    return int(table.offsets[len(table) // 10]) if table is not None else log.size // 10


def _cutter() -> Callable[[Path, Path, float, float], None]:
    spec = importlib.util.spec_from_file_location("cut", SAMPLES / "cut.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.cut


def main(arguments: list[str] | None = None) -> list[Salvage]:
    """Measure and print the table; returns its rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="length of the flight that is damaged")
    parser.add_argument("--seeds", type=int, default=2, help="files per kind of damage")
    options = parser.parse_args(arguments)
    print(f"{'log':30} {'damage':14} {'intact':>8} {'kept %':>8} {'false per file':>15}")
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for name, begin_s in LOGS.items():
            for damage in KINDS:
                row = measure(name, begin_s, damage, options.seconds, options.seeds, Path(folder))
                found.append(row)
                print(
                    f"{row.log:30} {row.damage:14} {row.intact:8} {row.kept_pct:8.2f} {row.false / row.files:15.1f}",
                    flush=True,
                )
    return found


if __name__ == "__main__":
    rows = main()
    sys.exit(0 if all(r.kept_pct > 99 and r.false < r.files for r in rows) else 1)
