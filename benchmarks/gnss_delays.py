"""A receiver later than it is: is the delay found inside its interval, and is nothing offered on untouched flights?

    python benchmarks/gnss_delays.py [--corpus DIR] [-v]

The set is ``sitl/`` below the corpus folder (default $ATTLOG_CORPUS). Times of the receiver's records are shifted in a
read log. What must be found is the simulator's own delay (TRUE_MS) plus the shift. PX4's publishes at once; ArduPilot's
(SIM_GPS_LAG_MS 100) comes 83 ms before GPA.SMS, which follows the record's arrival by less than the lag: that one
number is the mean of the untouched flights, so that there the scatter over flights is what is tried.
"""

from __future__ import annotations

import argparse
import os
from copy import deepcopy
from pathlib import Path

from attlog import flight, pipeline
from attlog.health import delays
from attlog.health.check import Check, HealthCase
from attlog.pipeline.evaluation import motion_attitude

LATE_MS = (0.0, 60.0, 120.0, 200.0)
TRUE_MS = {"PX4": 0.0, "ArduPilot": 83.0}


def found(path: Path, late_ms: float) -> Check | None:
    """What is said of the first receiver, its records ``late_ms`` later than logged; None where nothing is."""
    log = deepcopy(flight.read(path))
    for receiver in log.gnss:
        receiver.t = receiver.t + 1e-3 * late_ms
        if receiver.received is not None:
            receiver.received = receiver.received + 1e-3 * late_ms
    case = pipeline.prepare(log)
    asked = HealthCase(case.log, case.segments, case.reference, lambda: motion_attitude(case))
    return next(iter(delays.gnss_delays(asked)), None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", default=os.environ.get("ATTLOG_CORPUS", ""))
    parser.add_argument("--verbose", "-v", action="store_true")
    given = parser.parse_args()
    flights = sorted(p for p in (Path(given.corpus) / "sitl").rglob("*") if p.suffix in (".ulg", ".bin"))
    print("| late by | flights | answered | inside 95 % | offered | offered within 20 ms |")
    print("| --- | --- | --- | --- | --- | --- |")
    for late_ms in LATE_MS:
        answers = [(path, one) for path in flights if (one := found(path, late_ms)) is not None]
        told = [(path, one) for path, one in answers if one.ci95 is not None]
        inside = offered = right = 0
        for path, one in told:
            true = TRUE_MS["PX4" if path.suffix == ".ulg" else "ArduPilot"] + late_ms
            assert one.ci95 is not None
            inside += one.ci95[0] <= true <= one.ci95[1]
            offered += bool(one.settings)
            right += any(abs(s.new - true) <= 20.0 for s in one.settings)
        print(f"| {late_ms:.0f} ms | {len(flights)} | {len(told)} | {inside} | {offered} | {right} |")
        if given.verbose:
            print("\n".join(f"    {path.name}: {one.verdict}: {one.text}" for path, one in answers))


if __name__ == "__main__":
    main()
