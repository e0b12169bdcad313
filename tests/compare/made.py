"""Results made by hand: one row with some answers."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from attlog.compare.comparison import Comparison, LogLine, Question, SettingAnswer, select_questions
from attlog.compare.paired import Difference
from attlog.compare.run import LogComparison, gather
from attlog.compare.setting import Configuration, parse_configuration
from attlog.result import EstimatorRow, ParameterValue, Result
from tests.report.browser import Visit
from tests.words.made import Metrics, row


def result(*rows: EstimatorRow, sha: str = "a", version: str = "1", **changes: Any) -> Result:
    """A result of a log with this hash."""
    log = {
        "name": "x.bin",
        "sha256": sha,
        "firmware": {"name": "F", "version": version},
        "params": {"P": 1.0, "Q": 2.0},
    }
    values = {"config": {"window": "all"}, "log": log | changes.pop("log", {})} | changes
    return Result({"version": version}, "", values["config"], values["log"], estimators=list(rows))


def filtered(metrics: Metrics, name: str = "mahony", kp: float = 0.6, **changes: Any) -> EstimatorRow:
    """A row of a filter with one gain."""
    return row(name, metrics, parameters={"kp": ParameterValue(kp, "default", "1/s")}, **changes)


# What every page of this room has to stand: no complaint, no request, no sideways scroll, nothing that axe refuses.

WORDS = r"""(height) => {
    let first = 0, all = 0;
    const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    for (let n = texts.nextNode(); n; n = texts.nextNode()) {
        const place = document.createRange();
        place.selectNodeContents(n);
        const box = place.getBoundingClientRect();
        if (n.parentElement.closest('script, style, noscript, .vh')) continue;
        if (box.width < 2 || box.height < 2 || !n.parentElement.checkVisibility()) continue;
        const count = (n.textContent.match(/\S*[A-Za-z]\S*/g) || []).length;
        all += count;
        if (box.top < height) first += count;
    }
    return [first, all];
}"""


def page_words(browser: Any, path: Path, scheme: str) -> tuple[int, int]:
    """Open a page, unfold all of it and let axe look; words on its first screen and on the page as opened."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    visit = Visit(browser, path, color_scheme=scheme, viewport={"width": 1280, "height": 800})
    words = tuple(visit.page.evaluate(WORDS, 800))
    for details in visit.page.query_selector_all("details"):
        details.evaluate("d => { d.open = true; }")
    found = axe.Axe().run(visit.page)
    assert [(v["id"], v["nodes"][0]["html"][:120]) for v in found.response["violations"]] == []
    visit.page.set_viewport_size({"width": 390, "height": 844})
    visit.page.wait_for_timeout(300)
    assert visit.page.evaluate("document.documentElement.scrollWidth") == 390
    assert visit.complaints == []
    assert visit.requests == [path.as_uri()]
    visit.close()
    return words


# Made-up comparisons: differences whose numbers are known, as every log would give them.

CONFIGURATIONS = [parse_configuration("mahony:kp=0.3"), parse_configuration("mahony:kp=0.6")]
FIRST, SECOND = (c.name for c in CONFIGURATIONS)


def difference(log: str, question: Question, change: float, half: float) -> Difference:
    """A difference (of the logarithm for ratios) with its interval; significant where that excludes none."""
    direction = "better" if change < 0.0 else "worse"
    if abs(change) <= half:
        direction = "same" if half == 0.0 else "not significant"
    ends = (change - half, change + half)
    if question.scale == "ratio":
        value, ends = math.exp(change), (math.exp(ends[0]), math.exp(ends[1]))
    else:
        value = change
    return Difference(
        question.scale,
        value,
        ends,
        1.0 if direction in ("same", "not significant") else 0.001,
        half / 2.0,
        direction=direction,  # type: ignore[arg-type]
        n=9,
        first=2.0,
        second=2.0 * value,
        better=int(change < 0.0),
        worse=int(change > 0.0),
        log=log,
        window=question.window,
    )


def comparison(
    changes: dict[str, list[tuple[float, float]]],
    configurations: list[Configuration] | None = None,
    broken: list[LogLine] | None = None,
    questions: list[Question] | None = None,
    factors: tuple[float, ...] = (1.0,),
) -> Comparison:
    """A comparison of configurations: by metric id, for each log (change, half interval).

    ``factors``: what the changes of each configuration after the first are multiplied by.
    """
    chosen = configurations or CONFIGURATIONS
    questions = questions or [next(q for q in select_questions() if q.metric == metric) for metric in changes]
    count = max(len(each) for each in changes.values())
    logs = []
    for k in range(count):
        one = LogComparison(LogLine(f"flight{k + 1}.ulg", f"flight{k + 1}.ulg"))
        for q in questions:
            each = changes[q.metric]
            one.cells[q.id] = {c.name: SettingAnswer(1.0, (0.9, 1.1), 9, q.window) for c in chosen}
            one.differences[q.id] = {
                c.name: difference(one.line.name, q, factor * each[k][0], each[k][1])
                if k < len(each)
                else Difference(q.scale, log=one.line.name, reason="no steps")
                for c, factor in zip(chosen[1:], factors, strict=True)
            }
        logs.append(one)
    logs += [LogComparison(line) for line in broken or []]
    return gather(chosen, logs, questions, attlog={"version": "0"}, command="attlog compare")
