"""A log can name no file, run no code, fetch nothing: hostile texts are only text."""

from __future__ import annotations

import re

import pytest

from attlog.health.findings import Finding
from attlog.present.sentences import verdicts
from attlog.present.text import clean
from attlog.report import write_report
from attlog.report.bundle import bundle
from attlog.report.page import render
from attlog.result import ParameterValue, Result, Setting
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
    for check in result.audit:
        check.text = check.name = check.threshold = EVIL
    result.reference.text = result.reference.source = EVIL
    for answer in result.health:
        answer.sensor = answer.question = answer.text = answer.unit = answer.threshold = answer.source = EVIL
        answer.action = answer.why_no_setting = EVIL
        answer.evidence, answer.settings = [EVIL], [Setting(EVIL, 1.0, 2.0)]
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
