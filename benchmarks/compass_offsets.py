"""Offsets and a motor field planted in the compasses of simulated flights: found, in their interval, offered, proven?

    python benchmarks/compass_offsets.py [--corpus DIR] [--filters] [-v]

The set is ``sitl/`` below the corpus folder (default $ATTLOG_CORPUS), without flights whose compass fails. The
attitude by motion alone is made once for each flight, because no compass has part in it; each plant is put into a copy
of every compass. An offset of the sizes OFFSETS_UT in each of DIRECTIONS; a motor field of MOTOR_UT_A for each ampere
(where a log holds the throttle alone, of as much in hover), in two directions. Columns of the table:

- *judged*: compasses that an attitude by motion can judge, of all; the rest says why not (``-v``).
- *found*: the offset (or the motors' field) counts. *inside*: axes whose planted size lies in the 95 % interval.
- *offered*: no rule refuses it. Nothing planted: false offers.
- *heading*: median over the flights of the heading error (deg) on the half not fitted, before and after.

``--filters``: heading error of mahony and mekf against the truth in the second half of the flight, with the planted
compass and with it corrected by the offset of the first half.
"""

from __future__ import annotations

import argparse
import os
from copy import deepcopy
from pathlib import Path

import numpy as np

import attlog
from attlog import flight, reference, segments
from attlog.core import rotation
from attlog.estimators import place
from attlog.flight.compass import motor_drive, power_at
from attlog.flight.model import FlightLog
from attlog.health import compass
from attlog.health.check import HealthCase
from attlog.health.compass_offset import CompassStudy, compass_studies, fit_offset, offset_refusal
from attlog.metrics.metric import Case
from attlog.pipeline import preparation
from attlog.pipeline.config import Config
from attlog.pipeline.evaluation import motion_attitude
from attlog.reference.model import ReferenceOptions

OFFSETS_UT = (0.0, 3.0, 10.0, 20.0)
DIRECTIONS = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (-0.6, 0.6, 0.53), (0.5, 0.5, -0.71), (-0.8, 0.0, 0.6))
MOTOR_UT_A, HOVER_A = 0.2, 25.0
MOTOR_DIRECTIONS = ((1.0, 0.0, 0.0), (-0.6, 0.6, 0.53))
FAULT = "magfault"
"""Flights with a compass that fails on the way: no constant error is planted in them."""
FILTERS = ("mahony", "mekf")


def case_of(path: Path) -> HealthCase:
    """A flight as the questions see it, its truth hidden from everything but the score."""
    log = flight.read(path)
    phases = segments.build(log)
    none = reference.choose(log, phases, ReferenceOptions(reference="none"))
    motion = motion_attitude(Case(log, phases, none, settings=Config().resolved()))
    return HealthCase(log, phases, None, lambda: motion)


def planted(case: HealthCase, constant: np.ndarray, per_power: np.ndarray) -> HealthCase:
    """The flight with every compass reading so much more, uT and uT per unit of power."""
    log = deepcopy(case.log)
    _, drive = motor_drive(log)
    for mag in log.mags:
        power = np.nan_to_num(power_at(drive, mag.field.t_best))
        mag.field.x = mag.field.x + 1e-6 * (constant + power[:, None] * per_power)
    return HealthCase(log, case.segments, None, lambda: case.motion)


def row(name: str, compasses: int, found: list[tuple[CompassStudy, np.ndarray, bool]]) -> None:
    """A line of the table; ``found``: the study, the planted offset or field of the motors in flight, and whether
    it would be offered.
    """
    judged = len({id(study.samples.mag) for study, _, _ in found})
    hit, inside, offered, before, after = 0, [], 0, [], []
    for study, size, granted in found:
        hit += study.air.counts
        inside += list(np.abs(study.air.offset - size) <= 1.96 * study.air.sigma)
        offered += granted
        proof = study.motor_proof if name.startswith("motor") else study.proof
        before += [proof.before] if proof is not None else []
        after += [proof.after] if proof is not None else []
    print(
        f"| {name} | {judged} of {compasses} | {hit} | {np.mean(inside):.1%} of {len(inside)} | {offered} "
        f"| {np.median(before):.1f} -> {np.median(after):.1f} |",
        flush=True,
    )


def offered_offset(case: HealthCase, study: CompassStudy) -> bool:
    return study.air.counts and not offset_refusal(case, study)


def offered_motors(study: CompassStudy) -> bool:
    return study.ground_differs and not compass.motors_refusal(study)


