"""How many words a page has: 150 on the first screen, 1,000 as it opens."""

from __future__ import annotations

import functools
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

import attlog
from attlog.report.bundle import bundle
from attlog.report.page import render
from tests.conftest import SAMPLES

FIRST, WHOLE = 150, 1000
FIRST_SCREEN = ("happened", "findings", "comparison")
SILENT = ("script", "style", "noscript", "title", "desc")
EMPTY = ("meta", "input", "br", "link", "img", "circle", "line", "rect", "path")


class Words(HTMLParser):
    """Counts words with a letter in what is seen before anything is opened, by section."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[tuple[str, dict[str, str | None]]] = []
        self.count: dict[str, int] = {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in EMPTY:
            self.open.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        while tag not in EMPTY and self.open and self.open.pop()[0] != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self.seen():
            footer = "footer" in [tag for tag, _ in self.open]
            inside = (
                "footer"
                if footer
                else next((a["id"] for t, a in self.open if t == "section" and a.get("id")), "top") or ""
            )
            self.count[inside] = self.count.get(inside, 0) + len(re.findall(r"\S*[A-Za-z]\S*", data))

    def seen(self) -> bool:
        """Whether the innermost text is shown: not in a closed details, not hidden, not for screen readers alone."""
        tags = [tag for tag, _ in self.open]
        if not tags or any(tag in SILENT for tag in tags):
            return False
        if any("hidden" in a or {"vh", "again"} & set((a.get("class") or "").split()) for _, a in self.open):
            return False
        closed = [i for i, (tag, a) in enumerate(self.open) if tag == "details" and "open" not in a]
        return all(i + 1 < len(tags) and tags[i + 1] == "summary" for i in closed)


def counted(page: str) -> tuple[int, int]:
    """Words of the first screen, and of the page as it opens."""
    reader = Words()
    reader.feed(page)
    first = sum(n for section, n in reader.count.items() if section in ("top", *FIRST_SCREEN))
    return first, sum(reader.count.values())


@functools.cache
def page(path: Path) -> str:
    return render(attlog.analyze(path), bundle())


def test_closed_parts_and_labels_for_screen_readers_do_not_count() -> None:
    text = "<main><section id='findings'><p>One two 3</p><details><summary>four</summary><p>five</p></details>"
    text += "<span class='vh'>six</span></section><section id='table'><p>seven</p></section></main>"
    assert counted(text) == (3, 4)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["copter_yaw_turns.bin", "px4_steps.ulg", "px4_hover.ulg", "copter_steps_stabilize.tlog"]
)
def test_a_page_of_a_healthy_flight_is_short(name: str) -> None:
    first, whole = counted(page(SAMPLES / name))
    assert first <= FIRST
    assert whole <= WHOLE


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["px4_1.14_clipping_crash.ulg", "copter_two_compasses.bin", "plane_px4_1.13_crash.ulg"]
)
def test_a_page_of_a_flight_with_trouble_is_short(corpus: Path, name: str) -> None:
    first, whole = counted(page(corpus / "logs" / "cases" / name))
    assert first <= FIRST + 25  # five findings of up to 18 words, each with what to do
    assert whole <= WHOLE + 100
