"""What a smoothed run says of its own errors."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.core import rotation
from attlog.estimators.filters.navigation import attitude
from attlog.estimators.filters.navigation.attitude import HONEST, LEAST_HEADING, LEAST_TILT, sigmas
from attlog.estimators.filters.navigation.inputs import LEAST_R, NoiseLevels
from attlog.estimators.filters.navigation.jumps import Jump

NODE_TIMES = np.arange(0.0, 20.0, 0.1)
OWN = np.radians([0.3, 0.4, 0.7])


def run(q: np.ndarray) -> tuple[Any, Any]:
    """A run at rest with a node at every sample."""
    inputs = SimpleNamespace(t=NODE_TIMES, sensed_at=NODE_TIMES, gyr=np.zeros((len(NODE_TIMES), 3)))
    return inputs, SimpleNamespace(
        schedule=SimpleNamespace(node_at=np.arange(len(NODE_TIMES))), q=np.tile(q, (len(NODE_TIMES), 1))
    )


def test_tilt_holds_two_axes_and_heading_the_third() -> None:
    tilt, heading = sigmas(*run(np.array([1.0, 0, 0, 0])), np.tile(OWN**2, (len(NODE_TIMES), 1)))
    assert tilt == pytest.approx(np.hypot(HONEST * np.radians(0.5), LEAST_TILT))
    assert heading == pytest.approx(np.hypot(HONEST * np.radians(0.7), LEAST_HEADING))


@pytest.mark.parametrize(("roll", "tilted", "turned"), [(0.0, 0.0, 1.0), (90.0, 1.0, 0.0)])
def test_near_a_jump_what_it_turns_in_its_sigma_is_added_about_its_axis(roll: float, tilted: float, turned: float):
    """2 deg/s about the body's z, known to 0.5 s: 1 deg, of heading while level, of tilt on the side."""
    spread = np.tile(OWN**2, (len(NODE_TIMES), 1))
    at = run(rotation.from_euler(np.radians(roll), 0.0, 0.0))
    jump = Jump(10.0, 0.5, np.radians([0.0, 0.0, 2.0]), np.zeros(3))
    near = np.abs(NODE_TIMES - 10.0) <= 1.0 + 1e-9
    for with_jump, without, more in zip(
        sigmas(*at, spread, [jump]), sigmas(*at, spread), (tilted, turned), strict=True
    ):
        added = np.degrees(np.sqrt(with_jump**2 - without**2))
        assert added[near] == pytest.approx(more, abs=1e-6)
        assert added[~near] == pytest.approx(0.0, abs=1e-6)


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


def test_sigmas_are_interpolated_between_nodes_and_grow_with_the_rate_by_1_5_ms() -> None:
    t = np.array([0.0, 1.0, 2.0])
    inputs: Any = SimpleNamespace(t=t, sensed_at=t, gyr=np.array([[0, 0, 0], [2.0, 0, 0], [0, 3.0, 4.0]]))
    found: Any = SimpleNamespace(schedule=SimpleNamespace(node_at=np.array([0, 2])), q=np.tile([1.0, 0, 0, 0], (3, 1)))
    spread = np.array([[1e-4, 3e-4, 2e-4], [3e-4, -1.0, 6e-4]])
    tilt, heading = attitude.sigmas(inputs, found, spread)
    rate = 1.5e-3 * np.array([0.0, 2.0, 5.0])
    least = np.radians([0.03, 0.04])
    assert tilt**2 == pytest.approx(1.44 * np.array([4e-4, 3.5e-4, 3e-4]) + least[0] ** 2 + rate**2)
    assert heading**2 == pytest.approx(1.44 * np.array([2e-4, 4e-4, 6e-4]) + least[1] ** 2 + rate**2)


def test_test_ratios_are_held_from_node_to_node_and_unknown_before_the_first() -> None:
    nan = np.nan
    ratio = np.array([[nan, nan, 0.5, nan], [0.2, nan, nan, nan], [nan, nan, 0.7, nan], [0.4, nan, nan, 0.9]])
    found: Any = SimpleNamespace(schedule=SimpleNamespace(node_at=np.array([0, 2, 3, 5])), ratio=ratio)
    told = attitude.test_ratios(found, 7)
    assert set(told) == {"test_ratio_velocity", "test_ratio_baro", "test_ratio_mag"}
    np.testing.assert_array_equal(told["test_ratio_velocity"], [nan, nan, 0.2, 0.2, 0.2, 0.4, 0.4])
    np.testing.assert_array_equal(told["test_ratio_baro"], [0.5, 0.5, 0.5, 0.7, 0.7, 0.7, 0.7])
    np.testing.assert_array_equal(told["test_ratio_mag"], [nan, nan, nan, nan, nan, 0.9, 0.9])


def ran(**given: Any) -> Any:
    own = {"velocity": True, "mag": True, "aided_by": "gnss mag", "lag": 0.004}
    return SimpleNamespace(**(own | given))


