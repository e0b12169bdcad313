"""The comparison on the terminal: a row per estimator, a column per question."""

from __future__ import annotations

from typing import TYPE_CHECKING

from attlog.metrics.answer import Answer
from attlog.numbers import SIGNED, number
from attlog.report.table import WORDS
from attlog.result import EstimatorRow, Result
from attlog.verdicts import WITNESSES

if TYPE_CHECKING:
    from rich.table import Table

COLUMNS = (  # metrics (the largest value counts), heading, window used when the shown window is "all"
    (("noise_roll_deg", "noise_pitch_deg"), "tilt\nnoise °", "rest"),
    (("noise_heading_deg",), "heading\nnoise °", "rest"),
    (("lag_ms",), "step\nlag ms", "all"),
    (("drift_rest_deg_per_min",), "rest\ndrift °/min", "rest"),
    (("drift_air_deg_per_min",), "air\ndrift °/min", "airborne"),
    (("inclination_rmse_deg",), "tilt\nRMS error °", "all"),
    (("heading_rmse_deg",), "heading\nRMS error °", "all"),
)


def comparison_table(result: Result, window: str) -> Table:
    """The table of the rows, 100 columns wide or less with short names; columns without any value are left out.

    ``*`` marks what is best, ``~`` what may not be ranked, a word says why a value is missing.
    """
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("\nfilter", no_wrap=True)
    columns = []
    for metrics, heading, home in COLUMNS:
        cells = [_cell(result, row, metrics, home if window == "all" else window) for row in result.estimators]
        if any(has_value for _, has_value in cells):
            table.add_column(heading, justify="right", no_wrap=True)
            columns.append([text for text, _ in cells])
    for row, *cells in zip(result.estimators, *columns, strict=True):
        table.add_row(row.name + (" (reference)" if row.is_reference else ""), *cells)
    return table


LEGEND = "* best (several: too close to rank)   ~ shown, not ranked   ± half of the 95 % interval"


def _cell(result: Result, row: EstimatorRow, metrics: tuple[str, ...], window: str) -> tuple[str, bool]:
    """What a cell says, and whether it is a value."""
    found = [(name, answer) for name, answer in (_answer(row, m, window) for m in metrics) if answer is not None]
    if not found:
        return ("[red]failed[/]" if row.status == "failed" else "[dim]n/a[/]"), False
    values = [(name, answer) for name, answer in found if answer.value is not None]
    if not values:
        answer = found[0][1]
        itself = row.is_reference and answer.code == "not_applicable"
        return f"[dim]{'reference' if itself else WORDS[answer.code or 'not_applicable']}[/]", False
    answer = max((a for _, a in values), key=lambda a: abs(a.value or 0.0))
    best = all(row.name in result.best.get(window, {}).get(n, []) for n, _ in values)
    unranked = row.kind == "replay" and (row.status != "ok" or not all(a.ranked for _, a in values))
    return _number(answer) + ("*" if best else "~" if unranked else " "), True


def _answer(row: EstimatorRow, metric: str, window: str) -> tuple[str, Answer | None]:
    """The answer of a metric; drift in the air has one per witness: the most believed that has a value."""
    answers = row.metrics.get(window, {})
    if metric in answers:
        return metric, answers[metric]
    family = [f"{metric}.{w}" for w in WITNESSES if f"{metric}.{w}" in answers]
    name = next((m for m in family if answers[m].value is not None), family[0] if family else metric)
    return name, answers.get(name)


def _number(answer: Answer) -> str:
    """The value, with half of its interval where the sign is the message."""
    text = number(answer.value, answer.unit)
    if answer.ci95 is None or answer.unit not in SIGNED:
        return text
    return f"{text} ±{number(0.5 * (answer.ci95[1] - answer.ci95[0]), answer.unit, False)}"
