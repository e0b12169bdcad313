"""How closely filters follow an attitude that flew: ArduPilot's DCM (AHR2, or ATT where DCM flies), PX4's Q estimator.

    python benchmarks/follow.py [--corpus DIR] [--estimators LIST] [LOG...]

Without LOGs: every log of the corpus folder (default $ATTLOG_CORPUS) that holds AHR2, the plane that DCM flew, and the
two of PX4 that ``attitude_estimator_q`` flew. Per log and row: RMS of tilt and heading difference in deg over the
scored time. A replay knows the gyro bias as far as it is told: the autopilot had learnt it before a log that begins
long after power-up (``rest``: the mean rate at rest is taken off), not in one that begins at power-up (``none``).
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np

from attlog import pipeline
from attlog.core.errors import AttlogError
from attlog.flight import read
from attlog.pipeline.config import Config
from attlog.pipeline.replay import run_rows

FLOWN = {"plane_dcm.bin": "ATT", "ulg_px4_1.5_auavx21_ground_cut.ulg": "vehicle_attitude"}
"""Logs whose onboard attitude comes from one of the two filters."""
POWER_UP_S = 30.0
"""A log that begins earlier than this after power-up holds a DCM that still learns the gyro bias."""


def logs(root: Path) -> list[Path]:
    """Candidates: DataFlash logs, and those named above."""
    found = [p for folder in ("sitl/ardupilot", "logs", "logs/cases") for p in sorted((root / folder).glob("*"))]
    return [p for p in found if p.name in FLOWN or p.suffix.lower() in (".bin", ".log")]


def source(path: Path) -> tuple[str, str] | None:
    """The attitude to follow, and the setting of the common gyro bias; None for a log without one."""
    try:
        log = read(path)
    except AttlogError:
        return None
    name = FLOWN.get(path.name, "AHR2")
    if name not in log.attitudes or log.imu is None:
        return None
    return f"onboard:{name}", "none" if 0 <= log.t0_us < 1e6 * POWER_UP_S else "rest"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--corpus", type=Path, default=os.environ.get("ATTLOG_CORPUS"))
    parser.add_argument("--estimators", default="ap_dcm,px4_q,mahony,madgwick,vqf")
    parser.add_argument("logs", nargs="*", type=Path)
    options = parser.parse_args()
    if not (options.logs or options.corpus):
        parser.error("which logs? Name them, or a folder with --corpus")
    rows = options.estimators.split(",")
    print(f"{'log':44}{'bias':>6}", *(f"{row:>15}" for row in rows), sep="")
    found: dict[str, list[tuple[float, float]]] = {row: [] for row in rows}
    for path in options.logs or logs(options.corpus):
        wanted = source(path)
        if wanted is None:
            continue
        try:
            case = pipeline.prepare(path, Config.build({"reference": wanted[0], "gyro_bias": wanted[1]}))
        except AttlogError as error:
            print(f"{path.name:44}{error}")
            continue
        cells = []
        for row in rows:
            try:
                errors = run_rows(case, [row])[0].errors
            except AttlogError:
                errors = None
            if errors is None or not errors.scored.any():
                cells.append(f"{'-':>15}")
                continue
            tilt, heading = (float(np.sqrt(np.mean(x[errors.scored] ** 2))) for x in (errors.tilt, errors.heading))
            found[row].append((tilt, heading))
            cells.append(f"{tilt:9.2f} {heading:5.2f}")
        print(f"{path.name:44}{wanted[1]:>6}", *cells, sep="", flush=True)
    for what, of in (("median", np.median), ("mean", np.mean)):
        print(f"{what:50}", *("{:9.2f} {:5.2f}".format(*of(found[row], axis=0)) for row in rows), sep="")


if __name__ == "__main__":
    main()
