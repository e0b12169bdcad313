"""A page about settings of one filter: figures, the sentences under them, tables; drawn by the report's machinery."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from attlog.base.plain import plain
from attlog.report import shell
from attlog.report.figures.figure import PageFigure
from attlog.report.pack import Store

OWN = Path(__file__).parents[1] / "web"
Table = tuple[Sequence[str], Sequence[Sequence[str]]]


@dataclass(slots=True)
class PageSection:
    """What stands under a heading: figures, sentences, text to be copied, a table whose first ``left`` columns and last
    hold words. ``folded``: only the title is shown at first."""

    title: str
    code: str = ""
    figures: Sequence[PageFigure] = ()
    said: Sequence[str] = ()
    table: Table | None = None
    left: int = 1
    folded: bool = False


@dataclass(slots=True)
class SettingsPage:
    """``name`` begins the names of tables saved from it; ``document`` is the JSON that can be saved, which holds
    version and command."""

    name: str
    title: str
    document: dict[str, Any]
    sections: list[PageSection] = field(default_factory=list)


def render(page: SettingsPage) -> str:
    """The page as text: nothing in it is loaded from anywhere."""
    return shell.render(
        "settings.html",
        OWN,
        rows=[],
        figures=[figure for section in page.sections for figure in section.figures],
        store=Store(),
        document=plain(page.document),
        scripts=("settings.js",),
        styles=("settings.css",),
        page=page,
    )
