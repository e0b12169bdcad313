"""The comparison on the terminal: a row per estimator, a column per question."""

from __future__ import annotations

from typing import TYPE_CHECKING

from attlog.metrics.answer import Answer
from attlog.result import EstimatorRow, Result
from attlog.verdicts import WITNESSES

if TYPE_CHECKING:
    from rich.table import Table

COLUMNS = (  # metric, heading, window used when the shown window is "all"
    ("noise_roll_deg", "noise roll °", "rest"),
    ("noise_pitch_deg", "pitch °", "rest"),
    ("noise_heading_deg", "heading °", "rest"),
    ("lag_ms", "lag ms", "all"),
    ("drift_rest_deg_per_min", "drift rest °/min", "rest"),
    ("drift_air_deg_per_min", "drift air °/min", "airborne"),
    ("inclination_rmse_deg", "tilt rmse °", "all"),
    ("heading_rmse_deg", "heading rmse °", "all"),
)


def comparison_table(result: Result, window: str) -> Table:
    """The table of the rows; ``*`` marks what is best, a word says why a value is missing."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    table.add_column("filter", no_wrap=True)
    for _, heading, _ in COLUMNS:
        table.add_column(heading, justify="right")
    for row in result.estimators:
        cells = [_cell(result, row, metric, home if window == "all" else window) for metric, _, home in COLUMNS]
        table.add_row(row.name + ("  (reference)" if row.is_reference else ""), *cells)
    return table


def _cell(result: Result, row: EstimatorRow, metric: str, window: str) -> str:
    answers = row.metrics.get(window, {})
    name = metric
    if metric not in answers:  # drift in the air has one answer per witness: the most believed that has a value
        family = [f"{metric}.{w}" for w in WITNESSES if f"{metric}.{w}" in answers]
        name = next((m for m in family if answers[m].value is not None), family[0] if family else metric)
    answer = answers.get(name)
    if answer is None:
        return "[dim]-[/]" if row.status != "failed" else "[red]failed[/]"
    if answer.value is None:
        return f"[dim]{(answer.code or '').replace('_', ' ')}[/]"
    best = row.name in result.best.get(window, {}).get(name, [])
    return f"{_number(answer)}{'*' if best else ' '}"


def _number(answer: Answer) -> str:
    """The value with its interval, with as many digits as the interval earns."""
    value = answer.value or 0.0
    half = 0.5 * (answer.ci95[1] - answer.ci95[0]) if answer.ci95 else 0.0
    scale = half or abs(value)
    digits = 0 if scale >= 10 else 1 if scale >= 1 else 2 if scale >= 0.1 else 3 if scale >= 0.01 else 4
    return f"{value:.{digits}f} ± {half:.{digits}f}" if answer.ci95 else f"{value:.{digits}f}"
