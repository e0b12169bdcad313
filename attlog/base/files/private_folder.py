"""Where is kept what this machine made for itself and runs again? In a folder that nobody else can write into."""

from __future__ import annotations

import os
import stat
import tempfile
from functools import cache
from importlib.util import find_spec
from pathlib import Path

OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
TRUSTED = (0, 65_534)
"""Owners of the folders above: root, and whom a container shows in the place of an owner that it does not know."""


def private_folder(kind: str, version: str) -> Path | None:
    """The folder for things of this kind and version: in the user's cache, else a temporary one; None if neither is.

    It exists, can be written, and belongs to the user alone.
    """
    import platformdirs

    user = Path(platformdirs.user_cache_dir("attlog")) / kind / version
    if usable(user):
        return user
    try:
        temporary = Path(tempfile.gettempdir()) / f"attlog-{kind}-{_user()}" / version
    except OSError:  # no folder of the system's can be written either: a container that is read-only
        return None
    return temporary if usable(temporary) else None


@cache
def version_of(package: str) -> str:
    """The installed version of a package, for the name of a folder; "none" where there is none. Imports it not."""
    spec = find_spec(package)
    beside = Path(spec.origin).parents[1].iterdir() if spec is not None and spec.origin else ()
    names = [path.stem for path in beside if path.suffix == ".dist-info"]
    found = [name for name in names if name.lower().startswith(f"{package}-")]
    if len(found) == 1:  # the metadata would tell as well, but imports email and socket: 20 ms
        return found[0][len(package) + 1 :]
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return "none"


def usable(folder: Path) -> bool:
    """True if the folder can be made and written and nobody else can put code into it."""
    try:
        # One by one: folders made on the way get the rights of the umask, and with that of many systems (002) the
        # user's own group could write into them.
        for above in reversed([path for path in folder.parents if not path.exists()]):
            above.mkdir(mode=0o700, exist_ok=True)
        _close(folder.parent)  # earlier versions left it open
        folder.mkdir(mode=0o700, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder):
            pass
        return _private(folder) and _private(folder.parent) and all(map(_firm, folder.resolve().parents))
    except OSError:
        return False


def _firm(above: Path) -> bool:
    """True if nobody else can put another folder in the place of one that lies here (POSIX; elsewhere True).

    Who may write to a folder may rename what is in it, also what belongs to others, unless its sticky bit is set.
    """
    if not hasattr(os, "getuid"):
        return True
    info = above.stat()
    if info.st_uid not in (os.getuid(), *TRUSTED):
        return False
    by_group = info.st_mode & stat.S_IWGRP and info.st_gid not in (os.getgid(), 0)
    return bool(info.st_mode & stat.S_ISVTX) or not (info.st_mode & stat.S_IWOTH or by_group)


def _close(folder: Path) -> None:
    """Nobody else may write into a folder of the user's; what others put there before is theirs and never used."""
    info = folder.stat()
    if hasattr(os, "getuid") and info.st_uid == os.getuid() and info.st_mode & OTHERS_WRITE:
        folder.chmod(stat.S_IMODE(info.st_mode) & ~OTHERS_WRITE)


def _private(folder: Path) -> bool:
    """True if the folder belongs to the user and is not writable by others (POSIX; elsewhere True)."""
    if not hasattr(os, "getuid"):
        return True
    info = folder.stat()
    return info.st_uid == os.getuid() and not info.st_mode & OTHERS_WRITE


def _user() -> str:
    return str(os.getuid()) if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
