"""What an answer was made of, unit by unit, so that two rows can be compared on the units they share."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from attlog.base.plain import IN_JSON, NumberArray

Array = NDArray[np.float64]
Ids = NDArray[np.int64]
Kind = Literal["log_variance", "mean_square", "slope_group", "lag_event", "step_event"]


@dataclass(frozen=True, slots=True)
class Summary:
    """Value and 95 % interval of a row on some of its units, in the unit of its answer."""

    value: float
    ci95: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class UnitValues:
    """One value per unit of evidence. Rows are paired by ``ids`` (k,), see :func:`ids_of`; ``values`` (k,).

    By ``kind`` a value is: ``log_variance`` the logarithm of a window's variance; ``mean_square``
    the mean square of a block; ``slope_group`` the slope of a group, signed; ``lag_event`` the
    jackknife pseudo-value of an event, ``n whole - (n - 1) without it`` (their mean is the lag,
    their scatter its jackknife variance); ``step_event`` the magnitude of an event's error.
    ``of(ids)`` is the answer again, on these units only: it is called where rows differ in units, so that values that
    stand beside each other mean the same time. ``on`` is how the metric itself works that out (all of its units in
    ``ids``; it must pickle); units read from a file do not have it, and are summed up by their kind.
    """

    kind: Kind
    ids: Annotated[Ids, NumberArray(int)]
    values: Annotated[Array, NumberArray(float)]
    on: Callable[[Ids], Summary] | None = field(default=None, repr=False, compare=False, metadata={IN_JSON: False})

    def of(self, ids: Ids) -> Summary:
        """Value and interval on some of the units (m,)."""
        return self.on(ids) if self.on is not None else Summary(_summed_up(self.kind, self.at(ids)), None)

    def at(self, ids: Ids) -> Array:
        """The values (m,) of some of the units, in the order of ``ids`` (m,). KeyError for one that is not there."""
        order = np.argsort(self.ids)
        place = np.searchsorted(self.ids, ids, sorter=order)
        found = order[np.minimum(place, len(order) - 1)]
        if not np.array_equal(self.ids[found], ids):
            raise KeyError(f"units {np.setdiff1d(ids, self.ids).tolist()} are not there")
        return self.values[found]


def ids_of(times: ArrayLike) -> Ids:
    """Ids (k,) of units that begin at ``times`` (k,) s: whole milliseconds, the same for all rows of a log."""
    return np.round(1000.0 * np.asarray(times, np.float64)).astype(np.int64)


def _summed_up(kind: Kind, values: Array) -> float:
    """What units (k,) of a kind mean together: their mean on its scale, of step events the median."""
    if kind == "step_event":
        return float(np.median(values))
    mean = float(np.mean(values))
    return math.exp(0.5 * mean) if kind == "log_variance" else math.sqrt(mean) if kind == "mean_square" else mean
