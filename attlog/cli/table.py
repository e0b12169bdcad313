"""The comparison on the terminal: a row per estimator, a column per question."""

from __future__ import annotations

from typing import TYPE_CHECKING

from attlog.metrics.answer import Answer
from attlog.present.numbers import SIGNED, number
from attlog.present.verdicts import AIR, REST, find, quoted_heading_reference
from attlog.report.table import WORDS
from attlog.result import EstimatorRow, Result

if TYPE_CHECKING:
    from rich.table import Table

COLUMNS = (  # metrics (the larger value counts), heading, where it is looked for when the shown window is "all"
    (("noise_roll_deg", "noise_pitch_deg"), "tilt\nnoise °", REST),
    (("noise_heading_deg",), "heading\nnoise °", REST),
    (("lag_ms",), "step\nlag ms", AIR),
    (("drift_rest_deg_per_min",), "rest\ndrift °/min", REST),
    (("drift_air_deg_per_min",), "air\ndrift °/min", AIR),
    (("inclination_rmse_deg",), "tilt\nRMS error °", AIR),
    (("heading_rmse_deg",), "heading\nRMS error °", AIR),
)

LEGEND = "* best (several: too close to rank)   ~ shown, not ranked   ± half of the 95 % interval"


def comparison_table(result: Result, window: str) -> Table:
    """The table of the rows, 100 columns wide or less with short names; columns without any value are left out.

    ``*`` marks what is best, ``~`` what may not be ranked, a word says why a value is missing.
    """
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("\nfilter", no_wrap=True)
    columns = []
    for metrics, heading, home in COLUMNS:
        if metrics[0].startswith("drift_air"):
            metrics = (f"{metrics[0]}.{quoted_heading_reference(result)}",)
        windows = home if window == "all" else (window,)
        cells = [_cell(result, row, metrics, windows) for row in result.estimators]
        if any(has_value for _, has_value in cells):
            table.add_column(heading, justify="right", no_wrap=True)
            columns.append([text for text, _ in cells])
    for row, *cells in zip(result.estimators, *columns, strict=True):
        table.add_row(row.name + (" (reference)" if row.is_reference else ""), *cells)
    return table


def _cell(result: Result, row: EstimatorRow, metrics: tuple[str, ...], windows: tuple[str, ...]) -> tuple[str, bool]:
    """What a cell says, and whether it is a value."""
    found = {m: a for m, a in ((m, find(row, m, windows)) for m in metrics) if a is not None}
    values = {m: a for m, a in found.items() if a.value is not None}
    if not found:
        return ("[red]failed[/]" if row.status == "failed" else "[dim]n/a[/]"), False
    if not values:
        answer = next(iter(found.values()))
        itself = row.is_reference and answer.code == "not_applicable"
        return f"[dim]{'reference' if itself else WORDS[answer.code or 'not_applicable']}[/]", False
    answer = max(values.values(), key=lambda a: abs(a.value or 0.0))
    best = all(row.name in result.best.get(a.window, {}).get(m, []) for m, a in values.items())
    unranked = row.kind == "replay" and (row.status != "ok" or not all(a.ranked for a in values.values()))
    return _number(answer) + ("*" if best else "~" if unranked else " "), True


def _number(answer: Answer) -> str:
    """The value, with half of its interval where the sign is the message."""
    text = number(answer.value, answer.unit)
    if answer.ci95 is None or answer.unit not in SIGNED:
        return text
    return f"{text} ±{number(0.5 * (answer.ci95[1] - answer.ci95[0]), answer.unit, False)}"
