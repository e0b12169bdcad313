"""The compass's heading before and after a correction, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.base import rotation
from attlog.health.assessments.compass.heading import HeadingProof, crossed, halves, heading_error, rms_deg
from tests.health.assessments.compass.made import samples


def test_the_error_is_what_a_pilot_reads_too_much() -> None:
    """Nose 30 deg, a field turned anticlockwise by 10 deg about the vertical: the compass reads 40 deg."""
    q = np.tile(rotation.from_euler(0.1, -0.2, np.radians(30.0)), (4, 1))
    seen = rotation.rotate_inverse(q, np.array([np.cos(np.radians(-10)), np.sin(np.radians(-10)), 2.0]))
    error = heading_error(q, seen, np.array([1.0, 0.0, 2.0]))
    assert np.degrees(error) == pytest.approx(10.0)
    level = rotation.rotate(np.tile(rotation.from_euler(0.1, -0.2, 0.0), (4, 1)), seen)
    assert np.degrees(np.arctan2(-level[:, 1], level[:, 0])) == pytest.approx(40.0)


def test_each_half_is_corrected_by_the_other() -> None:
    made = samples((8.0, 0.0, 0.0), noise=0.0)
    parts = halves(made)
    assert not (parts[0] & parts[1]).any()
    assert np.array_equal(parts[0] | parts[1], made.air)
    right, nothing = np.tile([8.0, 0.0, 0.0], (len(made.t), 1)), np.zeros((len(made.t), 3))
    proof = crossed(made, parts, (right, right))
    assert proof.before > 10.0
    assert proof.after == pytest.approx(0.0, abs=0.01)
    half = crossed(made, parts, (right, nothing))  # the first half stays as it was
    as_logged = heading_error(made.q[parts[0]], made.measured[parts[0]], made.earth)
    assert half.after == pytest.approx(rms_deg(as_logged) / np.sqrt(2.0), rel=0.01)


def test_what_was_fitted_in_a_half_is_tried_on_the_other() -> None:
    made = samples(noise=0.0)
    parts = halves(made)
    made.measured[parts[1]] += [8.0, 0.0, 0.0]
    right, nothing = np.tile([8.0, 0.0, 0.0], (len(made.t), 1)), np.zeros((len(made.t), 3))
    assert crossed(made, parts, (right, nothing)).after == pytest.approx(0.0, abs=0.01)
    assert crossed(made, parts, (nothing, right)).after > crossed(made, parts, (nothing, right)).before


@pytest.mark.parametrize(
    ("before", "after", "holds"),
    [
        (15.0, 1.5, True),
        (2.0, 1.2, False),
        (30.0, 22.0, False),
        (30.0, 13.0, False),
        (4.0, 2.9, False),
        (4.0, 2.7, True),
    ],
)
def test_a_correction_helps_by_30_percent_and_1_deg_to_below_12_deg(before: float, after: float, holds: bool) -> None:
    assert HeadingProof(before, after).holds == holds
