"""What every page of this room has to stand: no complaint, no request, no sideways scroll, nothing that axe refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.report.browser import Visit

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


def stands(browser: Any, path: Path, scheme: str) -> tuple[int, int]:
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
