"""Did the files change from which a kernel's text is made? Asked at each start, so it must be cheap: 3 ms."""

from __future__ import annotations

import hashlib
import time
from functools import lru_cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent
STARTED = time.time()
"""When this module was loaded, which is before any text of a kernel is made."""


@lru_cache(maxsize=16)
def state(sources: tuple[str, ...]) -> str:
    """A hash of the Python files that ``sources``, files and folders below the package, hold now."""
    found = hashlib.sha256()
    for path in _files(sources):
        found.update(f"{path.relative_to(PACKAGE).as_posix()}\0".encode())
        found.update(_digest(path))
    return found.hexdigest()


@lru_cache(maxsize=256)
def _digest(path: Path) -> bytes:
    """The hash of one file: most kernels depend on the same folders."""
    return hashlib.sha256(path.read_bytes()).digest()


def edited(sources: tuple[str, ...]) -> bool:
    """True where a file may be another than the one this process has imported."""
    return any(path.stat().st_mtime >= STARTED - 2.0 for path in _files(sources))


def _files(sources: tuple[str, ...]) -> list[Path]:
    roots = [PACKAGE / name for name in sources]
    return sorted(p for root in roots for p in (root.rglob("*.py") if root.is_dir() else (root,)) if p.is_file())
