"""How accurate every estimator is where the truth is known, beside its peers in the same process.

    python benchmarks/accuracy.py [--corpus DIR] [--estimators LIST] [--peers LIST] [--lag]
    python benchmarks/accuracy.py --write

Sets below the corpus folder (default $ATTLOG_CORPUS): ``broad/`` (9-axis IMU with optical truth; motion
phases), the same started at 25 % of the motion phase and scored from 20 s later (``broad_mid``, without the trials with
an attached magnet), ``euroc/`` (quadrotor without magnetometer; after 20 s, tilt only), ``sitl/`` (simulated
firmware flights with truth and the log's GNSS; after 15 s), ``unbiased`` (the same, the gyro's bias at rest subtracted
as in an analysis). ``gsf`` is scored from where GNSS motion has told it a heading. At the end the ratios of ``mekf``
and ``smoother`` to their peers. Without a corpus the sample logs of the repository stand in, treated like ``sitl/``.
Per row: mean over the set of total, heading and tilt RMSE in deg and ns per update. ``--lag`` adds lag and step
gain from ``attlog.analyze`` on the simulated flights. Peers are those of ``peers.py``; ``ahrs`` is plain Python:
minutes.
``--write`` puts the means with their intervals into attlog/estimators/accuracy.csv and the table of
docs/estimators.md; what was not run stays there.
"""

from __future__ import annotations

import argparse
import csv
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import accuracy_file
import numpy as np
from numpy.typing import NDArray
from peers import PEERS, WITHOUT_HEADING, from_enu, installed

import attlog
from attlog import segments
from attlog.core import rotation
from attlog.core.errors import AttlogError
from attlog.core.truncation import truncation_of
from attlog.estimators import Aids, Estimate, estimate, place, select
from attlog.estimators.samples import Sampling
from attlog.pipeline import inputs
from attlog.pipeline.replay import KNOWN_RAD
from attlog.reference import alignment as log_declination

Array = NDArray[np.float64]
SAMPLES = Path(__file__).resolve().parent.parent / "sample_logs"
FLIP = np.array([1.0, -1.0, -1.0])


@dataclass(slots=True)
class Trial:
    """One recording in FRD and NED: sensors, truth ``q`` at ``t_true``, and which truth samples are scored."""

    group: str
    name: str
    t: Array
    gyr: Array
    acc: Array
    mag: Array | None
    t_true: Array
    q: Array
    scored: NDArray[np.bool_]
    sampling: Sampling = "interval"
    declination: float = 0.0
    aids: Aids | None = None

    def errors(self, t: Array, q: Array, heading: bool = True) -> Array:
        """Total, heading, tilt RMSE in deg of attitudes ``q`` at ``t``.

        The first two are NaN without magnetometer and for a filter that estimates no ``heading``.
        """
        use = self.scored & np.isfinite(self.q).all(axis=1) & (self.t_true >= t[0]) & (self.t_true <= t[-1])
        e = rotation.earth_error(rotation.slerp(t, q, self.t_true[use]), self.q[use])
        angles = [rotation.total_angle(e), rotation.heading_angle(e), rotation.tilt_angle(e)]
        rmse = np.rad2deg([np.sqrt(np.mean(a**2)) for a in angles])
        return rmse if heading and self.mag is not None else np.array([np.nan, np.nan, rmse[2]])


def broad(root: Path) -> Iterator[Trial]:
    """The BROAD trials: motion phases, no alignment."""
    for path in sorted((root / "broad").glob("*.npz")):
        with np.load(path) as d:
            t = np.arange(len(d["gyr"])) / float(d["fs"])
            q = from_enu(d["opt_quat"])
            sensors = [np.asarray(d[k], np.float64) * FLIP for k in ("gyr", "acc", "mag")]
            yield Trial("broad", path.stem, t, *sensors, t, q, d["movement"].astype(bool))


def broad_mid(root: Path) -> Iterator[Trial]:
    """The BROAD trials from 25 % of their motion phase on, scored from 20 s later; not those with a magnet attached."""
    for trial in broad(root):
        if "attached_magnet" not in trial.name:
            moving = np.flatnonzero(trial.scored)
            rest = slice(int(moving[0] + 0.25 * (moving[-1] - moving[0])), None)
            t = trial.t[rest] - trial.t[rest.start]
            parts = {k: getattr(trial, k)[rest] for k in ("gyr", "acc", "mag", "q")}
            yield replace(trial, group="broad_mid", t=t, t_true=t, scored=trial.scored[rest] & (t > 20.0), **parts)


