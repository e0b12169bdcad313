"""How long until a row is right, how much of the log was scored, and what difference can be resolved at all?"""

from __future__ import annotations

from attlog.metrics.answer import Answer, missing
from attlog.metrics.base import Case, Metric, paragraph
from attlog.metrics.evidence.phases import why_no_errors
from attlog.reference.model import Row

METRICS: tuple[Metric, ...] = (
    Metric(
        "convergence_s",
        "Convergence time",
        "s",
        "low",
        ("reference",),
        paragraph(
            """From the row's start to the first time from which, for 5 s, the tilt error is at most 2 deg above its
            later median (filters with a magnetometer: and the heading error 5 deg above its later median).
            One-sided: a filter that starts right and is pushed off later has converged at 0 s. A single event of this
            record: no interval."""
        ),
    ),
    Metric(
        "coverage_pct",
        "Coverage",
        "%",
        "high",
        ("reference",),
        "Share of the time in the air and at rest, after the scoring start, in which this row was compared.",
    ),
    Metric(
        "replay_floor_deg",
        "Replay floor",
        "deg",
        "low",
        ("reference",),
        "The smallest difference that this log can resolve, by the step of the logged attitude; no rank below it.",
    ),
)


def compute(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row over the whole log; nothing for other windows."""
    if window != "all":
        return {}
    absent = why_no_errors(case, row)
    if absent is not None or row.errors is None:
        absent = absent or ("no_reference", "this row was not compared")
        return {m.name: missing(*absent, m.unit, window) for m in METRICS}
    e = row.errors
    length = float(e.t[-1] - e.t[0])
    answers = {
        "replay_floor_deg": Answer(
            case.reference.floor_deg,
            "deg",
            window,
            len(e.t),
            length,
            None,
            "smallest step of the logged attitude",
            reason="a property of the log",
            ranked=False,
        )
    }
    if row.coverage_pct is None:
        reason = "neither flight nor rest after the scoring start"
        answers["coverage_pct"] = missing("not_covered", reason, "%", window)
    else:
        answers["coverage_pct"] = Answer(
            row.coverage_pct,
            "%",
            window,
            len(e.t),
            length,
            None,
            "scored over all time in air and at rest",
            reason="a property of the comparison",
            ranked=False,
        )
    if row.convergence_s is None:
        reason = row.reason or "the error did not stay near its later median for 5 s within 60 s of the start"
        answers["convergence_s"] = missing("not_converged", reason, "s", window)
    else:
        answers["convergence_s"] = Answer(
            row.convergence_s,
            "s",
            window,
            1,
            length,
            None,
            "first time from which the error stays small",
            reason="one event of this record",
            ranked=False,
        )
    return {m.name: answers[m.name] for m in METRICS}
