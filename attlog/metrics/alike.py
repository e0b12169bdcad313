"""Which rows are the same filter twice? By the equation that their files declare, or by attitudes that are equal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Literal

import numpy as np

from attlog import rotation
from attlog.reference.model import Row

EQUAL_DEG = 1e-6
"""Attitudes this close at every sample are equal: what the order of sums leaves is far below."""
GLANCES = 100


@dataclass(slots=True)
class Alike:
    """Rows that stand for one filter. ``by``: ``equation`` (of ``source``) or ``attitudes``.

    ``differ``: the parameters that both know and that have different values, one value for each row.
    ``apart_deg``: the largest angle between their attitudes, None where it was not measured.
    """

    rows: list[str]
    by: Literal["equation", "attitudes"]
    source: str = ""
    differ: dict[str, list[float | str]] = field(default_factory=dict)
    apart_deg: float | None = None


def alike(rows: Sequence[Row]) -> list[Alike]:
    """The groups among replayed rows of the same samples: equal attitudes first, then filters that share an equation.

    Rows of one filter with other parameters share its equation as everybody knows: they are listed only where
    their attitudes are equal, or beside another filter.
    """
    replays = [row for row in rows if row.kind == "replay" and row.status != "failed"]
    found = []
    equal: dict[str, float] = {}
    for group in _joined(replays):
        apart = max(_apart(group[0], other) for other in group[1:])
        found.append(Alike([row.name for row in group], "attitudes", differ=_differ(group), apart_deg=apart))
        equal |= dict.fromkeys((row.name for row in group), apart)
    declared: dict[tuple[str, int], list[Row]] = {}
    for row in replays:
        if row.equation:
            declared.setdefault((row.equation, id(row.imu)), []).append(row)
    for (source, _), group in declared.items():
        several = len({row.estimator for row in group}) > 1
        if several and not all(row.name in equal for row in group):
            found.append(Alike([row.name for row in group], "equation", source, _differ(group)))
    return found


def _joined(rows: Sequence[Row]) -> list[list[Row]]:
    """Groups of two and more rows that are equal to the first of their group."""
    groups: list[list[Row]] = []
    for row in rows:
        own = next((g for g in groups if g[0].imu is row.imu and _apart(g[0], row) <= EQUAL_DEG), None)
        groups.append([row]) if own is None else own.append(row)
    return [group for group in groups if len(group) > 1]


def _apart(a: Row, b: Row) -> float:
    """The largest angle in deg between two rows; infinite where they do not stand at the same times."""
    if len(a.t) != len(b.t) or len(a.t) == 0 or not np.array_equal(a.t, b.t):
        return np.inf
    few = np.linspace(0, len(a.t) - 1, min(GLANCES, len(a.t))).astype(int)
    for some in (few, slice(None)):
        angle = np.degrees(rotation.total_angle(rotation.error(a.q[some], b.q[some])))
        largest = float(np.max(angle))
        if not largest <= EQUAL_DEG:  # NaN too
            return largest if np.isfinite(largest) else np.inf
    return largest


def _differ(group: Sequence[Row]) -> dict[str, list[float | str]]:
    """Parameters known to every row of a group whose values differ."""
    names = [name for name in group[0].parameters if all(name in row.parameters for row in group)]
    values = {name: [row.parameters[name] for row in group] for name in names}
    return {name: told for name, told in values.items() if any(a != b for a, b in combinations(told, 2))}
