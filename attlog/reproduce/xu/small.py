"""Xu's remarks beside the figures: what a gain that is too small does, and which form of the attitude is cheaper."""

from __future__ import annotations

from collections.abc import Sequence

from attlog.reproduce.cost import MEASURED
from attlog.reproduce.judge import above, mean, numbers_text, ratio
from attlog.reproduce.paper import Claim
from attlog.reproduce.xu.best import GainErrors, best_gain
from attlog.reproduce.xu.runs import BAND_HZ, COSTED, SWEPT, XuSeed, gain


def slow(seeds: Sequence[XuSeed], missions: GainErrors) -> Claim:
    """The slow error below the best gain."""
    smallest, next_one = SWEPT[0], SWEPT[1]
    best = best_gain(missions, missions.tilt, "tilt")
    grown, printed = (
        ratio(
            f"slow error of roll and pitch, kp {kp:g} over {next_one:g}, simulated missions",
            [s.slow[gain(kp)] for s in seeds],
            [s.slow[gain(next_one)] for s in seeds],
        )
        for kp in (smallest, 0.6)
    )
    sizes = [
        mean(f"slow error of roll and pitch, kp {kp:g}, simulated missions", [s.slow[gain(kp)] for s in seeds], "deg")
        for kp in (smallest, next_one, 0.6)
    ]
    return Claim(
        "slow",
        "A gain that is too small lets slow errors of the gyro in.",
        "section 4",
        f"RMS error of roll and pitch averaged over {1.0 / BAND_HZ[0]:g} s, in the air. Holds if it grows from kp "
        f"{next_one:g} down to {smallest:g}: the interval of the ratio is above 1.",
        (grown, printed, *sizes, best.over),
        above(grown, 1.0),
        f"Too small is far below the paper's gains: in our simulation kp {best.kp:g} errs least in tilt. The slow "
        f"error with 0.6 is {numbers_text([printed])} that with {next_one:g}. Lasting accelerations are slow too.",
    )


def dearer(spent: dict[str, list[float]]) -> Claim:
    """Time per update; ``spent`` of :func:`attlog.reproduce.cost.nanoseconds`."""
    quaternion, matrix = COSTED
    one = ratio("time per update, rotation matrix over quaternion", spent[matrix], spent[quaternion])
    each = [
        mean(f"time per update, {name}", spent[row], "ns")
        for name, row in (("quaternion (mahony)", quaternion), ("matrix (mahony_dcm)", matrix))
    ]
    return Claim(
        "cost",
        "The quaternion needs less computation than the direction cosine matrix.",
        "section 0.1",
        f"{MEASURED} The same filter and gains in both forms. Holds if the interval of the ratio is above 1.",
        (one, *each),
        above(one, 1.0),
        "The matrix is renormalised, and a quaternion is made of it for the output. Times are of this machine.",
    )
