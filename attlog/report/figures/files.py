"""Figure files drawn by Chrome or Chromium: SVG for papers, PNG for slides.

plotly needs a browser for an SVG; its own exporter (kaleido) starts one too. The page makes no network request.
"""

from __future__ import annotations

import base64
import json
import math
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import zlib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from attlog import __version__
from attlog.core.errors import OutputError
from attlog.core.files import staging_folder
from attlog.core.own_files import FIGURES, require_replaceable
from attlog.report.bundle import bundle
from attlog.report.figures.catalogue import Album
from attlog.result import Result

DRIVER = Path(__file__).parents[1] / "web" / "pictures.js"
BROWSER_NAMES = (
    *("chromium", "chromium-browser", "google-chrome-stable", "google-chrome", "chrome"),
    *("msedge", "microsoft-edge", "microsoft-edge-stable", "brave", "brave-browser"),
)
# Browsers outside the search path of some systems.
BROWSER_PATHS = (
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    r"C:\Program Files\Google\Chrome\Application\chrome.exe",
    r"C:\Program Files (x86)\Google\Chrome\Application\chrome.exe",
    r"C:\Program Files (x86)\Microsoft\Edge\Application\msedge.exe",
)
BROWSER_OPTIONS = (
    *("--headless", "--disable-gpu", "--hide-scrollbars", "--no-first-run", "--disable-extensions"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage"),
    *("--host-resolver-rules=MAP * ~NOTFOUND", "--virtual-time-budget=600000", "--dump-dom"),
)
DRAWING_TIMEOUT_S = 180.0
# Lowest resolution that journals accept. Lines are sharper in the SVG.
PNG_DPI = 300
# Signature and header chunk of a PNG, behind which its texts come.
PNG_HEADER_BYTES = 8 + 25
POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
ANSWER = re.compile(rb'<pre id="pictures">([A-Za-z0-9+/=]*)</pre>')


@dataclass(frozen=True, slots=True)
class Picture:
    """Figure as SVG text and PNG bytes."""

    svg: str
    png: bytes


def find_browser() -> str:
    """Find the browser of ``BROWSER_PATH``, else an installed one. OutputError without any."""
    asked = os.environ.get("BROWSER_PATH")
    found = (
        shutil.which(asked) if asked else next(filter(None, map(shutil.which, (*BROWSER_NAMES, *BROWSER_PATHS))), None)
    )
    if found is None:
        wrong = f"BROWSER_PATH {asked} is none" if asked else "none was found"
        raise OutputError(f"figures need Chrome, Chromium or Edge; {wrong}: install one, or set BROWSER_PATH to it")
    return found


def draw_pictures(figures: Mapping[str, dict[str, Any]], scratch: Path) -> dict[str, Picture]:
    """Draw figures (``data`` and ``layout``, plain JSON) by name, in one browser run.

    ``scratch``: folder for the page while it is drawn. Some browsers read only folders of the user. OutputError if the
    browser fails.
    """
    program = find_browser()
    with TemporaryDirectory(prefix=".attlog-figures.", dir=scratch, ignore_cleanup_errors=True) as folder:
        page = Path(folder) / "figures.html"
        page.write_text(_page(list(figures.values())), encoding="utf-8")
        drawn = _drawn(program, page)
    if len(drawn) != len(figures):
        raise OutputError(f"{program}: {len(drawn)} of {len(figures)} figures were drawn")
    return {
        name: Picture(_in_millimetres(_named(svg, name)), base64.b64decode(png))
        for name, (svg, png) in zip(figures, drawn, strict=True)
    }


def _page(figures: list[dict[str, Any]]) -> str:
    """Return a page that draws the figures, then replaces itself by their pictures."""
    data = json.dumps({"figures": figures, "scale": PNG_DPI / 96.0}, allow_nan=False).replace("<", "\\u003c")
    scripts = [bundle().script.decode("utf-8"), DRIVER.read_text(encoding="utf-8")]
    head = f'<meta charset="utf-8"><meta http-equiv="Content-Security-Policy" content="{POLICY}">'
    body = f'<script type="application/json" id="figures">{data}</script>'
    return f"<!DOCTYPE html><html><head>{head}</head><body>{body}{''.join(f'<script>{s}</script>' for s in scripts)}"


def _drawn(program: str, page: Path) -> list[list[str]]:
    """Return the pictures of the finished page."""
    command = [program, *BROWSER_OPTIONS, f"--user-data-dir={page.parent / 'profile'}", page.resolve().as_uri()]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        command.insert(1, "--no-sandbox")  # root can run it only like this; the page is attlog's own
    try:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
        )
    except OSError as error:
        raise OutputError(f"{program} does not start ({error}); set BROWSER_PATH to another browser") from error
    try:
        out, said = process.communicate(timeout=DRAWING_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        raise OutputError(f"{program} took longer than {DRAWING_TIMEOUT_S:g} s to draw figures") from None
    finally:
        _end(process)
    found = ANSWER.search(out)
    if found is None:
        last = said.decode("utf-8", "replace").strip().rpartition("\n")[2][:200]
        raise OutputError(
            f"{program} drew no figure ({last or 'it says nothing'}); set BROWSER_PATH to another browser"
        )
    answer = json.loads(base64.b64decode(found[1]))
    if isinstance(answer, str):
        raise OutputError(f"{program}: a figure could not be drawn: {answer[:200]}")
    return list(answer)


def _end(process: subprocess.Popen[bytes]) -> None:
    """Terminate a browser with its children, also on an interrupt."""
    if process.poll() is None:
        with suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL) if sys.platform != "win32" else process.kill()
        process.wait()


