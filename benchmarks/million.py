"""What many logs cost, worked out from a batch that was measured: bytes, core-hours, memory, money.

    python benchmarks/million.py BATCH_DIR [--logs 1000000] [--mb 5,20,60] [--link 50] [--price 0.05]

BATCH_DIR is the folder of an `attlog batch` run. From its records come seconds of CPU and peak memory per log, each
fitted as a constant plus a slope over the log's size (least squares), and the median sizes of report, JSON and
record. The numbers of docs/clusters.md come from three simulated flights at full logging rates:

    for s in 110 300 600; do attlog simulate hover --set seconds=$s -o long/hover-$s.ulg; done
    attlog batch long -o measured -j 1 && python benchmarks/million.py measured
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from attlog.batch.job import records


def measured(folder: Path) -> dict[str, np.ndarray]:
    """Size (MB), CPU (s), peak (MB) and bytes of report, JSON and record (MB) of each log that has a report."""
    rows = []
    for record in records(folder):
        if record.done:
            size = json.loads((folder / f"{record.name}.json").read_bytes())["log"]["size"]
            html, result = record.files[f"{record.name}.html"][0], record.files[f"{record.name}.json"][0]
            rows.append(
                [size / 1e6, record.cpu_s, record.peak_mb, html / 1e6, result / 1e6, len(json.dumps(record.row)) / 1e6]
            )
    names = ("size", "cpu", "peak", "html", "json", "record")
    return dict(zip(names, np.array(rows).T, strict=True))


def line(x: np.ndarray, y: np.ndarray) -> tuple[float, float, float]:
    """Constant, slope and residual (standard deviation) of y over x."""
    a = np.column_stack([np.ones_like(x), x])
    (constant, slope), *_ = np.linalg.lstsq(a, y, rcond=None)
    return float(constant), float(slope), float(np.std(y - a @ [constant, slope]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("batch", type=Path)
    parser.add_argument("--logs", type=float, default=1e6)
    parser.add_argument("--mb", default="5,20,60", help="mean size of a log, several")
    parser.add_argument("--link", type=float, default=50.0, help="MB/s that one task gets from the store")
    parser.add_argument("--price", type=float, default=0.05, help="of a core-hour")
    options = parser.parse_args()
    m = measured(options.batch)
    cpu, peak = line(m["size"], m["cpu"]), line(m["size"], m["peak"])
    print(f"{len(m['size'])} logs of {m['size'].min():.1f} to {m['size'].max():.1f} MB")
    print(f"CPU  {cpu[0]:.2f} s + {cpu[1]:.3f} s per MB (residual {cpu[2]:.2f} s)")
    print(f"peak {peak[0]:.0f} MB + {peak[1]:.1f} MB per MB (residual {peak[2]:.0f} MB)")
    kept = sum(float(np.median(m[name])) for name in ("html", "json", "record"))
    print("kept " + ", ".join(f"{name} {np.median(m[name]):.2f} MB" for name in ("html", "json", "record")))
    print("MB/log  read TB  s/log  core-hours  peak MB  kept TB  days on 100 cores  money")
    for size in map(float, options.mb.split(",")):
        seconds = cpu[0] + cpu[1] * size + size / options.link
        hours = options.logs * seconds / 3600
        memory = peak[0] + peak[1] * size
        print(
            f"{size:6g}  {options.logs * size / 1e6:7.1f}  {seconds:5.1f}  {hours:10.0f}  {memory:7.0f}"
            f"  {options.logs * kept / 1e6:7.1f}  {hours / 2400:17.1f}  {hours * options.price:5.0f}"
        )


if __name__ == "__main__":
    main()
