"""The comparison on the terminal: width, marks, words for what is missing."""

from __future__ import annotations

import io

from rich.console import Console

from attlog.cli.table import comparison_table
from attlog.metrics.answer import missing
from tests.report.conftest import make_result


def printed(result) -> list[str]:
    """The lines of the table on a terminal of 100 columns."""
    out = Console(file=io.StringIO(), width=100)
    out.print(comparison_table(result, "all"))
    return out.file.getvalue().splitlines()


def test_the_table_fits_100_columns_without_cutting_a_name():
    lines = printed(make_result())
    assert max(map(len, lines)) <= 100
    for row in make_result().estimators:
        assert any(line.startswith(row.name) for line in lines), row.name


def test_a_missing_value_is_a_word_and_a_column_without_values_is_left_out():
    result = make_result()
    assert any("not judged" in line for line in printed(result) if line.startswith("complementary"))
    for row in result.estimators:
        row.metrics["airborne"]["lag_ms"] = missing("no_events", "no steps", "ms", "airborne")
    assert not any("lag ms" in line for line in printed(result))


def test_the_best_are_marked_and_what_may_not_be_ranked_is_told_apart():
    result = make_result()
    gyro = next(r for r in result.estimators if r.name == "gyro")
    assert "*" in next(line for line in printed(result) if line.startswith("gyro"))
    gyro.status, result.best = "diverged", {}
    assert "~" in next(line for line in printed(result) if line.startswith("gyro"))
