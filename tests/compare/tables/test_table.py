"""What stands beside a difference: the values that it was made of; without one those that each configuration has."""

from __future__ import annotations

from dataclasses import replace

from attlog.compare.differences.wording import value
from attlog.compare.tables.table import pooled_tables, tables
from tests.compare.flights import comparison


def test_values_are_those_of_the_pairs_and_without_a_difference_those_of_each_configuration() -> None:
    found = comparison({"inclination_rmse_deg": [(0.3, 0.1), (-0.2, 0.1)]})
    question = found.questions[0]
    (contrast,) = question.contrasts
    paired, alone = contrast.logs
    for cells in question.cells.values():
        for name in cells:
            cells[name] = replace(cells[name], value=77.0 if name == found.configurations[0].name else 88.0)
    contrast.logs[1:] = [replace(alone, value=None, reason="no pairs")]
    (table,) = (t for t in tables(found) if t.question is question)
    first, second, over = table.rows
    assert first[:3] == (paired.log, value(paired.first, question), value(paired.second, question))
    assert second[:3] == (alone.log, value(77.0, question), value(88.0, question))
    assert second[3:] == ("", "", "–")
    assert table.reasons[1] == "no pairs"
    assert over[0] in ("all 2 logs", "2 logs of 2")
    assert len(table.head) == len(first) == len(over)


def test_one_log_has_no_row_of_all_logs_and_pooled_changes_say_on_how_many_they_are_better() -> None:
    one = comparison({"inclination_rmse_deg": [(0.3, 0.1)]})
    assert [len(t.rows) for t in tables(one)] == [1]
    four = comparison({"inclination_rmse_deg": [(-0.3, 0.1)] * 3 + [(0.1, 0.1)]})
    (pooled,) = pooled_tables(four)
    assert pooled.rows[0][-1] == "3 of 4"
    assert pooled.title.endswith("4 logs")
