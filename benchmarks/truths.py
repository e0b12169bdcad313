"""Is a truth that is brought put on the right clock and axes, is it as sure as it says, is a foreign one refused?

    python benchmarks/truths.py [--corpus DIR] [--flights GLOB] [--seed N] [--foreign N]

The truth of each flight below ``sitl/`` of the corpus folder (default $ATTLOG_CORPUS) is written as a TUM file on
another clock (offset, drift), with its body and its earth turned, noise of 0.1 deg, at 100 Hz, and brought back. Per
flight: the clock's error in the middle and its sigma (ms), drift put in and found (ppm), tilt error (RMS) and its sigma
(deg). ``--foreign``: so many other flights' truths are tried on each log; what is accepted is named.
"""

from __future__ import annotations

import argparse
import fnmatch
import os
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.external import attitude as truth
from attlog.flight import read
from attlog.flight.model import Attitude, FlightLog

Array = NDArray[np.float64]
RATE_HZ, NOISE_DEG, DRIFT_PPM, OFFSET_S = 100.0, 0.1, 40.0, 1234.5678
BODY_DEG, WORLD_DEG = (3.0, -4.0, 170.0), (0.4, -0.6, 57.0)
"""Roll, pitch, yaw: of markers on the vehicle, and of a laboratory that is level within a degree."""


def sampled(attitude: Attitude) -> Array:
    """The times (n,) of an attitude's measurement."""
    return attitude.t if attitude.t_sample is None else attitude.t_sample


def write(path: Path, attitude: Attitude, drift_ppm: float, rng: np.random.Generator) -> float:
    """Write it as somebody else would have measured it; returns the middle of its times on the log's clock, s."""
    own = sampled(attitude)
    t = np.arange(own[0], own[-1], 1.0 / RATE_HZ)
    q = rotation.slerp(own, attitude.q, t)
    good = rotation.finite_rows(q)
    t, q = t[good], q[good]
    q = rotation.multiply(q, rotation.from_rotvec(np.radians(NOISE_DEG) * rng.normal(size=(len(q), 3))))
    world = rotation.multiply(rotation.from_euler(*np.radians(WORLD_DEG)), rotation.ENU)
    q = rotation.multiply(rotation.multiply(world, q), rotation.from_euler(*np.radians(BODY_DEG)))
    middle = float(t.mean())
    t = middle + (t - middle) * (1.0 + 1e-6 * drift_ppm) + OFFSET_S
    rows = np.column_stack([t, np.zeros((len(t), 3)), q[:, 1:], q[:, :1]])
    path.write_text("\n".join(" ".join(f"{x:.9f}" for x in row) for row in rows))
    return middle


def own(log: FlightLog, path: Path, rng: np.random.Generator) -> str:
    """A line on a flight with its own truth."""
    assert log.truth is not None
    ppm = DRIFT_PPM * float(rng.normal())
    write(path, log.truth, ppm, rng)
    try:
        found = truth.attach_truth(log, str(path)).truth
    except AttlogError as error:
        return f"refused: {error}"
    assert found is not None
    assert found.fit is not None
    fit = found.fit
    apart = rotation.earth_error(found.q, rotation.slerp(sampled(log.truth), log.truth.q, found.t))
    tilt = np.degrees(rotation.tilt_angle(apart[rotation.finite_rows(apart)]))
    late = 1e3 * (fit.offset_s + OFFSET_S)
    return (
        f"clock {late:+.2f} ({fit.offset_sigma_s * 1e3:.2f}) ms, drift {-ppm:+.0f} found {fit.drift_ppm:+.0f} "
        f"({fit.drift_sigma_ppm:.0f}) ppm, tilt {float(np.sqrt(np.mean(tilt**2))):.2f} ({fit.sigma_tilt_deg:.2f}) deg"
    )


def accepted(log: FlightLog, other: FlightLog, path: Path, rng: np.random.Generator) -> bool:
    """Whether the truth of another flight is taken for this one's."""
    assert other.truth is not None
    write(path, other.truth, 0.0, rng)
    try:
        truth.attach_truth(log, str(path))
    except AttlogError:
        return False
    return True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", type=Path, default=Path(os.environ.get("ATTLOG_CORPUS", "../shared")))
    parser.add_argument("--flights", default="*")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--foreign", type=int, default=0)
    asked = parser.parse_args()
    rng = np.random.default_rng(asked.seed)
    paths = sorted(p for s in ("*.ulg", "*.bin") for p in (asked.corpus / "sitl").glob(f"*/{s}"))
    logs = [read(p) for p in paths if fnmatch.fnmatch(p.name, asked.flights)]
    logs = [log for log in logs if log.truth is not None]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "truth.tum"
        for log in logs:
            print(f"{log.path.name:28}{own(log, path, rng)}", flush=True)
        tried = taken = 0
        for k, log in enumerate(logs if asked.foreign else ()):
            others = [logs[(k + 1 + j * 4) % len(logs)] for j in range(asked.foreign)]
            for other in (one for one in others if one is not log):
                tried += 1
                if accepted(log, other, path, rng):
                    taken += 1
                    print(f"{log.path.name}: accepted {other.path.name}", flush=True)
        if tried:
            print(f"foreign: {taken} of {tried} accepted")


if __name__ == "__main__":
    main()
