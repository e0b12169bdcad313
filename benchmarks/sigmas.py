"""Are estimators as wrong as they say? RMS of error over own sigma where the truth is known.

    python benchmarks/sigmas.py [--corpus DIR] [--estimators mekf,eskf,eskf@fixed,smoother] [--each]
                                [--compass turned,offset]

Sets below the corpus folder (default $ATTLOG_CORPUS): ``sitl/`` (airborne, from 15 s after the first sample on),
``broad/`` (motion phases), ``euroc/`` (after 20 s, tilt only). ``smoother`` runs with the aids of the log, and as
``smoother, no GNSS`` without; on BROAD and EuRoC there is no GNSS. Per row: pooled over the set, and the range over its
flights. ``--compass``: ``sitl/`` once with each of these faults, of which ``turned`` is by 15 deg and ``offset`` by
100, -60, 40 mG. ``--each`` prints every flight: error and sigma in deg, and their ratio.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import accuracy
import numpy as np
from flights import SCORED_S, samples
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.estimators import Aids, estimate

Array = NDArray[np.float64]
NO_GNSS = ", no GNSS"
COMPASS: dict[str, Callable[[Array], Array]] = {
    "sound": lambda field: field,
    "turned": lambda field: rotation.rotate(rotation.from_euler(0.0, 0.0, np.radians(15.0)), field),
    "offset": lambda field: field + 1e-7 * np.array([100.0, -60.0, 40.0]),
}
"""What a fault makes of the field (n, 3) in T."""
Flight = tuple[str, dict[str, Any], Array, Array, NDArray[np.bool_]]
"""Name, arguments of ``estimate``, truth's times and attitudes, which of them are scored."""


def simulated(root: Path, compass: list[str]) -> Iterator[Flight]:
    """The simulated firmware flights with truth, once with each state of the compass."""
    for path in accuracy.flights(root):
        case, given = samples(path)
        truth = case.log.truth
        if truth is None:
            continue
        flown = np.zeros(len(truth.t), bool)
        for span in case.segments.of("airborne"):
            flown |= (truth.t >= span.t0) & (truth.t <= span.t1)
        scored = flown & (truth.t >= given["t"][0] + SCORED_S)
        for name in compass:
            if name == "sound" or given["mag"] is not None:
                changed = given if given["mag"] is None else given | {"mag": COMPASS[name](given["mag"])}
                yield path.stem, changed, truth.t, truth.q, scored


def trials(found: Iterator[accuracy.Trial]) -> Iterator[Flight]:
    """Recordings with optical truth."""
    for trial in found:
        given = {k: getattr(trial, k) for k in ("t", "gyr", "acc", "mag", "sampling", "declination")}
        yield trial.name, given, trial.t_true, trial.q, trial.scored


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x * x)))


def ratios(name: str, flight: Flight, each: bool) -> Array:
    """Error over sigma (2,) of one estimator on one flight: tilt and heading."""
    label, given, t, truth, scored = flight
    if name.endswith(NO_GNSS):
        given = given | {"aids": replace(given.get("aids", Aids()), position=None, velocity=None)}
    e = estimate(name.removesuffix(NO_GNSS), **given)
    use = scored & np.isfinite(truth).all(axis=1) & (t <= e.t[-1])
    off = rotation.earth_error(rotation.slerp(e.t, e.q, t[use]), truth[use])
    found = []
    for which, error in (("tilt", rotation.tilt_angle(off)), ("heading", rotation.heading_angle(off))):
        sigma = np.interp(t[use], e.t, e.aux[f"sigma_{which}"])
        found.append(rms(error / sigma))
        if each:
            wrong, own = np.degrees([rms(error), rms(sigma)])
            print(f"{label:46} {name:18} {which:8} {wrong:7.2f} deg, sigma {own:6.2f}, ratio {found[-1]:6.2f}")
    return np.array(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", type=Path, default=os.environ.get("ATTLOG_CORPUS"), help="folder with the data")
    parser.add_argument("--estimators", default="mekf,eskf,eskf@fixed,smoother")
    parser.add_argument("--sets", default="sitl,broad,euroc")
    parser.add_argument("--compass", default="sound")
    parser.add_argument("--each", action="store_true")
    args = parser.parse_args()
    names = [x for n in args.estimators.split(",") for x in ([n, n + NO_GNSS] if n == "smoother" else [n])]
    sets = {
        "sitl": lambda: simulated(args.corpus, args.compass.split(",")),
        "broad": lambda: trials(accuracy.broad(args.corpus)),
        "euroc": lambda: trials(accuracy.euroc(args.corpus)),
    }
    for group in args.sets.split(","):
        rows: dict[str, list[Array]] = {}
        for flight in sets[group]():
            for name in names:
                if group == "sitl" or name in ("mekf", "smoother" + NO_GNSS):
                    rows.setdefault(name, []).append(ratios(name, flight, args.each))
        for name, found in rows.items():
            x = np.array(found)
            parts = [
                f"{which} {rms(x[:, i]):.2f} ({x[:, i].min():.2f} to {x[:, i].max():.2f})"
                for i, which in enumerate(("tilt", "heading"))
            ]
            print(f"{group:6} {name:20} {len(x):3} flights: {', '.join(parts[: 1 if group == 'euroc' else 2])}")


if __name__ == "__main__":
    main()