def test_a_run_tells_its_gates_its_noise_and_its_delays_in_the_units_of_their_names() -> None:
    memory = np.zeros(18)
    memory[13], memory[14], memory[15], memory[16] = 3.0, 2.0, 5.0, 40.0
    found: Any = SimpleNamespace(memory=memory, likelihood=-12.5)
    tuned = NoiseLevels(gyro=np.radians(0.03), acc=0.04, gnss_delay=0.15, mag_delay=-0.02)
    told = attitude.quality(ran(), found, tuned, np.radians([0.3, 0.4]), np.radians([1.0, 7.0]))
    assert told == {
        "aided_by": "gnss mag",
        "openings": 3.0,
        "kicks": 2.0,
        "soft_gated_pct": 12.5,
        "sigma_tilt_deg": pytest.approx(np.sqrt(0.125)),
        "sigma_heading_deg": pytest.approx(5.0),
        "imu_lag_corrected_ms": pytest.approx(4.0),
        "likelihood": -12.5,
        "gyro_noise_dps_sqrt_hz": pytest.approx(0.03),
        "acc_noise_m_s2_sqrt_hz": 0.04,
        "gnss_delay_ms": pytest.approx(150.0),
        "mag_delay_ms": pytest.approx(-20.0),
    }
    memory[16] = 0.0
    bare = attitude.quality(ran(velocity=None, mag=None, aided_by=""), found, tuned, np.zeros(0), np.zeros(0))
    assert bare["aided_by"] == "gravity"
    assert bare["soft_gated_pct"] == bare["sigma_tilt_deg"] == 0.0
    assert not {"gnss_delay_ms", "mag_delay_ms"} & set(bare)


def solution(**given: Any) -> Any:
    own = {"tuned": NoiseLevels(), "ratios": np.full(8, np.nan), "passes": 5, "kept": 3, "jumps": (), "unmodelled": 0.0}
    return SimpleNamespace(**(own | given))


def test_the_worst_ratio_is_of_what_is_not_at_its_floor_and_not_of_zero_velocity() -> None:
    r = np.array(NoiseLevels().r)
    r[1] = LEAST_R[1] * 1.0009
    ratios = np.array([2.0, 9.0, np.nan, 1.5, 0.1, 0.2, 0.3, 77.0])
    told = attitude.quality_of_passes(solution(tuned=NoiseLevels(r=r), ratios=ratios))
    assert told == {"passes": 5.0, "pass_kept": 4.0, "worst_ratio": 2.0, "gyro_jumps": 0.0}
    r[1] = LEAST_R[1] * 1.002
    assert attitude.quality_of_passes(solution(tuned=NoiseLevels(r=r), ratios=ratios))["worst_ratio"] == 9.0
    floor = np.array(LEAST_R)
    assert attitude.quality_of_passes(solution(tuned=NoiseLevels(r=floor), ratios=0.25 * ratios))["worst_ratio"] == 1.0
    told = attitude.quality_of_passes(solution(unmodelled=31.0))
    assert (told["worst_ratio"], told["gyro_jump_unmodelled"]) == (0.0, 31.0)


def test_biases_are_those_of_the_start_and_the_median_rate_in_motion() -> None:
    x, first, spread = np.zeros(39), np.zeros(39), np.zeros(39)
    x[12:15], first[12:15] = [0.1, 0.2, 0.3], [0.01, -0.02, 0.04]
    spread[12:15], spread[9:12] = [4e-4, 9e-4, -1.0], np.radians([0.1, 0.2, 0.3]) ** 2
    gyro = np.radians([[9.0, 9.0, 9.0], [1.0, 5.0, -1.0], [2.0, 6.0, -3.0], [8.0, 7.0, -2.0]])
    own = solution(begin=SimpleNamespace(x=x), found=SimpleNamespace(first=first, first_spread=spread))
    for rest, want in (([1, 0, 0, 0], [2.0, 6.0, -2.0]), ([1, 1, 1, 1], [5.0, 6.5, -1.5])):
        told = attitude.quality_of_biases(ran(rest=np.array(rest)), own, gyro)
        assert [told[f"gyro_bias_{axis}_dps"] for axis in "xyz"] == pytest.approx(want)
        assert [told[f"acc_bias_{axis}_m_s2"] for axis in "xyz"] == pytest.approx([0.11, 0.18, 0.34])
        assert [told[f"acc_bias_{axis}_sigma_m_s2"] for axis in "xyz"] == pytest.approx([0.02, 0.03, 0.0])
        assert [told[f"gyro_bias_{axis}_sigma_dps"] for axis in "xyz"] == pytest.approx([0.1, 0.2, 0.3])


def test_of_jumps_that_count_the_largest_is_told() -> None:
    small = Jump(3.0, 0.1, np.radians([0.1, 0.1, 0.1]), np.zeros(3))
    large = Jump(7.0, 0.2, np.radians([0.0, 0.6, -0.8]), np.radians([0.01, 0.02, 0.03]))
    other = Jump(9.0, 0.3, np.radians([0.3, 0.0, 0.0]), np.zeros(3))
    told = attitude.quality_of_jumps([other, small, large])
    assert (told["gyro_jumps"], told["gyro_jump_s"], told["gyro_jump_s_sigma"]) == (2.0, 7.0, 0.2)
    assert told["gyro_jump_dps"] == pytest.approx(1.0)
    assert [told[f"gyro_jump_{axis}_dps"] for axis in "xyz"] == pytest.approx([0.0, 0.6, -0.8])
    assert [told[f"gyro_jump_{axis}_sigma_dps"] for axis in "xyz"] == pytest.approx([0.01, 0.02, 0.03])
    assert attitude.quality_of_jumps([small]) == {"gyro_jumps": 0.0}


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
    nobody: dict[str, float | str] = {"heading_from": "nobody", "heading_why": "so it is", "sigma_heading_deg": 180.0}
    assert attitude.refusal(sound | nobody) == "no heading: so it is"
