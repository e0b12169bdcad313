"""A log can name no file, run no code, fetch nothing: hostile texts are only text."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from attlog.batch.index_page import write_index
from attlog.compare import comparison_page
from attlog.compare.grid import parse_grid
from attlog.compare.search import sweep
from attlog.compare.sweep_report import sweep_page
from attlog.estimators import get
from attlog.health.findings import Finding
from attlog.report import write_report
from attlog.report.bundle import bundle
from attlog.report.page import render
from attlog.result import ParameterValue, Result, Setting
from attlog.words.answers import verdicts
from attlog.words.text import clean
from tests.batch.made import failed, flown, reason
from tests.compare.made import comparison
from tests.compare.test_search import Made
from tests.report.browser import Visit
from tests.report.conftest import make_result

EVIL = (
    "</script><script>document.title='ran'</script><img src=x onerror=\"document.title='ran'\">"
    "'\"\x00\x1b[31m\u202e{{7*7}}%{x}<a href='javascript:1'>"
)


def hostile() -> Result:
    """A result in which everything that a log or a plug-in can name is an attack."""
    result = make_result((EVIL, "gyro", "mahony@xu-0.6"))
    log = result.log
    for key in ("name", "sha256", "format", "vehicle", "date_utc"):
        log[key] = EVIL
    log["firmware"] = dict.fromkeys(log["firmware"], EVIL)
    log["timeline"]["modes"] = [[0, 100, EVIL], [100, 200, "<b>AUTO</b>"]]
    log["timeline"]["texts"] = [[float(i), i % 8, EVIL] for i in range(20)]
    log["choices"] = {EVIL: EVIL}
    log["params_changed"] = {EVIL: [1.0, None], "A": [EVIL, EVIL]}
    log["imu"]["source"] = EVIL
    result.findings = [Finding(EVIL, "serious", EVIL, 3.0, evidence=[EVIL], cause=EVIL, action=EVIL)]
    result.command = EVIL
    result.config = {"estimators": [EVIL]}
    for row in result.estimators:
        row.reason = EVIL
        row.parameters[EVIL] = ParameterValue(EVIL, EVIL, EVIL, EVIL)
        row.skipped = {EVIL: 3}
        for answers in row.metrics.values():
            for answer in answers.values():
                answer.reason = EVIL
    for segment_index, segment in enumerate(result.segments):
        result.segments[segment_index] = type(segment)(segment.kind, segment.t0, segment.t1, EVIL)
    result.reference.text = result.reference.source = EVIL
    for check in result.checks:
        check.sensor = check.question = check.text = check.unit = check.threshold = check.source = EVIL
        check.action = check.why_no_setting = EVIL
        check.evidence, check.settings = [EVIL], [Setting(EVIL, 1.0, 2.0)]
    for trace in result.traces:
        trace.key = EVIL if trace.figure in ("compass", "levels", "clipping", "ratios", "interference") else trace.key
    result.verdicts = verdicts(result)
    return result


def test_no_text_of_a_log_becomes_markup():
    html = render(hostile(), bundle())
    assert html.count("<script") == render(make_result(), bundle()).count("<script")
    assert "<img" not in html
    assert "javascript:1'>" not in html
    assert not re.search(
        r"\son\w+=", re.sub(r"<script.*?</script>", "", html, flags=re.S).replace("&#34;", "").split("onerror=")[0]
    )
    assert "49" not in clean(EVIL)
    assert "\x00" not in html
    assert "\x1b" not in html
    assert "\u202e" not in html


def test_own_markup_sets_no_inline_style_and_no_handler():
    markup = re.sub(r"<(script|style)[^>]*>.*?</\1>", "", render(make_result(), bundle()), flags=re.S)
    assert " style=" not in markup
    assert not re.search(r"<[^>]*\son[a-z]+=", markup)


def test_the_policy_allows_hashes_only():
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', render(make_result(), bundle())).group(1)
    assert policy.startswith("default-src &#39;none&#39;")
    assert "unsafe" not in policy
    assert "http" not in policy
    assert "script-src &#39;sha256-" in policy


def test_a_browser_runs_and_fetches_nothing_from_a_hostile_log(visit, tmp_path):
    path = tmp_path / "hostile.html"
    write_report(hostile(), path)
    page = visit(path)
    assert page.page.get_attribute("html", "data-drawn") == "all"
    assert page.complaints == []
    assert page.requests == [path.as_uri()]
    assert page.page.evaluate("document.title") != "ran"
    assert page.page.evaluate("document.querySelectorAll('img, iframe, object, a[href^=javascript]').length") == 0
    assert page.page.evaluate("document.querySelectorAll('.plot a').length") == 0
    assert page.page.evaluate("document.querySelectorAll('.plot b').length") == 0


@pytest.mark.slow
def test_the_policy_stops_what_does_not_belong_to_the_page(visit, report, tmp_path):
    intruder = tmp_path / "intruder.html"
    text = report.read_text(encoding="utf-8")
    intruder.write_text(
        text.replace("<main", "<script>document.title='ran'</script><img src='http://127.0.0.1:9/x.png'><main", 1)
    )
    page = visit(intruder)
    assert page.page.evaluate("document.title") != "ran"
    assert [c for c in page.complaints if "Content Security Policy" in c] != []
    assert page.requests[0] == intruder.as_uri()
    assert page.page.get_attribute("html", "data-drawn") == "all"


# Names that scripts, spreadsheets and layouts stumble over: every page shows them, runs none, keeps to its screen.

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
            for c in question.contrasts:
                c.logs = [replace(d, log=name) if d.log == line.name else d for d in c.logs]
        line.name = line.path = name
    found.configurations[1].label = NAMES[-1]
    path = folder / "compare.html"
    path.write_text(comparison_page.render_comparison(found), encoding="utf-8")
    return path


def swept(folder: Path) -> Path:
    logs = [Made(name, 0.4 + 0.01 * k) for k, name in enumerate(NAMES)]
    found = sweep("mahony", parse_grid(["kp=0.1,0.2,0.4", "ki=0,0.01"], get("mahony")), logs)  # type: ignore[arg-type]
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
    from attlog.core.files import csv_cell

    for text in ("=1", "-1", "-1 -1", " @x", "a;=1", "a\r=2", "a\tb", "\t=1", "-5;=1", 'a"b', "two\nlines", "-", ""):
        assert spreadsheet(text) == '"' + csv_cell(text).replace('"', '""') + '"'


@pytest.fixture
def spreadsheet(page: Visit) -> Callable[[str], str]:
    from attlog.report.shell import WEB

    script = (WEB / "spreadsheet.js").read_text(encoding="utf-8")
    return lambda text: page.page.evaluate(f"text => {{ {script}; return spreadsheetCell(text); }}", text)
