"""The page of a sweep: sentences, figures, tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from attlog.compare import page
from attlog.compare.grid import text_of
from attlog.compare.sweep import Sweep
from attlog.compare.sweep_figures import figures
from attlog.compare.sweep_words import log_rows, references_of, rows, sentences
from attlog.present.numbers import counted
from attlog.present.text import clean


def sweep_page(s: Sweep, about: Mapping[str, Any]) -> str:
    """The page as text; ``about``: version, command and logs as in the JSON."""
    title = f"{clean(s.filter)}: {counted(len(s.grid), 'setting')} on {counted(len(s.logs), 'log')}"
    told = f"attlog {about['attlog']['version']} · {clean(str(about['command']))}"
    return page.page("sweep", title, told, _parts(s, about))


def _parts(s: Sweep, about: Mapping[str, Any]) -> Iterator[str]:
    yield page.said(map(clean, sentences(s, references_of(about))))
    yield page.heading("Figures")
    yield page.figures((clean(caption), drawing) for caption, drawing in figures(s))
    yield page.heading("Settings")
    yield page.table(rows(s), left=0)
    single = s.columns[0].single
    if single is not None:
        yield page.said(["The best setting, ready to paste:"])
        own = text_of(s.settings[single])
        yield page.code(f"attlog analyze LOG --estimators {s.filter}{',' if ':' in s.filter else ':'}{own}")
    if len(s.logs) > 1:
        for column in (c for c in s.columns if c.single is not None):
            yield page.heading(f"Each log: {column.metric.title}")
            yield page.table(log_rows(s, column), left=2)
    yield page.heading("Logs")
    head = ["log", "vehicle", "firmware", "compared with"]
    yield page.table(
        (head, [[clean(str(log[k])) for k in ("name", "vehicle", "firmware", "reference")] for log in about["logs"]]),
        left=3,
    )
