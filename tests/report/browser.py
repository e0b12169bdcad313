"""A real browser for the tests: the system's Chromium, headless, driven by playwright."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from attlog.report.bundle import bundle

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
REQUIRED = os.environ.get("ATTLOG_REQUIRE_BROWSER") == "1"
PATIENCE_MS = 120_000
"""A loaded machine with two cores may need long; a page that hangs still ends the test."""


def own_bytes(path: Path) -> int:
    """What a report weighs without the plotly.js in it, which is larger where the installation has no small bundle."""
    return path.stat().st_size - 4 * -(-len(bundle().packed) // 3)


def executable() -> str:
    """The browser's path; the test skips (or fails, where a browser is required) without one."""
    found = next((path for path in map(shutil.which, NAMES) if path), None)
    if found is None:
        missing("no Chromium on PATH (apt-get install chromium libatomic1)")
    return str(found)


def missing(why: str) -> None:
    """Skip, or fail where ATTLOG_REQUIRE_BROWSER=1 says that a browser has to be there."""
    if REQUIRED:
        pytest.fail(why)
    pytest.skip(why)


@contextmanager
def chromium() -> Iterator[Any]:
    """A running browser."""
    path = executable()
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        missing("playwright is not installed")
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-dev-shm-usage"])
        try:
            yield browser
        finally:
            browser.close()


class Visit:
    """A page opened from a file or an address, with everything it complained about and asked for."""

    def __init__(self, browser: Any, path: Path | str, *, ready: str = "html[data-drawn]", **options: Any) -> None:
        self.context = browser.new_context(**({"viewport": {"width": 1280, "height": 900}} | options))
        self.page = self.context.new_page()
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda m: self.complaints.append(f"{m.type}: {m.text}"))
        self.page.on("pageerror", lambda e: self.complaints.append(str(e)))
        self.page.on("request", lambda r: self.requests.append(r.url))
        self.page.set_default_timeout(PATIENCE_MS)
        self.page.goto(path.as_uri() if isinstance(path, Path) else path)
        if options.get("java_script_enabled", True):
            self.page.wait_for_selector(ready, state="attached")

    def figures(self) -> dict[str, bool]:
        """Every figure's place by id, and whether something visible is drawn in it when it is scrolled to."""
        late = "() => [...document.querySelectorAll('.plot:not([data-ready])')].map((p) => p.id)"
        for name in self.page.evaluate(late):
            self.page.evaluate("(id) => document.getElementById(id).scrollIntoView()", name)
            self.page.wait_for_selector(f"#{name}[data-ready]")
        return self.page.evaluate(
            """() => Object.fromEntries([...document.querySelectorAll('.plot')].map((p) => {
                const svg = p.querySelector('svg.main-svg');
                const marks = p.querySelectorAll('.scatterlayer path, .barlayer path, .scatterlayer text').length;
                return [p.id, !!svg && svg.getBoundingClientRect().height > 50 && marks > 0];
            }))"""
        )

    def range(self, figure: str) -> list[float]:
        """The time range a figure shows now."""
        return self.page.evaluate(f"() => document.getElementById('{figure}')._fullLayout.xaxis.range.map(Number)")

    def visible(self, figure: str) -> dict[str, bool]:
        """Rows drawn in a figure by number, and whether they are shown."""
        return self.page.evaluate(
            f"""() => Object.fromEntries(document.getElementById('{figure}').data
                .filter((t) => t.meta !== undefined && t.meta !== null)
                .map((t) => [String(t.meta), t.visible !== false]))"""
        )

    def close(self) -> None:
        """End the visit."""
        self.context.close()
