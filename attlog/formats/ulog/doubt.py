"""Which records of a damaged ULog hold values that cannot have been logged.

ULog has no checksums: a damage that lies within one record leaves the framing
intact. Random bytes as numbers give themselves away, because almost every one has
an exponent or a time that nothing on an aircraft has. Asked only where a file is
damaged anyway, so that an undamaged log always reads as it stands.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from attlog.formats.base import Table
from attlog.formats.ulog.clock import far_from_most

LARGEST, SMALLEST = 1e15, 1e-30
"""Magnitudes outside are no measurement: the largest real ones are times in us, the smallest variances."""
RARE = 0.01
"""A column in which a larger share is beyond the limits is logged that way (not initialised, say)."""
FEWEST = 5
"""Records that a topic needs before one of them can stand out."""


def doubtful(table: Table) -> NDArray[np.bool_]:
    """Mask (n,) of the records with a time far from the others or a number beyond any range."""
    found = np.zeros(len(table), bool)
    if len(table) < FEWEST:
        return found
    for name, field in table.fields.items():
        if name == "timestamp" and field.dtype.kind == "u":
            odd = far_from_most(table[name])
        elif field.dtype.base.kind == "f":
            odd = _beyond(table[name])
        else:
            continue
        if 0 < np.count_nonzero(odd) <= max(1, RARE * len(odd)):
            found |= odd
    return found


def _beyond(column: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Records with a finite number of impossible magnitude."""
    with np.errstate(invalid="ignore"):  # random bytes hold signalling NaN too
        size = np.abs(column)
        beyond: NDArray[np.bool_] = (size > LARGEST) & np.isfinite(size) | (size < SMALLEST) & (size > 0)
    return np.logical_or.reduce(beyond, axis=1) if beyond.ndim == 2 else beyond
