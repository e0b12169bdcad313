"""What the smoother makes of a log with an impact: two parts, each by itself."""

from __future__ import annotations

import numpy as np
import pytest

from attlog.estimators.aids import Aids
from attlog.estimators.base import Estimate
from attlog.estimators.filters import smoother


def test_attitude_bias_and_sigmas_of_both_sides_of_an_impact_are_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    t = np.arange(0.0, 20.0, 0.1)
    zero = np.zeros((len(t), 3))

    def part(t, gyr, acc, mag, aids, params):  # type: ignore[no-untyped-def]
        own = np.full(len(t), t[0])
        return Estimate(t, np.tile(own[:, None], (1, 4)), np.tile(own[:, None], (1, 3)), {"sigma_tilt": own})

    monkeypatch.setattr(smoother, "part", part)
    found = smoother.run(t, zero, zero, zero, Aids(impact=12.0), {})
    begin = np.where(t < 12.0 - smoother.BEFORE_IMPACT_S, 0.0, t[np.searchsorted(t, 12.0 - smoother.BEFORE_IMPACT_S)])
    np.testing.assert_array_equal(found.t, t)
    for x in (found.q, found.bias, found.aux["sigma_tilt"][:, None]):
        np.testing.assert_array_equal(x, np.tile(begin[:, None], (1, x.shape[1])))
    whole = smoother.run(t, zero, zero, zero, Aids(impact=4.0), {})
    assert not whole.q.any(), "less than 5 s before an impact are no flight of their own"
