"""A filter of an installed package: its code runs in the log's own process, and does what a test wants there."""

from __future__ import annotations

import atexit
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MODULE = """
from pathlib import Path
exec(Path(__file__).with_name("body.txt").read_text())
from attlog.estimators.filters.gyro import *
"""
PACKAGES = Path(tempfile.mkdtemp(prefix="attlog-harm-"))
atexit.register(shutil.rmtree, PACKAGES, ignore_errors=True)
(PACKAGES / "harm_module.py").write_text(MODULE)
ABOUT = PACKAGES / "harm-1.0.dist-info"
ABOUT.mkdir()
(ABOUT / "METADATA").write_text("Metadata-Version: 2.1\nName: harm\nVersion: 1.0\n")
(ABOUT / "entry_points.txt").write_text("[attlog.estimators]\nharm = harm_module\n")


@contextmanager
def installed() -> Iterator[None]:
    """A block in which the package is there, for this process and for those that are started in it."""
    sys.path.append(str(PACKAGES))
    try:
        yield
    finally:
        sys.path.remove(str(PACKAGES))
        sys.modules.pop("harm_module", None)


def harm(body: str) -> str:
    """The filter's name; from now on loading it does this."""
    (PACKAGES / "body.txt").write_text(body)
    return "harm"
