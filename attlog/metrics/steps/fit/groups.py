"""All events of one row for the fit of its lag, some at a time: of thousands the columns are not kept."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from attlog.metrics.evidence import aiding
from attlog.metrics.steps.events import Event
from attlog.metrics.steps.fit.columns import MARGIN_S, Columns, Covered, axes_of, build
from attlog.metrics.steps.turning import Turning, around

Array = NDArray[np.float64]

TOGETHER = 1 << 15
"""Samples of row and reference whose columns are made at once."""
KEPT_BYTES = 64_000_000
"""Columns up to this size are kept, as of 40 minutes full of movements; those beyond are made anew for each delay."""
MIN_PAIRS = 4


@dataclass(slots=True)
class Groups:
    """The events that both attitudes cover without a gap, in groups; ``slow_row``: the reference is the one moved."""

    row: Turning
    ref: Turning
    covered: list[Covered]
    sensors: aiding.Sensors | None
    slow_row: bool
    bounds: list[slice] = field(init=False)
    """Which of the events each group has."""
    _kept: dict[int, Columns] = field(default_factory=dict)
    _heavy: dict[int, int] = field(default_factory=dict)
    _room: int = KEPT_BYTES

    def __post_init__(self) -> None:
        sizes: NDArray[np.int64] = np.cumsum(
            [c.row.stop - c.row.start + c.ref.stop - c.ref.start for c in self.covered]
        )
        edges = np.flatnonzero(np.diff((sizes - 1) // TOGETHER)) + 1
        ends = [0, *edges.tolist(), len(self.covered)]
        self.bounds = [slice(a, b) for a, b in pairwise(ends)]

    @property
    def events(self) -> list[Event]:
        """The events themselves."""
        return [c.event for c in self.covered]

    @property
    def heavy(self) -> float:
        """Share of the row's samples in which the specific force exceeds 2 g, once :meth:`products` was asked."""
        return sum(self._heavy.values()) / sum(int(c.row.stop - c.row.start) for c in self.covered)

    def enough(self) -> bool:
        """Whether there are rates to compare."""
        pairs = 0
        for columns in self.each():
            pairs += len(columns.begin)
            if pairs >= MIN_PAIRS:
                return True
        return False

    def each(self, *, aided: bool = True) -> Iterator[Columns]:
        """The columns group by group; not ``aided``: those of the aiding may be zero where columns are not kept."""
        for k, own in enumerate(self.bounds):
            columns = self._kept.get(k)
            if columns is None:
                whole = aided or self._room > 0
                columns = build(self.row, self.ref, self.covered[own], self.sensors if whole else None, self.slow_row)
                if whole or self.sensors is None:
                    self._heavy[k] = columns.heavy
                    self._room -= columns.nbytes
                    if self._room > 0:
                        self._kept[k] = columns
            yield columns

    def products(self, delay: float, slope_s: float, aids: Array) -> tuple[Array, NDArray[np.int64]]:
        """Those of all events, see :meth:`Columns.products`."""
        products, lines = zip(*(columns.products(delay, slope_s, aids) for columns in self.each()), strict=True)
        return np.concatenate(products), np.concatenate(lines)

    def correlations(self, delays: Array) -> Array:
        """Correlation (n,) of both rates about the axes at delays (n,) s, of some samples of each event."""
        xx, yy, xy = sum((columns.powers(delays) for columns in self.each(aided=False)), np.zeros((len(delays), 3))).T
        size = np.sqrt(xx * yy)
        return np.asarray(np.divide(xy, size, out=np.zeros(len(delays)), where=size > 0.0))


def groups(row: Turning, ref: Turning, events: Sequence[Event], sensors: aiding.Sensors | None) -> Groups | None:
    """The events that both attitudes cover without a gap; None without any."""
    slow_row = row.step > 1.05 * ref.step
    row_parts = around(row, events, 0.0 if slow_row else MARGIN_S)
    ref_parts = around(ref, events, MARGIN_S if slow_row else 0.0)
    axes = axes_of(ref, events) if len(ref.t) else np.full((len(events), 3), np.nan)
    covered = [
        Covered(event, a, b, axis)
        for event, a, b, axis in zip(events, row_parts, ref_parts, axes, strict=True)
        if a is not None and b is not None and np.isfinite(axis[0])
    ]
    found = Groups(row, ref, covered, sensors, slow_row)
    return found if covered and found.enough() else None
