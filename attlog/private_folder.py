"""Where is kept what this machine made for itself and runs again? In a folder that nobody else can write into."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path


def private_folder(kind: str, version: str) -> Path | None:
    """The folder for things of this kind and version: in the user's cache, else a temporary one; None if neither is.

    It exists, can be written, and belongs to the user alone.
    """
    import platformdirs

    user = Path(platformdirs.user_cache_dir("attlog")) / kind / version
    temporary = Path(tempfile.gettempdir()) / f"attlog-{kind}-{_user()}" / version
    return next((folder for folder in (user, temporary) if usable(folder)), None)


def usable(folder: Path) -> bool:
    """True if the folder can be made and written and nobody else can put code into it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
        return _private(folder) and _private(folder.parent)
    except OSError:
        return False


def _private(folder: Path) -> bool:
    """True if the folder belongs to the user and is not writable by others (POSIX; elsewhere True)."""
    if not hasattr(os, "getuid"):
        return True
    info = folder.stat()
    return info.st_uid == os.getuid() and not info.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _user() -> str:
    return str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
