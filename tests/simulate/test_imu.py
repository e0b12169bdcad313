"""The inertial unit: each error alone against its closed form, noise by its Allan deviation."""

from __future__ import annotations

import math
from typing import Any

import allantools
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal, stats
from scipy.spatial.transform import Rotation

from attlog.simulate.imu import ImuSensor, imu_samples, low_pass
from tests.conftest import few
from tests.simulate.still import G, flown, perfect, rows, scenario, unit

Array = NDArray[np.float64]
RAW_T = np.arange(1, 20 * 2000 + 1) / 2000.0


def adev(x: Array, rate: float, tau: float) -> tuple[float, float]:
    """Overlapping Allan deviation at ``tau`` s and the relative half width of its 99.9 % interval (white noise)."""
    _, found, _, _ = allantools.oadev(x, rate=rate, data_type="freq", taus=[tau])
    edf = allantools.edf_simple(len(x), round(tau * rate), 0)
    low, high = stats.chi2.ppf([0.0005, 0.9995], edf)
    return float(found[0]), max(math.sqrt(edf / low) - 1.0, 1.0 - math.sqrt(edf / high))


@pytest.mark.parametrize(("sampling", "rate", "lowpass"), few([("interval", 400.0, 0.0), ("instant", 1000.0, 40.0)], 1))
def test_the_allan_deviation_is_that_of_the_declared_densities(sampling: str, rate: float, lowpass: float) -> None:
    """sigma(tau) = N / sqrt(tau) for white noise of density N (IEEE Std 952-1997, annex C)."""
    imu = perfect(
        {"noise_dps_rthz": 0.007, "lowpass_hz": lowpass},
        {"noise_ug_rthz": 180, "lowpass_hz": lowpass},
        sampling=sampling,
        rate_hz=rate,
    )
    got = unit(imu, seconds=400.0, seed=3)
    for x, density in ((got.gyro, math.radians(0.007)), (got.acc, 180e-6 * G)):
        for axis in range(3):
            for tau in (0.5, 2.0):
                found, half = adev(x[:, axis], rate, tau)
                assert found == pytest.approx(density / math.sqrt(tau), rel=half + 0.005)


@pytest.mark.slow
def test_the_bias_walks_with_the_declared_slope() -> None:
    """sigma(tau) = K sqrt(tau / 3) for a rate random walk of K (IEEE Std 952-1997, annex C)."""
    imu = perfect({"walk_dps_rts": 0.01}, {"walk_m_s2_rts": 0.02})
    found: list[float] = []
    for seed in range(4):
        got = unit(imu, seconds=400.0, seed=seed)
        assert np.abs(got.gyro[1:] - got.gyro_bias[1:]).max() < 1e-5
        for x, k in ((got.gyro, math.radians(0.01)), (got.acc, 0.02)):
            for axis in range(3):
                found += [adev(x[:, axis], 400.0, tau)[0] / (k * math.sqrt(tau / 3.0)) for tau in (1.0, 4.0)]
    assert np.mean(found) == pytest.approx(1.0, abs=0.05)
    steps = np.concatenate([np.diff(unit(imu, seconds=100.0, seed=s).gyro_bias[::40], axis=0) for s in range(4)])
    assert steps.std() == pytest.approx(math.radians(0.01) * math.sqrt(0.1), rel=0.04)


def test_raw_samples_are_multiples_of_the_step_and_end_at_the_range() -> None:
    w = np.linspace(-40.0, 40.0, 40_000)[:, None] * [1.0, 0.5, 0.1]
    got = unit(
        perfect(
            {"step_dps": 0.061, "range_dps": 2000}, {"step_mg": 0.5, "range_g": 8}, sampling="instant", rate_hz=2000
        ),
        rows(20.0, w=w, force=5.0 * w),
        seconds=20.0,
    )
    counts = np.degrees(got.gyro) / 0.061
    limit = np.degrees(np.abs(got.gyro)) >= 2000 - 0.061
    assert np.abs(counts - np.round(counts)).max() < 1e-6
    assert np.abs(got.gyro - w).max(where=np.abs(w) < 34.9, initial=0) <= math.radians(0.061) / 2 + 1e-12
    assert np.degrees(np.abs(got.gyro)).max() == pytest.approx(2000, abs=0.031)
    assert limit[:, 0].any()
    assert not limit[:, 2].any()
    over = (np.abs(w) >= math.radians(2000)).sum()
    assert got.clipped[:, 0].sum() == over
    assert np.abs(got.acc).max() == pytest.approx(8 * G, abs=0.5e-3 * G)


