"""Pages about parameter sets: figures, sentences and tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from attlog.compare.tables import TableCells
from attlog.core.plain import to_plain
from attlog.report import shell
from attlog.report.figures.figure import PageFigure

WEB_FOLDER = Path(__file__).parent / "web"


@dataclass(slots=True)
class PageSection:
    """Heading with figures, sentences, text to copy and a table.

    ``folded``: show only the heading initially. The first ``left`` columns of the table and the last hold words.
    """

    title: str
    code: str = ""
    figures: Sequence[PageFigure] = ()
    said: Sequence[str] = ()
    table: TableCells | None = None
    left: int = 1
    folded: bool = False


def render_sections(name: str, title: str, document: dict[str, Any], sections: Sequence[PageSection]) -> str:
    """Return a self-contained page.

    ``name`` begins the file names of saved tables. ``document``: JSON of the page.
    """
    return shell.render(
        "settings.html",
        WEB_FOLDER,
        rows=[],
        figures=[figure for section in sections for figure in section.figures],
        document=to_plain(document),
        scripts=("settings.js",),
        styles=("settings.css",),
        name=name,
        title=title,
        about=document,
        sections=sections,
    )


def titled(name: str, unit: str) -> str:
    """Append the unit to a name, behind a comma."""
    return f"{name}, {unit}" if unit else name
