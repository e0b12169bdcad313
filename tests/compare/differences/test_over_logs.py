"""What several logs say together: one log that resolves more than the others does not decide for all."""

from __future__ import annotations

import pytest

from attlog.compare.differences.comparison import LogDifference
from attlog.compare.differences.over_logs import over


@pytest.mark.parametrize(
    ("floors", "direction"),
    [((0.0, 0.6, 0.9), "not significant"), ((0.0, 0.1, 0.9), "better"), ((0.6, 0.6, 0.0), "not significant")],
)
def test_what_most_logs_cannot_resolve_is_no_difference(floors: tuple[float, ...], direction: str) -> None:
    each = [
        LogDifference(f"log{k}", value, (value - 0.1, value + 0.1), 0.001, 20, 2.0, 1.5, 0.05, floor, "better")
        for k, (value, floor) in enumerate(zip((-0.5, -0.52, -0.48), floors, strict=True))
    ]
    found = over(each, "difference")
    assert found is not None
    assert (found.value, found.direction) == (pytest.approx(-0.5, abs=0.01), direction)
