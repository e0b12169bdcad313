"""A page of another room drawn by the report's machinery: its style, its script, its packed data, its policy."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from attlog.report.bundle import ArrayPacker, bundle, packed
from attlog.report.figures.canvas import PageFigure
from attlog.report.page import SCRIPTS, WEB, policy
from attlog.words.numbers import counted, duration
from attlog.words.text import cleaned, typeset

NO_MARKS: dict[str, Any] = {
    "range": [0, 1],
    "modes": [],
    "armed": [],
    "airborne": [],
    "texts": [],
    "rest": [],
    "impact": [],
    "gaps": [],
    "resets": [],
}
"""What figures over flight time would show; pages of several flights have none."""
FILTERS: dict[str, Callable[..., Any]] = {"typeset": typeset, "duration": duration, "counted": counted}


def render(
    template: str,
    folder: Path,
    *,
    rows: Sequence[dict[str, Any]],
    figures: Iterable[PageFigure],
    store: ArrayPacker,
    document: Any,
    scripts: Sequence[str] = (),
    styles: Sequence[str] = (),
    **words: Any,
) -> str:
    """The page as text. ``template``, ``scripts`` (run before the page starts to draw), ``styles`` stand in ``folder``.

    ``rows``: name, slot, dash, shown, onboard, lost of each line; ``document``: the JSON that can be saved from the
    page; ``words``: what else the template wants.
    """
    from attlog.report.templates import template as compiled

    plot = bundle()
    header = {
        "rows": cleaned(rows),
        "marks": NO_MARKS,
        "figures": {f.id: {"kind": f.kind, "height": f.height} | cleaned(f.data) for f in figures},
    }
    style = "".join(
        file.read_text(encoding="utf-8") for file in (WEB / "style.css", *(folder / name for name in styles))
    )
    *drawing, start = [WEB / name for name in SCRIPTS]
    parts = [file.read_text(encoding="utf-8") for file in (*drawing, *(folder / name for name in scripts), start)]
    script = "\n".join(["'use strict';(() => {", *parts, "})();", ""])
    text = json.dumps(document, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return compiled(template, FILTERS, folder).render(
        policy=policy(plot, style, script),
        style=style,
        script=script,
        rows=rows,
        data=store.pack(header),
        json=packed(text.encode("utf-8", "replace")),
        bundle=base64.b64encode(plot.packed).decode(),
        **words,
    )
