"""How well do the settings of `mekf` and `smoother` carry over to trials on which they were not chosen?

    python benchmarks/crossvalidation.py [--corpus DIR]

The BROAD trials fall into groups by kind of motion and disturbance. For each group the settings are chosen on all
others (least mean logarithm of the error over that of vqf, of offlineVQF for the smoother) and scored on the group
itself: the cross-validated error. Choosing knows the trials, the same started in the middle of their motion, and copies
whose field at the first rest is turned by 3 deg, as at another place of the room: what a room does to the first field
is luck that 15 trials cannot tell. Printed per filter: the ratio of mean errors with the defaults, with what each
trial's other groups choose, and its 95 % interval by bootstrap over trials; then what all trials together choose.
"""

from __future__ import annotations

import argparse
import itertools
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import accuracy
import numpy as np
from numpy.typing import NDArray

from attlog.core import rotation
from attlog.estimators import estimate
from attlog.estimators.filters.inertial.backward import smooth

Array = NDArray[np.float64]
Settings = Mapping[str, float]
GROUPS = ("slow", "fast_rotation", "fast_translation", "combined", "tapping", "phone", "stationary", "attached")
"""Words in the trials' names; the first that fits counts."""
GRID: dict[str, tuple[float, ...]] = {
    "offset_sigma": (0.03, 0.06, 0.1),
    "mag_noise": (8.0, 14.0, 20.0),
    "field_sigma": (0.0, 2.0, 4.5),
}
TURNED_DEG, FADES_S = 3.0, 2.0
DRAWS, SEED = 2000, 1


def candidates() -> list[Settings]:
    """Every combination of the grid."""
    return [dict(zip(GRID, values, strict=True)) for values in itertools.product(*GRID.values())]


def turned(trial: accuracy.Trial, deg: float) -> accuracy.Trial:
    """The same with the field of the first rest turned about the vertical, which fades as the motion begins."""
    known = np.isfinite(trial.q).all(axis=1)
    t = trial.t[known]
    q = rotation.slerp(t, trial.q[known], np.clip(trial.t, t[0], t[-1]))
    begin = trial.t[np.argmax(trial.scored)]
    angle = np.deg2rad(deg) * np.clip(1.0 - (trial.t - begin) / FADES_S, 0.0, 1.0)
    field = rotation.rotate(rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]), rotation.rotate(q, trial.mag))
    return replace(trial, group="turned", mag=rotation.rotate(rotation.conjugate(q), field))


def cases(root: Path) -> Iterator[accuracy.Trial]:
    """Trials, the same begun in motion, and with another first field."""
    for trial in accuracy.broad(root):
        yield from (trial, turned(trial, TURNED_DEG), turned(trial, -TURNED_DEG))
    yield from accuracy.broad_mid(root)


def mekf(trial: accuracy.Trial, settings: Settings) -> Array:
    """Total, heading, tilt RMSE (3,) in deg."""
    found = estimate("mekf", trial.t, trial.gyr, trial.acc, trial.mag, **settings)
    return trial.errors(found.t, found.q)


def smoother(trial: accuracy.Trial, settings: Settings) -> Array:
    """Total, heading, tilt RMSE (3,) in deg."""
    found = smooth(trial.t, trial.gyr, trial.acc, trial.mag, settings)
    return trial.errors(found.t, found.q)


def group_of(trial: accuracy.Trial) -> int:
    """The number of a trial's group."""
    return next(k for k, word in enumerate(GROUPS) if word in trial.name)


def report(
    name: str, found: Callable[[accuracy.Trial, Settings], Array], peer: str, trials: list[accuracy.Trial]
) -> None:
    """Print the three ratios of total, heading, tilt of one filter, and the settings of all trials."""
    theirs = np.array([trial.errors(trial.t, rotation.normalize(accuracy.PEERS[peer](trial)[0])) for trial in trials])
    group = np.array([group_of(trial) for trial in trials])
    plain = np.array([trial.group == "broad" for trial in trials])
    tried = candidates()
    ours = np.array([[found(trial, settings) for trial in trials] for settings in tried])
    score = np.log(ours[:, :, 0] / theirs[:, 0])
    chosen = {g: int(np.argmin(score[:, group != g].mean(axis=1))) for g in np.unique(group)}
    default = np.array([found(trial, {}) for trial in trials])
    held_out = np.array([ours[chosen[g], k] for k, g in enumerate(group)])
    rows, peers = held_out[plain], theirs[plain]
    draws = np.random.default_rng(SEED).integers(0, len(rows), (DRAWS, len(rows)))
    spread = rows[draws].mean(axis=1) / peers[draws].mean(axis=1)
    low, high = np.quantile(spread, [0.025, 0.975], axis=0)
    in_hand = default[plain].mean(axis=0) / peers.mean(axis=0)
    across = rows.mean(axis=0) / peers.mean(axis=0)
    for k, what in enumerate(("total", "heading", "tilt")):
        print(
            f"{name:10}{what:13}{in_hand[k]:8.2f}{across[k]:8.2f}   [{low[k]:.2f}, {high[k]:.2f}]"
            f"   worst trial {np.max(rows[:, k] / peers[:, k]):.2f}"
        )
    print(f"{name:10}all trials choose {dict(tried[int(np.argmin(score.mean(axis=1)))])}")
    for g, k in chosen.items():
        print(f"{name:10}without {GROUPS[g]:18}{dict(tried[k])}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--corpus", type=Path, default=os.environ.get("ATTLOG_CORPUS"), help="folder with broad/")
    given = parser.parse_args()
    if given.corpus is None:
        raise SystemExit("Neither --corpus nor ATTLOG_CORPUS names a folder with broad/: nothing to validate on.")
    trials = list(cases(given.corpus))
    print(f"{len(trials)} cases; ratios of mean errors over the peer's: defaults, cross-validated [95 %]")
    report("mekf", mekf, "vqf", trials)
    report("smoother", smoother, "vqf_offline", trials)


if __name__ == "__main__":
    main()