def euroc(root: Path) -> Iterator[Trial]:
    """The EuRoC flights: no magnetometer, scored after 20 s."""
    for path in sorted((root / "euroc").glob("*.npz")):
        with np.load(path) as d:
            t, q = d["t"], np.asarray(d["quat"], np.float64)
            yield Trial("euroc", path.stem, t, d["gyr"].astype(float), d["acc"].astype(float), None, t, q, t > 20.0)


def simulated(root: Path, group: str) -> Iterator[tuple[Path, Trial]]:
    """The simulated flights with truth in the log, scored after 15 s, true declination given."""
    with (root / "sitl" / "MANIFEST.csv").open(encoding="utf-8") as file:
        declination = {r["file"]: float(r["declination_true"] or 0) for r in csv.DictReader(file)}
    for path in flights(root):
        trial = flight(path, f"{group}/{path.parent.name}", declination.get(f"{path.parent.name}/{path.name}", 0.0))
        if trial is not None:
            yield path, trial


def sitl(root: Path) -> Iterator[Trial]:
    """The simulated flights as they are."""
    for _, trial in simulated(root, "sitl"):
        yield trial


def unbiased(root: Path) -> Iterator[Trial]:
    """The simulated flights with the gyro that an analysis hands to filters: its bias at rest subtracted."""
    for path, trial in simulated(root, "unbiased"):
        case = attlog.prepare(path)
        imu = case.log.replay_imu
        assert imu is not None
        yield replace(trial, gyr=case.gyro_of(imu))


def samples(root: Path) -> Iterator[Trial]:
    """The flights with truth in the repository, scored like the simulated ones."""
    for path in sorted(root.iterdir()):
        if path.suffix in (".ulg", ".bin"):
            trial = flight(path, "samples", attlog.prepare(path).reference.alignment.declination_deg)
            if trial is not None:
                yield trial


def flight(path: Path, group: str, declination: float) -> Trial | None:
    """A simulated flight with truth and magnetometer, scored after 15 s; None for another."""
    log = attlog.read(path)
    if log.truth is None or log.imu is None or log.mag is None:
        return None
    imu, field = log.imus[log.imu], log.mags[log.mag].field
    aids = inputs.aids_of(log, segments.build(log), imu, log_declination.earth_field(log))
    return Trial(
        group,
        path.stem,
        imu.gyro.t,
        imu.gyro.x,
        imu.acc.x,
        place(imu.gyro.t, field.t_best, field.x),
        log.truth.t,
        log.truth.q,
        log.truth.t > 15.0,
        imu.gyro.sampling,
        declination,
        aids,
    )


def scores(cases: list[Trial], specs: list[str], peers: list[str]) -> dict[tuple[str, str], list[Array]]:
    """Per (row, group) the list of (total, heading, tilt, ns); rows that need a missing sensor are left out."""
    found: dict[tuple[str, str], list[Array]] = {}
    for trial in cases:
        for spec in specs:
            try:
                e = estimate(
                    spec,
                    trial.t,
                    trial.gyr,
                    trial.acc,
                    trial.mag,
                    sampling=trial.sampling,
                    declination=trial.declination,
                    aids=trial.aids,
                )
            except AttlogError:
                continue
            told = told_from(e) if "gnss" in select(spec)[0].estimator.needs else slice(None)
            if not len(e.t[told]):
                continue  # no motion told the heading: no trial of this filter
            row = np.append(trial.errors(e.t[told], e.q[told]), e.ns_per_update)
            found.setdefault((spec, trial.group), []).append(row)
        for name in peers:
            if name.endswith("_restored") and truncation_of(trial.gyr) is None:
                continue  # the same as without
            q, ns = PEERS[name](trial)
            turned = rotation.turn_about_down(rotation.normalize(q), np.deg2rad(trial.declination))
            row = np.append(trial.errors(trial.t, turned, heading=name not in WITHOUT_HEADING), ns)
            found.setdefault((f"peer {name}", trial.group), []).append(row)
    return found


def told_from(e: Estimate) -> slice:
    """The samples from which on a filter that finds its heading by GNSS motion knows it, as in an analysis."""
    known = np.flatnonzero(e.aux["sigma_heading"] < KNOWN_RAD)
    return slice(int(known[0]) if len(known) else len(e.t), None)


RATIOS = tuple(
    (group, row, f"peer {peer}{gyro}")
    for group in ("broad", "broad_mid", "euroc")
    for row, peer in (("mekf", "vqf"), ("smoother", "vqf_offline"))
    for gyro in ("", "_restored")
)
"""Set, row, and what it is divided by: means over the set."""


