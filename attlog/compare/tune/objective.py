"""What a search looks for: metrics with weights, each as the logarithm of its ratio to the default gains.

    cost = sum_m w_m mean_parts ln((s_m + f_m) / (s0_m + f_m)) / sum_m w_m

with s the size of the value (how far from perfect), s0 that of the default gains, and f a step that means nothing to
anybody who flies (that of :mod:`attlog.compare.diff.tolerance`), so that a lag near zero does not decide everything.
The cost of the default gains is 0; -0.2 is 18 % closer to perfect.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from attlog.base.errors import UsageError, suggestion
from attlog.compare.diff.tolerance import SMALLEST
from attlog.compare.sweep.many import SettingResult, SweptMetric, wanted
from attlog.compare.tune.folds import LogPart
from attlog.metrics.ranking.best import distance

TERMS = {
    "tilt": "inclination_rmse_deg",
    "heading": "heading_rmse_deg",
    "total": "total_rmse_deg",
    "noise": "noise_tilt_deg@hover",
    "rest_noise": "noise_tilt_deg",
    "step": "step_error_deg.0.5s",
    "lag": "lag_ms",
    "drift": "drift_rest_deg_per_min",
}
"""Short names of what is usually weighed; every metric can be named by its id."""
UNSOUND = 3.0
"""The cost of a setting that diverges, has no value or is not corrected by gravity: as if twenty times as far off."""


@dataclass(frozen=True, slots=True)
class ObjectiveTerm:
    """A metric and its weight."""

    name: str
    metric: SweptMetric
    weight: float


def objective(texts: Sequence[str]) -> list[ObjectiveTerm]:
    """The terms of texts such as ``tilt=1``, ``noise=0.5``, ``lag_ms@airborne=0.2``; commas part several in one text.

    UsageError tells everything wrong in them.
    """
    found: dict[str, ObjectiveTerm] = {}
    wrong = []
    for text in (part.strip() for given in texts for part in given.split(",") if part.strip()):
        name, sign, weight = (part.strip() for part in text.partition("="))
        try:
            number = float(weight) if sign else 1.0
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and number > 0.0):
            wrong.append(f"{text}: the weight is a number above 0, such as {name or 'tilt'}=1")
            continue
        try:
            metrics = wanted([TERMS.get(name, name)])
        except UsageError:
            wrong.append(
                f"{text}: there is nothing called {name}{suggestion(name, [*TERMS])}, nor a metric of that name"
            )
            continue
        found |= {m.name: ObjectiveTerm(name, m, number) for m in metrics}
    if wrong or not found:
        raise UsageError("\n".join(wrong) or "no objective; give one such as tilt=1,noise=0.5")
    return list(found.values())


def cost(
    terms: Sequence[ObjectiveTerm],
    parts: Sequence[LogPart],
    settled: Mapping[int, SettingResult],
    base: Mapping[int, SettingResult],
) -> float:
    """The cost of a setting on parts, from what it and the default gains (``base``) are worth by log."""
    total, weights = 0.0, 0.0
    for term in terms:
        found = [c for part in parts if (c := log_ratio(term, part, settled[part.log], base[part.log])) is not None]
        if found:
            total += term.weight * sum(found) / len(found)
            weights += term.weight
    return total / weights if weights else UNSOUND


def log_ratio(term: ObjectiveTerm, part: LogPart, settled: SettingResult, base: SettingResult) -> float | None:
    """ln of how far a setting is from perfect over how far the default gains are; None where that is not known."""
    metric = term.metric
    before = part.value(base.answers[metric])
    if before is None:
        return None
    value = part.value(settled.answers[metric]) if settled.fit(metric) else None
    if value is None:
        return UNSOUND
    step = SMALLEST.get(metric.unit, 0.0) or 1e-9
    sizes = (_size(v, metric.better) for v in (value, before))
    now, then = (max(s, 0.0) + step for s in sizes)
    return min(math.log(now / then), UNSOUND)


def _size(value: float, better: str) -> float:
    from attlog.metrics.answer import Answer

    return distance(Answer(value, "", ""), better)[1]