def _in_millimetres(svg: str) -> str:
    """Write the size in millimetres: programs disagree on the size of a pixel."""
    return re.sub(
        r'width="([\d.]+)" height="([\d.]+)"', lambda m: f'width="{_mm(m[1])}mm" height="{_mm(m[2])}mm"', svg, count=1
    )


def _mm(pixels: str) -> str:
    return f"{float(pixels) * 25.4 / 96.0:.2f}"


def _named(svg: str, name: str) -> str:
    """Replace plotly's random id, so that the same figure gives the same text."""
    chance = re.search(r'id="defs-(\w+)"', svg)
    return re.sub(rf'((?:id="|#)[\w-]*?){chance[1]}', rf"\g<1>{name}-", svg) if chance else svg


# Files of every figure of a result: SVG for papers, PNG for slides.


def write_figures(result: Result, start: Path, logs: Iterable[str] = ()) -> list[Path]:
    """Write ``START_NAME.svg`` and ``.png`` for every figure, all or none.

    ``logs``: SHA-256 of earlier states of the log, whose figures are replaced too.

    Returns the files. OutputError if no browser is found, if it fails, or if a file cannot be written.
    """
    album = Album.of(result)
    drawn = {name: plain(album.drawn(name)) for name in album.found}
    for figure in drawn.values():
        for i, trace in enumerate(figure["data"]):
            trace["uid"] = str(i)  # otherwise plotly assigns random ids, and no two files are equal
    log = str(result.log.get("sha256") or "")
    kind = FIGURES.of(log, *logs)
    for name in drawn:  # before a browser draws for seconds
        for suffix in ("svg", "png"):
            require_replaceable(start.parent / f"{start.name}_{name}.{suffix}", kind)
    with staging_folder(start.parent, kind) as stage:
        for name, picture in draw_pictures(drawn, stage.parent).items():
            path, signed = stage / f"{start.name}_{name}", sign_picture(picture, log)
            _write(path.with_name(path.name + ".svg"), signed.svg.encode("utf-8"))
            _write(path.with_name(path.name + ".png"), signed.png)
        return sorted(start.parent / path.name for path in stage.iterdir())


def sign_picture(picture: Picture, log: str) -> Picture:
    """Return a picture that names program and log (SHA-256), so that a later run knows its own files."""
    text = f"attlog {__version__}, log sha256:{log}"
    start, end = picture.svg.partition(">")[::2]
    kind, content = b"tEXt", f"Software\0{text}".encode("latin-1")
    chunk = struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
    after = PNG_HEADER_BYTES
    return Picture(f"{start}><!-- {text} -->{end}", picture.png[:after] + chunk + picture.png[after:])


def plain(value: Any) -> Any:
    """Convert a figure to JSON values: lists for arrays, null for non-finite numbers."""
    if isinstance(value, np.ndarray):
        return [x if math.isfinite(x) else None for x in value.tolist()]
    if isinstance(value, dict):
        return {name: plain(own) for name, own in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(own) for own in value]
    return value.item() if isinstance(value, np.generic) else value


def _write(path: Path, content: bytes) -> None:
    try:
        path.write_bytes(content)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from error
