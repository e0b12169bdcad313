"""Templates of pages, compiled once on a machine. Imports jinja2: import this where a page is made."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from jinja2 import BytecodeCache, Environment, FileSystemLoader, Template
from jinja2.bccache import Bucket

from attlog import __version__
from attlog.core.errors import OutputError
from attlog.core.files import installed_version, private_folder, write_atomic
from attlog.words.text import clean

WEB = Path(__file__).parent / "web"
DIGEST = hashlib.sha256().digest_size


def template(name: str, filters: Mapping[str, Callable[..., Any]], folder: Path | None = None) -> Template:
    """A template of this package, or of ``folder``, which may include those of this package.

    What jinja makes of its text is kept in a folder of the user's, where the next page finds it; a template that has
    changed is compiled anew.
    """
    kept = private_folder(
        "templates", f"attlog-{__version__}-{sys.implementation.cache_tag}-jinja-{installed_version('jinja2')}"
    )
    environment = Environment(
        loader=FileSystemLoader([WEB] if folder is None else [folder, WEB]),
        autoescape=True,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=None if kept is None else TemplateCache(kept),
    )
    environment.filters |= filters
    return environment.get_template(name)


def shown(value: Any) -> Any:
    """What the template puts in place of a value: texts cleaned (jinja escapes them), own markup as it is."""
    return value if hasattr(value, "__html__") or not isinstance(value, str) else clean(value)


class TemplateCache(BytecodeCache):
    """Compiled templates as files of a folder; a missing or damaged one is made again, a full disk is no error.

    They are code: one that is not as it was written (a checksum stands before it) is never run.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def load_bytecode(self, bucket: Bucket) -> None:
        try:
            content = (self._folder / bucket.key).read_bytes()
        except OSError:
            bucket.reset()
            return
        digest, code = content[:DIGEST], content[DIGEST:]
        if hashlib.sha256(code).digest() == digest:
            bucket.bytecode_from_string(code)
        else:
            bucket.reset()

    def dump_bytecode(self, bucket: Bucket) -> None:
        with suppress(OutputError):
            code = bucket.bytecode_to_string()
            write_atomic(self._folder / bucket.key, hashlib.sha256(code).digest() + code)
