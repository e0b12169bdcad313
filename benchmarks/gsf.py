"""How close ``gsf`` comes to the yaw estimator that ran beside the EKF, and both to the truth.

    python benchmarks/gsf.py [--corpus DIR] [--row ROW] [LOG ...]

Without LOGs: every log of the corpus folder (default $ATTLOG_CORPUS) that holds XKY0 or NKY0 (ArduPilot) or
``yaw_estimator_status`` (PX4). Compared where both have a sigma below 15 deg, from which on the firmwares use it, at
the time for which the firmware's holds: ``timestamp_sample`` of PX4; ArduPilot's EKF is behind by what fits the onboard
attitude best. Median and 90 % of the absolute difference in deg, and both against the simulator's truth; simulated
flights (those with truth) have a median of their own. ``gsf:smoothing=body`` is closer to what flew.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog import pipeline
from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.estimators import estimate
from attlog.flight.model import Attitude, FlightLog
from attlog.pipeline.replay import aids_of, log_facts

Array = NDArray[np.float64]
FOLDERS = ("sitl/ardupilot", "sitl/px4", "logs", "logs/cases")
SUFFIXES = (".bin", ".ulg")
KNOWN = np.deg2rad(15.0)
DELAYS_S = np.arange(0.0, 0.41, 0.01)
LEAST = 10
"""Fewer rows of the firmware in which both know the heading tell nothing."""


@dataclass(frozen=True, slots=True)
class Headings:
    """Yaw and its sigma (n,) rad at ``t`` (n,) s of the log's clock."""

    t: Array
    yaw: Array
    sigma: Array

    def at(self, t: Array) -> tuple[Array, Array]:
        """Yaw and sigma at other times; infinitely uncertain beyond the ends."""
        sigma = np.interp(t, self.t, self.sigma, left=np.inf, right=np.inf)
        return rotation.wrap(np.interp(t, self.t, rotation.unwrap(self.yaw))), sigma


def flown(log: FlightLog) -> Headings | None:
    """What the firmware found where it would use it, at the time for which it holds; None where the log lacks it."""
    own = log.estimator.yaw
    if own is None:
        return None
    found = Headings(own.t_best, own.x[:, 0], own.x[:, 1])
    if log.firmware.name == "PX4" or log.onboard not in log.attitudes:
        return found
    return replace(found, t=found.t - delay(found, log.attitudes[log.onboard]))


def delay(found: Headings, onboard: Attitude) -> float:
    """By how many s ``found`` is late against the onboard attitude."""
    off = [np.median(np.abs(apart(found.yaw, yaw_at(onboard, found.t - d)))) for d in DELAYS_S]
    return float(DELAYS_S[np.argmin(off)])


def yaw_at(attitude: Attitude, t: Array) -> Array:
    """Yaw (n,) rad of an attitude at times ``t`` (n,)."""
    good = rotation.finite_rows(attitude.q)
    return rotation.to_euler(rotation.slerp(attitude.t[good], attitude.q[good], t))[:, 2]


def apart(a: Array, b: Array) -> Array:
    """Differences (n,) of angles in deg, signed."""
    return np.rad2deg(rotation.wrap(a - b))


def replayed(path: Path, row: str) -> tuple[FlightLog, Headings]:
    """The log, and what ``row`` makes of its samples, as in an analysis."""
    case = pipeline.prepare(path)
    imu = case.imus[""]
    e = estimate(
        row,
        imu.gyro.t,
        case.gyro_of(imu),
        imu.acc.x,
        sampling=imu.gyro.sampling,
        dt=imu.dt,
        aids=aids_of(case, ""),
        log=log_facts(case, ""),
    )
    return case.log, Headings(e.t, rotation.to_euler(e.q)[:, 2], e.aux["sigma_heading"])


def numbers(difference: Array) -> str:
    """Median and 90 % of the absolute values."""
    return "{:8.2f}{:7.2f}".format(*np.percentile(np.abs(difference), (50, 90)))


def line(path: Path, row: str) -> tuple[str, list[float]] | None:
    """A log's line and its medians: difference, own and firmware's error; None for a log without either heading."""
    log, own = replayed(path, row)
    other = flown(log)
    if other is None or not len(own.t):
        return None
    yaw, sigma = own.at(other.t)
    both = sigma < KNOWN
    head = f"{path.name:44}{len(both):6}{np.count_nonzero(both):6}"
    if np.count_nonzero(both) < LEAST:
        return head, []
    differences = [apart(yaw, other.yaw)[both]]
    if log.truth is not None:
        true = yaw_at(log.truth, other.t[both])
        differences += [apart(yaw[both], true), apart(other.yaw[both], true)]
    return head + "".join(map(numbers, differences)), [float(np.median(np.abs(x))) for x in differences]


def logs(root: Path) -> Iterator[Path]:
    """Candidates of the corpus."""
    for folder in FOLDERS:
        yield from (p for p in sorted((root / folder).glob("*")) if p.suffix.lower() in SUFFIXES)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", type=Path, default=os.environ.get("ATTLOG_CORPUS"))
    parser.add_argument("--row", default="gsf", help="another setting, as on the command line of attlog")
    parser.add_argument("logs", nargs="*", type=Path)
    options = parser.parse_args()
    if not (options.logs or options.corpus):
        parser.error("which logs? Name them, or a folder with --corpus")
    print(
        f"{'log':44}{'flown':>6}{'both':>6}{'difference':>15}{'own error':>15}{'error flown':>15}   deg: median, 90 %"
    )
    found: list[list[float]] = []
    for path in options.logs or logs(Path(options.corpus)):
        try:
            done = line(path, options.row)
        except AttlogError as error:
            print(f"{path.name:44}{str(error)[:60]}")
            continue
        if done is not None:
            print(done[0], flush=True)
            found.append(done[1])
    for count in (1, 3):
        rows = [row[:count] if count == 1 else row for row in found if len(row) >= count]
        if rows:
            cells = "".join(f"{x:8.2f}{'':7}" for x in np.median(rows, axis=0))
            print(f"{f'median of {len(rows)} logs':56}{cells}")


if __name__ == "__main__":
    main()
