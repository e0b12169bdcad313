"""Numbers of many seeds, and what their interval says about a claim."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

from attlog.reproduce import page, paper
from attlog.reproduce.paper import PaperNumber, Verdict, paper_json
from tests.report.browser import Visit
from tests.reproduce.made import EVIL
from tests.reproduce.made import paper as made_paper

VALUES = list(np.random.default_rng(1).normal(3.0, 0.5, 20))
OTHERS = list(np.random.default_rng(2).normal(4.0, 0.5, 20))


def test_a_mean_has_students_interval() -> None:
    found = paper.mean("spread", VALUES, "deg")
    ends = stats.t.interval(0.95, 19, np.mean(VALUES), stats.sem(VALUES))
    assert (found.value, *found.ci95) == pytest.approx((np.mean(VALUES), *ends))
    assert found.n == 20


def test_seeds_without_a_number_are_not_counted() -> None:
    found = paper.mean("rise", [*VALUES, math.nan], "s")
    assert found == paper.mean("rise", VALUES, "s")
    assert paper.mean("rise", [math.nan], "s") == PaperNumber("rise", None, "s", None, 0)


def test_a_ratio_is_paired_and_has_the_interval_of_its_logarithm() -> None:
    found = paper.ratio("spread", VALUES, OTHERS)
    logs = np.log(np.array(VALUES) / np.array(OTHERS))
    ends = stats.t.interval(0.95, 19, logs.mean(), stats.sem(logs))
    assert (found.value, *found.ci95) == pytest.approx(tuple(np.exp([logs.mean(), *ends])))
    inverse = paper.ratio("spread", OTHERS, VALUES)
    assert inverse.value == pytest.approx(1 / found.value)


def test_equal_runs_have_a_ratio_of_one_without_width() -> None:
    assert paper.ratio("spread", VALUES, VALUES) == PaperNumber("spread", 1.0, "ratio", (1.0, 1.0), 20)


def test_a_difference_of_pairs_knows_nothing_of_what_both_share() -> None:
    shared = np.linspace(-100.0, 100.0, 20)
    found = paper.difference("lag", list(np.array(VALUES) + shared), list(shared), "ms")
    assert found.ci95 == pytest.approx(paper.mean("lag", VALUES, "ms").ci95)


@pytest.mark.parametrize("hits", [0, 7, 20])
def test_a_share_has_wilsons_interval(hits: int) -> None:
    found = paper.share_of_seeds("hovers", [k < hits for k in range(20)])
    ends = stats.binomtest(hits, 20).proportion_ci(method="wilson")
    assert (found.value, *found.ci95) == pytest.approx((5.0 * hits, 100 * ends.low, 100 * ends.high), abs=1e-4)


@pytest.mark.parametrize(
    ("ends", "smaller", "larger"),
    [
        ((0.5, 0.9), "holds", "does not hold"),
        ((1.1, 1.9), "does not hold", "holds"),
        ((0.9, 1.1), "cannot be judged", "cannot be judged"),
        ((1.0, 1.0), "does not hold", "does not hold"),
        (None, "cannot be judged", "cannot be judged"),
    ],
)
def test_a_claim_about_a_size_needs_the_whole_interval(ends: tuple[float, float] | None, smaller: str, larger: str):
    number = PaperNumber("ratio", 1.0, "ratio", ends, 20)
    assert paper.below(number, 1.0) == smaller
    assert paper.above(number, 1.0) == larger


@pytest.mark.parametrize(
    ("parts", "whole"),
    [
        (["holds", "holds"], "holds"),
        (["holds", "does not hold"], "holds in part"),
        (["holds", "cannot be judged"], "holds in part"),
        (["does not hold", "cannot be judged"], "does not hold"),
        (["does not hold", "does not hold"], "does not hold"),
        (["cannot be judged"], "cannot be judged"),
        (["holds in part", "does not hold"], "holds in part"),
    ],
)
def test_parts_make_a_whole(parts: list[paper.Verdict], whole: str) -> None:
    assert paper.combine_verdicts(parts) == whole


@pytest.mark.parametrize(
    ("verdicts", "said"),
    [
        (["holds", "holds"], "holds"),
        (["holds", "does not hold"], "holds in part"),
        (["cannot be judged", "holds"], "holds in part"),
        (["cannot be judged", "does not hold"], "cannot be judged"),
        (["does not hold", "does not hold"], "does not hold"),
    ],
)
def test_readings_of_what_is_not_printed_refute_a_claim_only_all_together(verdicts: list[Verdict], said: str) -> None:
    assert paper.combine_readings(verdicts) == said


# The page of a paper: whole, self-contained, drawn in a browser, and hostile names are only text.


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("paper") / "made.html"
    page.write_page(made_paper(), place)
    return place


def test_the_claims_stand_in_a_table_ahead_of_the_figures(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert "20 % quieter: 0.8° against 1.0°." in text
    assert EVIL not in text
    table = text[text.index('<table class="cmp claims">') : text.index('id="figures"')]
    rows = re.findall(r"<tr><th scope=\"row\">(.*?)</tr>", table, re.S)
    shown = [re.sub(r"<[^>]+>", " ", row).split() for row in rows]
    expected = [
        f"{k}. {c.says} {c.where} {'0.5°' if c.paper else 'no number'} 0.80× (0.70 to 0.90; 20) "
        f"{c.numbers[0].what} {c.verdict}"
        for k, c in enumerate(made_paper().claims, 1)
    ]
    assert shown == [words.split() for words in expected]
    silent = page.render_paper(replace(made_paper(), claims=made_paper().claims[1:]))
    assert ">Its number<" in text
    assert ">Its number<" not in silent
    assert "it prints no numbers" in silent


@pytest.mark.parametrize(
    ("value", "ci95", "unit", "text"),
    [
        (0.42, (0.4, 0.44), "deg", "0.42° (0.40 to 0.44; 20)"),
        (0.0002, (-0.0004, 0.0004), "deg", "below 0.001° (20)"),
        (0.0, (0.0, 0.0), "deg", "0° (20)"),
        (0.0, (0.0, 0.0), "s", "0 s (20)"),
        (None, None, "deg", "not measurable"),
        (2.0, None, "ratio", "2.00×"),
    ],
)
def test_a_number_stands_with_its_interval_and_its_flights(
    value: float | None, ci95: tuple[float, float] | None, unit: str, text: str
) -> None:
    assert page.number_text(PaperNumber("x", value, unit, ci95, 20)) == text


def test_the_document_holds_claims_and_no_points_of_figures() -> None:
    told = json.loads(paper_json(made_paper()))
    assert told["schema"] == "attlog-paper/1"
    assert told["claims"][0]["numbers"][0] == {
        "what": "spread, ours over theirs",
        "value": 0.8,
        "unit": "ratio",
        "ci95": [0.7, 0.9],
        "n": 20,
    }
    assert "lines" not in told["figures"][0]


def test_it_opens_without_complaint_or_request_and_draws_every_figure(browser: Any, path: Path) -> None:
    visit = Visit(browser, path)
    assert visit.complaints == []
    assert visit.requests == [path.as_uri()]
    assert visit.figures() == {"tilt": True, "spread": True}
    titles = visit.page.evaluate("() => document.getElementById('tilt').layout.yaxis2.title.text")
    assert titles == "heading, °"
    visit.page.click(".lg:has-text('first filter')")
    assert visit.visible("tilt") == {"0": True, "1": False, "2": True}
    assert visit.visible("spread") == {"1": False}
    visit.close()


@pytest.mark.slow
def test_a_figure_shows_what_it_was_given(browser: Any, path: Path) -> None:
    visit = Visit(browser, path)
    drawn = visit.page.evaluate("() => document.getElementById('spread').data[0]")
    assert drawn["y"] == [1, 2, 3]
    assert drawn["error_y"]["array"] == [0.5, 0.5, 0.5]
    truth = visit.page.evaluate("() => document.getElementById('tilt').data.find((t) => t.meta === 0)")
    assert max(truth["y"]) == pytest.approx(1.0, abs=1e-3)
    assert visit.range("tilt") == pytest.approx([0.0, 9.99])
    visit.close()


@pytest.mark.slow
def test_axe_finds_no_violation_and_a_phone_never_scrolls_sideways(browser: Any, path: Path) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright")
    visit = Visit(browser, path, color_scheme="dark", viewport={"width": 390, "height": 844}, has_touch=True)
    assert visit.page.evaluate("document.documentElement.scrollWidth") == 390
    for details in visit.page.query_selector_all("details"):
        details.evaluate("d => { d.open = true; }")
    found = axe.Axe().run(visit.page)
    assert [(v["id"], v["nodes"][0]["html"][:120]) for v in found.response["violations"]] == []
    visit.close()
