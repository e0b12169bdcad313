"""Configurations over logs, one after the other or in several processes, as one comparison."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from attlog.analysis.config import Config
from attlog.base.errors import UsageError
from attlog.base.processes.child import Died
from attlog.base.processes.pool import in_processes
from attlog.base.versions import versions
from attlog.compare.configurations.configuration import Configuration
from attlog.compare.differences.comparison import Comparison
from attlog.compare.differences.one_log import LogComparison, Plan, failed, measured
from attlog.compare.differences.over_logs import gathered
from attlog.compare.differences.questions import asked
from attlog.compare.differences.same_flight import repeated


def compare(
    logs: Sequence[Path],
    configurations: Sequence[Configuration],
    config: Config | None = None,
    *,
    metrics: Sequence[str] = (),
    jobs: int = 1,
    command: str = "",
    tell: Callable[[LogComparison], None] | None = None,
) -> Comparison:
    """What each configuration is worth beside the first, on every log and over all of them.

    ``config``: options as of ``attlog analyze``, its window among them; ``metrics``: other questions than the main
    ones (``all`` for every metric). A log that cannot be used is a line with its reason, the others
    finish. Logs of one flight count once where they are pooled. ``tell`` is called with each log as it is
    done. UsageError for fewer than two configurations or an unknown metric.
    """
    if len(configurations) < 2:
        raise UsageError(
            "a comparison needs two configurations or more: attlog compare LOG... mahony:kp=0.3 mahony:kp=0.6"
        )
    config = config or Config()
    questions = asked(metrics, config.window)
    names = log_names(logs)
    plan = Plan(tuple((c.name, c.text) for c in configurations), tuple(questions), config.resolved())
    found: dict[str, LogComparison] = {}
    work: dict[str, tuple[Any, ...]] = {name: (log, name, plan) for log, name in zip(logs, names, strict=True)}
    if jobs == 1 or len(logs) == 1:
        results = ((name, measured(*arguments)) for name, arguments in work.items())
    else:
        results = _in_processes(work, jobs)
    for name, one in results:
        found[name] = one
        if tell is not None:
            tell(one)
    ordered = [found[name] for name in names]
    again = repeated([one.track for one in ordered if one.track is not None])
    for one in ordered:
        one.line.same_as = again.get(one.line.name, "")
    return gathered(configurations, ordered, questions, attlog=versions(), command=command, config=config.resolved())


def _in_processes(work: dict[str, tuple[Any, ...]], jobs: int) -> Any:
    for name, one in in_processes(measured, work, jobs):
        yield name, failed(work[name][0], name, one) if isinstance(one, Died) else one


def log_names(logs: Sequence[Path]) -> list[str]:
    """What each log is called: its file name, with its folder where two share it, with a number if need be."""
    plain = [log.name for log in logs]
    names = [log.name if plain.count(log.name) == 1 else f"{log.parent.name}/{log.name}" for log in logs]
    return [n if names.count(n) == 1 else f"{n}-{names[: k + 1].count(n)}" for k, n in enumerate(names)]


__all__ = ["compare", "log_names"]
