"""An accelerometer offset planted in simulated flights: is it found, with its size, and is nothing said falsely?

    python benchmarks/accelerometer_offsets.py [--corpus DIR] [-v]

The flights are those of ``sitl/`` below the corpus folder (default $ATTLOG_CORPUS), whose own offsets the notes of its
MANIFEST.csv tell; the truth is taken away, as on a real vehicle. 0.3 m/s^2 are added along x, y and z, one after the
other, and the question of the report is asked anew. The table tells of how many flights the axis is known, the offset
(the flight's own and what was added) is above the limit and found, its true size is inside the 95 % interval, and
between which sizes what was added comes back. The lines below name what is said of the untouched flights, beside the
truth.
"""

from __future__ import annotations

import argparse
import csv
import os
import re
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np

from attlog import flight
from attlog.core.errors import AttlogError
from attlog.flight.model import FlightLog
from attlog.health import vibration
from attlog.health.accelerometer import OFFSET_OFF_M_S2, accelerometer_offsets, offset_axes
from attlog.health.check import HealthCase
from attlog.health.imu import SensorBias, smoothed_acc_bias
from attlog.pipeline.evaluation import motion_attitude
from attlog.pipeline.preparation import prepare

PLANTED = 0.3
TRUTH = re.compile(r"acc(?:elerometer offset| bias IMU0 \(SIM_ACC1_BIAS\)) ([-\d.]+)[ /]([-\d.]+)[ /]([-\d.]+)")
SCALE = re.compile(r"scale errors gyro \S+ \S+ \S+ accelerometer \S+ \S+ ([-\d.]+)")
G = 9.81


def truths(folder: Path) -> dict[str, np.ndarray]:
    """Each flight's own offset (3,) m/s^2; along z with what a scale error makes of gravity."""
    found = {}
    with open(folder / "MANIFEST.csv", encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if told := TRUTH.search(row["notes"]):
                own = np.array([float(v) for v in told.groups()])
                scale = SCALE.search(row["notes"])
                found[row["file"]] = own - np.array([0.0, 0.0, G * float(scale[1]) if scale else 0.0])
    return found


def case_of(log: FlightLog) -> HealthCase:
    case = prepare(log)
    checks = vibration.vibration_checks(case.log, case.segments)
    return HealthCase(case.log, case.segments, case.reference, checks, lambda: motion_attitude(case))


def pushed(log: FlightLog, axis: int) -> FlightLog:
    copy = deepcopy(log)
    for imu in copy.imus:
        imu.acc = replace(imu.acc, x=imu.acc.x + PLANTED * np.eye(3)[axis])
    return copy


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", default=os.environ.get("ATTLOG_CORPUS", ""))
    parser.add_argument("--verbose", "-v", action="store_true")
    given = parser.parse_args()
    folder = Path(given.corpus) / "sitl"
    rows: list[tuple[str, int, np.ndarray, SensorBias | None, SensorBias | None, int]] = []
    untouched = []
    for name, own in truths(folder).items():
        if not name.endswith((".ulg", ".bin")):
            continue
        try:
            log = flight.read(folder / name)
            log.truth = None
        except AttlogError:
            continue
        plain = case_of(log)
        said = [one for one in accelerometer_offsets(plain) if one.verdict in ("warning", "fault")]
        untouched += [(name, own, one) for one in said]
        for axis in range(3):
            case = case_of(pushed(log, axis))
            offered = sum(bool(one.settings) for one in accelerometer_offsets(case)[:1])
            rows.append(
                (
                    name,
                    axis,
                    own + PLANTED * np.eye(3)[axis],
                    smoothed_acc_bias(plain),
                    smoothed_acc_bias(case),
                    offered,
                )
            )
    table(rows, given.verbose)
    print(f"\n{len(untouched)} offsets are said of the untouched flights:")
    for name, own, one in untouched:
        print(f"- {name}, truth {', '.join(f'{v:+.2f}' for v in own)}: {one.text}")


def table(rows: list[tuple[str, int, np.ndarray, SensorBias | None, SensorBias | None, int]], verbose: bool) -> None:
    print("| 0.3 m/s^2 along | flights | known | above the limit | found | inside | comes back as | with settings |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for axis in range(3):
        mine = [row for row in rows if row[1] == axis]
        known = [row for row in mine if row[4] is not None and row[4].known[axis]]
        large = [row for row in known if abs(row[2][axis]) > OFFSET_OFF_M_S2[axis]]
        found = [row for row in large if row[4] is not None and offset_axes(row[4])[axis]]
        inside, back = 0, []
        for name, _, truth, before, after, _ in known:
            assert before is not None
            assert after is not None
            error = after.mean[axis] - truth[axis]
            inside += abs(error) <= 1.96 * after.sigma[axis]
            back.append(after.mean[axis] - before.mean[axis])
            if verbose:
                print(f"    {name}: {after.mean[axis]:+.3f} of {truth[axis]:+.3f}, sigma {after.sigma[axis]:.3f}")
        sizes = f"{min(back):.2f} to {max(back):.2f}" if back else ""
        offered = sum(row[5] for row in mine)
        counts = f"{len(mine)} | {len(known)} | {len(large)} | {len(found)} | {inside}"
        print(f"| {'xyz'[axis]} | {counts} | {sizes} | {offered} |")


if __name__ == "__main__":
    main()
