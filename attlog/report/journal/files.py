"""Every figure of a result as files: SVG for papers, PNG for slides."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from attlog.base.errors import OutputError
from attlog.base.files.output import staged
from attlog.report.journal.browser import pictures
from attlog.report.journal.pictures import Album
from attlog.result import Result


def write_figures(result: Result, start: Path) -> list[Path]:
    """Write ``START_NAME.svg`` and ``.png`` for every figure; the files. All appear, or none does.

    OutputError where no browser is found (see :func:`attlog.report.journal.browser.browser`), where it fails, or where
    a file cannot be written.
    """
    album = Album.of(result)
    drawn = {name: plain(album.drawn(name)) for name in album.found}
    for figure in drawn.values():
        for i, trace in enumerate(figure["data"]):
            trace["uid"] = str(i)  # else plotly names it by chance, and no two files are equal
    with staged(start.parent) as stage:
        for name, picture in pictures(drawn, stage.parent).items():
            path = stage / f"{start.name}_{name}"
            _write(path.with_name(path.name + ".svg"), picture.svg.encode("utf-8"))
            _write(path.with_name(path.name + ".png"), picture.png)
        return sorted(start.parent / path.name for path in stage.iterdir())


def plain(value: Any) -> Any:
    """A figure as JSON takes it: lists for arrays, null for what is not finite."""
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
