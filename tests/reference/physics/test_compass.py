"""Are the axes of the compass those of the gyro?"""

from __future__ import annotations

import copy

import numpy as np
import pytest

from attlog import flight
from attlog.reference.physics import compass
from tests.conftest import SAMPLES


@pytest.fixture(scope="module")
def sound():
    return flight.read(SAMPLES / "copter_steps_stabilize.bin")


def with_field(log, change):
    log = copy.copy(log)
    mag = copy.copy(log.mags[log.mag])
    mag.field = copy.copy(mag.field)
    mag.field.x = change(mag.field.x)
    log.mags = [mag if k == log.mag else other for k, other in enumerate(log.mags)]
    return log


@pytest.mark.parametrize("axes", compass.FRAMES[1:6], ids=compass._named)
def test_other_axes_are_found_and_named(sound, axes):
    said = compass.other_axes(with_field(sound, lambda x: x @ axes))
    assert f"it does with {compass._named(axes)} (" in said


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("as logged", lambda x: x),
        ("all signs, which turns cannot show", lambda x: -x),
        ("iron that turns with the vehicle", lambda x: 0.02 * x + np.array([3e-5, 2e-5, 1e-5])),
        ("noise alone", lambda x: 3e-5 * np.random.default_rng(0).normal(size=x.shape)),
        ("a mounting that is 20 deg off", lambda x: x @ np.array([[0.94, 0.34, 0], [-0.34, 0.94, 0], [0, 0, 1.0]])),
    ],
)
def test_what_is_no_matter_of_axes_is_not_accused(sound, what, change):
    assert compass.other_axes(with_field(sound, change)) == ""


def test_frames_are_all_ways_to_name_three_axes_but_for_their_common_sign():
    assert len(compass.FRAMES) == 24
    assert np.array_equal(compass.FRAMES[0], np.eye(3))
    assert len({axes.tobytes() for axes in compass.FRAMES}) == 24
    assert all(np.linalg.det(axes) == pytest.approx(1.0) for axes in compass.FRAMES)
