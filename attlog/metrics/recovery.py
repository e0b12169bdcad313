"""How long until a row is right, how much of the log was scored, and what difference can be resolved at all?"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.core import earth
from attlog.core.spans import Span
from attlog.metrics.metric import Answer, Case, Metric, missing, paragraph, per_case
from attlog.metrics.windows import why_no_errors
from attlog.reference.model import Row

CONVERGENCE_METRICS: tuple[Metric, ...] = (
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


def compute_convergence(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row over the whole log; nothing for other windows."""
    if window != "all":
        return {}
    absent = why_no_errors(case, row)
    if absent is not None or row.errors is None:
        absent = absent or ("no_reference", "this row was not compared")
        return {m.name: missing(*absent, m.unit, window) for m in CONVERGENCE_METRICS}
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
    return {m.name: answers[m.name] for m in CONVERGENCE_METRICS}


# How fast does a row recover from the largest disturbance of its sensors?

Array = NDArray[np.float64]

OFF_SHARE = 0.3
SHORTEST_S = 0.5
BEFORE_S = 5.0
HOLD_S = 1.0
BACK_DEG = 2.0
LIMIT_S = 60.0
"""What counts as a disturbance and as recovered: docs/metrics.md, the table."""
SMOOTH_S = 0.1
"""Vibration alone is no manoeuvre: the specific force is averaged over this time first."""

RECOVERY_METRICS: tuple[Metric, ...] = (
    Metric(
        "recovery_s",
        "Recovery time",
        "s",
        "low",
        ("reference", "disturbance"),
        paragraph(
            """After the largest disturbance (a manoeuvre in which the specific force is off 1 g by more than 30 % for
            more than 0.5 s, or a magnetic field off its median by as much): time until the row's error (tilt;
            heading for the magnetic one) is back within 2 deg of what it was in the 5 s before, for 1 s. 0 where it
            never left. One event of this record: no interval."""
        ),
    ),
)


def largest(t: Array, vectors: Array, usual: float) -> Span | None:
    """The segment over 0.5 s with |vector| off ``usual`` by more than 30 % that has most excess; None without any.

    ``t`` (n,) s; ``vectors`` (n, 3) and their ``usual`` length in one unit, body axes.
    """
    if len(t) < 3 or usual <= 0:
        return None
    count = max(1, round(SMOOTH_S / max(float(np.median(np.diff(t))), 1e-6)))
    size = np.sqrt(np.sum(vectors**2, axis=1))
    excess = np.abs(
        np.convolve(np.pad(size, count // 2, "edge"), np.full(count, 1.0 / count), "valid")[: len(t)] / usual - 1.0
    )
    off = np.concatenate([[False], excess > OFF_SHARE, [False]])
    begin, end = np.flatnonzero(~off[:-1] & off[1:]), np.flatnonzero(off[:-1] & ~off[1:])
    found = [
        (float(np.sum(excess[i:j])) * (t[j - 1] - t[i]) / (j - i), (float(t[i]), float(t[j - 1])))
        for i, j in zip(begin, end, strict=True)
        if t[j - 1] - t[i] > SHORTEST_S
    ]
    return max(found)[1] if found else None


def time_back(t: Array, error: Array, disturbance: Span) -> float | None:
    """Seconds after a disturbance until |error| (n,) deg is near its earlier level for 1 s; None if not in 60 s."""
    before = (t >= disturbance[0] - BEFORE_S) & (t < disturbance[0])
    after = (t >= disturbance[1]) & (t <= disturbance[1] + LIMIT_S)
    if before.sum() < 3 or after.sum() < 3:
        return None
    limit = float(np.median(np.abs(error[before]))) + BACK_DEG
    at, good = t[after], np.abs(error[after]) <= limit
    bad = np.flatnonzero(~good)
    starts = np.concatenate([[0], bad + 1])
    ends = np.concatenate([bad - 1, [len(at) - 1]])
    for i, j in zip(starts, ends, strict=True):
        if j > i and at[j] - at[i] >= HOLD_S:
            return float(at[i] - disturbance[1]) if i > 0 else 0.0
    return None


@per_case
def disturbances(case: Case) -> dict[str, Span]:
    """The largest disturbance of accelerometer and of magnetometer in scored flight, where there is one."""
    log, found = case.log, {}
    if log.replay_imu is not None:
        acc = log.replay_imu.acc
        found["acc"] = _in_flight(case, acc.t, acc.x, earth.gravity(45.0))
    if log.mag is not None:
        field = log.mags[log.mag].field
        sizes = np.sqrt(np.sum(field.x**2, axis=1))
        usual = float(np.median(sizes[np.isfinite(sizes)])) if np.isfinite(sizes).any() else 0.0
        found["mag"] = _in_flight(case, field.t_best, field.x, usual)
    return {k: v for k, v in found.items() if v is not None}


def _in_flight(case: Case, t: Array, x: Array, usual: float) -> Span | None:
    use = case.segments.mask(t, "airborne") & np.isfinite(x).all(axis=1)
    use &= (t >= case.reference.scoring_start + BEFORE_S) & (t <= case.reference.end)
    return largest(t[use], x[use], usual)


def compute_recovery(case: Case, row: Row, window: str) -> dict[str, Answer]:
    """Answers of METRICS for one row over the whole log; nothing for other windows."""
    if window != "all":
        return {}
    absent = why_no_errors(case, row)
    if absent is not None or row.errors is None:
        return {"recovery_s": missing(*(absent or ("no_reference", "this row was not compared")), "s", window)}
    found = disturbances(case)
    if not row.uses_mag:
        found = {k: v for k, v in found.items() if k != "mag"}
    if not found:
        reason = "no manoeuvre off 1 g by 30 % for 0.5 s in scored flight, and no magnetic disturbance of that size"
        return {"recovery_s": missing("no_events", reason, "s", window)}
    kind, span = max(found.items(), key=lambda item: item[1][1] - item[1][0])
    e = row.errors
    error = e.heading if kind == "mag" else e.tilt
    seconds = time_back(e.t, error, span)
    detail = {"disturbance": kind, "from_s": span[0], "to_s": span[1]}
    if seconds is None:
        reason = f"not back within 2 deg for 1 s in the {LIMIT_S:.0f} s after {span[1]:.1f} s"
        return {"recovery_s": missing("not_converged", reason, "s", window, **detail)}
    return {
        "recovery_s": Answer(
            seconds,
            "s",
            window,
            1,
            span[1] - span[0],
            None,
            f"after {span[0]:.1f} to {span[1]:.1f} s",
            reason="one event of this record",
            ranked=False,
            detail=detail,
        )
    }
