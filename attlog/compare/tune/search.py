"""A global search for the gains with the smallest cost: differential evolution (Storn1997) by scipy.

scipy's ``differential_evolution`` hands over a whole generation at once (``vectorized=True``), which is how the batches
of parameter sets run; it needs no gradient, is seeded, and scipy is small beside what attlog needs anyway. optuna and
nevergrad ask for one setting after the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.base.errors import UsageError
from attlog.compare.configurations.configuration import checked
from attlog.compare.sweep.grid import RANGE, Setting, text_of
from attlog.estimators import Parameter
from attlog.estimators.base import COMMON, Estimator
from attlog.estimators.spelling import range_spelled

Array = NDArray[np.float64]
Costs = Callable[[list[Setting]], Array]

GENERATION = 32
"""Settings of a generation: two whole kernels."""
DIGITS = 3
"""Gains are tried and given with so many digits: nobody needs more, and equal ones are run once."""
WIDER = 20.0
"""A parameter is looked for from its default over this to its default times this, where no range is given."""
MOST_UNASKED, MOST = 4, 8
"""So many gains are looked for without being named, and at all: a few flights tell no more."""


@dataclass(frozen=True, slots=True)
class FreeParameter:
    """A parameter that is looked for, between two values; on a logarithmic scale where ``log``."""

    name: str
    unit: str
    low: float
    high: float
    log: bool

    def value(self, share: float) -> float:
        """The value at a share of the way, to DIGITS."""
        if self.log:
            x = self.low * (self.high / self.low) ** share
        else:
            x = self.low + (self.high - self.low) * share
        return min(max(float(f"{x:.{DIGITS}g}"), self.low), self.high)

    def share(self, value: float) -> float:
        """Where a value lies, cut to the range."""
        value = min(max(value, self.low), self.high)
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


def free_parameters(texts: Sequence[str], estimator: Estimator) -> list[FreeParameter]:
    """The parameters of ``kp=0.05..5log`` and so on; without any, every number of the filter's own that has a default.

    UsageError tells everything wrong in them.
    """
    if not texts:
        own = [p for p in estimator.own if not p.choices and p not in COMMON and float(p.default) > 0.0]
        if not own:
            raise UsageError(f"{estimator.name} has no gains to tune; give ranges such as NAME=0.1..10log")
        if len(own) > MOST_UNASKED:
            names, example = ", ".join(p.name for p in own), _around(own[0])
            raise UsageError(
                f"{estimator.name} has {len(own)} numbers ({names}), too many to look for at once; "
                f"name up to {MOST} with ranges, such as "
                f"{example.name}={example.low:g}..{example.high:g}log"
            )
        return [_around(p) for p in own]
    if len(texts) > MOST:
        raise UsageError(f"{len(texts)} gains; up to {MOST} can be looked for at once")
    found, wrong = [], []
    for text in texts:
        try:
            found.append(_free(text, estimator))
        except UsageError as error:
            wrong.append(str(error))
    if wrong:
        raise UsageError("\n".join(wrong))
    return found


def _around(parameter: Parameter) -> FreeParameter:
    """A gain between its default over WIDER and times WIDER."""
    default = float(parameter.default)
    low, high = (float(f"{x:.{DIGITS}g}") for x in (default / WIDER, default * WIDER))
    return FreeParameter(parameter.name, parameter.unit, max(low, parameter.low), min(high, parameter.high), True)


def _free(text: str, estimator: Estimator) -> FreeParameter:
    name, _, values = (part.strip() for part in text.partition("="))
    parameter: Parameter = estimator.parameter(name)
    log = values.endswith("log")
    ends = RANGE.fullmatch(values.removesuffix("log").strip())
    if parameter.choices or ends is None or ends["count"] is not None:
        example = range_spelled(values.removesuffix("log").partition("/")[0]) or "0.1..10log"
        raise UsageError(f"{estimator.name}: {text}: give a range such as {name}={example}, or attlog sweep for a list")
    low, high = (float(checked(estimator, name, ends[end].strip())) for end in ("low", "high"))
    if not low < high:
        raise UsageError(f"{estimator.name}: {text}: the range is empty; give the smaller value first")
    if log and low <= 0.0:
        raise UsageError(f"{estimator.name}: {text}: a log range begins above 0")
    return FreeParameter(name, parameter.unit, low, high, log)


@dataclass(frozen=True, slots=True)
class SearchResult:
    """The best setting, its cost, and every setting that was tried with its cost, in the order of the search."""

    setting: Setting
    cost: float
    tried: list[tuple[Setting, float]]


def search(free: Sequence[FreeParameter], costs: Costs, start: Setting, generations: int, seed: int) -> SearchResult:
    """The setting with the smallest cost. ``costs`` takes a whole generation; ``start`` is among the first.

    The same seed and costs give the same result. UsageError where scipy is not installed.
    """
    try:
        from scipy.optimize import differential_evolution  # type: ignore[import-untyped, unused-ignore]
        from scipy.stats import qmc  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        raise UsageError(
            'attlog tune needs scipy: pip install scipy, or pip install ".[tune]" in the source folder'
        ) from None
    tried: dict[str, tuple[Setting, float]] = {}

    def cost(x: Array) -> Any:
        settings: list[Setting] = [
            {f.name: f.value(float(s)) for f, s in zip(free, column, strict=True)} for column in x.T
        ]
        found = costs(settings)
        for setting, value in zip(settings, found.tolist(), strict=True):
            tried.setdefault(text_of(setting), (setting, value))
        return found

    first = qmc.LatinHypercube(len(free), rng=np.random.default_rng(seed)).random(GENERATION)
    first[0] = [f.share(float(start[f.name])) for f in free]
    differential_evolution(
        cost,
        [(0.0, 1.0)] * len(free),
        init=first,
        maxiter=generations,
        rng=np.random.default_rng(seed),
        tol=1e-3,
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    best = min(tried.values(), key=lambda one: one[1])
    return SearchResult(best[0], best[1], list(tried.values()))
