"""The comparison table: which columns, what each cell says, who is marked best."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

from attlog.metrics.answer import Answer
from attlog.present.numbers import interval, number, unit_sign
from attlog.present.verdicts import AIR, REST, find, quoted_heading_reference
from attlog.report.look import ordered
from attlog.result import EstimatorRow, Result

ALL = ("all", "airborne", "rest")

DRIFT_AIR = "drift_air_deg_per_min"
COLUMNS = (
    ("noise_roll_deg", "Roll noise", REST),
    ("noise_pitch_deg", "Pitch noise", REST),
    ("noise_heading_deg", "Heading noise", REST),
    ("lag_ms", "Step delay", AIR),
    ("step_gain", "Step gain", AIR),
    ("drift_rest_deg_per_min", "Drift at rest", REST),
    (DRIFT_AIR, "Air drift by", AIR),
    ("inclination_rmse_deg", "Tilt error RMS", AIR),
    ("heading_rmse_deg", "Heading error RMS", AIR),
    ("convergence_s", "Settles after", ALL),
    ("cost_ns", "Cost", ALL),
)
"""Metric, heading and the windows in which it is looked for, in the order of the questions.

Of the drifts in the air the best heading reference has a column; the others stand in the expert's tables.
"""

WORDS = {
    "no_rest": "no rest",
    "rest_too_short": "rest too short",
    "no_reference": "no reference",
    "reference_too_slow": "reference slow",
    "reference_diverged": "reference diverged",
    "no_events": "no steps",
    "too_few_events": "few steps",
    "no_magnetometer": "no mag",
    "no_setpoint": "no set-point",
    "no_gnss": "no GNSS",
    "not_converged": "not converged",
    "diverged": "diverged",
    "not_a_pure_delay": "not judged",
    "not_covered": "not covered",
    "clock_unknown": "clock unknown",
    "not_applicable": "n/a",
    "did_not_move": "did not move",
    "lag_at_edge": "not judged",
    "rate_too_low": "rate too low",
    "record_too_short": "too short",
}
"""What a cell without a value says, by code; the sentence stands beside it."""

SHAPE = ("step_gain", "distortion")
"""Conditions for judging a delay, not contests: never marked."""

FULL_COVERAGE = 95.0

BY = {"gnss_yaw": "GNSS yaw", "mag": "mag", "course": "GNSS course"} | {w: w for w in ("truth", "smoother", "onboard")}
"""A heading reference in a table heading."""


@dataclass(slots=True)
class Cell:
    """One value as it is shown. ``sort`` is None where there is nothing to sort by."""

    text: str
    small: tuple[str, ...] = ()
    missing: bool = False
    best: bool = False
    unranked: bool = False
    reason: str = ""
    sort: float | None = None


@dataclass(slots=True)
class Column:
    """One heading: title, unit, metric and window it stands for."""

    title: str
    unit: str
    metric: str
    window: str


@dataclass(slots=True)
class Table:
    """Columns and rows ready for the template: (row, cells)."""

    columns: list[Column] = field(default_factory=list)
    rows: list[tuple[EstimatorRow, list[Cell]]] = field(default_factory=list)

    @property
    def partial(self) -> bool:
        """Whether a cell says that only part of the time could be compared."""
        return any(small.startswith("of ") for _, cells in self.rows for c in cells for small in c.small)


def main_table(result: Result) -> Table:
    """The comparison of all rows: every column of COLUMNS in which at least one row has a value."""
    heading_reference = quoted_heading_reference(result)
    columns = [
        (f"{m}.{heading_reference}", f"{t} {BY[heading_reference]}", w) if m == DRIFT_AIR else (m, t, w)
        for m, t, w in COLUMNS
    ]
    return filled(result, columns)


def filled(result: Result, columns: Iterable[tuple[str, str, tuple[str, ...]]]) -> Table:
    """The columns in which at least one row has a value, for all rows."""
    rows = ordered(result)
    table = Table()
    chosen: list[tuple[str, tuple[str, ...]]] = []
    for metric, title, windows in columns:
        found = [a for a in (find(r, metric, windows) for r in rows) if a is not None and a.value is not None]
        if found:
            table.columns.append(Column(title, unit_sign(found[0].unit), metric, found[0].window))
            chosen.append((metric, (found[0].window, *windows)))
    for row in rows:
        table.rows.append((row, [cell(result, row, metric, find(row, metric, windows)) for metric, windows in chosen]))
    return table


def axis_table(result: Result) -> Table:
    """Delay, gain and shape of the steps by axis."""
    return filled(
        result,
        [
            (f"{metric}_{axis}_{unit}".rstrip("_"), f"{axis.capitalize()} {title}", AIR)
            for axis in ("roll", "pitch", "yaw")
            for metric, title, unit in (
                ("lag", "delay", "ms"),
                ("step_gain", "gain", ""),
                ("distortion", "distortion", "pct"),
            )
        ],
    )


def window_tables(result: Result) -> dict[str, Table]:
    """Every metric of every window: the expert's tables."""
    out = {}
    names = list(dict.fromkeys(w for r in result.estimators for w in r.metrics))
    for window in names:
        table = Table()
        metrics = dict.fromkeys(m for r in result.estimators for m in r.metrics.get(window, {}))
        for metric in metrics:
            answers = [r.metrics.get(window, {}).get(metric) for r in result.estimators]
            if any(a is not None and a.value is not None for a in answers):
                unit = next(a.unit for a in answers if a is not None)
                table.columns.append(Column(metric, unit_sign(unit), metric, window))
        for row in ordered(result):
            cells = [cell(result, row, c.metric, row.metrics.get(window, {}).get(c.metric)) for c in table.columns]
            table.rows.append((row, cells))
        if table.columns:
            out[window] = table
    return out


def cell(result: Result, row: EstimatorRow, metric: str, answer: Answer | None) -> Cell:
    """The cell for an answer: value with interval, or a word and the reason."""
    if answer is None:
        return Cell("failed" if row.status == "failed" else "n/a", missing=True, reason=row.reason)
    if answer.value is None or not math.isfinite(answer.value):
        itself = row.is_reference and answer.code == "not_applicable" and not metric.startswith("cost")
        word = "reference" if itself else WORDS.get(answer.code or "", "n/a")
        return Cell(word, missing=True, reason=answer.reason or "")
    best = not metric.startswith(SHAPE) and row.name in result.best.get(answer.window, {}).get(metric, ())
    small = [interval(answer.ci95, answer.unit)]
    unranked = row.kind == "replay" and (not answer.ranked or row.status != "ok")
    coverage = answer.detail.get("coverage_pct")
    if isinstance(coverage, (int, float)) and coverage < FULL_COVERAGE:
        small.append(f"of {coverage:.0f} %")
    better = result.definitions.get(metric, {}).get("better") or ("zero" if answer.unit in ("ms", "deg/min") else "low")
    return Cell(
        number(answer.value, answer.unit),
        tuple(x for x in small if x),
        best=best,
        unranked=unranked,
        reason=answer.reason or "",
        sort={"zero": abs(answer.value), "one": abs(answer.value - 1.0)}.get(better, float(answer.value)),
    )
