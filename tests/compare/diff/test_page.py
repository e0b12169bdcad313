"""The page of a difference: short, accessible, in the order of the terminal, and hostile names are only text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from attlog.compare.diff.changes import RunDifference
from attlog.compare.diff.diff import difference
from attlog.compare.diff.page import diff_page
from attlog.compare.diff.tolerance import Tolerances
from attlog.metrics.answer import Answer
from tests.compare.made import filtered, result
from tests.compare.pages import stands
from tests.present.made import lag, merged, noise, tilt
from tests.report.browser import Visit
from tests.report.test_safety import EVIL


def made(name: str = "x.json", text: str = "A crash.") -> RunDifference:
    many = ({"all": {f"noise_{k}_deg": Answer(v, "deg", "all") for k in range(30)}} for v in (1.0, 2.0))
    rows = [
        filtered(merged(tilt(t), noise(0.1), lag(1.0), more), kp=t) for t, more in zip((2.0, 4.0), many, strict=True)
    ]
    old, new = (result(row) for row in rows)
    old.headline, new.headline = "A flight.", text
    return difference(name, old, new, Tolerances())


def written(tmp_path: Path, *found: RunDifference) -> Path:
    path = tmp_path / "diff.html"
    path.write_text(diff_page(found, [("y.json", "old")], "a", "b", "1", "attlog diff a b"), encoding="utf-8")
    return path


def test_headline_numbers_by_question_and_causes_stand_in_this_order(tmp_path: Path) -> None:
    body = written(tmp_path, made()).read_text(encoding="utf-8")
    body = body[body.index("<main") :].replace("\u00a0", " ")
    places = [
        body.index(w)
        for w in ("A crash.", "Accuracy (1)", "Other numbers (30)", "28 more", "Filter gains", "No change")
    ]
    assert places == sorted(places)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("count", [1, 3])
def test_the_page_is_short_and_accessible(tmp_path: Path, browser: Any, scheme: str, count: int) -> None:
    path = written(tmp_path, *(made(f"x{k}.json") for k in range(count)))
    first, whole = stands(browser, path, scheme)
    assert first <= 150
    assert whole <= 1000


@pytest.mark.slow
def test_hostile_names_are_only_text(tmp_path: Path, browser: Any) -> None:
    path = written(tmp_path, made(EVIL, EVIL))
    visit = Visit(browser, path)
    assert visit.page.title() != "ran"
    assert visit.complaints == []
    assert visit.requests == [path.as_uri()]
    visit.close()
