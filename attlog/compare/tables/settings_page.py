"""A page about settings of one filter: sentences, figures and tables in an order, drawn by the report's machinery."""

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
    """What stands under a heading: text to be copied, figures, a table whose first ``left`` columns and last hold
    words."""

    title: str
    code: str = ""
    figures: Sequence[PageFigure] = ()
    table: Table | None = None
    left: int = 1


@dataclass(slots=True)
class SettingsPage:
    """``name`` begins the names of tables saved from it; ``document`` is the JSON that can be saved; ``subtitle``: the
    version and the command."""

    name: str
    title: str
    subtitle: str
    said: Sequence[str]
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
