"""Where the vehicle stands still, gravity says who is tilted, the judge or the accused."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.reference.physics.standing import StillResiduals


def residuals(judge: float, accused: float, sigma: float = 0.5, begin: float = 10.0) -> StillResiduals:
    """Ten still windows from ``begin`` s on with these residuals in deg."""
    start = begin + 0.5 * np.arange(10)
    each = np.ones(10)
    return StillResiduals(np.column_stack([start, start + 2.0]), judge * each, accused * each, sigma * each)


@pytest.mark.parametrize(
    ("judge", "accused", "acquitted"),
    [
        (8.4, 1.05, True),  # the judge is the wrong one
        (0.1, 2.4, True),  # an accelerometer bias explains it
        (0.1, 6.0, False),
        (7.0, 6.0, True),  # both are off, the judge by more
    ],
)
def test_nobody_is_accused_of_tilt_against_gravity(judge: float, accused: float, acquitted: bool) -> None:
    assert residuals(judge, accused).acquits((11.0, 15.0)) is acquitted


def test_windows_beside_a_span_count_where_none_lies_within() -> None:
    found = residuals(8.0, 1.0)
    assert found.acquits((17.0, 30.0))
    assert found.medians((17.0, 30.0)) == (8.0, 1.0)
    assert not found.acquits((25.0, 40.0))
    assert found.medians((25.0, 40.0)) is None


@pytest.mark.parametrize(
    ("judge", "accused", "sigma", "refused"),
    [
        (2.4, 0.8, 0.9, True),  # twice the other's
        (2.4, 1.5, 0.9, False),
        (4.0, 3.5, 0.2, True),  # above 3 sigmas with 1 deg of the accelerometer's own
        (4.0, 3.5, 1.2, False),
        (1.9, 0.1, 0.1, False),
        (4.0, np.nan, 0.2, True),
    ],
)
def test_gravity_refuses_a_judge_that_is_further_off_than_it_says(
    judge: float, accused: float, sigma: float, refused: bool
) -> None:
    assert bool(residuals(judge, accused, sigma).refusing()) is refused
