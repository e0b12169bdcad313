"""Made-up comparisons: differences whose numbers are known, as every log would give them."""

from __future__ import annotations

import math

from attlog.compare.configurations.configuration import Configuration, parse
from attlog.compare.differences.comparison import Comparison, ConfigurationAnswer, LogDifference, LogLine
from attlog.compare.differences.one_log import LogComparison
from attlog.compare.differences.over_logs import gathered
from attlog.compare.differences.questions import ComparedMetric, asked

CONFIGURATIONS = [parse("mahony:kp=0.3"), parse("mahony:kp=0.6")]
FIRST, SECOND = (c.name for c in CONFIGURATIONS)


def beside(log: str, question: ComparedMetric, change: float, half: float) -> LogDifference:
    """A difference (of the logarithm for ratios) with its interval; significant where that excludes none."""
    direction = "better" if change < 0.0 else "worse"
    if abs(change) <= half:
        direction = "same" if half == 0.0 else "not significant"
    ends = (change - half, change + half)
    if question.scale == "ratio":
        value, ends = math.exp(change), (math.exp(ends[0]), math.exp(ends[1]))
    else:
        value = change
    p = 1.0 if direction in ("same", "not significant") else 0.001
    return LogDifference(log, value, ends, p, 9, 2.0, 2.0 * value, half / 2.0, 0.0, direction, question.windows[0])


def comparison(
    changes: dict[str, list[tuple[float, float]]],
    configurations: list[Configuration] | None = None,
    broken: list[LogLine] | None = None,
    questions: list[ComparedMetric] | None = None,
    factors: tuple[float, ...] = (1.0,),
) -> Comparison:
    """A comparison of configurations: by metric id, for each log (change, half interval).

    ``factors``: what the changes of each configuration after the first are multiplied by.
    """
    chosen = configurations or CONFIGURATIONS
    questions = questions or [next(q for q in asked() if q.metric == metric) for metric in changes]
    count = max(len(each) for each in changes.values())
    logs = []
    for k in range(count):
        one = LogComparison(LogLine(f"flight{k + 1}.ulg", f"flight{k + 1}.ulg"))
        for q in questions:
            each = changes[q.metric]
            one.cells[q.id] = {c.name: ConfigurationAnswer(1.0, (0.9, 1.1), 9, q.windows[0]) for c in chosen}
            one.beside[q.id] = {
                c.name: beside(one.line.name, q, factor * each[k][0], each[k][1])
                if k < len(each)
                else LogDifference(one.line.name, None, reason="no steps")
                for c, factor in zip(chosen[1:], factors, strict=True)
            }
        logs.append(one)
    logs += [LogComparison(line) for line in broken or []]
    return gathered(chosen, logs, questions, attlog={"version": "0"}, command="attlog compare")
