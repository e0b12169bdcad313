"""Several logs as one comparison: what was measured on each, gathered by question and pooled."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any

from attlog.compare.configurations.configuration import Configuration, labels
from attlog.compare.configurations.settings import written
from attlog.compare.differences.comparison import (
    Comparison,
    ConfigurationSummary,
    Contrast,
    LogDifference,
    PooledDifference,
    Question,
)
from attlog.compare.differences.one_log import LogComparison
from attlog.compare.differences.paired import ALPHA, Direction, Scale
from attlog.compare.differences.pooled import pool
from attlog.compare.differences.questions import ComparedMetric
from attlog.compare.differences.sentences import verdicts
from attlog.metrics import definitions
from attlog.metrics.base import named


def gathered(
    configurations: Sequence[Configuration],
    logs: Sequence[LogComparison],
    questions: Sequence[ComparedMetric],
    *,
    attlog: dict[str, str],
    command: str = "",
    config: dict[str, Any] | None = None,
) -> Comparison:
    """The comparison of configurations on logs; a log that failed is a line with its reason and nothing else."""
    called = labels(configurations)
    found = Comparison(attlog, command, config or {}, [_configured(c, called[c.name]) for c in configurations])
    found.logs = [m.line for m in logs]
    usable = [m for m in logs if m.line.code == 0]
    for asked in questions:
        metric = named(definitions().values(), asked.metric)
        question = Question(
            asked.id,
            asked.metric,
            list(asked.windows),
            asked.title,
            metric.unit,
            metric.better,
            asked.scale,
            asked.main,
        )
        question.cells = {m.line.name: m.cells[asked.id] for m in usable}
        for c in configurations[1:]:
            each = [m.beside[asked.id][c.name] for m in usable]
            once = [b for m, b in zip(usable, each, strict=True) if not m.line.same_as]
            question.contrasts.append(Contrast(c.name, each, over(once, asked.scale)))
        cells = [cell for by_name in question.cells.values() for cell in by_name.values()]
        if any(cell.value is not None for cell in cells):
            found.questions.append(question)
            found.definitions[asked.id] = metric.definition
        else:
            found.unanswered[asked.id] = commonest(cell.reason for cell in cells) or "no log could be used"
    found.verdicts = verdicts(found)
    return found


def commonest(reasons: Iterable[str]) -> str:
    """The reason given most often, empty where none is given."""
    given = [reason for reason in reasons if reason]
    return max(dict.fromkeys(given), key=given.count) if given else ""


def over(each: Sequence[LogDifference], scale: Scale) -> PooledDifference | None:
    """Differences of several logs as one; None where no log has any."""
    usable = [b for b in each if b.value is not None]
    if not usable:
        return None
    forward, back = (math.log, math.exp) if scale == "ratio" else (float, float)
    alone = usable[0]
    own = None if alone.ci95 is None else (forward(alone.ci95[0]), forward(alone.ci95[1]))
    pooled = pool([forward(b.value or 0.0) for b in usable], [b.error for b in usable], (own, alone.p))
    floor = median(b.floor for b in usable)
    ci95 = None if pooled.ci95 is None else (back(pooled.ci95[0]), back(pooled.ci95[1]))
    return PooledDifference(
        back(pooled.value),
        ci95,
        pooled.p,
        pooled.logs,
        pooled.better,
        pooled.worse,
        pooled.same,
        pooled.tau,
        pooled.i2_pct,
        pooled.method,
        floor,
        alone.direction if len(usable) == 1 else direction(pooled.value, pooled.p, pooled.same == pooled.logs, floor),
    )


def direction(value: float, p: float | None, same: bool, floor: float) -> Direction:
    """Whether a pooled difference is significant: p below 5 %, and larger than what a log resolves."""
    if same:
        return "same"
    if p is None or p >= ALPHA or abs(value) <= floor:
        return "not significant"
    return "better" if value < 0.0 else "worse"


def _configured(c: Configuration, label: str) -> ConfigurationSummary:
    parameters = {k: f"{v:g}" if isinstance(v, float) else str(v) for k, v in c.row.params.items()}
    before = {k: written(k, v).partition("=")[2] for k, v in c.before.items()}
    return ConfigurationSummary(c.name, label, c.text, parameters, before)
