"""What stands beside a difference: the values that it was made of; without one those that each configuration has."""

from __future__ import annotations

import csv
import io
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.compare import comparison_page as page
from attlog.compare import tables
from attlog.compare.comparison import Comparison, LogLine
from attlog.compare.comparison_page import dots, end_label, scale_ends
from attlog.compare.setting import parse_configuration
from attlog.compare.setting_words import read_configurations
from attlog.compare.tables import comparison_tables, matrix, pooled_tables
from attlog.compare.wording import own_value_text, signed_text
from attlog.core.files import write_all_atomic
from tests.compare.made import CONFIGURATIONS, FIRST, SECOND, comparison
from tests.report.browser import Visit


def test_values_are_those_of_the_pairs_and_without_a_difference_those_of_each_configuration() -> None:
    found = comparison({"tilt_rmse_deg": [(0.3, 0.1), (-0.2, 0.1)]})
    question = found.questions[0]
    (contrast,) = question.contrasts
    paired, alone = contrast.logs
    for cells in question.cells.values():
        for name in cells:
            cells[name] = replace(cells[name], value=77.0 if name == found.configurations[0].name else 88.0)
    contrast.logs[1:] = [replace(alone, value=None, reason="no pairs")]
    (table,) = (t for t in comparison_tables(found) if t.title == question.title)
    first, second, over = table.rows
    assert first[:3] == (paired.log, own_value_text(paired.first, question), own_value_text(paired.second, question))
    assert second[:3] == (alone.log, own_value_text(77.0, question), own_value_text(88.0, question))
    assert second[3:] == ("", "", "–")
    assert table.reasons[1] == "no pairs"
    assert over[0] in ("all 2 logs", "2 logs of 2")
    assert len(table.head) == len(first) == len(over)


def test_one_log_has_no_row_of_all_logs_and_pooled_changes_say_on_how_many_they_are_better() -> None:
    one = comparison({"tilt_rmse_deg": [(0.3, 0.1)]})
    assert [len(t.rows) for t in comparison_tables(one)] == [1]
    four = comparison({"tilt_rmse_deg": [(-0.3, 0.1)] * 3 + [(0.1, 0.1)]})
    (pooled,) = pooled_tables(four, 80)
    assert pooled.rows[0][-1] == "3 of 4"
    assert pooled.title.endswith("4 logs")


# The first figure of a comparison: every sentence agrees with the dots beneath it.

THREE = [parse_configuration(f"mahony:kp={kp}") for kp in (0.3, 0.6, 1.2)]
LABELS = ("kp 0.6", "kp 1.2")


def some(seed: int) -> Comparison:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))

    def each(scale: float) -> list[tuple[float, float]]:
        middle = rng.normal(0.0, 2.0 * scale)
        return [(float(rng.normal(middle, 0.3 * scale)), float(rng.uniform(0.1, 0.6) * scale)) for _ in range(n)]

    changes = {
        "tilt_rmse_deg": each(0.3),
        "heading_rmse_deg": each(0.1),
        "noise_tilt_deg": each(1.5),
        "lag_ms": each(3.0),
        "drift_rest_deg_per_min": each(2.0),
    }
    return comparison(changes, THREE, factors=(1.0, float(rng.normal())))


@pytest.mark.parametrize("seed", range(12))
def test_sentences_and_cells_agree_with_the_dots(seed: int) -> None:
    found = some(seed)
    for row in matrix(found):
        for k, (cell, dot) in enumerate(zip(row.cells, dots(row), strict=True)):
            over = row.question.contrasts[k].over
            assert dot is not None
            assert over is not None
            assert (cell.direction, cell.change) == (over.direction, signed_text(over.value or 0.0, row.question))
            assert dot.say.startswith(cell.change)
            lead = found.verdicts[k].lead
            named = f"{row.question.title.lower()} ({cell.change})"
            if cell.direction in ("better", "worse"):
                side = -1.0 if cell.direction == "better" else 1.0
                assert dot.ends is not None
                assert side * (dot.x - 50.0) >= dot.floor
                assert min(side * (e - 50.0) for e in dot.ends) >= 0.0
                part = re.split(r"(?=better|worse)", lead)
                assert any(p.startswith(cell.direction) and (named in p or "more" in p) for p in part)
            else:
                assert named not in lead


def test_a_difference_far_from_the_others_stands_at_the_end_of_its_row() -> None:
    found = comparison({"noise_tilt_deg": [(0.05, 0.01)] * 3}, THREE, factors=(1.0, 60.0))
    (row,) = matrix(found)
    near, far = dots(row)
    assert near is not None
    assert far is not None
    assert (near.beyond, far.beyond) == (0, 1)
    assert 55.0 < near.x < far.x
    assert scale_ends(row)[0].startswith("−")


