"""The table of ``attlog analyze`` for a paper: a row for each filter of each log, the columns of all logs together."""

from __future__ import annotations

from collections.abc import Sequence

from attlog.present.names import row_names
from attlog.present.table.table import Heading, main_table
from attlog.present.text import clean
from attlog.result import Result

BEST, UNRANKED = "*", "~"


def head_and_rows(results: Sequence[Result], window: str = "all") -> tuple[list[str], list[list[str]]]:
    """Titles and rows: value, half of its 95 % interval where it has one, ``*`` best, ``~`` shown but not ranked.

    The column of the log is left out where there is one log only.
    """
    tables = [(result, main_table(result, window)) for result in results]
    titles = list(dict.fromkeys(_title(c) for _, table in tables for c in table.columns))
    rows = []
    for result, table in tables:
        names = row_names(result)
        for row, cells in table.rows:
            by = {
                _title(c): " ".join(p for p in (cell.text, "" if cell.missing else cell.half) if p)
                + (BEST if cell.best else UNRANKED if cell.unranked and not cell.missing else "")
                for c, cell in zip(table.columns, cells, strict=True)
            }
            log = [clean(str(result.log.get("name") or "log"))] if len(results) > 1 else []
            rows.append([*log, clean(names[row.name]), *(clean(by.get(title, "")) for title in titles)])
    return [*(["log"] if len(results) > 1 else []), "filter", *titles], rows


def _title(column: Heading) -> str:
    return f"{column.title}, {column.unit}" if column.unit else column.title
