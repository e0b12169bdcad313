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
from attlog.compare.comparison_page import comparison_headline, end_label, overview
from attlog.compare.setting import parse_configuration
from attlog.compare.setting_words import read_configurations
from attlog.compare.tables import comparison_tables, matrix_of_log, matrix_over_logs, pooled_tables
from attlog.compare.wording import own_value_text
from attlog.core.errors import LogUnreadable, UsageError
from attlog.core.files import write_all_atomic
from tests.compare.made import CONFIGURATIONS, FIRST, SECOND, comparison, stands
from tests.report.browser import Visit
from tests.report.test_safety import EVIL


def test_values_are_those_of_the_pairs_and_without_a_difference_those_of_each_configuration() -> None:
    found = comparison({"tilt_rmse_deg": [(0.3, 0.1), (-0.2, 0.1)]})
    question = found.questions[0]
    (contrast,) = question.contrasts
    paired, alone = contrast.logs
    for cells in question.cells.values():
        for name in cells:
            cells[name] = replace(cells[name], value=77.0 if name == found.configurations[0].name else 88.0)
    contrast.logs[1:] = [replace(alone, value=None, reason="no pairs")]
    (table,) = (t for t in comparison_tables(found) if t.question is question)
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
    (pooled,) = pooled_tables(four)
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


@pytest.mark.parametrize("seed", range(30))
def test_sentences_agree_with_the_dots(seed: int) -> None:
    found = some(seed)
    columns = overview(found)
    assert [c.title for c in columns] == ["Accuracy", "Static noise", "Step response", "Yaw drift"]
    said = " ".join(comparison_headline(found))
    for column in columns:
        assert len(column.sentence.split()) <= 20
        better, _, worse = column.sentence.partition("Worse:")
        for label, cell in zip(LABELS, column.cells, strict=True):
            assert (label in better) == (cell.direction == "better"), column.sentence
            assert (label in worse) == (cell.direction == "worse"), column.sentence
            if cell.direction in ("better", "worse"):
                side = -1.0 if cell.direction == "better" else 1.0
                assert cell.ends is not None
                assert side * (cell.x - 50.0) >= cell.floor
                assert min(side * (e - 50.0) for e in cell.ends) >= 0.0
                noun = column.what.rpartition(",")[0].lower()
                sentence = next(
                    s for s in comparison_headline(found) if s.startswith(f"Significantly {cell.direction}")
                )
                part = next(p for p in re.split(r"[:;]", sentence) if p.strip().startswith(label))
                assert f"{noun} ({cell.value})" in part or "more" in part
            assert re.match(r"[+−<×>]|\d+ times|not comparable", cell.value), cell.value
    significant = any(c.over.direction in ("better", "worse") for q in found.questions for c in q.contrasts if c.over)
    assert said.startswith("Significantly") == significant


@pytest.mark.parametrize("seed", range(10))
def test_the_table_shows_what_the_dots_show(seed: int) -> None:
    found = some(seed)
    rows = {title: cells for title, _, cells in matrix_over_logs(found).rows}
    for column in overview(found):
        cells = next(cells for title, cells in rows.items() if title.startswith(column.what.rpartition(",")[0] + ","))
        assert [(c.change, c.direction) for c in cells] == [(c.value, c.direction) for c in column.cells]


def test_nothing_significant_is_said_once() -> None:
    found = comparison({"tilt_rmse_deg": [(0.02, 0.1), (-0.03, 0.1)], "lag_ms": [(0.1, 3.0), (0.0, 3.0)]})
    assert comparison_headline(found) == ["No significant difference to kp 0.3 in any question."]
    assert {c.sentence for c in overview(found)} == {"No significant difference."}


def test_a_column_that_no_log_answers_says_why_and_has_no_dots() -> None:
    found = comparison({"tilt_rmse_deg": [(0.3, 0.1)] * 3})
    found.unanswered = {"lag_ms@airborne": "no steps", "step_error_deg.0.5s@airborne": "no steps"}
    column = next(c for c in overview(found) if c.cells == [])
    assert column.sentence == "Cannot be determined: no steps."


def test_a_difference_far_from_the_others_stands_at_the_end_of_its_column() -> None:
    found = comparison({"noise_tilt_deg": [(0.05, 0.01)] * 3}, THREE, factors=(1.0, 60.0))
    (column,) = overview(found)
    near, far = column.cells
    assert (near.beyond, far.beyond) == (0, 1)
    assert 55.0 < near.x < far.x
    assert (far.direction, column.sentence) == ("worse", "Worse: kp 0.6 and kp 1.2.")


def test_dots_count_the_logs_that_point_the_same_way_of_those_with_an_answer() -> None:
    found = comparison({"tilt_rmse_deg": [(-0.3, 0.1), (-0.2, 0.1), (0.05, 0.1)], "lag_ms": [(1.0, 0.1)]})
    accuracy, lag = overview(found)
    assert accuracy.cells[0].count == "2/3 logs"
    assert lag.cells[0].count == "1/1 log"
    assert len(accuracy.cells[0].logs) == 3


