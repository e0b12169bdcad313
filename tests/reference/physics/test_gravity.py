"""Does the accelerometer in quiet time contradict a reference?"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.reference.physics.gravity import G, QuietSegment, _sometimes

REFERENCE: Any = SimpleNamespace(t=np.array([0.0, 100.0]), source="ATT")


def quiet(begin: float, tilt: float, force: float = G) -> QuietSegment:
    return QuietSegment("rest", begin, 5.0, tilt, force)


@pytest.mark.parametrize(
    ("wrong", "refused"),
    [
        ([quiet(20.0, 30.0), quiet(50.0, 14.0)], True),
        ([quiet(2.0, 30.0), quiet(50.0, 14.0)], False),  # it may not be aligned yet
        ([quiet(20.0, 30.0, G + 0.6), quiet(50.0, 14.0)], False),  # the force is not gravity alone
        ([quiet(20.0, 9.0), quiet(50.0, 14.0)], False),
    ],
)
def test_two_quiet_times_with_gravity_alone_after_the_alignment_refuse_an_attitude(
    wrong: list[QuietSegment], refused: bool
) -> None:
    found = _sometimes(REFERENCE, [*wrong, quiet(70.0, 1.0), quiet(80.0, 1.0)])
    assert bool(found) is refused
    if refused:
        assert found.startswith("ATT is wrong by 30 deg at rest at 20 s")
