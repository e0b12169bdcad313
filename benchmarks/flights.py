"""How far `eskf` and `smoother` are from the truth on simulated flights, as parts of the onboard attitude's own error.

    python benchmarks/flights.py [--corpus DIR] [--estimators eskf,smoother] [--inject] [--air] [--only NAME,...]

The set is ``sitl/`` below the corpus folder (default $ATTLOG_CORPUS). Per flight: RMSE of tilt and heading in deg of
the onboard attitude and of each estimator, their ratio, RMS of error over the estimator's own sigma, seconds of
processor time per 100 s, and what the estimator says of itself; medians at the end. Scored from 15 s after the first
inertial sample, and airborne alone, there with 95 % intervals by bootstrap over flights. ``--inject`` adds GNSS noise
(0.2 m/s, 1.5 m and as much wander), soft iron of 2.5 % per entry and a declination error of 1 deg, the same for every
run; the onboard attitude keeps its clean sensors.
``--air`` cuts what comes before 20 s after the first arming (or before a quarter of the log).
"""

from __future__ import annotations

import argparse
import os
import time
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import attlog
from attlog.core import rotation
from attlog.estimators import Aids, Estimate, Measurements, estimate, place
from attlog.pipeline import inputs
from attlog.reference import alignment

Array = NDArray[np.float64]
SCORED_S = 15.0
IN_THE_AIR_S = 20.0
DRAWS = 4000


def samples(path: Path) -> tuple[Any, dict[str, Any]]:
    """The case of a log, and the arguments of ``attlog.estimators.estimate`` for it."""
    case = attlog.prepare(path)
    log = case.log
    assert log.imu is not None
    imu = log.imus[log.imu]
    t = imu.gyro.t_best
    field = None if log.mag is None else log.mags[log.mag].field
    given = {
        "t": t,
        "gyr": imu.gyro.x,
        "acc": imu.acc.x,
        "mag": None if field is None else place(t, field.t_best, field.x),
        "aids": inputs.aids_of(log, case.segments, imu, alignment.earth_field(log)),
        "sampling": imu.gyro.sampling,
        "dt": imu.dt,
        "declination": case.reference.alignment.declination_deg or 0.0,
    }
    return case, given


def injected(given: dict[str, Any], seed: int) -> dict[str, Any]:
    """The same flight with a poorer GNSS, a compass with soft iron and a declination that is off by 1 deg."""
    random = np.random.default_rng(seed)
    aids: Aids = given["aids"]
    changed: dict[str, Any] = {}
    if aids.velocity is not None:
        v = aids.velocity
        changed["velocity"] = Measurements(v.t, v.x + 0.2 * random.standard_normal(v.x.shape), v.sigma)
    if aids.position is not None:
        p = aids.position
        off = random.standard_normal(p.x.shape) * [1.5, 1.5, 2.2] + wander(p.t, random)
        metres = np.array([111_320.0, 111_320.0 * np.cos(np.radians(p.x[0, 0])), 1.0])
        changed["position"] = Measurements(p.t, p.x + off / metres, p.sigma)
    out = dict(given)
    if given["mag"] is not None:
        E = random.standard_normal((3, 3))
        E = np.triu(E) + np.triu(E, 1).T
        soft = np.eye(3) + 0.025 * E
        out["mag"] = given["mag"] @ soft.T
    turn = random.choice([-1.0, 1.0])
    out["declination"] = given["declination"] + turn
    return out | {"aids": replace(aids, **changed)}


def wander(t: Array, random: np.random.Generator) -> Array:
    """A slow error (n, 3) of 1.5 m: white noise once a second under a Gaussian of 20 s."""
    grid = np.arange(t[0] - 100.0, t[-1] + 100.0)
    weight = np.exp(-0.5 * (np.arange(-80, 81) / 20.0) ** 2)
    weight /= np.sqrt(np.sum(weight**2))
    columns = [np.convolve(random.standard_normal(len(grid)), weight, "same") for _ in range(3)]
    return np.column_stack([1.5 * np.interp(t, grid, c) for c in columns])


def in_the_air(case: Any, given: dict[str, Any]) -> dict[str, Any]:
    """The flight from 20 s after take-off on."""
    flown = case.segments.of("airborne")
    t = given["t"]
    begin = min(flown[0].t0 + IN_THE_AIR_S if flown else t[-1] / 4, t[-1] - 30.0)
    keep = t >= begin
    out = dict(given)
    for name in ("t", "gyr", "acc", "mag", "dt"):
        out[name] = None if given[name] is None else given[name][keep]
    return out | {"aids": given["aids"].between(begin, t[-1])}


