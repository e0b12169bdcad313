"""What computed the numbers."""

from __future__ import annotations

import os
import platform

import numpy as np

import attlog


def versions() -> dict[str, str]:
    """Versions of attlog, Python and numpy, and the processor."""
    return {
        "version": attlog.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        # ``platform.processor`` starts ``uname``, whose answer on Linux is this one or none.
        "cpu": os.environ.get("PROCESSOR_IDENTIFIER") or platform.machine(),
    }