def ratios(table: dict[tuple[str, str], list[Array]]) -> Iterator[str]:
    """One line per ratio whose rows are there: total / heading / tilt."""
    for group, row, peer in RATIOS:
        if (row, group) in table and (peer, group) in table:
            a, b = (np.mean(table[name, group], axis=0)[:3] for name in (row, peer))
            parts = "".join(f"{x:8.2f}" if np.isfinite(x) else f"{'':8}" for x in a / b)
            yield f"{group:10}{row + ' / ' + peer[5:]:38}{len(table[row, group]):4}{parts}   ratio of means"


def flights(corpus: Path | None) -> list[Path]:
    """The simulated flights of the corpus, else of the repository."""
    found = SAMPLES.iterdir() if corpus is None else (corpus / "sitl").glob("*/*")
    return sorted(path for path in found if path.suffix in (".ulg", ".bin"))


def lags(paths: list[Path], specs: list[str]) -> dict[str, list[Array]]:
    """Per row the list of (lag ms, step gain of roll) of the simulated flights that have steps."""
    from attlog.pipeline.config import Config

    found: dict[str, list[Array]] = {}
    for path in paths:
        for row in attlog.analyze(path, Config(estimators=specs)).estimators:
            answers = row.metrics.get("all", {})
            values = [answers[m].value if m in answers else None for m in ("lag_ms", "step_gain_roll")]
            if values[0] is not None:
                found.setdefault(row.name, []).append(np.array([np.nan if v is None else v for v in values]))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", type=Path, default=os.environ.get("ATTLOG_CORPUS"), help="folder with the data")
    parser.add_argument("--estimators", default="all,fusion@example", help="as on the command line of attlog")
    some = ",".join(name for name in PEERS if name != "ahrs")
    parser.add_argument("--peers", default=some, help=f"of {', '.join(PEERS)}; empty for none (default all but ahrs)")
    parser.add_argument("--sets", default="broad,broad_mid,euroc,sitl,unbiased")
    parser.add_argument("--write", action="store_true", help="write attlog/estimators/accuracy.csv and the docs' table")
    parser.add_argument("--lag", action="store_true", help="lag and step gain on the simulated flights as well")
    given = parser.parse_args()
    peers = [name for name in given.peers.split(",") if name]
    if unknown := set(peers) - set(PEERS):
        parser.error(f"no peer {', '.join(sorted(unknown))}; there are {', '.join(PEERS)}")
    peers = installed(peers)
    if given.corpus is None:
        print(
            "Neither --corpus nor ATTLOG_CORPUS: BROAD, EuRoC and simulated flights are skipped, the sample logs serve."
        )
        cases = list(samples(SAMPLES))
    else:
        sets = {"broad": broad, "broad_mid": broad_mid, "euroc": euroc, "sitl": sitl, "unbiased": unbiased}
        cases = [c for name in given.sets.split(",") for c in sets[name](given.corpus)]
    specs = [row.name for row in select(given.estimators)]
    for spec in specs:
        with suppress(AttlogError):  # one that needs GNSS
            estimate(spec, *(x[:50] for x in (cases[0].t, cases[0].gyr, cases[0].acc, cases[0].acc)))
    table = scores(cases, specs, peers)
    print(f"{'group':20}{'row':28}{'n':>4}{'total':>9}{'heading':>9}{'incl.':>9}{'ns':>9}   RMSE in deg")
    for group in dict.fromkeys(c.group for c in cases):
        for (row, where), values in table.items():
            if where == group:
                *angles, ns = np.mean(values, axis=0)
                cells = "".join(f"{x:9.2f}" if np.isfinite(x) else f"{'':9}" for x in angles)
                print(f"{group:20}{row:28}{len(values):4}{cells}{ns:9.0f}", flush=True)
    for line in ratios(table):
        print(line)
    if given.write:
        accuracy_file.write(table)
        accuracy_file.write_page()
    if given.lag:
        print(f"{'row':44}{'n':>4}{'lag ms':>9}{'step gain':>11}   medians over simulated flights")
        for row, values in lags(flights(given.corpus), specs).items():
            lag, gain = (np.median(x[np.isfinite(x)]) if np.isfinite(x).any() else np.nan for x in np.transpose(values))
            print(f"{row:44}{len(values):4}{lag:9.1f}{gain:11.3f}")


if __name__ == "__main__":
    main()
