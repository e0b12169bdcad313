"""The columns of one ULog topic, decoded when asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats.base import Table
from attlog.formats.mapping import gather
from attlog.formats.ulog.index import HEADER, Bytes, Offsets
from attlog.formats.ulog.layout import Layout


@dataclass(slots=True)
class Topic:
    """A topic's records so far; another layout (a second log in the same file) starts a new part."""

    layouts: list[Layout]
    begins: list[int]
    offsets: list[Offsets] = field(default_factory=list)

    def add(self, layout: Layout, offsets: Offsets) -> None:
        """Take in records of one layout, starts in file order."""
        if self.layouts[-1] != layout:
            self.layouts.append(layout)
            self.begins.append(int(offsets[0]))
        self.offsets.append(offsets)

    def table(self, data: Bytes, name: str, multi: int) -> Table:
        """The topic's table; fields are those that all its layouts share."""
        parts, self.offsets = self.offsets, []
        offsets = parts[0] if len(parts) == 1 else np.concatenate(parts)
        if any(after[0] < before[-1] for before, after in pairwise(parts)):
            offsets.sort()
        first, *others = self.layouts
        fields = {n: f for n, f in first.fields.items() if all(o.fields.get(n) == f for o in others)}
        return Table(name, multi, fields, offsets, _Decoder(data, self.layouts, self.begins))


class _Decoder:
    """Gathers all bytes of a topic's records once; columns are views of them."""

    def __init__(self, data: Bytes, layouts: Sequence[Layout], begins: Sequence[int]) -> None:
        self._data, self._begins = data, begins
        self._records = [layout.record() for layout in layouts]
        self._of: Offsets | None = None
        self._gathered: list[NDArray[np.void]] = []

    def __call__(self, column: str, offsets: Offsets) -> NDArray[Any]:
        if self._of is not offsets:
            cuts = np.searchsorted(offsets, self._begins[1:])
            parts = zip(self._records, np.split(offsets, cuts), strict=True)
            self._gathered = [gather(self._data[HEADER:], part, record) for record, part in parts]
            self._of = offsets
        if len(self._gathered) == 1:
            return self._gathered[0][column]
        return np.concatenate([rows[column] for rows in self._gathered])
