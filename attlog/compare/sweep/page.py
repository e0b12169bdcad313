"""The page of a sweep: sentences, figures, tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from attlog.compare.sweep.figures import figures
from attlog.compare.sweep.grid import text_of
from attlog.compare.sweep.sweep import Sweep
from attlog.compare.sweep.text import document, log_rows, references_of, rows, sentences
from attlog.compare.tables.settings_page import PageSection, SettingsPage, render
from attlog.present.numbers import counted


def sweep_page(s: Sweep, about: Mapping[str, Any]) -> str:
    """The page as text; ``about``: version, command and logs as in the JSON."""
    title = f"{s.filter}: {counted(len(s.grid), 'setting')} on {counted(len(s.logs), 'log')}"
    subtitle = f"attlog {about['attlog']['version']} · {about['command']}"
    said = list(sentences(s, references_of(about)))
    return render(SettingsPage("sweep", title, subtitle, said, document(s, dict(about)), list(_sections(s, about))))


def _sections(s: Sweep, about: Mapping[str, Any]) -> Iterator[PageSection]:
    yield PageSection("Figures", figures=figures(s))
    yield PageSection("Settings", table=rows(s))
    single = s.columns[0].single
    if single is not None:
        own = text_of(s.settings[single])
        paste = f"attlog analyze LOG --estimators {s.filter}{',' if ':' in s.filter else ':'}{own}"
        yield PageSection("The best setting, ready to paste", code=paste)
    if len(s.logs) > 1:
        for column in (c for c in s.columns if c.single is not None):
            yield PageSection(f"Each log: {column.metric.title}", table=log_rows(s, column), left=2)
    keys = ("name", "vehicle", "firmware", "reference")
    logs = [[str(log[k]) for k in keys] for log in about["logs"]]
    yield PageSection("Logs", table=(["log", "vehicle", "firmware", "compared with"], logs), left=3)
