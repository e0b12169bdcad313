"""The table of ``attlog health`` for a paper or a spreadsheet: a row for each assessment of each log, worst first."""

from __future__ import annotations

from collections.abc import Sequence

from attlog.present.health import shown_assessments
from attlog.present.text import clean
from attlog.result import Result

HEAD = ["sensor", "question", "verdict", "value", "to set", "found"]


def head_and_rows(results: Sequence[Result]) -> tuple[list[str], list[list[str]]]:
    """Titles and rows; the column of the log is left out where there is one log only."""
    several = len(results) > 1
    rows = []
    for result in results:
        log = [clean(str(result.log.get("name") or "log"))] if several else []
        for a in shown_assessments(result.health):
            rows.append([*log, a.sensor, a.question, a.verdict, a.value, a.to_set, a.text])
    return [*(["log"] if several else []), *HEAD], rows
