"""Tables of metrics across logs, one line for each log or group."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any, NamedTuple

from attlog.batch.order import natural_sort_key
from attlog.core.errors import UsageError
from attlog.result import MEASURED_TIMES
from attlog.words.names import CODES
from attlog.words.numbers import number, unit_sign
from attlog.words.ranking import AIR, PHASES, REST
from attlog.words.table import AXIS_COLUMNS, DRIFT_REST_COLUMN, ERROR_COLUMNS, STEP_COLUMNS

if TYPE_CHECKING:
    import pandas as pd

    from attlog.batch.results_file import BatchNumbers

ALL = ("all", "airborne", "rest")
# Windows in which a metric is looked up, as on the page of one log: noise by phase, errors and steps in the air.
WINDOWS = {c.metric: c.windows for c in (*ERROR_COLUMNS, *STEP_COLUMNS, DRIFT_REST_COLUMN, *AXIS_COLUMNS)}
AGAINST_REFERENCE = ("tilt_", "heading_", "total_", "lag_", "step_", "distortion_")
FAMILIES = (
    ("noise_", PHASES),
    ("drift_rest", REST),
    ("drift_air", AIR),
    *((start, AIR) for start in AGAINST_REFERENCE),
)
# Smallest number of values in a usable window, as a share of the number in the fullest window.
MIN_SHARE = 0.5
# Groups of logs.
BY = ("firmware", "version", "vehicle", "board", "reference", "batch", "month", "year", "attlog")
ABOUT = ("log", "date", "vehicle", "firmware")
LOGS = "logs"
NO_VALUE = "–"


class Column(NamedTuple):
    """One metric of one row in one window; ``unit`` as in the results."""

    metric: str
    window: str
    row: str
    unit: str


@dataclass(slots=True)
class LogTable:
    """Metrics of many logs.

    ``logs``: one row per log, see :class:`attlog.batch.results_file.BatchNumbers`. ``values`` and ``codes`` (reasons of
    missing values): one row per log, one column for each of ``columns``. ``repeats``: results left out because a newer
    result has the same content.
    """

    logs: pd.DataFrame
    columns: list[Column]
    values: pd.DataFrame
    codes: pd.DataFrame
    repeats: int = 0


@dataclass(slots=True)
class TableText:
    """Printable table: ``body`` of logs or groups, ``foot`` with medians and quartiles."""

    head: list[str]
    body: list[list[str]] = field(default_factory=list)
    foot: list[list[str]] = field(default_factory=list)


def across(
    found: BatchNumbers,
    metrics: Sequence[str],
    rows: Sequence[str] = (),
    window: str | None = None,
    by: str | None = None,
) -> LogTable:
    """Collect metrics of table rows for each log.

    ``metrics``: METRIC or METRIC@WINDOW; ``rows``: names or patterns, default all. A metric without a window is looked
    up as on the page of one log, in the same window for all logs. Results with the same content count once: the newest
    attlog version, then the last. With ``by`` "batch" they count once per batch. UsageError for a metric, row or window
    that no log has.
    """
    asked = [tuple(m.partition("@")[::2]) for m in dict.fromkeys(metrics)]
    kept = _newest(found.logs, each_batch=by == "batch")
    for metric in sorted({m for m, _ in asked} - found.units.keys()) if len(kept) else ():
        if metric in MEASURED_TIMES:
            raise UsageError(f"--metric {metric}: measured times differ from run to run and are kept in no table")
        raise UsageError(f"--metric {metric}: no log has it; {suggest_words(metric, found.units)}")
    common = found.answers[found.answers["value"].notna()].groupby("row")["at"].nunique()
    held = sorted(found.answers["row"].unique(), key=lambda row: (_place(row), -common.get(row, 0), row))
    chosen = select_rows(rows, held) if rows and len(kept) else held
    windows = set(found.answers["window"])
    answers = found.answers[found.answers["at"].isin(kept.index)]
    columns: list[Column] = []
    for metric, own in asked if len(kept) else ():
        wanted = own or window
        if wanted and wanted not in windows:
            option = f"--metric {metric}@{own}" if own else f"--window {window}"
            raise UsageError(f"{option}: no log has this window; {suggest_words(wanted, windows)}")
        where = wanted or usual_window(metric, answers)
        has = set(answers["row"][(answers["metric"] == metric) & (answers["window"] == where)])
        columns += [Column(metric, where, row, found.units[metric]) for row in chosen if row in has]
    place = {column[:3]: k for k, column in enumerate(columns)}
    keys = zip(answers["metric"], answers["window"], answers["row"], strict=True)
    spots: list[Any] = [place.get(key) for key in keys]
    cells = answers.assign(column=spots).dropna(subset="column")
    values, codes = (
        cells.pivot(index="at", columns="column", values=what).reindex(index=kept.index, columns=range(len(columns)))
        for what in ("value", "code")
    )
    return LogTable(kept, columns, values.astype(float), codes, len(found.logs) - len(kept))


def usual_window(metric: str, answers: pd.DataFrame) -> str:
    """Return the first window with MIN_SHARE of the fullest window's values."""
    count = answers["window"][(answers["metric"] == metric) & answers["value"].notna()].value_counts(sort=False)
    order = WINDOWS.get(metric) or next((windows for start, windows in FAMILIES if metric.startswith(start)), ALL)
    best = max((count.get(w, 0) for w in order), default=0)
    if best:
        return next(w for w in order if count.get(w, 0) >= MIN_SHARE * best)
    return str(count.idxmax()) if len(count) else order[0]


