"""The comparison on the terminal: width, marks, words for what is missing."""

from __future__ import annotations

import pytest

from attlog.cli.shared.terminal import comparison, printed
from attlog.metrics.answer import missing
from attlog.present.names import row_names
from attlog.present.stand_ins import stand_in
from attlog.present.table.table import main_table
from tests.report.conftest import make_result


def lines(result, width=100, shown=str):
    """The lines of the table in this many columns."""
    return [line.text for line in comparison(result, "all", width, shown)]


@pytest.mark.parametrize("width", [60, 80, 100, 160])
def test_every_number_is_whole_and_no_line_is_wider_than_the_terminal(width):
    result = make_result()
    found = lines(result, width)
    assert max(map(len, found)) <= width
    table = main_table(result)
    left_out = found[-1] if found[-1].startswith("No room") else ""
    for row, cells in table.rows:
        line = next(x for x in found if x.startswith(row_names(result)[row.name]))
        for heading, cell in zip(table.columns, cells, strict=True):
            words = line.replace("*", " ").replace("~", " ").split()
            gone = heading.title[0].lower() + heading.title[1:] in " ".join(found[-2:])
            assert cell.missing or gone or cell.text in words, (row.name, heading.title, left_out)


def test_a_narrow_terminal_keeps_the_four_questions_and_names_what_it_leaves_out():
    found = "\n".join(lines(make_result(), 60))
    assert all(word in found for word in ("Tilt", "Noise", "Lag", "Drift"))
    assert "No room for: heading error RMS, air drift by onboard, cost" in found


def test_names_give_way_before_numbers_do():
    found = lines(make_result(), 40)
    vqf = next(line for line in found if line.startswith("VQF"))
    assert vqf.split() == ["VQF", "5.2", "0.004*", "−1*", "−0.05*"]
    assert any(line.startswith("Compl") and ".." in line for line in found)


def test_a_wide_terminal_shows_the_ids():
    found = lines(make_result(), 160)
    assert any(line.split()[:4] == ["Mahony,", "Xu", "0.6", "mahony@xu-0.6"] for line in found)
    assert not any("mahony@xu-0.6" in line for line in lines(make_result(), 80))


def test_no_line_ends_with_a_blank():
    assert [x.text for x in printed(make_result(), "all", 80, "utf-8", True) if x.text != x.text.rstrip()] == []


def test_columns_stay_aligned_where_signs_have_stand_ins():
    found = lines(make_result(), 80, lambda text: stand_in(text, "ascii"))
    assert "".join(found).isascii()
    assert max(map(len, found)) <= 80
    starts = {line.index(n) for name, n in (("Gyro", "0.003"), ("Madgwick", "0.044")) for line in found if name in line}
    assert len(starts) == 1


def test_a_missing_value_is_a_word_and_a_column_without_values_is_left_out():
    result = make_result()
    assert any("not a pure delay" in line for line in lines(result, 160) if line.startswith("Complementary"))
    for row in result.estimators:
        row.metrics["airborne"]["lag_ms"] = missing("no_events", "no steps", "ms", "airborne")
    assert not any("Lag ms" in line for line in lines(result))


def test_the_best_are_marked_and_what_was_not_compared_is_told_apart():
    result = make_result()
    assert "*" in next(line for line in lines(result) if line.startswith("VQF"))
    assert "~" not in next(line for line in lines(result) if line.startswith("VQF"))
    result.best, result.ranked = {}, {}
    assert "~" in next(line for line in lines(result) if line.startswith("VQF"))
