"""The offset of a compass against planted ones, closed forms and MAGFit's formula."""

from __future__ import annotations

import math

import numpy as np
import pytest

from attlog import flight
from attlog.base import rotation
from attlog.health.assessments.compass.fitting import of_samples, offset_of, total_error
from attlog.reference import declination
from tests.conftest import SAMPLES
from tests.health.assessments.compass.made import EARTH, samples


def test_a_planted_offset_comes_back() -> None:
    made = samples((-12.0, 5.0, 3.0))
    found = of_samples(made, made.air)
    assert found is not None
    assert found.offset == pytest.approx([-12.0, 5.0, 3.0], abs=0.05)
    assert found.counts
    assert found.size == pytest.approx(math.sqrt(178.0), abs=0.05)
    assert found.size_ci95[0] < found.size < found.size_ci95[1]


def test_a_tenth_of_wild_samples_moves_it_by_little() -> None:
    made = samples((-12.0, 5.0, 3.0))
    wild = made.air & (np.arange(len(made.t)) % 10 == 0)
    made.measured[wild] += 40.0
    found = of_samples(made, made.air)
    assert found is not None
    assert found.offset == pytest.approx([-12.0, 5.0, 3.0], abs=0.15)


def test_the_error_holds_heading_tilt_and_model() -> None:
    """By hand: 2 deg of heading in 20 uT, 0.8 deg of tilt in 40 uT, 1 % of 44.7 uT, 0.3 uT, 1.5 standard errors."""
    sigma = total_error(np.array([0.2, 0.2, 0.2]), math.radians(2.0), np.array([20.0, 0.0, 40.0]))
    across = math.sqrt(0.3**2 + (0.0349066 * 20) ** 2 + (0.0139626 * 40) ** 2 + 0.3**2)
    along = math.sqrt(0.3**2 + (0.0139626 * 20) ** 2 + (0.01 * 44.72136) ** 2 + 0.3**2)
    assert sigma == pytest.approx([across, across, along], rel=1e-5)


def test_a_constant_offset_has_no_error_of_the_fit_but_that_of_the_heading() -> None:
    t, error = np.arange(500) * 0.1, np.tile([3.0, 0.0, 0.0], (500, 1))
    sure, unsure = (offset_of(t, error, np.full(500, np.radians(s)), EARTH) for s in (0.5, 4.0))
    assert sure is not None
    assert unsure is not None
    assert sure.counts
    assert not unsure.counts


def test_nothing_is_found_in_one_sample() -> None:
    assert offset_of(np.zeros(1), np.zeros((1, 3)), np.zeros(1), EARTH) is None
    assert offset_of(np.zeros(0), np.zeros((0, 3)), np.zeros(0), EARTH) is None


def test_on_the_same_numbers_it_is_that_of_magfit() -> None:
    """MAGFit's offsets only: least squares of raw + ofs - expected, with the attitude of the log; within 1 mG."""
    log = flight.read(SAMPLES / "copter_steps_stabilize.bin")
    attitude, model = log.onboard_attitude, declination.model(log)
    assert attitude is not None
    assert model is not None
    field = log.mags[0].field
    planted = np.array([-14.0, 6.0, 9.0])
    q = rotation.slerp(attitude.t, attitude.q, field.t_best)
    use = rotation.finite(q) & rotation.finite(field.x) & (field.t_best > 25.0) & (field.t_best < 60.0)
    raw_mgauss = 1e7 * field.x[use] + 10.0 * planted
    w, x, y, z = q[use].T
    down_to_body = np.array(  # the transposed direction cosine matrix, written out
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
            [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
            [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    expected = np.einsum("ijn,j->ni", down_to_body, 1e7 * np.array(model.ned_t))
    rows = np.tile(np.eye(3), (len(raw_mgauss), 1))
    ofs, *_ = np.linalg.lstsq(rows, (expected - raw_mgauss).ravel(), rcond=None)
    found = offset_of(
        field.t_best[use], 0.1 * (raw_mgauss - expected), np.zeros(len(raw_mgauss)), 1e6 * np.array(model.ned_t)
    )
    assert found is not None
    assert 10.0 * found.offset == pytest.approx(-ofs, abs=1.0)
    assert found.offset == pytest.approx(planted, abs=1.5)  # the attitude of the log errs
