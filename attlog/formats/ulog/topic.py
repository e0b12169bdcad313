"""The columns of one ULog topic, decoded when asked for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.base.limits import MAX_LAYOUTS
from attlog.formats.base import Field, Guard, Offsets, Table
from attlog.formats.mapping import gather
from attlog.formats.ulog.index import HEADER, Bytes
from attlog.formats.ulog.layout import TopicLayout


@dataclass(slots=True)
class Topic:
    """A topic's records so far; another layout (a second log in the same file) starts a new part."""

    layouts: list[TopicLayout]
    parts: list[tuple[int, Offsets]] = field(default_factory=list)
    left_out: int = 0
    decoder: _TopicDecoder | None = None

    def add(self, layout: TopicLayout, offsets: Offsets) -> None:
        """Take in records of one layout, starts in file order."""
        if self.layouts[-1] != layout:
            if len(self.layouts) >= MAX_LAYOUTS:
                self.left_out += len(offsets)
                return
            self.layouts.append(layout)
        self.parts.append((len(self.layouts) - 1, offsets))

    def table(self, data: Bytes, name: str, multi: int, guard: Guard, *, own_starts: bool = False) -> Table:
        """The topic's table; fields are those that all its layouts share. Gives up the parts.

        ``own_starts``: where records were sorted in several groups, one part would keep all of its group.
        """
        parts, self.parts = self.parts, []
        one = len(parts) == 1 and not own_starts
        starts = parts[0][1] if one else np.concatenate([offsets for _, offsets in parts])
        which = None
        if len(self.layouts) > 1:
            which = np.repeat(np.array([k for k, _ in parts], np.int8), [len(offsets) for _, offsets in parts])
        if any(after[0] < before[-1] for (_, before), (_, after) in pairwise(parts)):
            order = starts.argsort(kind="stable")
            starts, which = starts[order], None if which is None else which[order]
        self.decoder = _TopicDecoder(data, self.layouts, starts, which)
        return Table(name, multi, self._fields, starts, self.decoder, guard)

    def forget(self) -> None:
        """Drop the records that were gathered to look at a table once."""
        if self.decoder is not None:
            self.decoder.forget()

    def _fields(self) -> dict[str, Field]:
        first, *others = self.layouts
        if not others:
            return first.fields
        return {n: f for n, f in first.fields.items() if all(o.fields.get(n) == f for o in others)}


class _TopicDecoder:
    """Gathers all bytes of a topic's records once; columns are views of them.

    ``which`` (n,) is the layout of each of the topic's records, which start at ``starts``; None where there is one.
    """

    def __init__(
        self, data: Bytes, layouts: Sequence[TopicLayout], starts: Offsets, which: NDArray[np.int8] | None = None
    ) -> None:
        self._data, self._layouts, self._starts, self._which = data, layouts, starts, which
        self._of: Offsets | None = None
        self._gathered: list[tuple[NDArray[np.bool_] | slice, NDArray[np.void]]] = []

    def forget(self) -> None:
        self._of, self._gathered = None, []

    def __call__(self, column: str, offsets: Offsets) -> NDArray[Any]:
        if self._of is not offsets:
            self._gathered = list(self._gather(offsets))
            self._of = offsets
        if len(self._gathered) == 1:
            return self._gathered[0][1][column]
        first = self._gathered[0][1][column]
        found = np.empty((len(offsets), *first.shape[1:]), first.dtype)
        for here, rows in self._gathered:
            found[here] = rows[column]
        return found

    def _gather(self, offsets: Offsets) -> Iterator[tuple[NDArray[np.bool_] | slice, NDArray[np.void]]]:
        body = self._data[HEADER:]
        if self._which is None:
            yield slice(None), gather(body, offsets, self._layouts[0].record)
            return
        which = self._which[self._starts.searchsorted(offsets)]
        for k, layout in enumerate(self._layouts):
            here = which == k
            yield here, gather(body, offsets[here], layout.record)