def flight_halves(study: CompassStudy) -> tuple[np.ndarray, np.ndarray]:
    """Return masks of the first and of the second half of a study's samples in the air."""
    air = study.samples.air
    early = np.cumsum(air) <= np.count_nonzero(air) // 2
    return air & early, air & ~early


def with_filters(case: HealthCase, study: CompassStudy, size: np.ndarray) -> dict[str, tuple[float, float]]:
    """Heading RMSE (deg) of filters against the truth in the second half: with the planted compass, and corrected."""
    log, imu, first = case.log, case.log.replay_imu, fit_offset(study.samples, flight_halves(study)[0])
    if imu is None or log.truth is None or first is None:
        return {}
    t, late = imu.gyro.t_best, study.samples.t[flight_halves(study)[1]]
    scored = (t >= late[0]) & (t <= late[-1])
    truth = rotation.slerp(log.truth.t, log.truth.q, t[scored])
    told = true_north(log)
    found = {}
    for name in FILTERS:
        errors = []
        for wrong in (np.zeros(3), first.offset):
            field = study.samples.mag.field
            mag = place(t, field.t_best, field.x - 1e-6 * wrong)
            q = attlog.estimate(name, t, imu.gyro.x, imu.acc.x, mag, sampling=imu.gyro.sampling, **told).q[scored]
            error = rotation.heading_angle(rotation.earth_error(q, truth))
            errors.append(float(np.degrees(np.sqrt(np.nanmean(error**2)))))
        found[name] = (errors[0], errors[1])
    return found


def true_north(log: FlightLog) -> dict[str, float]:
    """The declination, so that headings are true."""
    north, _ = reference.alignment.declination_step(log, preparation.reference_options(Config()).declination)
    return {"declination": float(north or 0.0)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", default=os.environ.get("ATTLOG_CORPUS", ""))
    parser.add_argument("--filters", action="store_true")
    parser.add_argument("--verbose", "-v", action="store_true")
    given = parser.parse_args()
    paths = sorted(p for p in (Path(given.corpus) / "sitl").rglob("*") if p.suffix in (".ulg", ".bin"))
    cases = [case_of(path) for path in paths if FAULT not in path.stem.replace("_", "")]
    count = sum(len(case.log.mags) for case in cases)
    print("| planted | judged | found | inside | offered | heading |")
    print("| --- | --- | --- | --- | --- | --- |")
    zero = np.zeros(3)
    for size in OFFSETS_UT:
        found = []
        for direction in DIRECTIONS if size else DIRECTIONS[:1]:
            wrong = size * np.array(direction)
            for case in cases:
                copy = planted(case, wrong, zero)
                studied, why = compass_studies(copy)
                found += [(study, wrong, offered_offset(copy, study) or offered_motors(study)) for study in studied]
                if given.verbose:
                    said = why or "; ".join(f"{s.air.offset.round(1)} {offset_refusal(copy, s)}" for s in studied)
                    print(f"    {case.log.path.name}: {wrong}: {said}")
        row(f"{10 * size:.0f} mG" if size else "nothing", count * (len(DIRECTIONS) if size else 1), found)
    found = []
    for direction in MOTOR_DIRECTIONS:
        for case in cases:
            kind, _ = motor_drive(case.log)
            unit = MOTOR_UT_A * (1.0 if kind == "current" else 2.0 * HOVER_A) * np.array(direction)
            copy = planted(case, zero, unit)
            for study in compass_studies(copy)[0]:
                found.append((study, unit * study.samples.hover, offered_motors(study)))
                if given.verbose:
                    print(f"    {case.log.path.name}: {study.motors}: {compass.motors_refusal(study)}")
    row(f"motors {MOTOR_UT_A} uT/A", count * len(MOTOR_DIRECTIONS), found)
    if given.filters:
        filters(cases)


def filters(cases: list[HealthCase]) -> None:
    """Pasting: what filters make of it, with 100 mG along x."""
    wrong = np.array([10.0, 0.0, 0.0])
    results: dict[str, list[tuple[float, float]]] = {name: [] for name in FILTERS}
    for case in cases:
        copy = planted(case, wrong, np.zeros(3))
        for study in compass_studies(copy)[0][:1]:
            for name, pair in with_filters(copy, study, wrong).items():
                results[name].append(pair)
    for name, pairs in results.items():
        before, after = np.median(pairs, axis=0)
        print(f"{name}: 100 mG, {len(pairs)} flights, heading {before:.1f} -> {after:.1f} deg (median RMSE)")


if __name__ == "__main__":
    main()