def test_dots_count_the_logs_that_point_the_same_way_of_those_with_an_answer() -> None:
    found = comparison({"tilt_rmse_deg": [(-0.3, 0.1), (-0.2, 0.1), (0.05, 0.1)], "lag_ms": [(1.0, 0.1)]})
    tilt, lag = matrix(found)
    assert (tilt.cells[0].count, lag.cells[0].count) == ("2/3", "")
    dot = dots(tilt)[0]
    assert dot is not None
    assert len(dot.logs) == 3


def test_a_log_without_a_difference_has_its_reason_in_its_table() -> None:
    found = comparison({"tilt_rmse_deg": [(0.3, 0.1)] * 2, "lag_ms": [(1.0, 0.1)]})
    cells = [row.cells[0] for row in matrix(found, found.logs[1])]
    assert [(c.change, c.reason) for c in cells] == [("+35 %", ""), ("–", "no steps")]


@pytest.mark.parametrize(("value", "label"), [(0.5, "−50 %"), (1.5, "+50 %"), (40.0, "×40"), (0.005, "÷200")])
def test_ends_of_a_scale_of_ratios_are_percent_and_beyond_ten_a_factor(value: float, label: str) -> None:
    assert end_label(value, SimpleNamespace(scale="ratio", unit="deg")) == label  # type: ignore[arg-type]


# The page of a comparison: whole, self-contained, drawn in a browser, and hostile names are only text.

WHY = "This log holds no gyro."


def made() -> Comparison:
    return comparison(
        {"tilt_rmse_deg": [(0.3, 0.1), (0.25, 0.2), (-0.1, 0.15)], "lag_ms": [(0.1, 0.3), (0.05, 0.2)]},
        broken=[LogLine("dead.bin", "dead.bin", code=65, reason=WHY)],
    )


def test_the_page_says_every_sentence_and_which_log_was_not_used() -> None:
    found = made()
    text = page.render_comparison(found)
    for said in (verdict.lead for verdict in found.verdicts):
        assert said.replace("<", "&lt;") in text.replace("\u00a0", " ")
    assert WHY in text
    assert "=&#34;" not in text, "an attribute of the template was taken for text"
    assert "http://" not in text.replace("http://www.w3.org", "")


def test_the_configurations_of_the_page_are_a_file_that_compare_reads(tmp_path: Path) -> None:
    path = tmp_path / "filters.toml"
    path.write_text(page.configurations_toml(made()))
    tomllib.loads(path.read_text())
    assert read_configurations(path).configurations == CONFIGURATIONS


def test_figures_are_drawn_in_a_browser_and_saved_as_numbers(tmp_path: Path, browser: Any) -> None:
    path = tmp_path / "compare.html"
    write_all_atomic({path: page.render_comparison(made())})
    visit = Visit(browser, path)
    visit.page.click("#plots summary")
    visit.page.wait_for_function("document.getElementById('forest0').querySelector('svg').clientWidth > 600")
    assert visit.figures() == {"forest0": True, "forest1": True}
    assert visit.complaints == []
    assert visit.requests == [path.as_uri()]
    with visit.page.expect_download() as download:
        visit.page.click("#fig-forest0 button[data-out=csv]")
    lines = list(csv.DictReader(io.StringIO(Path(download.value.path()).read_text())))
    assert [line["log"] for line in lines] == ["flight1.ulg", "flight2.ulg", "flight3.ulg", "all logs"]
    assert float(lines[0]["value"]) == pytest.approx(1.34986, rel=1e-4)
    contrast = made().questions[0].contrasts[0]
    assert [line["significant"] for line in lines] == [d.direction for d in (*contrast.logs, contrast.over)]
    with visit.page.expect_download() as download:
        visit.page.click("#fig-forest0 button[data-out=svg]")
    assert "<svg" in Path(download.value.path()).read_text()
    visit.close()


def test_tables_for_papers(tmp_path: Path) -> None:
    found = made()
    rows = list(csv.DictReader(io.StringIO(tables.comparison_csv(found))))
    whole = [r for r in rows if r["log"] == "(all)" and r["metric"] == "tilt_rmse_deg"]
    over = found.questions[0].contrasts[0].over
    assert over is not None
    assert [float(r["change"]) for r in whole] == [over.value]
    assert [(r["log"], r["reason"]) for r in rows if r["log"] == "dead.bin"] == [("dead.bin", WHY)]
    assert {r["configuration"] for r in rows if r["log"] == "flight1.ulg"} == {FIRST, SECOND}
    tex = tables.comparison_latex(found)
    assert tex.count(r"\begin{tabular}") == tex.count(r"\end{tabular}") == 2
    assert not set(tex) & set("−°–±")
    assert tex.count("%") == 1 + tex.count(r"\%")
    assert "| 3 logs of 4 |" in tables.comparison_markdown(found)
    assert tables.comparison_text(found, "tex") == tex


def test_a_log_called_like_a_formula_is_no_formula_in_the_table() -> None:
    found = comparison({"lag_ms": [(0.1, 0.3)]}, broken=[LogLine("=cmd()", "x", code=65, reason="+1")])
    assert "'=cmd()" in tables.comparison_csv(found)
