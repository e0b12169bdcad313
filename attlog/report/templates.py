"""Templates of pages; imports jinja2, so import it late."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemBytecodeCache, FileSystemLoader, Template
from jinja2.bccache import Bucket

from attlog import __version__
from attlog.core.files import installed_version, private_folder
from attlog.words.text import clean

WEB = Path(__file__).parent / "web"


def template(name: str, filters: Mapping[str, Callable[..., Any]], folder: Path | None = None) -> Template:
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