def test_sampling_and_publication_delays_are_exact() -> None:
    def w(t: Array) -> Array:
        return np.column_stack([np.sin(3.0 * t), np.cos(2.0 * t), np.sin(t)])

    imu = perfect(sampling="instant", rate_hz=200, delay_s=0.004, hidden_delay_s=0.011)
    got = unit(imu, rows(20.0, w=w(RAW_T)), seconds=20.0)
    assert np.abs(got.t - got.t_sample - 0.004).max() < 1e-12
    assert np.abs(got.gyro - w(got.t_sample - 0.011)).max() < 2e-6
    assert np.abs(got.gyro - w(got.t_sample)).max() > 0.02


def test_jitter_has_the_declared_size_and_values_belong_to_the_true_instant() -> None:
    def w(t: Array) -> Array:
        return np.column_stack([np.sin(3.0 * t), np.cos(2.0 * t), np.sin(t)])

    got = unit(perfect(sampling="instant", rate_hz=200, jitter_s=0.0004), rows(20.0, w=w(RAW_T)), seconds=20.0)
    off = got.t_sample - np.round(got.t_sample * 200) / 200
    assert off.std() == pytest.approx(0.0004, rel=0.05)
    assert stats.kstest(off / 0.0004, "norm").pvalue > 0.001
    assert (np.diff(got.t_sample) > 0).all()
    assert np.abs(got.gyro - w(got.t_sample)).max() < 2e-6
    assert np.allclose(np.diff(got.t_sample), got.dt[1:], atol=1e-12)


def test_samples_are_lost_at_the_declared_rate_and_in_gaps() -> None:
    got = unit(perfect(rate_hz=400, loss_pct=5.0, gaps=[[4.0, 4.5]]), seconds=20.0)
    assert not ((got.t_sample > 4.0) & (got.t_sample < 4.5)).any()
    whole = 8000 - 200
    assert stats.binomtest(whole - len(got.t), whole, 0.05).pvalue > 1e-4


def test_the_lever_arm_feels_centripetal_and_tangential_acceleration() -> None:
    r, w, w_dot = (0.05, -0.02, 0.03), np.array([1.0, -2.0, 8.0]), np.array([20.0, 5.0, -10.0])
    got = unit(perfect(position_m=r), rows(1.0, w=w, w_dot=w_dot, force=[0, 0, -G]), seconds=1.0)
    want = np.array([0, 0, -G]) + np.cross(w_dot, r) + np.cross(w, np.cross(w, r))
    assert np.abs(got.acc - want).max() < 1e-9
    spin = unit(perfect(position_m=(0.1, 0, 0)), rows(1.0, w=[0, 0, 10.0]), seconds=1.0)
    assert spin.acc[-1] == pytest.approx([-10.0, 0, 0], abs=1e-12)  # w^2 r towards the axis


def test_scale_misalignment_and_mounting_turn_the_vector_as_scipy_says() -> None:
    w, f = np.array([1.0, -2.0, 3.0]), np.array([2.0, 1.0, -9.0])
    imu = perfect(
        {"scale_pct": [1, -2, 0.5], "misalign_deg": [0.5, -0.3, 0.2]},
        {"scale_pct": [-20, 0, 0]},
        rotation_deg=[5, -10, 90],
    )
    got = unit(imu, rows(1.0, w=w, force=f), seconds=1.0)
    mount = Rotation.from_euler("ZYX", [90, -10, 5], degrees=True).inv()
    small = Rotation.from_rotvec(np.radians([0.5, -0.3, 0.2])).inv()
    assert got.gyro[-1] == pytest.approx(np.array([1.01, 0.98, 1.005]) * small.apply(mount.apply(w)), abs=1e-9)
    assert got.acc[-1] == pytest.approx(np.array([0.8, 1, 1]) * mount.apply(f), abs=1e-9)


def test_the_bias_drifts_with_the_warming() -> None:
    imu = perfect(
        {"bias_dps": [0.1, 0, 0], "drift_dps_per_k": [0.02, 0, 0]},
        {"drift_m_s2_per_k": [0, 0.01, 0]},
        warming_k=12,
        warming_s=4,
        temperature_c=30,
    )
    got = unit(imu, seconds=20.0)
    warmer = 12 * (1 - np.exp(-got.t_sample / 4))
    assert np.abs(got.temperature - 30 - warmer).max() < 1e-9
    assert np.abs(np.degrees(got.gyro[:, 0]) - 0.1 - 0.02 * warmer).max() < 0.0003
    assert np.abs(got.acc[:, 1] - 0.01 * warmer).max() < 0.0002


