"""Table of filters for page and terminal: columns by question, cells."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass, field

from attlog.metrics import definitions
from attlog.result import Answer, EstimatorRow, Result
from attlog.words.names import AGREEMENT_TITLE, CODES, heading_reference_short, is_against_onboard
from attlog.words.numbers import SIGNED, bracketed, half_width, number, unit_sign
from attlog.words.ranking import (
    AIR,
    ALL,
    DRIFT_AIR,
    PHASES,
    REST,
    RankedValue,
    has_value,
    is_best,
    is_ranked,
    quoted_heading_reference,
    reason_unranked,
    rows_in_order,
    value_of,
    window_of,
)
from attlog.words.text import typeset


@dataclass(frozen=True, slots=True)
class TableColumn:
    """Table column of ``metric`` in the first of ``windows`` with a filter's value.

    ``contest`` False: never marked best. ``spare``: order in which a narrow terminal drops columns, largest first, 0
    never. ``short``: title if its question has a single column, or empty. ``unit``: its sign, in a filled table, whose
    columns have one window.
    """

    title: str
    metric: str
    windows: tuple[str, ...] = field(default=ALL)
    contest: bool = True
    spare: int = 0
    short: str = ""
    unit: str = ""

    @property
    def window(self) -> str:
        """The window of a filled column, else the preferred one."""
        return self.windows[0]


NOISE = "noise_tilt_deg"
NOISE_TITLES = {
    "rest": "Noise at rest",
    "hover": "Noise added in hover",
    "cruise": "Noise added moving",
    "idle": "Noise added idling",
}

ERROR_COLUMNS = (
    TableColumn("Tilt error RMS", "tilt_rmse_deg", AIR, short="Tilt"),
    TableColumn("Heading error RMS", "heading_rmse_deg", AIR, spare=2, short="Heading"),
)
# Titles of the errors against the onboard attitude.
AGREEMENT_TITLES = {"tilt_rmse_deg": AGREEMENT_TITLE, "heading_rmse_deg": "Heading against onboard"}
STEP_COLUMNS = (
    TableColumn("Lag", "lag_ms", AIR, short="Lag"),
    TableColumn("Step error", "step_error_deg.0.5s", AIR, spare=1),
)
DRIFT_REST_COLUMN = TableColumn("Drift at rest", "drift_rest_deg_per_min", REST, short="Drift")
COST_COLUMN = TableColumn("Cost", "cost_ns", ALL, contest=False, spare=4)


# Lag, gain and shape of the steps by axis.
AXIS_COLUMNS = tuple(
    TableColumn(f"{axis.capitalize()} {title}", f"{metric}_{axis}{unit}", AIR, contest)
    for axis in ("roll", "pitch", "yaw")
    for metric, title, unit, contest in (
        ("lag", "lag", "_ms", True),
        ("step_gain", "gain", "", False),
        ("distortion", "distortion", "_pct", False),
    )
)


def table_columns(result: Result) -> list[TableColumn]:
    """Return the columns of the comparison: errors, noise by phase, steps, drift, cost.

    Noise has one column per phase with a value, drift in the air one for the reported heading reference.
    """
    replayed = [row for row in result.estimators if row.kind == "replay"]
    phases = [p for p in PHASES if any(has_value(row.metrics.get(p, {}).get(NOISE)) for row in replayed)]
    noise = [
        TableColumn(NOISE_TITLES[p], NOISE, (p,), spare=3 if i else 0, short="Noise") for i, p in enumerate(phases)
    ]
    reference = quoted_heading_reference(result)
    title = f"Air drift by {heading_reference_short(reference)}"
    air = TableColumn(title, f"{DRIFT_AIR}.{reference}", AIR, spare=3, short="Drift")
    return [*ERROR_COLUMNS, *noise, *STEP_COLUMNS, DRIFT_REST_COLUMN, air, COST_COLUMN]


# Answer as a cell: number and interval, or a word for a missing value; marked best or not ranked.

FULL_COVERAGE_PCT = 95.0


@dataclass(slots=True)
class TableCell:
    """Table cell for display.

    ``small``: lines below the number (interval, share of the time). ``half``: half of the interval for one line.
    ``brief``: short text for narrow columns. ``sort`` is None without a value.
    """

    text: str
    small: tuple[str, ...] = ()
    half: str = ""
    brief: str = ""
    missing: bool = False
    best: bool = False
    unranked: bool = False
    reason: str = ""
    sort: float | None = None


def table_cell(result: Result, row: EstimatorRow, column: TableColumn) -> TableCell:
    """Return the cell of a row in a column."""
    window = column.window
    answer = row.metrics.get(window, {}).get(column.metric)
    if answer is None:
        word = "failed" if row.status == "failed" else "n/a"
        return TableCell(word, brief=word, missing=True, reason=row.reason)
    if not has_value(answer):
        return missing_cell(row, column.metric, answer)
    ranked = is_ranked(result, row, column.metric, window)
    return TableCell(
        number(answer.value, answer.unit),
        tuple(x for x in (bracketed(answer.ci95, answer.unit), coverage_text(answer)) if x),
        half=half_width(answer.ci95, answer.unit) if answer.unit in SIGNED else "",
        brief=number(answer.value, answer.unit),
        best=column.contest and is_best(result, row, column.metric, window),
        unranked=row.kind == "replay" and column.contest and not ranked,
        reason=typeset(
            reason_unranked(RankedValue(row, answer, ranked)) if row.kind == "replay" and not ranked else ""
        ),
        sort=sort_key(column.metric, answer),
    )


def missing_cell(row: EstimatorRow, metric: str, answer: Answer) -> TableCell:
    """Return the cell of a missing answer: a word and the reason."""
    if row.kind != "onboard" and row.status == "failed":
        return TableCell("failed", brief="failed", missing=True, reason=row.reason)
    itself = row.is_reference and answer.code == "not_applicable" and not metric.startswith("cost")
    word, brief = ("reference", "ref") if itself else CODES.get(answer.code or "", ("n/a", "n/a"))
    return TableCell(word, brief=brief, missing=True, reason=answer.reason or "")


def coverage_text(answer: Answer) -> str:
    """Return the share of the time compared, ``of 62 %``; empty if nearly all."""
    coverage = answer.coverage_pct
    return f"of {coverage:.0f} %" if coverage is not None and coverage < FULL_COVERAGE_PCT else ""


def sort_key(metric: str, answer: Answer) -> float:
    """Return the distance of a value from its ideal, for sorting."""
    known = definitions().get(metric)
    better = known.better if known is not None else "zero" if answer.unit in SIGNED else "low"
    value = value_of(answer)
    return {"zero": abs(value), "one": abs(value - 1.0)}.get(better, value)


# Comparison as rows and cells for page and terminal.


@dataclass(slots=True)
class FilterTable:
    """Columns, and (row, cells) of every row."""

    columns: list[TableColumn] = field(default_factory=list)
    rows: list[tuple[EstimatorRow, list[TableCell]]] = field(default_factory=list)

    @property
    def partial(self) -> bool:
        """True if a cell covers only part of the time."""
        return any(small.startswith("of ") for _, cells in self.rows for c in cells for small in c.small)


def main_table(result: Result, window: str = "all", *, many: bool = False) -> FilterTable:
    """Return the comparison of all rows: every column with a value.

    With ``window`` other than ``all`` only that window is used. ``many``: titles for logs with different references.
    """
    chosen = table_columns(result)
    if window != "all":
        chosen = [dataclasses.replace(c, windows=(window,)) for c in chosen if c.metric != NOISE]
        chosen.insert(len(ERROR_COLUMNS), TableColumn("Noise", NOISE, (window,), short="Noise"))
    if is_against_onboard(result) and not many:
        chosen = [dataclasses.replace(c, title=AGREEMENT_TITLES.get(c.metric, c.title)) for c in chosen]
    return fill_table(result, chosen)


def axis_table(result: Result) -> FilterTable:
    """Return lag, gain and shape of the steps by axis."""
    return fill_table(result, AXIS_COLUMNS)


def window_tables(result: Result) -> dict[str, FilterTable]:
    """Return a table of all metrics for each window."""
    windows = dict.fromkeys(w for r in result.estimators for w in r.metrics)
    out = {}
    for window in windows:
        metrics = dict.fromkeys(m for r in result.estimators for m in r.metrics.get(window, {}))
        contests = [TableColumn(m, m, (window,), not m.startswith(("step_gain", "distortion"))) for m in metrics]
        table = fill_table(result, contests)
        if table.columns:
            out[window] = table
    return out


def fill_table(result: Result, wanted: Iterable[TableColumn]) -> FilterTable:
    """Return the columns with a value, for all rows, each in one window."""
    rows = rows_in_order(result)
    table = FilterTable()
    for column in wanted:
        window = window_of(result, column.metric, column.windows)
        answers = (row.metrics.get(window, {}).get(column.metric) for row in rows)
        first = next((a for a in answers if a is not None and has_value(a)), None)
        if first is not None:
            table.columns.append(dataclasses.replace(column, windows=(window,), unit=unit_sign(first.unit)))
    table.rows = [(row, [table_cell(result, row, column) for column in table.columns]) for row in rows]
    return table
