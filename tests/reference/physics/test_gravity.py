"""Does the accelerometer in quiet time contradict a reference?"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from attlog.base import rotation
from attlog.flight.model import Imu, Stream
from attlog.reference import trim
from attlog.reference.physics.gravity import G, QuietSegment, _sometimes, check
from attlog.segments import Segment, Segments

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


def test_the_trim_of_a_reference_is_put_back_before_gravity_in_the_imus_axes_judges_it() -> None:
    """The IMU stands 8 deg rolled and the reference has that taken out: both are right, neither is 16 deg off."""
    t, roll = np.arange(0.0, 20.0, 0.05), np.radians([8.0, 0.0, 0.0])
    own = np.tile(rotation.from_rotvec(roll), (len(t), 1))
    force = rotation.rotate_inverse(own, np.tile([0.0, 0.0, -G], (len(t), 1)))
    unit = Imu(0, Stream(t, np.zeros_like(force), "rad/s", "FRD", "IMU"), Stream(t, force, "m/s^2", "FRD", "IMU"))
    vehicle: Any = SimpleNamespace(
        t=t, q=trim.apply(own, roll), segment=np.zeros(len(t), np.int64), trim=roll, source="ATT"
    )
    fault, (step,) = check(vehicle, unit, Segments([Segment("rest.long", 0.0, 20.0)]))
    assert fault == ""
    assert step.value == pytest.approx(0.0, abs=1e-6)
