"""Outputs that are kept as files and reviewed as diffs: ``ATTLOG_GOLDEN=1 pytest ...`` writes them anew."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path


def check_golden(file: Path, text: str | Iterable[str]) -> None:
    """Compare a text, or lines, with the file that holds what was last reviewed."""
    text = text if isinstance(text, str) else "".join(f"{line}\n" for line in text)
    if os.environ.get("ATTLOG_GOLDEN"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    assert text == file.read_text(encoding="utf-8")
