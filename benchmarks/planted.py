"""Faults planted in simulated flights: is each shown, with its cause and its size, and is the flight itself silent?

    python benchmarks/planted.py [--corpus DIR] [--all] [--without-truth] [-v]

The set is ``sitl/`` below the corpus folder (default $ATTLOG_CORPUS), the flights of FLIGHTS; ``--all`` takes every
flight. Each fault is put into a copy of the read log, into every unit of the sensor (the scale into the
replayed unit), and the audit is made anew.
``--without-truth`` takes the logged truth away first, so that the onboard attitude is all there is, as on a real
vehicle. The table tells of how many flights the check names it (shown), the finding has a cause and an action, the
size is right within the tolerance of PLANTS, the flight cannot tell by the check's own word, and of how many flights
without the plant the check accuses the sensor (untouched).
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from attlog import flight, reference, segments
from attlog.core import rotation
from attlog.flight.model import FlightLog
from attlog.health import accelerometer, run_checks
from attlog.health.check import Check, HealthCase
from attlog.health.findings import findings

FLIGHTS = (
    "px4/px4_steps.ulg",
    "px4/px4_wind.ulg",
    "px4/px4_plane.ulg",
    "ardupilot/copter_aggressive.bin",
    "ardupilot/copter_wind_guided.bin",
    "ardupilot/plane_fbwa_cruise.bin",
)
LATE_S, GAP_S, EVERY_S, SCALE, OFF_UT, TURN_DEG, STEP_DPS, FORCE = 0.015, 0.1, 5.0, 1.03, 10.0, 28.0, 1.0, 0.3


@dataclass(frozen=True, slots=True)
class Plant:
    """A fault: what it does to a log, the check that tells it, its size in that unit and how far that may be off."""

    make: Callable[[FlightLog], None]
    check: str
    size: float
    within: float


def late(log: FlightLog) -> None:
    for imu in log.imus:
        for stream in (imu.gyro, imu.acc):
            stream.t = stream.t + LATE_S
            if stream.t_sample is not None:
                stream.t_sample = stream.t_sample + LATE_S


def holes(log: FlightLog) -> None:
    for imu in log.imus:
        keep = (imu.gyro.t % EVERY_S) >= GAP_S
        for stream in (imu.gyro, imu.acc):
            stream.t, stream.x = stream.t[keep], stream.x[keep]
            stream.t_sample = None if stream.t_sample is None else stream.t_sample[keep]
        imu.dt = None if imu.dt is None else imu.dt[keep]


def scaled(log: FlightLog) -> None:
    """In the replayed unit alone: units that turn alike acquit each other."""
    if log.replay_imu is not None:
        log.replay_imu.gyro.x = log.replay_imu.gyro.x * SCALE


def exchanged(log: FlightLog) -> None:
    for imu in log.imus:
        imu.acc.x = imu.acc.x[:, [1, 0, 2]]


def iron(log: FlightLog) -> None:
    for mag in log.mags:
        mag.field.x = mag.field.x + 1e-6 * np.array([OFF_UT, 0.0, 0.0])


def turned(log: FlightLog) -> None:
    """The compass sits clockwise by TURN_DEG: what it shows is turned the other way."""
    turn = rotation.from_euler(0.0, 0.0, np.radians(TURN_DEG))
    for mag in log.mags:
        mag.field.x = rotation.rotate_inverse(np.tile(turn, (len(mag.field.x), 1)), mag.field.x)


def stepped(log: FlightLog) -> None:
    a, b = max(segments.build(log).spans("airborne"), key=lambda s: s[1] - s[0])
    for imu in log.imus:
        imu.gyro.x = imu.gyro.x + np.radians(STEP_DPS) * np.outer(imu.gyro.t >= 0.5 * (a + b), [0.0, 1.0, 0.0])


def pushed(log: FlightLog) -> None:
    for imu in log.imus:
        imu.acc.x = imu.acc.x + np.array([FORCE, 0.0, 0.0])


PLANTS: dict[str, Plant] = {
    "IMU delay 15 ms": Plant(late, "imu_delay", 15.0, 2.0),
    "100 ms gaps": Plant(holes, "gaps", 0.1, 0.02),
    "gyro scale 3 %": Plant(scaled, "gyro_scale", 3.0, 1.0),
    "accelerometer x and y swapped": Plant(exchanged, "force_axes", 0.0, np.inf),
    "compass offset 100 mG": Plant(iron, "compass_offset", 10.0, 3.0),
    "compass yawed by 28 deg": Plant(turned, "compass_turn", 28.0, 4.0),
    "gyro bias step 1 deg/s": Plant(stepped, "gyro_bias_step", 1.0, 0.2),
    "accelerometer offset 0.3 m/s^2": Plant(pushed, "accelerometer_offset", 0.3, 0.1),
}


def audited(log: FlightLog) -> list[Check]:
    return run_checks(HealthCase(log, segments.build(log)))


def size_of(log: FlightLog, check: Check, before: Check | None) -> float:
    """How much a check's number grew by the plant, without sign; of gaps their mean length."""
    if not isinstance(check.value, (int, float)):
        return float("nan")
    if check.question == "gaps":
        return check.value / check.count
    if check.question == "accelerometer_offset":  # which tells the worst axis: this is the planted one
        phases = segments.build(log)
        found = accelerometer.fit_force(log, phases, reference.choose(log, phases))
        return float("nan") if found is None else -float(found.solution.x[4])
    start = before.value if before is not None and isinstance(before.value, (int, float)) else 0.0
    return float(abs(check.value - start))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", default=os.environ.get("ATTLOG_CORPUS", ""))
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--without-truth", action="store_true")
    parser.add_argument("--verbose", "-v", action="store_true")
    given = parser.parse_args()
    folder = Path(given.corpus) / "sitl"
    every = sorted(p for p in folder.rglob("*") if p.suffix in (".ulg", ".bin"))
    logs = [flight.read(p) for p in (every if given.all else [folder / name for name in FLIGHTS])]
    for log in logs:
        log.truth = None if given.without_truth else log.truth
    plain = [{c.question: c for c in audited(log)} for log in logs]
    print("| planted | flights | shown | cause and action | size | cannot tell | untouched |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for what, plant in PLANTS.items():
        rows = [one(log, plant, before, given.verbose) for log, before in zip(logs, plain, strict=True)]
        false = [b[plant.check].text for b in plain if plant.check in b and b[plant.check].verdict in BAD]
        shown, caused, sized, unknown = (sum(column) for column in zip(*rows, strict=True))
        print(f"| {what} | {len(logs)} | {shown} | {caused} | {sized} | {unknown} | {len(false)} |")
        if given.verbose:
            print("\n".join(f"    untouched: {text}" for text in false))


def one(log: FlightLog, plant: Plant, before: dict[str, Check], verbose: bool) -> tuple[bool, bool, bool, bool]:
    """Whether a plant is shown, with cause and action, in its size; and whether the log cannot tell."""
    copy = deepcopy(log)
    plant.make(copy)
    checks = audited(copy)
    told = next((c for c in checks if c.question == plant.check), None)
    if verbose and told is not None:
        print(f"    {log.path.name}: {told.verdict}: {told.text}")
    if told is None or told.verdict not in BAD:
        return False, False, False, told is None or told.verdict == "unknown"
    entry = next((f for f in findings(copy, checks) if told.text in (f.text, *f.evidence)), None)
    size = size_of(copy, told, before.get(plant.check))
    base = size_of(log, before[plant.check], None) if told.question == "accelerometer_offset" else 0.0
    caused = entry is not None and bool(entry.cause and entry.action)
    return True, caused, plant.within == np.inf or abs(size - base - plant.size) <= plant.within, False


BAD = ("warning", "fault")

if __name__ == "__main__":
    main()