def test_vibration_stands_at_the_harmonics_of_the_rotors_speed() -> None:
    turns = 83.0
    imu = perfect(
        sampling="instant", rate_hz=1000, vibration={"harmonics": [1, 2], "acc_m_s2": [3, 1], "gyro_dps": [2, 0.5]}
    )
    speed = 2 * math.pi * turns
    got = unit(imu, rows(20.0, rotor=[speed, 0, 0, 0], angle=(speed * RAW_T)[:, None]), seconds=20.0)
    hover = scenario().vehicle.speed_max_rad_s * math.sqrt(scenario().vehicle.hover_command(G))
    for x, sizes in ((got.acc, (3.0, 1.0)), (np.degrees(got.gyro), (2.0, 0.5))):
        frequency = np.fft.rfftfreq(len(x), 1e-3)
        size = np.sqrt((np.abs(np.fft.rfft(x, axis=0) / len(x) * 2) ** 2).sum(axis=1))
        peaks = sorted(frequency[np.argsort(size)[-2:]])
        assert peaks == pytest.approx([turns, 2 * turns], abs=0.06)
        for harmonic, want in zip((1, 2), sizes, strict=True):
            found = size[np.argmin(np.abs(frequency - harmonic * turns))]
            assert found == pytest.approx(want * (speed / hover) ** 2, rel=0.02)


@pytest.mark.parametrize("cutoff", [20.0, 300.0])
def test_the_low_pass_is_scipys_butterworth(cutoff: float) -> None:
    b0, b1, b2, a1, a2 = low_pass(cutoff, 2000.0)
    b, a = signal.butter(2, cutoff, fs=2000.0)
    assert [b0, b1, b2] == pytest.approx(b, abs=1e-12)
    assert [1.0, a1, a2] == pytest.approx(a, abs=1e-12)
    rng = np.random.default_rng(1)
    w = rng.standard_normal((4000, 3))
    got = unit(perfect({"lowpass_hz": cutoff}, sampling="instant", rate_hz=2000), rows(2.0, w=w), seconds=2.0)
    start = signal.lfilter_zi(b, a)[:, None] * w[0]
    assert np.abs(got.gyro - signal.lfilter(b, a, w, axis=0, zi=start)[0]).max() < 1e-9


@pytest.mark.parametrize("axis", few([0, 1, 2], 1))
def test_intervals_compose_to_the_true_turn_even_where_the_axis_cones(axis: int) -> None:
    """A coning motion about an axis: two rates 90 deg apart at 10 Hz, which a plain mean rate turns into a false
    drift."""

    def rate(t: Array) -> Array:
        w = np.column_stack([0.3 + 0 * t, 6 * np.cos(60 * t), 6 * np.sin(60 * t)])
        return np.roll(w, axis, axis=1)

    truth = Rotation.identity()
    for turn in Rotation.from_rotvec(rate((np.arange(20_000) + 0.5) / 20_000) / 20_000):
        truth = truth * turn
    w = rate(np.arange(1, 2001) / 2000.0)
    got = unit(perfect(rate_hz=100), rows(1.0, w=w), seconds=1.0)
    composed, plain = Rotation.identity(), Rotation.identity()
    for k in range(len(got.t)):
        composed = composed * Rotation.from_rotvec(got.gyro[k] * got.dt[k])
        plain = plain * Rotation.from_rotvec(w[20 * k : 20 * (k + 1)].mean(axis=0) * 0.01)
    # The unit knows no rate before its first raw sample and takes that for the first half millisecond.
    assert (composed.inv() * truth).magnitude() < 5e-4
    assert (plain.inv() * truth).magnitude() > 0.01


def test_in_a_prescribed_motion_the_gyro_integrates_to_the_truth() -> None:
    moves = [{"seconds": 1.0, "roll_deg": 40.0, "heading_deg": 60.0}, {"seconds": 1.0, "pitch_deg": -50.0}]
    for sampling in ("interval", "instant"):
        one = scenario(4.0, motion={"move": moves}, sensors={"imu": [perfect(sampling=sampling, rate_hz=400)]})
        flight = flown(one)
        imu, q = flight.imus[0], Rotation.identity()
        for k in range(len(imu.t)):
            rate = imu.gyro[k] if sampling == "interval" or k == 0 else 0.5 * (imu.gyro[k - 1] + imu.gyro[k])
            q = q * Rotation.from_rotvec(rate * imu.dt[k])
        truth = Rotation.from_quat(np.roll(flight.truth.q[-1], -1))
        assert np.degrees((q.inv() * truth).magnitude()) < 0.002, sampling


