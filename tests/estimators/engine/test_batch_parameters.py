"""Every parameter of every filter means in a batch what it means in a run of its own."""

from __future__ import annotations

import numpy as np
import pytest

import attlog
from attlog.base import rotation
from attlog.estimators import get
from attlog.estimators.base import Parameter
from attlog.estimators.engine import batch
from attlog.estimators.engine.batch import estimate_batch
from attlog.estimators.registry import BUILT_IN
from attlog.testing.motion import CONSUMER, flight
from attlog.testing.subject import IN_PLACE

PARAMETERS = [(name, p.name) for name in BUILT_IN if get(name).step is not None for p in get(name).parameters]
SINGLE_DEG = 0.2
"""What float32 may be off after 20 s: 4000 steps of a few 1e-7 rad each, and gains that carry it."""


def values(parameter: Parameter) -> list[float | str]:
    """Other values than the default, far enough from it to show."""
    if parameter.choices:
        return list(parameter.choices)
    default = float(parameter.default)
    found = (
        [0.5 * default, 1.7 * default] if default else [0.3 * min(parameter.high, 1.0), 0.1 * min(parameter.high, 1.0)]
    )
    return [float(np.clip(v, parameter.low, parameter.high)) for v in found]


@pytest.fixture(autouse=True)
def side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """However little there is to do."""
    monkeypatch.setattr(batch, "WORTH", 0)


@pytest.fixture(scope="module")
def motion() -> tuple[np.ndarray, ...]:
    t, gyr, acc, mag = flight(20.0, 200.0, noise=CONSUMER).sensors
    mag = mag.copy()
    mag[np.arange(len(t)) % 4 != 0] = np.nan
    return t, gyr, acc, mag


@pytest.mark.slow
@pytest.mark.parametrize(("name", "parameter"), PARAMETERS)
def test_a_batch_over_one_parameter_equals_runs_of_their_own(
    name: str, parameter: str, motion: tuple[np.ndarray, ...]
) -> None:
    sets = [{parameter: v} for v in values(get(name).parameter(parameter))]
    given = {"aids": IN_PLACE} if "gnss" in get(name).needs else {}
    alone = [attlog.estimate(name, *motion, **given, **one) for one in sets]  # type: ignore[arg-type]
    for one, own in zip(estimate_batch(get(name), sets, *motion, **given), alone, strict=True):
        assert np.abs(one.q - own.q).max() < 1e-9
        assert (one.bias is None) == (own.bias is None)
        if own.bias is not None and one.bias is not None:
            assert np.abs(one.bias - own.bias).max() < 1e-9
    for one, own in zip(estimate_batch(get(name), sets, *motion, **given, dtype="float32"), alone, strict=True):
        apart = np.rad2deg(rotation.total_angle(rotation.error(one.q, own.q)))
        assert apart.max() < SINGLE_DEG