def select_rows(patterns: Iterable[str], held: Sequence[str]) -> list[str]:
    """Select rows by names or patterns. UsageError for a pattern without a match."""
    found: dict[str, None] = {}
    for pattern in patterns:
        meant = [row for row in held if row == pattern] or [row for row in held if fnmatchcase(row, pattern)]
        if not meant:
            raise UsageError(f"--row {pattern}: no log has this row; {suggest_words(pattern, held)}")
        found |= dict.fromkeys(meant)
    return list(found)


def suggest_words(word: str, known: Iterable[str]) -> str:
    """Suggest known words similar to an unknown one, else all."""
    listed = sorted(known)
    close = difflib.get_close_matches(word, listed, 3, 0.5) or [k for k in listed if word and word in k][:5]
    return f"did you mean {', '.join(close)}?" if close else f"they have {', '.join(listed)}"


def references(found: LogTable) -> dict[str, int]:
    """Count logs by reference if a column depends on the reference."""
    if not any(c.metric.startswith(AGAINST_REFERENCE) for c in found.columns):
        return {}
    return {str(k): int(n) for k, n in found.logs["reference"].fillna("none").value_counts().items()}


def group_logs(logs: pd.DataFrame, by: str) -> dict[str, pd.Index[int]]:
    """Group the index of logs, ``unknown`` last. UsageError for an unknown grouping."""
    if by not in BY:
        raise UsageError(f"--by {by}: use {', '.join(BY[:-1])} or {BY[-1]}")
    text = logs["date_utc" if by in ("month", "year") else by].fillna("").astype(str)
    if by in ("month", "year"):
        text = text.str[: 7 if by == "month" else 4]
    found = {str(name): part.index for name, part in logs.groupby(text.replace("", "unknown"))}
    return {name: found[name] for name in sorted(found, key=lambda name: (name == "unknown", natural_sort_key(name)))}


def _newest(logs: pd.DataFrame, each_batch: bool) -> pd.DataFrame:
    """Keep the newest result of each content, sorted by report name."""
    best: dict[tuple[str, str], Any] = {}
    for log in logs.itertuples():
        key = (str(log.sha256 or f"{log.Index} unknown"), str(log.batch) if each_batch else "")
        if key not in best or _version(log.attlog) >= _version(best[key].attlog):
            best[key] = log
    return logs.loc[
        [log.Index for log in sorted(best.values(), key=lambda log: (natural_sort_key(log.report), log.batch))]
    ]


def _version(attlog: Any) -> list[int]:
    return [int(part) for part in re.findall(r"\d+", str(attlog or ""))]


def _place(row: str) -> int:
    """Return the sort key of a row: onboard first, other recorded attitudes last."""
    return 0 if row == "onboard" else 2 if row.startswith("onboard:") else 1


