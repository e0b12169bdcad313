"""Every page of comparisons: short, accessible in both colour schemes, and hostile names are only text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from attlog.compare.comparison_page import render_comparison
from attlog.compare.diff_report import diff_page
from attlog.compare.sweep_report import sweep_page
from attlog.compare.tune_report import tune_page
from tests.compare import test_comparison_page, test_diff, test_sweep_report
from tests.compare.made import page_words
from tests.compare.test_tune import ABOUT as TUNED
from tests.compare.test_tune import noisy, tuned
from tests.report.browser import Visit
from tests.report.test_safety import EVIL


def comparison(name: str) -> str:
    found = test_comparison_page.made()
    if name == EVIL:
        for line in found.logs:
            line.vehicle = line.firmware = line.reference = EVIL
        found.logs[-1].name = found.logs[-1].reason = EVIL
        for question in found.questions:
            logs = question.contrasts[0].logs
            logs[0] = replace(logs[0], reason=EVIL, value=None)
        found.questions = [replace(question, title=EVIL) for question in found.questions]
        found.configurations[1].label = found.command = EVIL
    return render_comparison(found)


def diff(name: str) -> str:
    found = [test_diff.made(name, name), test_diff.made("y.json", name)]
    return diff_page(found, [("z.json", "old")], "a", "b", "1", "attlog diff a b")


def sweep(name: str) -> str:
    about = {"attlog": {"version": "1"}, "command": name, "logs": [dict.fromkeys(test_sweep_report.LOG, name)]}
    return sweep_page(test_sweep_report.swept("kp=0.1,0.2,0.4", "ki=0,0.01", name=name), about)


def tune(name: str) -> str:
    found = tuned([noisy(seed, 40.0) for seed in range(2)], ["kp=0.05..20log"], generations=1)
    return tune_page(replace(found, filter=name), TUNED)


@pytest.mark.slow
@pytest.mark.parametrize("page", [comparison, diff, sweep, tune])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_page_is_short_and_accessible(tmp_path: Path, browser: Any, page: Callable[[str], str], scheme: str) -> None:
    path = tmp_path / "page.html"
    path.write_text(page("a.bin"), encoding="utf-8")
    first, whole = page_words(browser, path, scheme)
    assert first <= 150
    assert whole <= 1000


@pytest.mark.slow
@pytest.mark.parametrize("page", [comparison, diff, sweep, tune])
def test_hostile_names_are_only_text(tmp_path: Path, browser: Any, page: Callable[[str], str]) -> None:
    path = tmp_path / "page.html"
    path.write_text(page(EVIL), encoding="utf-8")
    visit = Visit(browser, path)
    assert visit.page.title() != "ran"
    assert visit.complaints == []
    assert visit.requests == [path.as_uri()]
    visit.close()
