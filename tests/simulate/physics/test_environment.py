"""The air at a scenario's place, by the tables of the standard atmosphere (ISO 2533),
whose heights are geopotential."""

from __future__ import annotations

import pytest

from attlog.simulate.physics.environment import environment
from attlog.simulate.scenario.scenario import build


@pytest.mark.parametrize(
    ("alt_m", "density"), [(0.0, 1.22500), (1000.0, 1.11164), (3000.0, 0.909122), (5000.0, 0.736116)]
)
def test_the_density_is_that_of_the_standard_atmosphere(alt_m: float, density: float) -> None:
    assert environment(build({"place": {"alt_m": alt_m}})).density == pytest.approx(density, rel=5e-5)
