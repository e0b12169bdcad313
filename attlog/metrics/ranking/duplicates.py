"""Which rows are the same filter twice? By the equation that their files declare, or by attitudes that are equal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from attlog.base import rotation
from attlog.base.errors import AttlogError
from attlog.reference.model import Row

Array = NDArray[np.float64]

EQUAL_DEG = 1e-6
"""Attitudes this close at every sample are equal: what the order of sums leaves is far below."""
GLANCES = 100


@dataclass(slots=True)
class Duplicates:
    """Rows that stand for one filter. ``by``: ``equation`` (of ``source``) or ``attitudes``.

    ``differ``: the parameters that both know and that have different values, one value for each row.
    ``apart_deg``: the largest angle between their attitudes, None where it was not measured.
    """

    rows: list[str]
    by: Literal["equation", "attitudes"]
    source: str = ""
    differ: dict[str, list[float | str]] = field(default_factory=dict)
    apart_deg: float | None = None


class DuplicateSearch:
    """Finds groups among rows that pass one by one: replayed rows of the same samples, equal or declared so.

    Of a row that has passed only a glance is kept. Where another one looks the same there, ``again`` is asked for the
    whole of the earlier row, which is run once more: rare, and cheaper than keeping all.
    """

    def __init__(self, again: Callable[[Row], Row]) -> None:
        self._again = again
        self._rows: list[Row] = []
        self._groups: list[_Group] = []

    def add(self, row: Row) -> None:
        """Take from a row what is to be compared; it may be released then."""
        if row.kind != "replay" or row.status == "failed":
            return
        self._rows.append(row)
        glance = _excerpt(row)
        for group in self._groups:
            angle = self._angle(group, row, glance)
            if angle <= EQUAL_DEG:
                group.rows.append(row)
                group.apart_deg = max(group.apart_deg, angle)
                return
        self._groups.append(_Group([row], glance))

    def found(self) -> list[Duplicates]:
        """Equal attitudes first, then filters that share an equation.

        Rows of one filter with other parameters share its equation as everybody knows: they are listed only where
        their attitudes are equal, or beside another filter.
        """
        groups = [group for group in self._groups if len(group.rows) > 1]
        equal = {row.name for group in groups for row in group.rows}
        found = [
            Duplicates([r.name for r in g.rows], "attitudes", differ=_differ(g.rows), apart_deg=g.apart_deg)
            for g in groups
        ]
        declared: dict[tuple[str, int], list[Row]] = {}
        for row in self._rows:
            if row.equation:
                declared.setdefault((row.equation, id(row.imu)), []).append(row)
        for (source, _), rows in declared.items():
            several = len({row.estimator for row in rows}) > 1
            if several and not equal.issuperset(row.name for row in rows):
                found.append(Duplicates([row.name for row in rows], "equation", source, _differ(rows)))
        return found

    def _angle(self, group: _Group, row: Row, glance: _Excerpt) -> float:
        """The largest angle in deg between a row and the first of a group; infinite where that is not known."""
        first, seen = group.rows[0], group.glance
        if first.imu is not row.imu or seen.n != glance.n or not np.array_equal(seen.t, glance.t):
            return np.inf
        if not _largest_deg(seen.q, glance.q) <= EQUAL_DEG:
            return np.inf
        try:
            whole = self._again(first)
        except AttlogError:
            return np.inf
        return _largest_deg(whole.q, row.q) if np.array_equal(whole.t, row.t) else np.inf


@dataclass(frozen=True, slots=True)
class _Excerpt:
    """Some of a row's attitudes (m, 4) with their times (m,), spread over its ``n`` samples."""

    n: int
    t: Array
    q: Array


@dataclass(slots=True)
class _Group:
    """Rows that are equal to the first of them, what was seen of that one, and the largest angle found."""

    rows: list[Row]
    glance: _Excerpt
    apart_deg: float = 0.0


def alike(rows: Sequence[Row]) -> list[Duplicates]:
    """The groups among rows that are all at hand."""
    likeness = DuplicateSearch(lambda row: row)
    for row in rows:
        likeness.add(row)
    return likeness.found()


def _excerpt(row: Row) -> _Excerpt:
    few = np.linspace(0, len(row.t) - 1, min(GLANCES, len(row.t))).astype(int)
    return _Excerpt(len(row.t), row.t[few], row.q[few])


def _largest_deg(a: Array, b: Array) -> float:
    """The largest angle in deg between attitudes (n, 4); infinite where there are none or one is not finite."""
    largest = float(np.max(np.degrees(rotation.total_angle(rotation.error(a, b))))) if len(a) else np.inf
    return largest if np.isfinite(largest) else np.inf


def _differ(group: Sequence[Row]) -> dict[str, list[float | str]]:
    """Parameters known to every row of a group whose values differ."""
    names = [name for name in group[0].parameters if all(name in row.parameters for row in group)]
    values = {name: [row.parameters[name] for row in group] for name in names}
    return {name: own for name, own in values.items() if any(a != b for a, b in combinations(own, 2))}
