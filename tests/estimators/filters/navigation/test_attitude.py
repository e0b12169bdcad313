"""What a smoothed run says of its own errors."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.estimators.filters.navigation import attitude

NODE_TIMES = np.arange(0.0, 20.0, 0.1)


def run(q: np.ndarray) -> tuple[Any, Any]:
    """A run at rest with a node at every sample."""
    inputs = SimpleNamespace(t=NODE_TIMES, sensed_at=NODE_TIMES, gyr=np.zeros((len(NODE_TIMES), 3)))
    return inputs, SimpleNamespace(
        schedule=SimpleNamespace(node_at=np.arange(len(NODE_TIMES))), q=np.tile(q, (len(NODE_TIMES), 1))
    )


# What a run tells of itself: numbers of one hand-made pass each, and when it is no reference.

Array = np.ndarray


def quaternions(turns: Rotation) -> Array:
    return np.roll(turns.as_quat(), 1, axis=-1)


def apart(a: Array, b: Array) -> Array:
    inner = np.abs(np.sum(a * b, axis=-1))
    return 2.0 * np.arccos(np.minimum(inner, 1.0))


def test_a_smoothed_attitude_is_the_filters_with_the_error_of_the_node_before_and_its_bias_since(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(1)
    n, nodes = 30, np.array([0, 7, 19, 29])
    own = Rotation.random(n, rng)
    t = np.cumsum(rng.uniform(0.01, 0.03, n))
    rest = (np.arange(n) >= 22).astype(np.int8)
    d, bias = 0.02 * rng.normal(size=(4, 6)), rng.normal(size=(4, 3))
    found: Any = SimpleNamespace(schedule=SimpleNamespace(node_at=nodes), q=quaternions(own), d=d, bias=bias)
    inputs: Any = SimpleNamespace(t=t, sensed_at=t - 0.004, rest=rest)
    want, b = [], []
    for k in range(n):
        node = max(i for i in range(4) if nodes[i] <= k)
        since = 0.0 if rest[k] else t[k] - t[nodes[node]]
        late = own[k].apply(d[node, 3:]) * since
        want.append(Rotation.from_rotvec(d[node, :3] - late) * own[k])
        b.append(bias[node] + d[node, 3:])
    for block in (7, 50_000):
        monkeypatch.setattr(attitude, "BLOCK", block)
        q, found_bias = attitude.smoothed_samples(found, inputs)
        assert apart(q, quaternions(Rotation.concatenate(want))).max() < 1e-6
        assert found_bias == pytest.approx(np.array(b))
    assert attitude.node_before(found, n)[[0, 6, 7, 18, 19, 28, 29]].tolist() == [0, 0, 1, 1, 2, 2, 3]


def test_a_late_attitude_is_turned_on_by_the_next_samples_rate_less_the_bias(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    n = 20
    t, q = 0.01 * np.arange(n), quaternions(Rotation.random(n, rng))
    gyr, bias = rng.normal(size=(n, 3)), 0.1 * rng.normal(size=(n, 3))
    inputs: Any = SimpleNamespace(t=t, sensed_at=t - 0.023, lag=0.023, gyr=gyr)
    want = []
    for k in range(n):
        j = min(k + 2, n - 1)
        turn = (gyr[min(j + 1, n - 1)] - bias[j]) * (t[k] - (t[j] - 0.023))
        want.append(Rotation.from_quat(np.roll(q[j], -1)) * Rotation.from_rotvec(turn))
    for block in (6, 50_000):
        monkeypatch.setattr(attitude, "BLOCK", block)
        assert apart(attitude.at_stamps(inputs, q, bias), quaternions(Rotation.concatenate(want))).max() < 1e-6
    inputs.lag = 0.0
    assert attitude.at_stamps(inputs, q, bias) is q


def test_test_ratios_are_held_from_node_to_node_and_unknown_before_the_first() -> None:
    nan = np.nan
    ratio = np.array([[nan, nan, 0.5, nan], [0.2, nan, nan, nan], [nan, nan, 0.7, nan], [0.4, nan, nan, 0.9]])
    found: Any = SimpleNamespace(schedule=SimpleNamespace(node_at=np.array([0, 2, 3, 5])), ratio=ratio)
    told = attitude.test_ratios(found, 7)
    assert set(told) == {"test_ratio_velocity", "test_ratio_baro", "test_ratio_mag"}
    np.testing.assert_array_equal(told["test_ratio_velocity"], [nan, nan, 0.2, 0.2, 0.2, 0.4, 0.4])
    np.testing.assert_array_equal(told["test_ratio_baro"], [0.5, 0.5, 0.5, 0.7, 0.7, 0.7, 0.7])
    np.testing.assert_array_equal(told["test_ratio_mag"], [nan, nan, nan, nan, nan, 0.9, 0.9])


@pytest.mark.parametrize(
    ("name", "limit", "word"),
    [
        ("sigma_tilt_deg", 1.0, "tilt sigma"),
        ("sigma_heading_deg", 1.0, "heading sigma"),
        ("worst_ratio", 3.0, "residuals"),
        ("soft_gated_pct", 40.0, "GNSS velocities"),
        ("openings", 5.0, "lost an aid"),
    ],
)
def test_a_reference_is_refused_beyond_each_limit(name: str, limit: float, word: str) -> None:
    sound: dict[str, float | str] = {"sigma_tilt_deg": 0.1, "heading_from": "both"}
    assert attitude.refusal(sound | {name: limit}) == ""
    assert word in attitude.refusal(sound | {name: limit * 1.01})
    two = attitude.refusal(sound | {"sigma_tilt_deg": 2.0, "openings": 6.0})
    assert two.count("; ") == 1
    nobody: dict[str, float | str] = {"heading_from": "none", "heading_why": "so it is", "sigma_heading_deg": 180.0}
    assert attitude.refusal(sound | nobody) == "no heading: so it is"
