import numpy as np
import pytest
from scipy.optimize import least_squares

from attlog.core import rotation
from attlog.flight.model import Imu, Mag, Stream
from attlog.metrics import lag, step_fit, step_products, step_turning
from attlog.segments.model import Segment
from tests.conftest import few
from tests.metrics import flights
from tests.metrics.flights import STEP_S, aided, motion, sampled

DELAY = 0.0073


def fit(row, ref, events=None, sensors=None):
    events = step_turning.find_steps(ref.t, ref.q, ref.segment) if events is None else events
    return step_fit.fit(step_products.event_batches(row, ref, events, sensors))


@pytest.mark.parametrize("misaligned_deg", [0.0, 3.5])
@pytest.mark.parametrize(("hz", "tolerance"), [(200.0, 1e-4), (25.0, 1e-4), (10.0, 1e-3)])
@pytest.mark.parametrize("kind", ["steps", "yaw", "flips"])
def test_a_pure_delay_of_7_3_ms_is_measured_without_distortion(kind, hz, tolerance, misaligned_deg):
    t, q = motion(kind, 40.0)
    turn = rotation.from_rotvec(np.radians(misaligned_deg) * np.array([0.6, 0.64, 0.48]))
    found = fit(sampled(t, rotation.multiply(q, turn), 200.0, DELAY), sampled(t, q, hz, offset=0.0013))["all"]
    assert len(found.events) >= 8
    assert abs(found.delay - DELAY) < tolerance
    assert found.gain == pytest.approx(1.0, abs=0.003)
    assert found.distortion < 0.02


def test_the_misalignment_comes_out_as_it_was_made():
    """About the vertical: rolling and pitching at once show it."""
    t, q = motion("steps", 60.0)
    row = sampled(t, rotation.multiply(q, rotation.from_rotvec(np.radians([0.0, 0.0, 2.0]))), 200.0)
    found = fit(row, sampled(t, q, 100.0))["all"]
    np.testing.assert_allclose(np.degrees(found.coefficients[2:5]), [0.0, 0.0, -2.0], atol=0.1)


def rate_fit_by_scipy(row, ref, events):
    """Delay (s) and gain of yaw rates over 60 ms, one constant per event, by an independent least-squares fit."""
    span = round(0.06 / ref.step)

    def residual(x):
        out = []
        for k, e in enumerate(events):
            i, j = np.searchsorted(ref.t, [e.begin - 1e-9, e.end + 1e-9])
            t = ref.t[i:j]
            wanted = (ref.turned[i + span : j, 2] - ref.turned[i : j - span, 2]) / 0.06
            shown = np.interp(t + x[0], row.t, row.turned[:, 2])
            out.append((shown[span:] - shown[:-span]) / 0.06 - x[1] * wanted - x[2 + k])
        return np.concatenate(out)

    start = np.concatenate([[0.01, 1.0], np.zeros(len(events))])
    found = least_squares(residual, start, x_scale="jac", diff_step=1e-4)
    return found.x[0], found.x[1], np.sqrt(np.mean(found.fun**2))


def test_a_first_order_lag_of_50_ms_is_told_as_an_independent_fit_tells_it():
    t, q = motion("yaw", 40.0)
    euler = np.unwrap(rotation.to_euler(q), axis=0)
    late = rotation.from_euler(*(flights.first_order(x, STEP_S, 0.05) for x in euler.T))
    ref, row = sampled(t, q, 50.0), sampled(t, late, 200.0)
    events = step_turning.find_steps(ref.t, ref.q, ref.segment)
    found = fit(row, ref, events)["all"]
    assert 0.040 < found.delay < 0.050
    assert 0.02 < found.distortion < 0.12
    delay, gain, _ = rate_fit_by_scipy(row, ref, events)
    assert found.delay == pytest.approx(delay, abs=3e-4)
    assert found.gain == pytest.approx(gain, abs=3e-3)


def thrust_flight(kp, hz=100.0, mag=False):
    """A multirotor whose accelerometer shows thrust alone, and a filter of gain kp that takes it for gravity."""
    t, q = motion("steps", 25.0)
    at = np.arange(0.5, t[-1] - 0.5, 1.0 / hz)
    exact = rotation.slerp(t, q, at)
    f = np.tile([0.0, 0.0, -9.80665], (len(at), 1)) + 0.02 * np.sin(7.0 * at)[:, None]
    m = rotation.rotate_inverse(exact, np.array([0.5, 0.2, 0.8])) if mag else None
    row = flights.row(at, aided(at, exact, f, kp, m))
    gyro = np.zeros((len(at), 3))
    gyro[1:] = rotation.to_rotvec(rotation.multiply(rotation.conjugate(exact[:-1]), exact[1:])) * hz
    end = float(at[-1])
    ref = sampled(t, q, 50.0)
    case = flights.case([row], [Segment("continuous", 0, end), Segment("airborne", 1, end)], (ref.t, ref.q))
    streams = [Stream(at, x, "", "FRD", "made", "interval") for x in (gyro, f)]
    case.log.imus, case.log.imu = [Imu(0, *streams)], 0
    if m is not None:
        case.log.mags, case.log.mag = [Mag(0, Stream(at, 5e-5 * m, "T", "FRD", "made"))], 0
    return case, row


