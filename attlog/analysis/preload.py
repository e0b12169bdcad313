"""Compiled loops of filters, loaded before a process forks others that then have them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from attlog import estimators
from attlog.estimators.registry import BUILT_IN


def preload(specs: Sequence[str]) -> None:
    """Load the compiled loops of built-in filters into this process, which then forks others that have them.

    Others are left out: their code runs where a log is analysed. What fails here fails there, and is told.
    """
    t = np.arange(100) * 0.004
    rest = (np.zeros((t.size, 3)), np.tile([0.0, 0.0, -9.80665], (t.size, 1)), np.tile([2e-5, 0.0, 4e-5], (t.size, 1)))
    for item in estimators.items(",".join(specs)):
        name = item.partition(":")[0].partition("@")[0]
        for one in BUILT_IN if name == "all" else [item] if name in ("default", *BUILT_IN) else []:
            with suppress(Exception):
                for row in estimators.select(one):
                    estimators.estimate(row, t, *rest)