def test_in_a_prescribed_motion_the_accelerometer_feels_acceleration_less_gravity() -> None:
    motion = {"arm_m": [0.1, 0.2, -0.1], "move": [{"seconds": 0.6, "roll_deg": 50.0, "up_m": 1.0}]}
    one = scenario(2.0, motion=motion, sensors={"imu": [perfect(sampling="instant", rate_hz=400)]})
    flight = flown(one)
    truth, imu = flight.truth, flight.imus[0]
    v = np.gradient(truth.p, truth.t, axis=0)
    a = np.gradient(truth.v, truth.t, axis=0)
    assert np.abs(v - truth.v)[1:-1].max() < 2e-3
    assert np.abs(a - truth.a)[1:-1].max() < 0.2
    felt = Rotation.from_quat(np.roll(truth.q[1:], -1, axis=1)).inv().apply(truth.a[1:] - [0, 0, flight.gravity])
    assert np.abs(imu.acc - felt).max() < 1e-9


def test_what_is_drawn_at_once_or_step_by_step_is_the_same() -> None:
    one = scenario(3.0)
    raw = np.zeros((3 * 2000, 17))
    whole, bits = ImuSensor(one, 0, 5, G), ImuSensor(one, 0, 5, G)
    whole.advance(0, raw)
    for k in range(1200):
        bits.advance(k, raw[5 * k : 5 * k + 5])
    assert whole.out.tobytes() == bits.out.tobytes()


@pytest.mark.parametrize("sampling", ["interval", "instant"])
def test_the_compiled_unit_is_its_plain_twin_to_the_bit(sampling: str) -> None:
    imu = {
        "sampling": sampling,
        "rate_hz": 300,
        "jitter_s": 1e-4,
        "gyro": {"lowpass_hz": 60},
        "position_m": [0.1, 0, 0],
    }
    one = scenario(1.0, sensors={"imu": [imu]})
    raw = np.ascontiguousarray(np.random.default_rng(2).standard_normal((400, 17)) * 5.0)
    compiled, plain = ImuSensor(one, 0, 5, G), ImuSensor(one, 0, 5, G)
    plain.run = imu_samples
    for sensor in (compiled, plain):
        sensor.advance(0, raw)
    assert compiled.next == plain.next > 50
    assert compiled.out.tobytes() == plain.out.tobytes()


@pytest.mark.parametrize(
    ("fault", "check"),
    few(
        [
            ({"part": "gyro", "kind": "stuck"}, lambda x, y: np.ptp(x.gyro[801:], axis=0).max() == 0),
            ({"part": "acc", "kind": "zero"}, lambda x, y: not x.acc[800:].any()),
            (
                {"part": "gyro", "kind": "offset", "value": [0.1, 0, 0]},
                lambda x, y: np.allclose(x.gyro[800:] - y.gyro[800:], [0.1, 0, 0]),
            ),
            ({"part": "acc", "kind": "scale", "factor": 0.8}, lambda x, y: np.allclose(x.acc[800:], 0.8 * y.acc[800:])),
            ({"part": "acc", "kind": "noise", "size": 2.0}, lambda x, y: abs((x.acc - y.acc)[800:].std() - 2.0) < 0.1),
            (
                {"part": "gyro", "kind": "spikes", "size": 5.0, "share_pct": 2},
                lambda x, y: 0.01 < (np.abs(x.gyro - y.gyro)[800:] > 1).any(axis=1).mean() < 0.03,
            ),
            ({"part": "gyro", "kind": "silent", "seconds": 1.0}, lambda x, y: len(x.t) == len(y.t) - 400),
            ({"part": "gyro", "kind": "flipped"}, lambda x, y: np.allclose(x.gyro[800:, :2], -y.gyro[800:, :2])),
        ],
        4,
    ),
)
def test_a_planted_fault_acts_from_its_time_on_and_not_before(fault: dict[str, Any], check: Any) -> None:
    hurt = flown(scenario(4.0, fault=[{"t": 2.0 + 1e-6} | fault]), 2).imus[0]
    well = flown(scenario(4.0), 2).imus[0]
    assert np.array_equal(hurt.gyro[:800], well.gyro[:800])
    assert np.array_equal(hurt.acc[:800], well.acc[:800])
    assert check(hurt, well)


def test_one_rotor_out_of_balance_shakes_by_its_own_harmonics_while_it_lasts() -> None:
    fault = {"t": 1.0, "seconds": 1.0, "part": "rotor", "kind": "unbalanced", "factor": 5.0, "instance": 2}
    shaking = {"harmonics": [1, 2], "gyro_dps": [3.0, 1.0], "acc_m_s2": [4.0, 2.0]}
    unit = ImuSensor(scenario(4.0, sensors={"imu": [{"vibration": shaking}]}, fault=[fault]), 0, 5, G)
    for t, factor in ((0.5, 1.0), (1.5, 5.0), (2.5, 1.0)):
        unit._shake_at(t)
        times = np.ones((1, 4, 1))
        times[0, 2] = factor
        np.testing.assert_allclose(unit.shake, unit.balanced * times)
