"""Names that scripts, spreadsheets and layouts stumble over: every page shows them, runs none, keeps to its screen."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from attlog.compare.sweep.grid import grid
from attlog.compare.sweep.page import sweep_page
from attlog.compare.sweep.sweep import sweep
from attlog.compare.tables import comparison_page
from attlog.estimators import get
from attlog.fleet.pages.index import write_index
from attlog.report import write_report
from tests.compare.flights import comparison
from tests.compare.sweep.test_sweep import Made
from tests.fleet.made import failed, flown, reason
from tests.report.browser import Visit
from tests.report.conftest import make_result

NAMES = (
    "__proto__",
    "constructor",
    "toString",
    "hasOwnProperty",
    "length",
    "-1",
    "{{7*7}}",
    "%{x}<br>",
    "]]>",
    "javascript:document.title='ran'",
    "</script><script>document.title='ran'</script>",
    "<!--<script>",
    "&lt;b&gt;",
    '"><img src=x onerror="document.title=\'ran\'">',
    "line\u2028end\u2029s",
    "\u202egnitirw",
    "nul\x00\x1b[31m\x9b",
    "half\ud800",
    "=cmd|' /C calc'!A0",
    "a;=1\r=2",
    "W" * 10_000,
)


def report(folder: Path) -> Path:
    found = make_result(NAMES)
    found.log |= {"name": NAMES[-1], "vehicle": NAMES[-1], "choices": dict.fromkeys(NAMES, "__proto__")}
    found.log["firmware"] = dict.fromkeys(found.log["firmware"], NAMES[-1])
    found.log["params_changed"] = {name: [1.0, 2.0] for name in NAMES}
    found.log["timeline"]["modes"] = [[9.0 * k, 9.0 * k + 9.0, name] for k, name in enumerate(NAMES)]
    found.log["timeline"]["texts"] = [[9.0 * k, k % 8, name] for k, name in enumerate(NAMES)]
    path = folder / "report.html"
    write_report(found, path)
    return path


def index(folder: Path) -> Path:
    entries = [flown(f"{k}.ulg", reason("crash", text=n), vehicle=n, firmware=n, board=n) for k, n in enumerate(NAMES)]
    return write_index(folder, [*entries, *(failed(name, name) for name in NAMES)], title=NAMES[-1])


def compared(folder: Path) -> Path:
    found = comparison({"lag_ms": [(0.1, 0.3)] * len(NAMES)})
    for line, name in zip(found.logs, NAMES, strict=True):
        for question in found.questions:
            question.cells[name] = question.cells.pop(line.name)
            for one in (one for c in question.contrasts for one in c.logs if one.log == line.name):
                one.log = name
        line.name = line.path = name
    found.configurations[1].label = NAMES[-1]
    path = folder / "compare.html"
    path.write_text(comparison_page.render(found), encoding="utf-8")
    return path


def swept(folder: Path) -> Path:
    logs = [Made(name, 0.4 + 0.01 * k) for k, name in enumerate(NAMES)]
    found = sweep("mahony", grid(["kp=0.1,0.2,0.4", "ki=0,0.01"], get("mahony")), logs)  # type: ignore[arg-type]
    told = [dict.fromkeys(("name", "vehicle", "firmware", "reference"), name) for name in NAMES]
    path = folder / "sweep.html"
    text = sweep_page(found, {"attlog": {"version": "1"}, "command": " ".join(NAMES), "logs": told})
    path.write_text(text, encoding="utf-8")
    return path


PAGES = {"report": report, "index": index, "comparison": compared, "sweep": swept}


@pytest.fixture(scope="module", params=PAGES)
def page(request: pytest.FixtureRequest, browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Visit]:
    path = PAGES[request.param](tmp_path_factory.mktemp(request.param))
    ready = "html[data-drawn]" if request.param != "sweep" else "main table"
    visit = Visit(browser, path, ready=ready)
    yield visit
    visit.close()


@pytest.mark.slow
def test_nothing_is_run_fetched_or_complained_of(page: Visit) -> None:
    page.page.evaluate(
        "document.querySelectorAll('.open, summary, .lg:nth-of-type(-n+3) input').forEach((e) => e.click())"
    )
    page.page.wait_for_timeout(300)
    assert page.complaints == []
    assert len(page.requests) == 1
    assert page.page.evaluate("document.title") != "ran"
    assert page.page.locator("main img, iframe, object, a[href^=javascript i]").count() == 0


@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 1280])
def test_the_page_keeps_to_its_screen_and_long_names_leave_room_for_what_is_said(page: Visit, width: int) -> None:
    page.page.set_viewport_size({"width": width, "height": 844})
    assert page.page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.page.locator("h1").bounding_box()["height"] < 260
    assert page.page.locator("main").bounding_box()["y"] < 700


@pytest.mark.slow
def test_what_is_hidden_or_turns_the_line_round_is_shown_as_a_mark(page: Visit) -> None:
    text = page.page.evaluate("document.body.textContent")
    assert not set(text) & set("\u202e\u2028\x00\x1b\x9b")


@pytest.mark.slow
def test_tables_saved_from_the_page_run_nothing(page: Visit) -> None:
    if page.page.locator("button.csv").count():
        button: Any = page.page.locator("button.csv").last
    elif page.page.locator("[data-out=csv]").count():
        button = page.page.locator("[data-out=csv]").last
    else:
        pytest.skip("this page saves no table")
    with page.page.expect_download() as download:
        button.evaluate("e => e.click()")
    text = Path(download.value.path()).read_bytes().decode("utf-8")
    assert "\r" not in text
    assert len(text) > 100
    for line in csv.reader(io.StringIO(text)):
        assert [cell for cell in line if cell.startswith("=") or ";=" in cell] == []


@pytest.mark.slow
def test_the_script_quotes_cells_as_the_package_does(page: Visit, spreadsheet: Callable[[str], str]) -> None:
    from attlog.base.files.spreadsheet import cell

    for text in ("=1", "-1", "-1 -1", " @x", "a;=1", "a\r=2", "a\tb", "\t=1", "-5;=1", 'a"b', "two\nlines", "-", ""):
        assert spreadsheet(text) == '"' + cell(text).replace('"', '""') + '"'


@pytest.fixture
def spreadsheet(page: Visit) -> Callable[[str], str]:
    from attlog.report.page import WEB

    script = (WEB / "spreadsheet.js").read_text(encoding="utf-8")
    return lambda text: page.page.evaluate(f"text => {{ {script}; return spreadsheetCell(text); }}", text)
