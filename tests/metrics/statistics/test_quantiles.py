import numpy as np
import pytest
from scipy import stats

from attlog.metrics.statistics import quantiles

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


@pytest.mark.parametrize("dof", [*DOFS, 4.0, 35.0])
def test_tails_of_many_are_those_of_each_and_of_scipy(dof):
    t = np.array([0.0, 1e-300, np.inf, *np.geomspace(1e-6, 1e6, 40), *np.linspace(0.1, 5.0, 40)])
    found = quantiles.students_two_sided(t, dof)
    np.testing.assert_allclose(found, [quantiles.student_two_sided(x, dof) for x in t], rtol=1e-12, atol=1e-300)
    np.testing.assert_allclose(found, 2 * stats.t.sf(t, dof), rtol=1e-6, atol=1e-12)
    assert np.isnan(quantiles.students_two_sided(np.array([np.nan]), dof)[0])
    assert len(quantiles.students_two_sided(t[:0], dof)) == 0


def test_all_far_out_take_no_more_steps_than_one(monkeypatch):
    """Tails that end at once leave nothing to sum, and no loop runs on for nobody."""
    steps = []
    monkeypatch.setattr(quantiles, "_nonzeros", lambda x: steps.append(1) or x)
    quantiles.students_two_sided(np.array([0.0, np.inf]), 5.0)
    assert len(steps) < 20
