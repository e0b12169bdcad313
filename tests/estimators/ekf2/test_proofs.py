"""EKF2 run again on flights with known truth and planted faults; its limits are those of its definition."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from attlog.core.errors import UsageError
from attlog.flight.px4 import ekf2_inputs
from attlog.formats.table import Messages
from attlog.pipeline import onboard_rerun
from benchmarks import rerun as bench
from tests.conftest import SAMPLES

STEPS = str(SAMPLES / "px4_steps.ulg")
# Simulated flights without a second fault; px4_magfault has three.
FLIGHTS = ("aggressive", "gnssloss", "hover", "long", "plane", "static", "steps", "wind", "yaw")
# Its heading was reset on the ground from few samples of a noisy field, 1.3 deg off until the climb.
NOISY_START = "aggressive"
# Logged states, logged rates of 2 Hz, versions 1.8 to 1.17.
REAL = (
    "px4_1.14_clipping_crash.ulg",
    "px4_1.14_clipping_field.ulg",
    "px4_1.14_hard_landing.ulg",
    "px4_1.14_spoofing_text.ulg",
    "px4_1.17_gnss_messages_missing.ulg",
    "px4_1.8_hexa.ulg",
    "plane_px4_1.13_crash.ulg",
)


def simulated(corpus: Path, name: str) -> str:
    return str(corpus / "sitl" / "px4" / f"px4_{name}.ulg")


def test_planted_delays_of_gnss_and_field_are_found() -> None:
    gnss_s, field_s = bench.found_delays(*bench.prepared(STEPS))
    assert gnss_s == pytest.approx(bench.GNSS_DELAY_S, abs=0.015)
    assert field_s == pytest.approx(bench.FIELD_DELAY_S, abs=0.015)


def test_planted_compass_offset_and_noises_are_found() -> None:
    case, inputs = bench.prepared(STEPS)
    assert bench.found_offset(case, inputs) == pytest.approx(bench.OFFSET_GAUSS, abs=0.005)
    field, velocity = bench.found_noises(case, inputs)
    assert field == pytest.approx(bench.FIELD_NOISE_GAUSS, rel=0.1)
    assert velocity == pytest.approx(bench.VELOCITY_NOISE_M_S, rel=0.1)


def test_a_parameter_has_the_same_effect_on_a_thinned_log() -> None:
    tilt, heading = bench.correlations(*bench.prepared(STEPS)).T
    assert tilt.min() >= 0.85
    assert heading.min() >= 0.9


def test_half_the_rate_of_the_imu_changes_nothing_that_counts() -> None:
    case, inputs = bench.prepared(STEPS)
    full, half = (bench.followed(case, bench.again(case, x)) for x in (inputs, bench.halved(inputs)))
    assert full is not None
    assert half is not None
    assert half.tilt_p95_deg == pytest.approx(full.tilt_p95_deg, abs=0.02)
    assert half.heading_p95_deg == pytest.approx(full.heading_p95_deg, abs=0.02)


def test_an_antenna_away_from_the_imu_is_seen_by_its_lever_arm() -> None:
    """A velocity that has the antenna's turning in it fits when the offset is given."""
    case, inputs = bench.prepared(STEPS)
    lever = np.array([0.0, 3.0, 0.0])
    imu, states = inputs.imu, bench.again(case, inputs)
    at = np.clip(np.searchsorted(imu.t, inputs.gnss["t"]), 0, len(imu.t) - 1)
    known = np.isfinite(states.q[at, 0])
    turn = np.zeros((len(at), 3))
    q = Rotation.from_quat(states.q[at][known], scalar_first=True)
    smooth = np.column_stack([np.convolve(imu.gyro[:, i], np.full(25, 1 / 25), "same") for i in range(3)])
    turn[known] = q.apply(np.cross(smooth[at][known], lever))
    gnss = {**inputs.gnss, **{name: inputs.gnss[name] + turn[:, i] for i, name in enumerate(("vn", "ve", "vd"))}}
    moved = replace(inputs, gnss=gnss)
    without, right, wrong = (
        bench.rms(bench.again(case, moved, {"GPS_POS_Y": y}), bench.VELOCITY) for y in (0.0, 3.0, -3.0)
    )
    assert right < without < wrong


@pytest.mark.parametrize("flag", ekf2_inputs.UNSUPPORTED_AIDS)
def test_a_flight_on_an_aid_that_is_not_modelled_is_refused(flag: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ekf2_inputs, "control_flags", lambda *_: {"t": np.arange(10.0), flag: np.ones(10)})
    with pytest.raises(UsageError, match="which the re-run does not model"):
        bench.prepared(STEPS)


