"""Whether filters rank on attlog's own simulated flights as on those of the firmwares' simulators.

    python benchmarks/simulated.py [--corpus DIR] [--seeds 2] [--estimators LIST] [--keep DIR]

Each scenario is flown, written as ULog and analysed against its truth; so are the flights of the firmware
simulators of the same kind (``sitl/px4``, ``sitl/ardupilot`` below the corpus folder, default $ATTLOG_CORPUS). Per
kind of flight: Spearman's rank correlation between the filters' errors here and there, for tilt and heading, beside
the same between the two firmwares' simulators and between two of our seeds: nobody can agree better than they do. At
the end the correlation of mean ranks over all kinds, and the ranks.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import attlog
from attlog import formats
from attlog.core.errors import AttlogError
from attlog.simulate.fly import fly
from attlog.simulate.logs import recording
from attlog.simulate.scenario import load_scenario

Array = NDArray[np.float64]
FILTERS = (
    "accel_mag,complementary,variable_integral,mahony_passive,mahony_dcm,mahony,mahony_adaptive,madgwick,ekf12,mekf,"
    "px4_q,ap_dcm,vqf,fusion"
)
KINDS = {
    "hover": ("px4_hover.ulg", "copter_hover_rest.bin"),
    "steps": ("px4_steps.ulg", "copter_steps_stabilize.bin"),
    "yaw": ("px4_yaw.ulg", "copter_yaw_turns.bin"),
    "aggressive": ("px4_aggressive.ulg", "copter_aggressive.bin"),
    "waypoints": ("px4_wind.ulg", "copter_wind_guided.bin"),
    "gnss-loss": ("px4_gnssloss.ulg", "copter_gps_loss.bin"),
}
METRICS = ("tilt_rmse_deg", "heading_rmse_deg")


def errors(path: Path, filters: list[str]) -> Array:
    """Tilt and heading RMSE (filters, 2) in deg against the log's truth over what is scored; NaN without an answer."""
    result = attlog.analyze(path, {"estimators": filters, "reference": "truth"})
    rows = {row.name: row.metrics.get("all", {}) for row in result.estimators}
    found = np.full((len(filters), len(METRICS)), np.nan)
    for i, name in enumerate(filters):
        for k, metric in enumerate(METRICS):
            one = rows.get(name, {}).get(metric)
            if one is not None and one.value is not None:
                found[i, k] = one.value
    return found


def ranks(x: Array) -> Array:
    """Ranks (n,) from 0, equal values sharing theirs."""
    return np.array([(np.sum(x < v) + 0.5 * (np.sum(x == v) - 1)) for v in x])


def spearman(a: Array, b: Array) -> float:
    """Spearman's rank correlation of two columns over the rows that both have."""
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 3:
        return float("nan")
    return float(np.corrcoef(ranks(a[both]), ranks(b[both]))[0, 1])


def ours(name: str, seed: int, filters: list[str], folder: Path) -> Array:
    """Errors on a scenario's flight."""
    path = folder / f"{name}-{seed}.ulg"
    if not path.is_file():
        formats.write(path, recording(fly(load_scenario(name), seed), "ulog"))
    return errors(path, filters)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", type=Path, default=os.environ.get("ATTLOG_CORPUS"))
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--estimators", default=FILTERS)
    parser.add_argument("--keep", type=Path, help="folder for the logs; made anew each time without it")
    options = parser.parse_args()
    if options.corpus is None:
        parser.error("give --corpus or set ATTLOG_CORPUS")
    filters = options.estimators.split(",")
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        report(filters, options.corpus / "sitl", options.seeds, folder)


def report(filters: list[str], sitl: Path, seeds: int, folder: Path) -> None:
    """Print the table."""
    print(f"{'':12}" + "".join(f"{m.removesuffix('_rmse_deg'):>46}" for m in METRICS))
    columns = f"{'ours~PX4':>12}{'ours~ArduP.':>12}{'PX4~ArduP.':>12}{'seeds':>10}"
    print(f"{'':12}" + columns * len(METRICS))
    here, there = [], []
    for name, files in KINDS.items():
        own = [ours(name, seed, filters, folder) for seed in range(seeds)]
        firmware = [_of(sitl / kind / file, filters) for kind, file in zip(("px4", "ardupilot"), files, strict=True)]
        mean = np.mean(own, axis=0)
        here.append(mean)
        there.append(np.nanmean(firmware, axis=0))
        line = f"{name:12}"
        for k in range(len(METRICS)):
            again = spearman(own[0][:, k], own[-1][:, k]) if seeds > 1 else float("nan")
            pairs = [spearman(mean[:, k], f[:, k]) for f in firmware]
            pairs += [spearman(firmware[0][:, k], firmware[1][:, k]), again]
            line += "".join(f"{p:{w}.2f}" for p, w in zip(pairs, (12, 12, 12, 10), strict=True))
        print(line, flush=True)
    print("\nmean rank over the kinds (0 is best); firmware simulators in brackets")
    average = [[np.mean([ranks(e[:, k]) for e in side], axis=0) for side in (here, there)] for k in range(len(METRICS))]
    for k, metric in enumerate(METRICS):
        print(f"{metric}: rank correlation of the mean ranks {spearman(*average[k]):.2f}")
    for i in np.argsort(average[0][0]):
        print(f"  {filters[i]:20}" + "".join(f"{average[k][0][i]:8.1f} ({average[k][1][i]:4.1f})" for k in range(2)))


def _of(path: Path, filters: list[str]) -> Array:
    """Errors on a log of the corpus, NaN where it cannot be used."""
    try:
        return errors(path, filters)
    except AttlogError as error:
        print(f"{path.name}: {error}")
        return np.full((len(filters), len(METRICS)), np.nan)


if __name__ == "__main__":
    main()
