import numpy as np
import pytest
from scipy import stats

from attlog.metrics import quantiles

DOFS = (0.7, 1.0, 2.0, 3.3, 10.0, 55.5, 300.0, 1e4)
PROBABILITIES = (0.001, 0.025, 0.05, 0.5, 0.95, 0.975, 0.999)


@pytest.mark.parametrize("dof", DOFS)
def test_chi_square_quantiles_are_those_of_scipy(dof):
    ours = [quantiles.chi_square(p, dof) for p in PROBABILITIES]
    np.testing.assert_allclose(ours, stats.chi2.ppf(PROBABILITIES, dof), rtol=1e-7)


@pytest.mark.parametrize("dof", DOFS)
def test_student_quantiles_are_those_of_scipy(dof):
    ours = [quantiles.student(p, dof) for p in PROBABILITIES]
    np.testing.assert_allclose(ours, stats.t.ppf(PROBABILITIES, dof), rtol=1e-7, atol=1e-9)
