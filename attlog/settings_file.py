"""Files that people write for attlog (options, scenarios, configurations, gates): their text and their TOML."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from attlog.errors import LogUnreadable, UsageError


def text_of(path: Path) -> str:
    """The text of a file, with or without a byte order mark. LogUnreadable if it cannot be opened, UsageError where
    it is no UTF-8."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise LogUnreadable(f"{path}: cannot be read ({error.strerror or error})") from error
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: no UTF-8 text at byte {error.start}") from error


def toml_of(text: str, path: Path) -> dict[str, Any]:
    """The values of a TOML text, which ``path`` names in what is told. UsageError with line and column."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{path}: not valid TOML: {error}") from error
