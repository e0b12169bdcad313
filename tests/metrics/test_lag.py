import numpy as np
import pytest
from scipy.optimize import least_squares

from attlog import rotation
from attlog.metrics import angle_fit, lag, steps
from attlog.segments.model import Segment
from tests.metrics import flights
from tests.metrics.motions import STEP_S, motion, sampled

DELAY = 0.0073


def events_of(track):
    return steps.find(track.t, track.q, track.segment)


@pytest.mark.parametrize("misaligned_deg", [0.0, 3.5])
@pytest.mark.parametrize(("hz", "tolerance"), [(200.0, 2e-4), (25.0, 3e-4), (10.0, 2e-3)])
@pytest.mark.parametrize("kind", ["steps", "yaw", "flips"])
def test_a_pure_delay_of_7_3_ms_is_measured_without_distortion(kind, hz, tolerance, misaligned_deg):
    t, q = motion(kind, 40.0)
    ref, est = sampled(t, q, hz, offset=0.0013), sampled(t, q, 200.0, DELAY)
    turn = rotation.from_rotvec(np.radians(misaligned_deg) * np.array([0.6, 0.64, 0.48]))
    est.q = rotation.multiply(est.q, turn)
    found = angle_fit.fit(est, ref, events_of(ref))
    assert found.events >= 8
    assert abs(found.delay - DELAY) < tolerance
    assert found.gain == pytest.approx(1.0, abs=0.003)
    assert found.distortion < 0.005


def fit_by_scipy(found):
    """Delay (s), gain and residual RMS (deg) of the same windows by an independent least-squares fit."""

    def residual(x):
        out = []
        for k, p in enumerate(found.pairs):
            use = (p.t_ref >= p.event.begin) & (p.t_ref <= p.event.end)
            out.append(np.interp(p.t_ref[use] + x[0], p.t_est, p.est) - x[2 + k] - x[1] * p.ref[use])
        return np.concatenate(out)

    free = least_squares(residual, np.concatenate([[0.01, 1.0], found.offsets]), x_scale="jac", diff_step=1e-4)
    return free.x[0], free.x[1], np.sqrt(np.mean(free.fun**2))


@pytest.mark.parametrize("kind", ["steps", "yaw"])
def test_a_first_order_lag_of_50_ms_is_told_as_an_independent_fit_of_the_same_windows_tells_it(kind):
    t, q = motion(kind, 40.0)
    euler = np.unwrap(rotation.to_euler(q), axis=0)
    late = rotation.from_euler(*(flights.first_order(x, STEP_S, 0.05) for x in euler.T))
    ref, est = sampled(t, q, 25.0), sampled(t, late, 200.0)
    found = angle_fit.fit(est, ref, events_of(ref))
    assert 0.040 < found.delay < 0.050
    assert 0.97 < found.gain < 1.0
    assert 0.0 < found.distortion < 0.04
    delay, gain, residual = fit_by_scipy(found)
    assert found.delay == pytest.approx(delay, abs=2e-4)
    assert found.gain == pytest.approx(gain, abs=1e-3)
    assert found.residual_deg == pytest.approx(residual, rel=0.01)


def noisy_delays(runs, seed=0):
    t, q = motion("steps", 64.0)
    ref, est = sampled(t, q, 25.0, offset=0.0013), sampled(t, q, 200.0, DELAY)
    events = events_of(ref)[:30]
    assert len(events) == 30
    size = np.median([abs(e.delta_deg) for e in events])
    rng = np.random.default_rng(seed)
    clean, found = est.q, []
    for _ in range(runs):
        est.q = rotation.multiply(
            clean, rotation.from_rotvec(np.radians(0.03 * size * rng.standard_normal((len(est.t), 3))))
        )
        found.append(angle_fit.fit(est, ref, events))
    covered = [f.delay_ci95[0] <= DELAY <= f.delay_ci95[1] for f in found]
    return np.array([f.delay for f in found]), np.mean(covered)


def test_noise_of_3_percent_leaves_the_mean_lag_right():
    delays, _ = noisy_delays(8)
    assert abs(delays.mean() - DELAY) < 5e-4


@pytest.mark.slow
def test_the_jackknife_interval_covers_the_true_lag():
    delays, covered = noisy_delays(100, seed=1)
    assert abs(delays.mean() - DELAY) < 5e-4
    assert 0.88 <= covered <= 1.0


def step_case(est, ref, kind="truth", **fields):
    row = flights.row(est.t, est.q, **fields)
    end = float(ref.t[-1])
    return flights.case([row], [Segment("continuous", 0, end), Segment("airborne", 1, end)], (ref.t, ref.q), kind), row


def test_a_filter_that_follows_half_is_bent_and_its_gain_is_told():
    t, q = motion("steps", 40.0)
    half = rotation.from_rotvec(0.5 * rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[0]), q)))
    case, row = step_case(sampled(t, half, 200.0), sampled(t, q, 25.0))
    answers = lag.compute(case, row, "all")
    assert answers["lag_ms"].value is None
    assert answers["lag_ms"].code == "not_a_pure_delay"
    assert answers["step_gain"].value == pytest.approx(0.5, abs=0.01)
    assert "50 %" in answers["lag_ms"].reason