def errors(t: Array, q: Array, truth_t: Array, truth_q: Array, begin: float) -> tuple[Array, Array, Array]:
    """Times (m,) of truth that are scored, tilt and heading errors in rad."""
    use = (truth_t >= begin) & (truth_t <= t[-1]) & np.isfinite(truth_q).all(axis=1)
    e = rotation.earth_error(rotation.slerp(t, q, truth_t[use]), truth_q[use])
    return truth_t[use], rotation.tilt_angle(e), rotation.heading_angle(e)


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x * x))) if len(x) else np.nan


def interval(x: Array) -> str:
    """The 95 % interval of the median (over flights that have a value) by bootstrap."""
    x = x[np.isfinite(x)]
    drawn = np.median(np.random.default_rng(1).choice(x, (DRAWS, len(x))), axis=1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return f"[{low:.2f}, {high:.2f}]"


def flown(case: Any, when: Array) -> NDArray[np.bool_]:
    """Which times (m,) lie in the air."""
    inside = np.zeros(len(when), bool)
    for span in case.segments.of("airborne"):
        inside |= (when >= span.t0) & (when <= span.t1)
    return inside


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", default=os.environ.get("ATTLOG_CORPUS", ""))
    parser.add_argument("--estimators", default="eskf,smoother")
    parser.add_argument("--inject", action="store_true")
    parser.add_argument("--air", action="store_true")
    parser.add_argument("--only", default="")
    args = parser.parse_args()
    root = Path(args.corpus) / "sitl"
    files = [p for p in sorted(root.rglob("*")) if p.suffix in (".ulg", ".bin")]
    files = [p for p in files if not args.only or any(n in p.name for n in args.only.split(","))]
    rows: dict[str, list[list[float]]] = {n: [] for n in args.estimators.split(",")}
    for path in files:
        case, given = samples(path)
        log = case.log
        onboard = log.onboard_attitude
        if log.truth is None or onboard is None:
            continue
        given = in_the_air(case, given) if args.air else given
        given = injected(given, zlib.crc32(path.stem.encode())) if args.inject else given
        begin = float(given["t"][0]) + SCORED_S
        at = onboard.t if onboard.t_sample is None else onboard.t_sample
        seen, *both = errors(at, onboard.q, log.truth.t, log.truth.q, begin)
        own = [np.degrees(rms(x)) for x in both]
        own_air = [np.degrees(rms(x[flown(case, seen)])) for x in both]
        for name, found in rows.items():
            clock = time.thread_time()
            e: Estimate = estimate(name, **given)
            spent = 100.0 * (time.thread_time() - clock) / (e.t[-1] - e.t[0])
            when, tilt, heading = errors(e.t, e.q, log.truth.t, log.truth.q, begin)
            sigma = [np.interp(when, e.t, e.aux[n]) for n in ("sigma_tilt", "sigma_heading")]
            off = [np.degrees(rms(tilt)), np.degrees(rms(heading))]
            z = [rms(tilt / sigma[0]), rms(heading / sigma[1])]
            refused = bool(e.quality.get("refused"))
            air = [np.degrees(rms(x[flown(case, when)])) for x in (tilt, heading)]
            air = [a / b for a, b in zip(air, own_air, strict=True)]
            found.append([*off, off[0] / own[0], off[1] / own[1], *z, spent, float(refused), *air])
            print(
                f"{path.stem:24s} {name:10s} onboard {own[0]:5.2f} {own[1]:5.2f}  deg {off[0]:6.3f} {off[1]:6.3f}  "
                f"ratio {off[0] / own[0]:5.2f} {off[1] / own[1]:5.2f}  "
                f"airborne {air[0]:5.2f} {air[1]:5.2f}  z {z[0]:4.1f} {z[1]:4.1f}  {spent:4.1f} s  "
                + " ".join(f"{k}={v:.3g}" if isinstance(v, float) else f"{k}={v}" for k, v in e.quality.items()),
                flush=True,
            )
    for name, found in rows.items():
        x = np.array(found)
        taken = x[x[:, 7] == 0.0]
        pooled = np.sqrt(np.mean(taken[:, 4:6] ** 2, axis=0))
        print(
            f"{name:10s} {len(x)} flights: median ratio {np.median(x[:, 2]):.3f} {np.median(x[:, 3]):.3f}, airborne "
            f"{np.nanmedian(x[:, 8]):.3f} {interval(x[:, 8])} {np.nanmedian(x[:, 9]):.3f} {interval(x[:, 9])}, deg "
            f"{np.median(x[:, 0]):.3f} {np.median(x[:, 1]):.3f}; of {len(taken)} not refused worst "
            f"{taken[:, 2].max():.2f} {taken[:, 3].max():.2f}"
            f", pooled error/sigma {pooled[0]:.2f} {pooled[1]:.2f}, above 1.5 "
            f"{np.mean(taken[:, 4] > 1.5):.2f} {np.mean(taken[:, 5] > 1.5):.2f}; {np.median(x[:, 6]):.2f} s per 100 s"
        )


if __name__ == "__main__":
    main()
