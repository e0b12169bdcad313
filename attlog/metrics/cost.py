"""Processor time of a filter per update."""

from __future__ import annotations

from attlog.metrics.metric import Answer, Case, Metric, MetricGroup, paragraph
from attlog.reference.model import Track

_MEASURED = """Processor time of the filter's run on this log over the number of IMU samples, on the machine that made
    this result: the loop alone of filters that step from sample to sample, all stages of those that take the whole
    record. Never ranked: another machine, another number."""
# Shortest measured run: its start, some 50 us, is at most a fifth of it.
MIN_RUN_NS = 2.5e5
COST_METRICS = (Metric("cost_ns", "Cost per update", "ns", "low", paragraph(_MEASURED)),)


def compute_cost(case: Case, row: Track, window: str) -> dict[str, Answer]:
    """Return the time per update of a row's filter (whole log only)."""
    if window != "all":
        return {}
    if row.kind != "replay" or not row.ns_per_update:
        reason = "flew on board: its time is not in the log" if row.kind == "onboard" else "its time was not measured"
        return COST.without("not_applicable", reason, window)
    if row.ns_per_update * len(row.t) < MIN_RUN_NS:
        return COST.without("record_too_short", "the run is too short to measure beside its start", window)
    return {
        "cost_ns": Answer(
            row.ns_per_update,
            "ns",
            window,
            1,
            method="one replay",
            reason="depends on the machine and what else it does",
            ranked=False,
        )
    }


COST = MetricGroup("cost", "", COST_METRICS, compute_cost)
