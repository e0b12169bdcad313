"""Is what a filter's ``run`` returned an Estimate of the samples that it got?

A filter from a file returns what it likes. What is no number, or not one for each time, is reported here, where the
filter's name is known; further on it would be an exception in whatever computes with it, or silently lose a part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.base.errors import PluginError
from attlog.estimators.base import Estimate


def returned(where: str, one: Any, n: int) -> Estimate:
    """``one`` with arrays of float64, for ``n`` samples. PluginError names the file ``where``."""
    if not isinstance(one, Estimate) or np.shape(one.q) != (n, 4):
        raise PluginError(
            f"{where}: run must return an attlog.estimators.Estimate with one attitude for each time, q ({n}, 4)"
        )
    if not isinstance(one.aux, Mapping):
        raise PluginError(f"{where}: aux must be a dictionary of arrays")
    bias = None if one.bias is None else _numbers(where, "bias", one.bias)
    if bias is not None and bias.shape != (n, 3):
        raise PluginError(f"{where}: bias has shape {bias.shape}, not ({n}, 3)")
    aux = {str(name): _numbers(where, f"aux {name!r}", x) for name, x in one.aux.items()}
    for name, x in aux.items():
        if x.ndim not in (1, 2) or len(x) != n:
            raise PluginError(f"{where}: aux {name!r} has shape {x.shape}, not ({n},) or ({n}, k)")
    cost = float(_numbers(where, "ns_per_update", one.ns_per_update).reshape(-1)[:1].sum())
    return replace(
        one,
        q=_numbers(where, "q", one.q),
        bias=bias,
        aux=aux,
        ns_per_update=cost if np.isfinite(cost) and cost > 0 else 0.0,
        skipped=_counts(where, one.skipped),
        quality=_qualities(where, one.quality),
    )


def _numbers(where: str, name: str, values: Any) -> NDArray[np.float64]:
    array = np.asarray(values)
    if array.dtype.kind not in "fiub":
        raise PluginError(f"{where}: {name} holds {array.dtype} in place of real numbers")
    return np.asarray(array, np.float64)


def _counts(where: str, counted: Any) -> dict[str, int]:
    if not isinstance(counted, Mapping) or not all(isinstance(v, int | np.integer) for v in counted.values()):
        raise PluginError(f"{where}: skipped must be a dictionary of whole numbers")
    return {str(name): int(value) for name, value in counted.items()}


def _qualities(where: str, quality: Any) -> dict[str, float | str]:
    if not isinstance(quality, Mapping) or not all(
        isinstance(v, str | float | int | np.floating | np.integer) for v in quality.values()
    ):
        raise PluginError(f"{where}: quality must be a dictionary of numbers and words")
    return {str(name): value if isinstance(value, str) else float(value) for name, value in quality.items()}