def test_a_frozen_filter_has_no_distortion_and_still_does_not_win_it():
    t, q = motion("steps", 40.0)
    frozen = sampled(t, q, 200.0)
    frozen.q = np.tile(frozen.q[0], (len(frozen.t), 1))
    answer = lag.compute(*step_case(frozen, sampled(t, q, 25.0)), "all")["distortion_pct"]
    assert answer.value == pytest.approx(0.0, abs=1e-6)
    assert not answer.ranked


def test_a_causal_filter_that_comes_out_early_against_truth_is_bent_but_not_against_onboard():
    t, q = motion("steps", 40.0)
    early, ref = sampled(t, q, 200.0, delay=-0.02), sampled(t, q, 25.0)
    assert lag.compute(*step_case(early, ref), "all")["lag_ms"].code == "not_a_pure_delay"
    onboard = lag.compute(*step_case(early, ref, kind="onboard"), "all")["lag_ms"]
    assert onboard.value == pytest.approx(-20.0, abs=0.5)


def test_a_delay_beyond_the_range_is_no_answer():
    t, q = motion("steps", 40.0)
    case, row = step_case(sampled(t, q, 200.0, delay=0.4), sampled(t, q, 25.0))
    assert lag.compute(case, row, "all")["lag_ms"].code == "lag_at_edge"


def test_the_input_delay_is_subtracted_once_and_both_numbers_are_told():
    t, q = motion("steps", 40.0)
    case, row = step_case(sampled(t, q, 200.0, delay=0.0113), sampled(t, q, 25.0))
    case.reference.input_delay_s = 0.0113
    told = lag.compute(case, row, "all")["lag_ms"]
    assert told.value == pytest.approx(0.0, abs=0.3)
    assert told.detail["fitted_ms"] == pytest.approx(11.3, abs=0.3)
    assert told.detail["input_delay_ms"] == pytest.approx(11.3)
    case.reference.input_delay_shared = True
    assert lag.compute(case, row, "all")["lag_ms"].value == pytest.approx(11.3, abs=0.3)


def test_a_reference_below_5_hz_answers_no_lag():
    t, q = motion("yaw", 40.0)
    case, row = step_case(sampled(t, q, 200.0), sampled(t, q, 4.0))
    assert lag.compute(case, row, "all")["lag_ms"].code == "reference_too_slow"


@pytest.mark.parametrize("kind", ["steps", "yaw", "flips"])
def test_a_slow_row_is_compared_at_its_own_times(kind):
    t, q = motion(kind, 60.0)
    case, row = step_case(sampled(t, q, 10.0, delay=0.02), sampled(t, q, 200.0))
    told = lag.compute(case, row, "all")
    assert told["lag_ms"].value == pytest.approx(20.0, abs=2.0)
    assert told["step_gain"].value == pytest.approx(1.0, abs=0.01)
    assert told["distortion_pct"].value < 2.0


def test_two_events_are_too_few_and_none_is_none():
    t, q = motion("yaw", 10.5)
    answers = lag.compute(*step_case(sampled(t, q, 200.0), sampled(t, q, 25.0)), "all")
    assert answers["lag_yaw_ms"].code == "too_few_events"
    assert answers["lag_roll_ms"].code == "no_events"


def test_lag_does_not_change_with_heading():
    t, q = motion("steps", 30.0)
    turned = rotation.turn_about_down(q, 2.0)
    one = lag.compute(*step_case(sampled(t, q, 200.0, DELAY), sampled(t, q, 25.0)), "all")["lag_ms"]
    two = lag.compute(*step_case(sampled(t, turned, 200.0, DELAY), sampled(t, turned, 25.0)), "all")["lag_ms"]
    assert one.value == pytest.approx(two.value, abs=1e-6)


def test_no_movement_is_said_in_a_pilots_words():
    t = np.arange(0.0, 40.0, 0.02)
    still = sampled(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), 25.0)
    case, row = step_case(still, still)
    told = lag.compute(case, row, "airborne")["lag_ms"].reason
    assert told.startswith("no quick movement in flight from 0 s on; turns of 5 deg")
    del case.segments.segments[1]
    told = lag.compute(case, row, "airborne")["lag_ms"].reason
    assert told == "the vehicle was never airborne (as far as the log tells)"
    case.log.vehicle = "boat"
    assert lag.compute(case, row, "airborne")["lag_ms"].reason == "a boat does not fly"


def test_a_refused_reference_is_not_called_missing():
    t, q = motion("steps", 20.0)
    case, row = step_case(sampled(t, q, 200.0), sampled(t, q, 25.0))
    case.reference.kind, case.reference.fault = "none", "ATT never changes while the gyro turns"
    assert lag.compute(case, row, "all")["lag_ms"].reason == case.reference.fault
