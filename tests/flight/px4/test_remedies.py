"""Which rotation of a compass is named: that of the slot of the one in use."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.model import Mag, Stream
from attlog.flight.px4 import remedies

SLOTS = {"CAL_MAG0_ID": 589858.0, "CAL_MAG0_ROT": -1.0, "CAL_MAG1_ID": 592905.0, "CAL_MAG1_ROT": 6.0}


def compass(device: str | None) -> Mag:
    return Mag(0, Stream(np.zeros(1), np.zeros((1, 3)), "T", "FRD", "vehicle_magnetometer:0"), device=device)


@pytest.mark.parametrize(
    ("values", "device", "named"),
    [
        (SLOTS, "592905", "CAL_MAG1_ROT 6,"),
        (SLOTS, "589858", "CAL_MAG0_ROT -1,"),
        (SLOTS, "7", ""),
        (SLOTS, None, ""),
        (SLOTS | {"CAL_MAG0_EN": 0.0, "CAL_MAG1_EN": 1.0}, None, "CAL_MAG1_ROT 6,"),
        (SLOTS | {"CAL_MAG0_PRIO": 0.0, "CAL_MAG1_PRIO": 75.0}, None, "CAL_MAG1_ROT 6,"),
        ({"CAL_MAG0_ID": 5.0, "CAL_MAG0_ROT": 0.0, "CAL_MAG1_ID": 0.0, "CAL_MAG1_ROT": -1.0}, None, "CAL_MAG0_ROT 0,"),
    ],
)
def test_the_rotation_that_is_named_is_that_of_the_compass_in_use(
    values: dict[str, float], device: str | None, named: str
) -> None:
    """A vehicle flew on its second compass and was told to compare the first one's rotation."""
    said = remedies.of(values, compass(device))["compass_mounting"]
    assert named in said
    assert bool(named) is ("_ROT" in said)
