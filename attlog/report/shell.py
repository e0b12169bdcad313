"""Frame of a page with figures: style, script, packed data, content-security policy."""

from __future__ import annotations

import base64
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

from jinja2 import Environment, FileSystemBytecodeCache, FileSystemLoader, Template
from jinja2.bccache import Bucket

from attlog import __version__
from attlog.core.files import installed_version, private_folder
from attlog.report.bundle import ArrayPacker, Bundle, bundle, packed, source_hash
from attlog.report.figures.figure import PageFigure, figure_data
from attlog.report.figures.style import RowStyle
from attlog.words.numbers import counted, duration
from attlog.words.text import clean, cleaned, typeset

WEB = Path(__file__).parent / "web"
# Scripts of the page, joined in this order; a page's own scripts are inserted before the last.
SCRIPTS = (
    *("unpack.js", "theme.js", "reduce.js", "plots.js", "spreadsheet.js", "export.js"),
    *("signals.js", "reading.js", "page.js"),
)
# Empty marks of the time axis, for pages of several flights.
MARKS = ("modes", "armed", "airborne", "texts", "rest", "impact", "gaps", "resets")
NO_MARKS: dict[str, Any] = {"range": [0, 1], **{name: [] for name in MARKS}}
FILTERS: dict[str, Callable[..., Any]] = {"typeset": typeset, "duration": duration, "counted": counted}


def render(
    template: str,
    folder: Path | None = None,
    *,
    rows: Sequence[RowStyle],
    figures: Iterable[PageFigure],
    document: str,
    scripts: Sequence[str] = (),
    styles: Sequence[str] = (),
    filters: dict[str, Callable[..., Any]] = FILTERS,
    marks: dict[str, Any] = NO_MARKS,
    more: Mapping[str, Any] = MappingProxyType({}),
    log: str = "",
    plot: Bundle | None = None,
    **words: Any,
) -> str:
    """Return the page as text.

    ``template``, ``scripts`` and ``styles`` are in ``folder``, else in this package. ``document``: JSON text that
    can be saved from the page. ``more``: other values for the script. ``log`` begins the names of saved
    files. ``words``: variables of the template.
    """
    plot, packer = plot or bundle(), ArrayPacker()
    header = {
        "rows": [row_header(row) for row in rows],
        "log": log,
        "marks": cleaned(marks),
        "figures": {f.id: figure_header(f, packer) for f in figures},
    } | cleaned(dict(more))
    own = folder or WEB
    style = "".join(file.read_text(encoding="utf-8") for file in (WEB / "style.css", *(own / name for name in styles)))
    *drawing, start = [WEB / name for name in SCRIPTS]
    parts = [file.read_text(encoding="utf-8") for file in (*drawing, *(own / name for name in scripts), start)]
    script = "\n".join(["'use strict';(() => {", *parts, "})();", ""])
    return load_template(template, filters, folder).render(
        policy=policy(plot, style, script),
        style=style,
        script=script,
        rows=rows,
        data=packer.pack(header),
        json=packed(document.encode("utf-8", "replace")),
        bundle=base64.b64encode(plot.packed).decode(),
        bundle_name=plot.name,
        **words,
    )


def figure_header(figure: PageFigure, packer: ArrayPacker) -> dict[str, Any]:
    """Return a figure for the script; its arrays go to the packer."""
    return {"kind": figure.kind, "height": figure.height} | figure_data(figure.data, packer)


def row_header(row: RowStyle) -> dict[str, Any]:
    """Return the style of a row for the script."""
    named = {"name": clean(row.name), "slot": row.slot, "dash": row.dash}
    return named | {"shown": row.shown, "onboard": row.onboard, "lost": row.lost}


def policy(plot: Bundle, style: str, script: str) -> str:
    """Return the content-security policy: own script, style and bundle by hash, no requests."""
    scripts = [plot.hash, source_hash(script.encode("utf-8"))]
    styles = [source_hash(style.encode("utf-8")), *plot.styles]
    quoted = [" ".join(f"'{h}'" for h in hashes) for hashes in (scripts, styles)]
    return (
        f"default-src 'none'; script-src {quoted[0]}; style-src {quoted[1]}; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )


def load_template(name: str, filters: Mapping[str, Callable[..., Any]], folder: Path | None = None) -> Template:
    """Load a template of this package, or of ``folder``.

    Templates of ``folder`` may include those of this package. Compiled templates are cached in a folder of the user,
    because compiling takes 0.13 CPU s per page.
    """
    version = f"attlog-{__version__}-{sys.implementation.cache_tag}-jinja-{installed_version('jinja2')}"
    kept = private_folder("templates", version)
    environment = Environment(
        loader=FileSystemLoader([WEB] if folder is None else [folder, WEB]),
        autoescape=True,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=None if kept is None else TemplateCache(str(kept)),
    )
    environment.filters |= filters
    return environment.get_template(name)


def shown(value: Any) -> Any:
    """Clean texts before jinja escapes them; leave attlog's own markup unchanged."""
    return value if hasattr(value, "__html__") or not isinstance(value, str) else clean(value)


class TemplateCache(FileSystemBytecodeCache):
    """Cache of compiled templates; an unwritable folder is no error."""

    def dump_bytecode(self, bucket: Bucket) -> None:
        with suppress(OSError):
            super().dump_bytecode(bucket)
