"""What a smoother says of biases: which run counts, whether two agree in each axis, and the total error."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.health.assessments.inertial import biases
from attlog.reference.model import Reference
from tests.health.assessments.inertial.cases import case, log_of, motion, told, unit

NONE = (0.0, 0.0, 0.0)
LOG = log_of(unit(0, 100.0, NONE, NONE))


def smoother(acc: tuple[float, float, float], sigma: float = 0.01, kind: str = "smoother") -> Reference:
    t = np.arange(3.0)
    zeros = np.zeros(3, np.int64)
    found = Reference(kind, kind, t, np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)), zeros, zeros)  # type: ignore[arg-type]
    found.quality = told(acc, sigma)
    return found


def total(sigma: float) -> np.ndarray:
    return np.asarray(np.hypot(1.5 * sigma, [0.03, 0.03, 0.05]))


def test_without_a_compass_its_own_sigma_is_believed_up_to_three_hundredths() -> None:
    for sigma, known in ((0.029, True), (0.031, False)):
        found = biases.acc_bias(case(LOG, told((0.3, -0.2, 0.5), sigma)))
        assert found is not None
        assert found.known == (known,) * 3
        assert found.sure is known
        np.testing.assert_allclose(found.mean, [0.3, -0.2, 0.5])
        np.testing.assert_allclose(found.sigma, total(sigma))
    assert (found.n, found.seconds) == (12000, pytest.approx(119.99))
    assert biases.acc_bias(case(LOG)) is None


@pytest.mark.parametrize("axis", [0, 1])
def test_runs_with_and_without_a_compass_must_agree_in_either_horizontal_axis(axis: int) -> None:
    doubt = float(np.hypot(total(0.02)[0], total(0.04)[0]))
    for factor, agree in ((1.95, True), (-1.95, True), (2.05, False), (-2.05, False)):
        both = np.array([0.1, 0.2, 0.3])
        both[axis] += factor * doubt
        reference = smoother((both[0], both[1], both[2]), 0.04)
        found = biases.acc_bias(case(LOG, told((0.1, 0.2, 0.3), 0.02), reference=reference))
        assert found is not None
        assert found.known == (agree, agree, True)
        np.testing.assert_allclose(found.mean, both)
        np.testing.assert_allclose(found.sigma, total(0.04))
        assert found.by.endswith("and compass")


def test_along_z_the_runs_need_not_agree_and_with_a_compass_more_is_believed() -> None:
    found = biases.acc_bias(case(LOG, told((0.1, 0.2, 0.3), 0.02), reference=smoother((0.1, 0.2, 3.0), 0.044)))
    assert found is not None
    assert found.sure
    found = biases.acc_bias(case(LOG, told((0.1, 0.2, 0.3), 0.02), reference=smoother((0.1, 0.2, 0.3), 0.046)))
    assert found is not None
    assert found.known == (False, False, False)


def test_only_a_smoother_whose_compass_agrees_with_motion_takes_the_place_of_the_run_without_one() -> None:
    other = smoother((0.5, 0.5, 0.5))
    other.quality = {**other.quality, "heading_from": "mag"}
    for reference in (other, smoother((0.5, 0.5, 0.5), kind="truth")):
        found = biases.acc_bias(case(LOG, told((0.1, 0.2, 0.3)), reference=reference))
        assert found is not None
        np.testing.assert_allclose(found.mean, [0.1, 0.2, 0.3])


def test_the_gyros_bias_has_its_own_limits_for_each_axis() -> None:
    quality = told(NONE, gyro=(1.0, -2.0, 0.5))
    quality["gyro_bias_y_sigma_dps"], quality["gyro_bias_z_sigma_dps"] = 0.29, 0.31
    found = biases.gyro_bias(case(LOG, quality))
    assert found is not None
    assert found.known == (True, True, False)
    np.testing.assert_allclose(found.mean, [1.0, -2.0, 0.5])
    np.testing.assert_allclose(found.sigma, np.hypot(1.5 * np.array([0.02, 0.29, 0.31]), 0.05))


def test_the_longest_segment_tells() -> None:
    one = motion(told(NONE))
    one.segment[:] = np.searchsorted([20.0, 90.0], one.t, side="right")
    read = biases._of_motion(one)
    assert read is not None
    assert (read[0][0], read[0][-1]) == (pytest.approx(20.0), pytest.approx(89.99))


def test_a_number_that_is_missing_or_none_leaves_nothing() -> None:
    quality = told((0.1, 0.2, 0.3))
    assert biases._read(quality, "acc_bias_{}_m_s2", "acc_bias_{}_sigma_m_s2") is not None
    quality["acc_bias_y_m_s2"] = float("nan")
    assert biases.acc_bias(case(LOG, quality)) is None
