"""Every figure of a result as files: SVG for papers, PNG for slides."""

from __future__ import annotations

import json
from pathlib import Path

from attlog.base.errors import OutputError
from attlog.base.files.output import staged
from attlog.report.journal.browser import pictures
from attlog.report.journal.pictures import figure, figures
from attlog.result import Result


def write_figures(result: Result, start: Path) -> list[Path]:
    """Write ``START_NAME.svg`` and ``.png`` for every figure; the files. All appear, or none does.

    OutputError where no browser is found (see :func:`attlog.report.journal.browser.browser`), where it fails, or where
    a file cannot be written.
    """
    drawn = {name: json.loads(figure(result, name).to_json()) for name in figures(result)}
    with staged(start.parent) as stage:
        for name, picture in pictures(drawn, stage.parent).items():
            path = stage / f"{start.name}_{name}"
            _write(path.with_name(path.name + ".svg"), picture.svg.encode("utf-8"))
            _write(path.with_name(path.name + ".png"), picture.png)
        return sorted(start.parent / path.name for path in stage.iterdir())


def _write(path: Path, content: bytes) -> None:
    try:
        path.write_bytes(content)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from error
