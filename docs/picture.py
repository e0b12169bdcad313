"""The picture of a report's first screen with four callouts: python docs/picture.py REPORT.html [PICTURE.png]

Needs playwright, pillow and a Chromium on PATH. `make example` runs it on a report made for it.
"""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

from PIL import Image
from PIL.PngImagePlugin import PngInfo
from playwright.sync_api import sync_playwright

# What each part is for, by its place on the page.
CALLOUTS = {
    "#happened": "The flight in one sentence: what flew, when, what went wrong first, how it ended.",
    "#findings": "What to fix, the worst first. A click on a time shows it in the figures.",
    "#comparison": "A row for each filter, a column for each question. Dashed: the autopilot's own estimate; "
    "below it the same EKF run again.",
    "#table": "Every number with its 95 % interval. ● marks what none is significantly better than.",
}
WIDTH, MARGIN, HEIGHT = 1280, 270, 1200

DRAW = """([callouts, width, margin]) => {
  document.body.style.width = width + 'px';
  const main = document.getElementById('main');
  Object.entries(callouts).forEach(([place, text], number) => {
    const box = document.querySelector(place).getBoundingClientRect();
    const note = document.createElement('div');
    note.innerHTML = '<b></b><span></span>';
    note.firstChild.textContent = number + 1;
    note.lastChild.textContent = text;
    note.style.cssText = 'position:absolute;display:flex;gap:10px;align-items:flex-start;font:15px/1.35 sans-serif;'
      + `color:#7a2e0e;left:${width - 22}px;width:${margin}px;top:${box.top + window.scrollY + 8}px`;
    note.firstChild.style.cssText = 'flex:none;width:28px;height:28px;border-radius:50%;background:#b8430f;color:#fff;'
      + 'text-align:center;line-height:28px';
    document.body.append(note);
  });
}"""


def main(report: str, picture: str = str(Path(__file__).with_name("report.png"))) -> None:
    """Draw the page at 1280 pixels, with the callouts in a margin at its right."""
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": WIDTH + MARGIN, "height": HEIGHT}, bypass_csp=True)
        page.goto(Path(report).resolve().as_uri())
        page.evaluate(DRAW, [CALLOUTS, WIDTH, MARGIN])
        page.wait_for_timeout(500)
        page.screenshot(path=picture)
        browser.close()
    made_by = PngInfo()  # tests compare it with the version
    made_by.add_text("Software", version(Path(report).read_text(encoding="utf-8")))
    Image.open(picture).convert("RGB").quantize(128, dither=Image.Dither.NONE).save(
        picture, optimize=True, pnginfo=made_by
    )


def version(page: str) -> str:
    """Return the program and version named in the footer of a report."""
    found = re.search(r"Made by (attlog [^ <]+)\. ", page)
    if found is None:
        raise SystemExit("the page names no version: is it a report?")
    return found[1]


if __name__ == "__main__":
    main(*sys.argv[1:])