def test_a_log_without_a_difference_has_its_reason_beside_its_table() -> None:
    found = comparison({"tilt_rmse_deg": [(0.3, 0.1)] * 2, "lag_ms": [(1.0, 0.1)]})
    matrix = matrix_of_log(found, found.logs[1])
    assert [cells[0].change for _, _, cells in matrix.rows] == ["+35 %", "–"]
    assert matrix.reasons == ["no steps"]


@pytest.mark.parametrize(("value", "label"), [(0.5, "−50"), (1.5, "+50"), (40.0, "×40"), (0.005, "÷200")])
def test_ends_of_a_scale_of_ratios_are_percent_and_beyond_ten_a_factor(value: float, label: str) -> None:
    assert end_label(value, SimpleNamespace(scale="ratio", unit="deg")) == label  # type: ignore[arg-type]


# The page of a comparison: whole, self-contained, drawn in a browser, and hostile names are only text.

WHY = "This log holds no gyro."


def made() -> Comparison:
    return comparison(
        {"tilt_rmse_deg": [(0.3, 0.1), (0.25, 0.2), (-0.1, 0.15)], "lag_ms": [(0.1, 0.3), (0.05, 0.2)]},
        broken=[LogLine("dead.bin", "dead.bin", code=65, reason=WHY)],
    )


def test_a_comparison_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    found = made()
    text = found.to_json(tmp_path / "c.json")
    assert Comparison.load(tmp_path / "c.json").to_json() == text
    assert Comparison.load(tmp_path / "c.json") == found


@pytest.mark.parametrize(
    ("text", "why"),
    [("{", "no valid JSON"), ("[]", "its schema is None"), ('{"schema": "attlog-comparison/2"}', "is missing")],
)
def test_what_is_no_comparison_is_refused(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "c.json"
    path.write_text(text)
    with pytest.raises(UsageError, match=why):
        Comparison.load(path)
    with pytest.raises(LogUnreadable):
        Comparison.load(tmp_path / "none.json")


def test_the_page_says_every_sentence_and_which_log_was_not_used() -> None:
    found = made()
    text = page.render_comparison(found)
    for said in (*comparison_headline(found), *(column.sentence for column in overview(found))):
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
    with visit.page.expect_download() as download:
        visit.page.click("#fig-forest0 button[data-out=svg]")
    assert "<svg" in Path(download.value.path()).read_text()
    visit.close()


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_is_short_and_accessible(tmp_path: Path, browser: Any, scheme: str) -> None:
    path = tmp_path / "compare.html"
    path.write_text(page.render_comparison(made()), encoding="utf-8")
    first, whole = stands(browser, path, scheme)
    assert first <= 150
    assert whole <= 1000


@pytest.mark.slow
def test_on_a_phone_the_name_of_a_configuration_stands_above_its_cells(tmp_path: Path, browser: Any) -> None:
    path = tmp_path / "compare.html"
    path.write_text(page.render_comparison(made()), encoding="utf-8")
    visit = Visit(browser, path, viewport={"width": 390, "height": 844})
    for row in visit.page.query_selector_all("#overview tbody tr:not(.scale)"):
        name = row.query_selector("th").bounding_box()
        for cell in row.query_selector_all(".cell"):
            box = cell.bounding_box()
            assert box["y"] >= name["y"] + name["height"]
            assert box["x"] + box["width"] <= 390
    visit.close()


@pytest.mark.slow
def test_hostile_names_are_only_text(tmp_path: Path, browser: Any) -> None:
    found = made()
    for line in found.logs:
        line.vehicle = line.firmware = line.reference = EVIL
    found.logs[-1].name = found.logs[-1].reason = EVIL
    for question in found.questions:
        question.contrasts[0].logs[0].reason = EVIL
        question.title = EVIL
    found.configurations[1].label = found.command = EVIL
    path = tmp_path / "compare.html"
    write_all_atomic({path: page.render_comparison(found)})
    visit = Visit(browser, path)
    assert visit.page.title() != "ran"
    assert visit.complaints == []
    assert visit.requests == [path.as_uri()]
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


def test_a_forest_has_a_line_for_each_log_and_the_diamond_on_the_last() -> None:
    found = made()
    by_metric = {question.metric: page._forest_figure(found, question, 1) for question in found.questions}
    tilt = by_metric["tilt_rmse_deg"].data
    contrast = next(q for q in found.questions if q.metric == "tilt_rmse_deg").contrasts[0]
    assert contrast.over is not None
    assert tilt["lines"] == [*(b.log for b in contrast.logs), "all logs"]
    assert [(i["line"], i["all"]) for i in tilt["items"]] == [(0, False), (1, False), (2, False), (3, True)]
    assert [i["v"] for i in tilt["items"]] == [*(b.value for b in contrast.logs), contrast.over.value]
    told = ("better", "worse")
    assert [i["significant"] for i in tilt["items"]] == [b.direction in told for b in (*contrast.logs, contrast.over)]
    assert (tilt["all"], tilt["log"]) == (True, True)
    assert len(tilt["table"]) == 5
    assert [row[0] for row in tilt["table"][1:]] == tilt["lines"]
    alone = comparison({"tilt_rmse_deg": [(0.3, 0.1)]})
    single = page._forest_figure(alone, alone.questions[0], 2)
    assert (single.data["all"], len(single.data["lines"]), single.height) == (False, 1, 92 + 26)
