"""A segment whose first field comes after the start: run in two parts, between them the heading is set."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.estimators.base import Array, Estimator
from attlog.estimators.engine.samples import PreparedSamples
from attlog.estimators.engine.start import StartVectors

Part = Callable[[slice, "Array", NDArray[np.int64], int, Any], None]
"""Runs the samples of a slice with these magnetometer rows and their use, keeping each n-th output in an array."""


def late_field(estimator: Estimator, seen: StartVectors, heading_given: bool) -> int | None:
    """The sample whose field sets the heading of this filter after the start; None where none needs to."""
    return None if heading_given or "mag" not in estimator.uses else seen.late


def in_parts(
    run: Part,
    realign: Callable[[Any], None],
    handed: tuple[Array, NDArray[np.int64]],
    segment: slice,
    late: int | None,
    every: int,
    shape: tuple[int, ...],
    dtype: str = "float64",
) -> Any:
    """Outputs (rows, *shape) of a segment of samples, each n-th kept.

    ``handed``: magnetometer rows and their use, for all samples. ``realign`` sets the heading of the
    state from the field of sample ``late`` and writes it to the row of outputs that it gets.
    """
    mag, use = handed
    a, b = segment.start, segment.stop
    if late is None:
        out = np.empty((-(-(b - a) // every), *shape), dtype)
        run(segment, mag[segment], use[segment], every, out)
        return out
    out = np.empty((b - a, *shape), dtype)
    # Up to and with that sample the filter sees no field: it would take it for an error of its heading.
    before, after = slice(a, late + 1), slice(late + 1, b)
    nothing = np.zeros_like(mag[before])
    run(before, nothing, np.zeros_like(use[before]), 1, out[: late + 1 - a])
    realign(out[late - a])
    if late + 1 < b:
        run(after, mag[after], use[after], 1, out[late + 1 - a :])
    return np.ascontiguousarray(out[::every])


def without_heading(
    samples: PreparedSamples, silent: list[tuple[int, int]]
) -> tuple[dict[str, int], list[tuple[float, float]]]:
    """What the wait for a field is worth in ``Estimate.skipped`` and ``Estimate.no_heading``.

    ``silent``: of each segment that waited, its first sample and the first with a field.
    """
    spans = [(float(samples.t[a]), float(samples.t[late])) for a, late in silent]
    return ({"late_field": sum(late - a for a, late in silent)} if silent else {}), spans