@pytest.mark.parametrize("mag", few([False, True], 1))
@pytest.mark.parametrize("kp", few([0.6, 2.0], 1))
def test_turning_back_to_thrust_is_not_read_as_an_early_estimate(kp, mag):
    case, row = thrust_flight(kp, mag=mag)
    told = lag.LAG.ask(case, row, "all")["lag_ms"]
    assert told.value == pytest.approx(0.0, abs=0.05)
    fitted = step_fit.fits(case, row, "all")["all"]
    assert fitted.gain == pytest.approx(1.0, abs=1e-3)
    case.log.imu = None  # without the accelerometer the turning back bends the answer
    case.forget()
    blind = step_fit.fits(case, row, "all")["all"]
    assert blind.delay < -0.001
    assert fitted.delay - fitted.aiding_shift_s == pytest.approx(blind.delay, abs=0.0015 if kp < 1 else 0.008)


def test_aiding_acts_with_the_attitude_before_the_sample():
    """Half a sample wrong would be read as a lag: the aiding of one sample later fits worse."""
    case, row = thrust_flight(2.0)
    right = lag.LAG.ask(case, row, "all")["distortion_pct"].value
    case.log.imus[0].acc.x[:] = np.roll(case.log.imus[0].acc.x, 20, axis=0)
    case.log.imus[0].acc.x[:, 0] += np.sin(case.log.imus[0].acc.t)
    case.forget()
    assert right < 0.1
    assert lag.LAG.ask(case, row, "all")["distortion_pct"].value > 2 * right


def test_the_jackknife_is_that_of_refits_without_each_event():
    t, q = motion("steps", 30.0)
    rng = np.random.default_rng(3)
    ref, row = sampled(t, q, 50.0), sampled(t, q, 200.0, DELAY)
    noisy = rotation.multiply(row.q, rotation.from_rotvec(0.003 * rng.standard_normal((len(row.t), 3))))
    row = type(row)(row.t, noisy, row.segment)
    events = step_turning.find_steps(ref.t, ref.q, ref.segment)
    found = fit(row, ref, events)["all"]
    assert len(found.events) == len(events)
    again = [fit(row, ref, events[:k] + events[k + 1 :])["all"].delay for k in range(len(events))]
    np.testing.assert_allclose(found.left_out[:, 0], again, atol=3e-5)


def test_the_half_width_is_students_t_on_the_jackknife_error():
    """Values 1, 2, 3, 4: spread 5, error sqrt(3/4 5) = 1.936, t(0.975, 3) = 3.182 (printed tables)."""
    columns = step_products.event_batches(*(sampled(*motion("steps", 30.0), 50.0),) * 2, [], None)
    assert columns is None
    found = fit(sampled(*motion("steps", 20.0), 200.0), sampled(*motion("steps", 20.0), 50.0))["all"]
    found.left_out = np.array([[1.0], [2.0], [3.0], [4.0]])
    assert found.half_width(0) == pytest.approx(3.182 * 1.9365, rel=1e-3)
    found.left_out = found.left_out[:2]
    assert found.half_width(0) == np.inf


def test_an_axis_and_a_choice_of_events_are_solved_from_the_same_sums():
    t, q = motion("steps", 40.0)
    found = fit(sampled(t, q, 200.0, DELAY), sampled(t, q, 50.0))
    assert {"all", "roll", "pitch"} == set(found)
    for part in found.values():
        assert part.delay == pytest.approx(DELAY, abs=1e-4)
        np.testing.assert_allclose(part.each, DELAY, atol=5e-4)
    some = found["all"].sums.fit(np.array([0, 2, 5]))
    assert some.delay == pytest.approx(DELAY, abs=1e-4)
    assert some.seconds < found["all"].seconds


def test_the_slower_row_is_met_at_its_own_times():
    t, q = motion("steps", 40.0)
    found = fit(sampled(t, q, 20.0, DELAY), sampled(t, q, 200.0))["all"]
    assert found.sums.slow_row
    assert found.delay == pytest.approx(DELAY, abs=2e-4)


def test_an_event_with_a_gap_is_left_out():
    t, q = motion("steps", 40.0)
    ref, row = sampled(t, q, 50.0), sampled(t, q, 200.0)
    events = step_turning.find_steps(ref.t, ref.q, ref.segment)
    hole = (row.t < events[4].middle) | (row.t > events[4].middle + 0.1)
    found = fit(type(row)(row.t[hole], row.q[hole], row.segment[hole]), ref, events)["all"]
    assert len(found.events) == len(events) - 1


def test_an_axis_keeps_the_aiding_and_misalignment_of_the_whole():
    case, row = thrust_flight(2.0)
    found = step_fit.fits(case, row, "all")
    for axis in ("roll", "pitch"):
        np.testing.assert_array_equal(found[axis].coefficients[2:], found["all"].coefficients[2:])
        assert found[axis].delay == pytest.approx(0.0, abs=5e-5)
