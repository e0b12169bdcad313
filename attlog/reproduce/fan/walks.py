"""Fan's filters by name, and what the Kalman filter's three random walks say of a claim."""

from __future__ import annotations

from collections.abc import Sequence

from attlog.present.numbers import listed
from attlog.reproduce.fan.runs import FILTER, RAW, WIDER, FanSeed, wider
from attlog.reproduce.judge import ratio
from attlog.reproduce.paper import Claim, PaperNumber, Verdict
from attlog.reproduce.samples import AXES

CALLED = {RAW: "raw", FILTER: "complementary filter"} | {
    wider(f): "Kalman filter" if f == 1.0 else f"Kalman filter, walks x {f:g}" for f in WIDER
}
Judged = tuple[Claim, list[Verdict]]
"""A claim about the Kalman filter, and whether it holds with each of the random walks."""


def spreads(found: Sequence[FanSeed], row: str, over: str, axis: int) -> PaperNumber:
    """The spread of one axis at rest, one filter's over another's."""
    return ratio(
        f"spread of {AXES[axis]} at rest, {CALLED[row]} over {CALLED[over]}",
        [s.spread[row][axis] for s in found],
        [s.spread[over][axis] for s in found],
    )


def by_walk(verdicts: Sequence[Verdict]) -> str:
    """With which random walks a claim holds and with which it is not significant, in words."""
    held, untold = (
        [f"{f:g}" for f, v in zip(WIDER, verdicts, strict=True) if v == which]
        for which in ("holds", "cannot be judged")
    )
    if len(untold) == len(WIDER):
        return "with none of the random walks significantly"
    if len(held) in (0, len(WIDER)):
        said = "with every random walk" if held else "with none of the random walks"
    else:
        said = "with our random walks alone" if held == ["1"] else f"with random walks {listed(held)} times ours"
    if not untold:
        return said
    return f"{said}; not significant with {'ours' if untold == ['1'] else f'{listed(untold)} times ours'}"
