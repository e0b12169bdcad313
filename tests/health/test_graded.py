"""A size at its limit is still within it; and whose heading judges a compass."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from attlog import health
from attlog.health.model import graded


@pytest.mark.parametrize(
    ("value", "verdict"),
    [(-5.0, "ok"), (2.0, "ok"), (2.001, "warning"), (7.0, "warning"), (7.001, "fault"), (float("nan"), "fault")],
)
def test_a_size_at_a_limit_is_within_it(value: float, verdict: str) -> None:
    assert graded(value, 2.0, 7.0) == verdict


def by(heading: str) -> Any:
    return SimpleNamespace(heading_by=heading)


def test_a_compass_is_judged_by_a_heading_of_the_references_own_or_by_none() -> None:
    own, other = by("own"), by("own")
    assert health._heading(own, other) is own
    assert health._heading(by("onboard"), other) is other
    assert health._heading(None, other) is other
    assert health._heading(by("onboard"), by("onboard")) is None
    assert health._heading(None, by("onboard")) is None
    assert health._heading(own, None) is own
    assert health._heading(None, None) is None