def column_titles(columns: Sequence[Column]) -> list[str]:
    """Name columns by their row, and by metric and window where these differ."""
    several = len({c.metric for c in columns}) > 1
    windows = {(c.metric, c.window) for c in columns}
    several_windows = len(windows) > len({metric for metric, _ in windows})
    return [
        f"{c.metric}{f'@{c.window}' if several_windows else ''} {c.row}" if several or several_windows else c.row
        for c in columns
    ]


def table_text(found: LogTable, by: str | None, columns: Sequence[Column], *, units: bool = False) -> TableText:
    """Format columns of the table as text, one line per log or group (``by``).

    ``units``: also in the headings.
    """
    heads = [
        f"{title} [{unit_sign(c.unit)}]" if units and unit_sign(c.unit) else title
        for title, c in zip(column_titles(columns), columns, strict=True)
    ]
    at = [found.columns.index(c) for c in columns]
    if by is not None:
        table = TableText([by, LOGS, *heads])
        for name, logs in group_logs(found.logs, by).items():
            table.body.append([name, str(len(logs)), *_middles(found, at, logs)])
        if len(table.body) > 1:
            table.foot.append(["all", str(len(found.logs)), *_middles(found, at, found.logs.index)])
        return table
    table = TableText([*ABOUT[:2], *heads])
    for log, about in zip(found.logs.index, _about(found.logs), strict=True):
        table.body.append([*about[:2], *(_cell(found, log, k) for k in at)])
    for label, share in (("median", 0.5), ("25 %", 0.25), ("75 %", 0.75)):
        middle = found.values.quantile(share)
        cells = [NO_VALUE if middle.isna()[k] else number(middle[k], found.columns[k].unit) for k in at]
        table.foot.append([label, "", *cells])
    table.foot.append([LOGS, "", *(str(found.values[k].count()) for k in at)])
    return table


def _about(logs: pd.DataFrame) -> list[list[str]]:
    """Return the ABOUT columns of each log; several batches prefix its name."""
    several = logs["batch"].nunique() > 1
    texts = logs[["batch", "report", "date_utc", "vehicle", "firmware"]].fillna("").astype(str).to_numpy()
    return [
        [f"{batch}/{name}" if several and batch else name, date[:10], vehicle, firmware]
        for batch, name, date, vehicle, firmware in texts
    ]


def table_values(found: LogTable, by: str | None) -> tuple[list[str], list[list[Any]]]:
    """Return headings and lines of the table, with None for a missing value."""
    heads = column_titles(found.columns)
    if by is not None:
        head = [by, LOGS, *(f"{title} {what}" for title in heads for what in ("n", "q25", "median", "q75"))]
        lines = []
        for name, logs in group_logs(found.logs, by).items():
            part = found.values.loc[logs]
            quartiles = part.quantile([0.25, 0.5, 0.75])
            cells = [x for k in part for x in (int(part[k].count()), *map(_or_none, quartiles[k]))]
            lines.append([name, len(logs), *cells])
        return head, lines
    return [*ABOUT, "sha256", *heads], [
        [*(text or None for text in about), found.logs.at[log, "sha256"], *map(_or_none, found.values.loc[log])]
        for log, about in zip(found.logs.index, _about(found.logs), strict=True)
    ]


def _or_none(value: Any) -> float | None:
    return None if value != value else float(value)


def _middles(found: LogTable, at: Sequence[int], logs: pd.Index[int]) -> list[str]:
    """Return median and quartiles of some logs for each column."""
    texts = []
    for k in at:
        part, unit = found.values.loc[logs, k], found.columns[k].unit
        low, middle, high = (number(float(part.quantile(share)), unit) for share in (0.25, 0.5, 0.75))
        texts.append(NO_VALUE if not part.count() else middle if part.count() == 1 else f"{middle} ({low} to {high})")
    return texts


def _cell(found: LogTable, log: int, k: int) -> str:
    value, code = _or_none(found.values.at[log, k]), found.codes.at[log, k]
    if value is not None:
        return number(value, found.columns[k].unit)
    return CODES.get(code, ("", code))[1] if isinstance(code, str) else NO_VALUE
