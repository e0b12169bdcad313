"""The correction of every firmware as one formula, and its inverses."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.flight.calibration.correction import CalibrationUnknownError, Correction

RANDOM = np.random.default_rng(3)
MATRIX = np.eye(3) + 0.1 * RANDOM.normal(size=(3, 3))
CORRECTION = Correction(MATRIX, np.array([1.0, -2.0, 0.5]), np.array([0.1, 0.2, -0.3]))


def test_raw_values_come_back_from_those_in_body_axes() -> None:
    raw, power = RANDOM.normal(size=(50, 3)), RANDOM.uniform(0, 30, (50, 1))
    offset, motor = np.array([1.0, -2.0, 0.5]), np.array([0.1, 0.2, -0.3])
    by_hand = np.array([MATRIX @ (x + offset) + p * motor for x, p in zip(raw, power, strict=True)])
    np.testing.assert_allclose(CORRECTION.body(raw, power), by_hand, atol=1e-12)
    np.testing.assert_allclose(CORRECTION.raw(by_hand, power), raw, atol=1e-12)


def test_an_error_vanishes_with_the_new_offset() -> None:
    raw, error = RANDOM.normal(size=(50, 3)), np.array([0.7, -0.1, 0.4])
    new = Correction(MATRIX, CORRECTION.offset_without(error), CORRECTION.motor)
    np.testing.assert_allclose(CORRECTION.body(raw) - new.body(raw), np.tile(error, (50, 1)), atol=1e-12)


@pytest.mark.parametrize("matrix", [np.diag([1.0, 1.0, 0.0]), np.full((3, 3), np.nan)])
def test_a_matrix_that_folds_the_axes_is_refused(matrix) -> None:
    with pytest.raises(CalibrationUnknownError, match="no rotation"):
        Correction(matrix, np.zeros(3), np.zeros(3))
