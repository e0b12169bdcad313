"""Fan's conclusion: which filter is the more exact one, and which needs the more computation."""

from __future__ import annotations

from attlog.present.numbers import quantity
from attlog.reproduce import cost
from attlog.reproduce.fan.runs import EKF, EKFS, FILTER, FanSeed
from attlog.reproduce.fan.walks import CALLED, Judged, by_walk
from attlog.reproduce.judge import above, alternatives, below, ends, led, mean, ratio, span, together
from attlog.reproduce.paper import Claim


def exact(found: list[FanSeed]) -> Judged:
    """The error of the attitude, at rest and in rotation."""
    numbers = [
        [
            ratio(
                f"error of the attitude {where}, {CALLED[row]} over complementary filter",
                [_off(s, row, where) for s in found],
                [_off(s, FILTER, where) for s in found],
            )
            for where in ("at rest", "in rotation")
        ]
        for row in EKFS
    ]
    verdicts = [together([below(n, 1.0) for n in pair]) for pair in numbers]
    own = [
        mean(f"error of the attitude {where}, complementary filter", [_off(s, FILTER, where) for s in found], "deg")
        for where in ("at rest", "in rotation")
    ]
    pairs = [n for pair in numbers for n in pair]
    claim = Claim(
        "exact",
        "The Kalman filter's attitude is the more exact one.",
        "section 6",
        "RMS of the whole angle to the true attitude, Kalman over complementary filter. Holds if the intervals at rest "
        "and in rotation are below 1.",
        led(ends(pairs), (*pairs, *own)),
        alternatives(verdicts),
        f"It holds {by_walk(verdicts)}. The ratios are {span(pairs, 'ratio')}. The Kalman filter has no gyro bias "
        "among its states: with a narrow band a bias tilts it. The complementary filter's gain of 3 leaves little of "
        "it.",
        shown=2,
    )
    return claim, verdicts


def _off(seed: FanSeed, row: str, where: str) -> float:
    return seed.off[row] if where == "at rest" else seed.turned[row].off_deg


def dearer(spent: dict[str, list[float]]) -> Claim:
    """Time per update; ``spent`` of :func:`attlog.reproduce.cost.nanoseconds`."""
    one = ratio("time per update, Kalman over complementary filter", spent[EKF], spent[FILTER])
    each = [mean(f"time per update, {CALLED[row]}", spent[row], "ns") for row in (EKF, FILTER)]
    return Claim(
        "dearer",
        "The Kalman filter needs many matrix operations, the complementary filter little computation.",
        "sections 5, 6",
        f"{cost.MEASURED} Holds if the interval of the ratio is above 1.",
        (one, *each),
        above(one, 1.0),
        f"An update takes {quantity(each[0].value, 'ns')} and {quantity(each[1].value, 'ns')}. The sparse blocks of "
        "(11) are used: with dense matrices the ratio would be larger. Times are of this machine.",
    )
