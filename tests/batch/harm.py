"""A package that a built-in filter imports: its code runs in the log's own process, and does what a test wants."""

from __future__ import annotations

import atexit
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MODULE = """
import importlib, sys
from pathlib import Path
exec(Path(__file__).with_name("body.txt").read_text())
sys.path.remove(str(Path(__file__).parent))
del sys.modules["imufusion"]
importlib.import_module("imufusion")
"""
PACKAGES = Path(tempfile.mkdtemp(prefix="attlog-harm-"))
atexit.register(shutil.rmtree, PACKAGES, ignore_errors=True)
(PACKAGES / "imufusion.py").write_text(MODULE)


@contextmanager
def installed() -> Iterator[None]:
    """A block in which the package is there, for this process and for those that are started in it."""
    harm("")
    sys.path.insert(0, str(PACKAGES))
    try:
        yield
    finally:
        if str(PACKAGES) in sys.path:  # the package was imported here
            sys.path.remove(str(PACKAGES))


def harm(body: str) -> str:
    """The filter's name; from now on loading what it imports does this, once in a process."""
    (PACKAGES / "body.txt").write_text(body)
    return "fusion"