@pytest.mark.parametrize(("release", "version"), [(0x010E0000, (1, 14)), (0x010F0040, (1, 15)), (0x010F0000, None)])
def test_development_builds_between_1_14_and_1_15_are_refused(release: int, version: tuple[int, int] | None) -> None:
    messages = Messages(Path(), "ulog", 0, {}, info={"ver_sw_release": release})
    if version is None:
        with pytest.raises(UsageError, match="mix two filters"):
            ekf2_inputs.version_of(messages, {})
    else:
        assert ekf2_inputs.version_of(messages, {}) == version


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
def test_a_simulated_flight_is_followed_in_both_modes(corpus: Path, name: str) -> None:
    case, inputs = bench.prepared(simulated(corpus, name))
    for mode in ("flown", "own"):
        found = bench.again(case, inputs, mode=mode)
        same = bench.followed(case, found)
        assert same is not None
        assert (found.mode, found.start, same.follows) == (mode, "cold", True)
        assert same.tilt_median_deg <= 0.2
        assert same.tilt_p95_deg <= 1.0
        assert same.heading_median_deg <= 0.4
        assert same.heading_p95_deg <= 1.0 or name == NOISY_START
        assert bench.bias_difference(found, inputs) <= 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
def test_errors_against_truth_are_those_of_the_filter_that_flew(corpus: Path, name: str) -> None:
    tilt, heading = bench.truth_difference(simulated(corpus, name))
    assert abs(tilt) <= 0.1
    assert abs(heading) <= 0.3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["aggressive", "gnssloss", "long", "plane", "wind", "yaw"])
def test_planted_faults_are_found_on_other_flights(corpus: Path, name: str) -> None:
    case, inputs = bench.prepared(simulated(corpus, name))
    gnss_s, field_s = bench.found_delays(case, inputs)
    assert gnss_s == pytest.approx(bench.GNSS_DELAY_S, abs=0.015)
    assert field_s == pytest.approx(bench.FIELD_DELAY_S, abs=0.015)
    assert np.linalg.norm(bench.found_offset(case, inputs) - bench.OFFSET_GAUSS) < 0.01
    field, velocity = bench.found_noises(case, inputs)
    assert field == pytest.approx(bench.FIELD_NOISE_GAUSS, rel=0.1)
    assert velocity == pytest.approx(bench.VELOCITY_NOISE_M_S, rel=0.1)
    assert (np.median(bench.correlations(case, inputs), axis=0) >= (0.85, 0.9)).all()


@pytest.mark.slow
def test_real_flights_are_followed_with_the_logged_sigmas(corpus: Path) -> None:
    ratios, apart = [], []
    for name in REAL:
        case, inputs = bench.prepared(str(corpus / "logs" / "cases" / name))
        found = bench.again(case, inputs)
        same = bench.followed(case, found)
        assert same is not None
        assert found.start == "warm"
        ratios.append(bench.sigma_ratios(found, inputs))
        apart.append((same.tilt_median_deg, same.tilt_p95_deg, same.heading_median_deg, same.heading_p95_deg))
        if inputs.imu.filled <= 0.01 * len(inputs.imu.t):
            assert same.tilt_median_deg <= 1.0
            assert same.heading_median_deg <= 4.0
    assert np.median(ratios, axis=0) == pytest.approx(np.ones(6), abs=0.1)
    assert (np.median(apart, axis=0) <= (0.15, 0.5, 0.7, 1.8)).all(), apart


@pytest.mark.slow
@pytest.mark.parametrize(("name", "switches"), [("plane_px4_1.13_crash.ulg", 4), ("px4_1.14_clipping_crash.ulg", 2)])
def test_a_lane_that_takes_over_is_run_from_its_own_states(
    corpus: Path, name: str, switches: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    case, inputs = bench.prepared(str(corpus / "logs" / "cases" / name))
    assert len(inputs.switches) == switches
    monkeypatch.setattr(onboard_rerun, "first_lane_switch", lambda _: None)  # compare to the end
    apart = onboard_rerun.onboard_difference(case, bench.again(case, inputs).estimate(case.log.t0_us * 1e-6))
    t = apart[:, 0] + case.log.t0_us * 1e-6
    for begin, end in zip(inputs.switches + 1.0, np.append(inputs.switches[1:], t[-1]), strict=True):
        span = apart[(t >= begin) & (t < end)]
        if len(span):
            assert np.median(span[:, 1]) <= 1.0
            assert np.median(np.abs(span[:, 2])) <= 4.0
