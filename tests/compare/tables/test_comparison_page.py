"""The page of a comparison: whole, self-contained, drawn in a browser, and hostile names are only text."""

from __future__ import annotations

import csv
import io
import tomllib
from pathlib import Path
from typing import Any

import pytest

from attlog.base.errors import LogUnreadable, UsageError
from attlog.base.files.output import write_together
from attlog.compare.configurations.toml_file import read
from attlog.compare.differences.comparison import Comparison, LogLine
from attlog.compare.tables import comparison_page as page
from attlog.compare.tables import export
from attlog.compare.tables.overview import headline, overview
from tests.compare.flights import CONFIGURATIONS, FIRST, SECOND, comparison
from tests.compare.pages import stands
from tests.report.browser import Visit
from tests.report.test_safety import EVIL

WHY = "This log holds no gyro."


def made() -> Comparison:
    return comparison(
        {"inclination_rmse_deg": [(0.3, 0.1), (0.25, 0.2), (-0.1, 0.15)], "lag_ms": [(0.1, 0.3), (0.05, 0.2)]},
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
    text = page.render(found)
    for said in (*headline(found), *(column.sentence for column in overview(found))):
        assert said.replace("<", "&lt;") in text.replace("\u00a0", " ")
    assert WHY in text
    assert "=&#34;" not in text, "an attribute of the template was taken for text"
    assert "http://" not in text.replace("http://www.w3.org", "")


def test_the_configurations_of_the_page_are_a_file_that_compare_reads(tmp_path: Path) -> None:
    path = tmp_path / "filters.toml"
    path.write_text(page.as_toml(made()))
    tomllib.loads(path.read_text())
    assert read(path).configurations == CONFIGURATIONS


def test_figures_are_drawn_in_a_browser_and_saved_as_numbers(tmp_path: Path, browser: Any) -> None:
    path = tmp_path / "compare.html"
    write_together({path: page.render(made())})
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
    path.write_text(page.render(made()), encoding="utf-8")
    first, whole = stands(browser, path, scheme)
    assert first <= 150
    assert whole <= 1000


@pytest.mark.slow
def test_on_a_phone_the_name_of_a_configuration_stands_above_its_cells(tmp_path: Path, browser: Any) -> None:
    path = tmp_path / "compare.html"
    path.write_text(page.render(made()), encoding="utf-8")
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
    write_together({path: page.render(found)})
    visit = Visit(browser, path)
    assert visit.page.title() != "ran"
    assert visit.complaints == []
    assert visit.requests == [path.as_uri()]
    visit.close()


def test_tables_for_papers(tmp_path: Path) -> None:
    found = made()
    rows = list(csv.DictReader(io.StringIO(export.numbers(found))))
    whole = [r for r in rows if r["log"] == "(all)" and r["metric"] == "inclination_rmse_deg"]
    over = found.questions[0].contrasts[0].over
    assert over is not None
    assert [float(r["change"]) for r in whole] == [over.value]
    assert [(r["log"], r["reason"]) for r in rows if r["log"] == "dead.bin"] == [("dead.bin", WHY)]
    assert {r["configuration"] for r in rows if r["log"] == "flight1.ulg"} == {FIRST, SECOND}
    tex = export.latex(found)
    assert tex.count(r"\begin{tabular}") == tex.count(r"\end{tabular}") == 2
    assert not set(tex) & set("−°–±")
    assert tex.count("%") == 1 + tex.count(r"\%")
    assert "| 3 logs of 4 |" in export.markdown(found)
    assert export.text(found, "tex") == tex


def test_a_log_called_like_a_formula_is_no_formula_in_the_table() -> None:
    found = comparison({"lag_ms": [(0.1, 0.3)]}, broken=[LogLine("=cmd()", "x", code=65, reason="+1")])
    assert "'=cmd()" in export.numbers(found)


def test_a_forest_has_a_line_for_each_log_and_the_diamond_on_the_last() -> None:
    found = made()
    by_metric = {question.metric: page._forest(found, question, 1) for question in found.questions}
    tilt = by_metric["inclination_rmse_deg"].data
    contrast = next(q for q in found.questions if q.metric == "inclination_rmse_deg").contrasts[0]
    assert contrast.over is not None
    assert tilt["lines"] == [*(b.log for b in contrast.logs), "all logs"]
    assert [(i["line"], i["all"]) for i in tilt["items"]] == [(0, False), (1, False), (2, False), (3, True)]
    assert [i["v"] for i in tilt["items"]] == [*(b.value for b in contrast.logs), contrast.over.value]
    told = ("better", "worse")
    assert [i["significant"] for i in tilt["items"]] == [b.direction in told for b in (*contrast.logs, contrast.over)]
    assert (tilt["all"], tilt["log"]) == (True, True)
    assert len(tilt["table"]) == 5
    assert [row[0] for row in tilt["table"][1:]] == tilt["lines"]
    alone = comparison({"inclination_rmse_deg": [(0.3, 0.1)]})
    single = page._forest(alone, alone.questions[0], 2)
    assert (single.data["all"], len(single.data["lines"]), single.height) == (False, 1, 92 + 26)
