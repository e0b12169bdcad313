"""What does a filter cost? Nanoseconds per update, and relative to mahony in the same process."""

from __future__ import annotations

from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Metric, Trial
from attlog.reference.model import Row

BASE = "mahony"

METRICS: tuple[Metric, ...] = (
    Metric(
        "cost_ns", "Cost per update", "ns", "low", (),
        "Measured time per IMU sample on the machine that made this result. One measurement: no interval.",
    ),
    Metric(
        "cost_ratio", "Cost relative to mahony", "1", "low", (),
        "Time per update over that of mahony in the same process, so that results from different machines compare.",
    ),
)  # fmt: skip


def compute(trial: Trial, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row over the whole log; nothing for other windows."""
    if window != "all":
        return {}
    own = row.ns_per_update
    if not own:
        reason = "flew on board: its time is not in the log" if row.kind == "onboard" else "its time was not measured"
        return {m.name: missing("not_applicable", reason, m.unit, window) for m in METRICS}
    base = next((r.ns_per_update for r in trial.rows if r.estimator == BASE and r.ns_per_update), None)
    unranked = "one measurement has no interval"
    length = float(row.t[-1] - row.t[0]) if len(row.t) else 0.0
    answers = {
        "cost_ns": Answer(own, "ns", window, 1, length, None, "one replay", reason=unranked, ranked=False),
        "cost_ratio": missing("not_applicable", f"needs {BASE} in the same run to compare with", "1", window),
    }
    if base:
        answers["cost_ratio"] = Answer(
            own / base, "1", window, 1, length, None, "one replay", reason=unranked, ranked=False
        )
    return answers
