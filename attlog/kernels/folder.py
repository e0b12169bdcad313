"""Where is machine code kept that this machine made? In a folder that nobody else can write."""

from __future__ import annotations

import functools
import os
import platform
import stat
import sys
import tempfile
from pathlib import Path

import attlog


@functools.lru_cache(maxsize=1)
def folder() -> Path | None:
    """The user's cache, a private temporary folder, or None."""
    import platformdirs

    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    version = f"attlog-{attlog.__version__}-python-{python}-numba-{numba_version()}-{platform.machine()}"
    user = Path(platformdirs.user_cache_dir("attlog")) / "kernels" / version
    temporary = Path(tempfile.gettempdir()) / f"attlog-kernels-{_user()}" / version
    return next((f for f in (user, temporary) if usable(f)), None)


@functools.lru_cache(maxsize=1)
def numba_version() -> str:
    """The installed compiler's version, asked without importing it."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("numba")
    except PackageNotFoundError:
        return "none"


def usable(folder: Path) -> bool:
    """True if the folder can be made and written and nobody else can put code into it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
        return _private(folder) and _private(folder.parent)
    except OSError:
        return False


def write(path: Path, content: bytes) -> None:
    """Write atomically, with a fixed time stamp: numba compares it, and two writers must agree."""
    handle, temporary = tempfile.mkstemp(prefix=f".{path.stem}.", dir=path.parent)
    with os.fdopen(handle, "wb") as file:
        file.write(content)
    os.utime(temporary, (1, 1))
    os.replace(temporary, path)


def _private(folder: Path) -> bool:
    """True if the folder belongs to the user and is not writable by others (POSIX; elsewhere True)."""
    if not hasattr(os, "getuid"):
        return True
    info = folder.stat()
    return info.st_uid == os.getuid() and not info.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _user() -> str:
    return str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
