"""Gates on a page: red or green, filled anew, and nothing else of the page changes."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog.report.gates import BEGIN, END, Said, block, show, with_gates
from tests.compare.made import result
from tests.words.made import lag, row

GOOD: list[Said] = [("passed", "lag_ms max=5", "mekf: lag_ms 1 ms"), ("skipped", "x max=1", "mekf: no x")]
BAD: list[Said] = [("failed", "lag_ms max=5", "<b>mekf</b> & co: lag_ms 9 ms"), *GOOD]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("page") / "x.html"
    result(row("mekf", lag(1.0))).to_html(file)
    return file


def test_a_page_has_one_place_for_gates_which_is_empty_at_first(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text.count(BEGIN + END) == text.count(BEGIN) == 1
    assert text.index('<main id="main"') < text.index(BEGIN) < text.index('id="findings"')


def test_gates_are_filled_in_and_filled_anew(page: Path, tmp_path: Path) -> None:
    file = tmp_path / "x.html"
    before = page.read_text(encoding="utf-8")
    file.write_text(before, encoding="utf-8")
    assert show(file, BAD)
    red = file.read_text(encoding="utf-8")
    assert "<b>Gates: 1 of 3 checks failed.</b> &lt;b&gt;mekf&lt;/b&gt; &amp; co: lag_ms 9 ms" in red
    assert show(file, GOOD)
    green = file.read_text(encoding="utf-8")
    assert '<span class="chk good">passed</span> Gates: 1 check passed, 1 skipped' in green
    assert 'class="alert"><b>Gates' not in green
    assert show(file, [])
    assert file.read_text(encoding="utf-8") == before


def test_a_page_of_an_older_version_is_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "old.html"
    file.write_text("<html></html>")
    assert not show(file, BAD)
    assert file.read_text() == "<html></html>"
    assert with_gates("<html></html>", BAD) is None


def test_every_check_stands_in_the_table_in_the_order_given() -> None:
    text = block(BAD)
    assert text.count("<tr class=") == 3
    assert text.index('class="failed"') < text.index('class="passed"') < text.index('class="skipped"')


def test_what_was_only_skipped_is_not_green() -> None:
    assert "chk good" not in block(GOOD[1:])
    assert "Gates: 0 checks passed, 1 skipped" in block(GOOD[1:])


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_page_with_gates_has_no_accessibility_violation(visit, page: Path, tmp_path: Path, scheme: str) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    file = tmp_path / "x.html"
    file.write_text(page.read_text(encoding="utf-8"), encoding="utf-8")
    assert show(file, BAD)
    shown = visit(file, color_scheme=scheme).page
    shown.locator(".gates summary").click()
    assert shown.locator(".gates tbody tr").count() == 3
    found = axe.Axe().run(shown)
    assert [(v["id"], v["nodes"][0]["html"][:120]) for v in found.response["violations"]] == []
