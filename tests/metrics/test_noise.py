import numpy as np
import pytest
from scipy.signal import detrend, lfilter

from attlog import estimators, rotation
from attlog.flight.model import Imu, Stream
from attlog.metrics import noise, probe
from attlog.metrics.ranking import leaders
from attlog.segments.model import Segment
from tests.metrics import flights


def process(rng, n, step, time_constant):
    """Unit Gauss-Markov noise, white for a time constant of 0."""
    white = rng.standard_normal(n)
    if time_constant == 0:
        return white
    a = np.exp(-step / time_constant)
    return lfilter([np.sqrt(1 - a * a)], [1, -a], white, zi=[a * rng.standard_normal()])[0]


def expected_sigma(rng, seconds, step, time_constant, runs=1500):
    """What the statistic of METRICS 3 gives on average: rms over many windows, detrended by scipy."""
    n = round(seconds / step)
    squares = [np.sum(detrend(process(rng, n, step, time_constant)) ** 2) / (n - 2) for _ in range(runs)]
    return np.sqrt(np.mean(squares))


def coverage(seconds, time_constant, runs, step=0.02, seed=3):
    rng = np.random.default_rng(seed)
    truth = expected_sigma(rng, min(seconds, noise.WINDOW_S), step, time_constant)
    t = np.arange(round(seconds / step) + 1) * step
    windows = noise.cut(t, slice(0, len(t)))
    found = []
    for _ in range(runs):
        x = process(rng, len(t), step, time_constant)
        found.append(noise.pooled([noise.detrended(t[w], x[w]) for w in windows]))
    return np.mean([f.ci95[0] <= truth <= f.ci95[1] for f in found]), truth, np.mean([f.sigma for f in found])


@pytest.mark.parametrize(("time_constant", "share"), [(0.0, 1.0), (0.2, 0.925), (1.0, 0.70), (3.0, 0.46)])
def test_the_windowed_statistic_leaves_out_wander(time_constant, share):
    _, truth, mean = coverage(30.0, time_constant, 40)
    assert truth == pytest.approx(share, abs=0.015)
    assert mean == pytest.approx(truth, rel=0.05)


@pytest.mark.parametrize(("seconds", "time_constant"), [(5.0, 0.0), (10.0, 0.2), (20.0, 1.0), (30.0, 3.0)])
def test_the_interval_covers_the_expected_value(seconds, time_constant):
    covered, _, _ = coverage(seconds, time_constant, 60)
    assert 0.85 <= covered <= 1.0  # 60 runs of a 92 to 98 % interval; the 200-run test below is the proof


@pytest.mark.slow
@pytest.mark.parametrize("time_constant", [0.0, 0.2, 1.0, 3.0])
@pytest.mark.parametrize("seconds", [5.0, 10.0, 15.0, 20.0, 30.0, 60.0])
def test_the_interval_covers_in_88_to_100_percent_of_200_runs(seconds, time_constant):
    covered, _, _ = coverage(seconds, time_constant, 200)
    assert 0.88 <= covered <= 1.0


def test_windows_are_5_s_and_a_short_rest_is_one_window():
    t = np.arange(0.0, 17.0, 0.01)
    assert [w.stop - w.start for w in noise.cut(t, slice(0, len(t)))] == [500, 500, 500]
    assert noise.cut(t[:300], slice(0, 300)) == [slice(0, 300)]
    assert noise.cut(t[:150], slice(0, 150)) == []


def still(sigma_deg, seconds=60.0, hz=100.0, seed=0, tilt=0.1):
    t = np.arange(0.0, seconds, 1.0 / hz)
    wobble = np.radians(sigma_deg) * np.random.default_rng(seed).standard_normal((len(t), 3))
    return t, rotation.multiply(rotation.from_euler(tilt, -tilt, 2.0), rotation.from_rotvec(wobble))


REST = [Segment("continuous", 0, 60), Segment("rest.long", 0, 40), Segment("idle", 40, 45), Segment("airborne", 46, 60)]


@pytest.mark.parametrize("sigma", [0.002, 0.01, 0.1])
def test_noise_is_told_in_degrees_per_axis(sigma):
    row = flights.row(*still(sigma))
    answers = noise.compute(flights.case([row], REST), row, "rest")
    for axis in ("roll", "pitch", "heading"):
        answer = answers[f"noise_{axis}_deg"]
        assert answer.value == pytest.approx(sigma, rel=0.05)
        assert answer.ci95[0] < answer.value < answer.ci95[1]
        assert answer.unit == "deg"


def test_noise_does_not_depend_on_where_north_is():
    t, q = still(0.01)
    rows = [flights.row(t, q), flights.row(t, rotation.turn_about_down(q, 1.3))]
    one, two = (noise.compute(flights.case([r], REST), r, "all") for r in rows)
    assert {k: a.value for k, a in one.items()} == pytest.approx({k: a.value for k, a in two.items()}, rel=1e-9)


def test_a_slow_drift_is_not_noise():
    t, q = still(0.001)
    row = flights.row(t, rotation.turn_about_down(q, np.radians(0.1) * t))
    assert noise.compute(flights.case([row], REST), row, "rest")["noise_heading_deg"].value < 0.0012


def test_rest_begins_5_s_after_the_rows_own_start():
    t, q = still(0.001)
    q[t < 4.0] = rotation.from_euler(np.radians(30) * np.sin(t[t < 4.0]), 0, 0)
    row = flights.row(t, q)
    assert noise.compute(flights.case([row], REST), row, "rest")["noise_roll_deg"].value < 0.0012


def test_motors_turning_are_told_apart_and_flight_is_never_rest():
    row = flights.row(*still(0.01))
    case = flights.case([row], REST)
    assert noise.compute(case, row, "airborne") == {}
    assert noise.compute(case, row, "hover") == {}
    assert noise.compute(case, row, "idle")["noise_roll_deg"].seconds == pytest.approx(5.0, abs=0.1)
    assert noise.compute(case, row, "rest")["noise_roll_deg"].seconds == pytest.approx(35.0, abs=0.2)


def test_no_rest_is_a_code_and_a_sentence():
    row = flights.row(*still(0.01))
    answer = noise.compute(flights.case([row], REST[:1]), row, "rest")["noise_roll_deg"]
    assert answer.code == "no_rest"
    assert "10 s" in answer.reason


def test_why_there_is_no_rest_is_said_without_names_of_windows():
    row = flights.row(*still(0.01))
    early = flights.case([row], [Segment("continuous", 0, 60), Segment("rest.short", 0, 4)])
    told = [noise.compute(early, row, window)["noise_roll_deg"].reason for window in ("rest", "rest.long", "2:9")]
    assert told == [
        "there is no rest later than 5 s after the filter's start",
        "no rest of this log is long enough to count as long; record 10 s before arming",
        "there is no rest in 2:9 s later than 5 s after the filter's start",
    ]


def test_the_step_of_logged_values_is_taken_out_and_noise_below_it_is_not_ranked():
    t, q = still(0.02)
    euler = np.radians(np.round(np.degrees(rotation.to_euler(q)) / 0.05) * 0.05)
    coarse = flights.row(t, rotation.from_euler(*euler.T), step_deg=0.05)
    answer = noise.compute(flights.case([coarse], REST), coarse, "rest")["noise_roll_deg"]
    assert not answer.ranked or answer.value == pytest.approx(0.02, rel=0.15)
    quiet = flights.row(*still(0.001), step_deg=0.05)
    answer = noise.compute(flights.case([quiet], REST), quiet, "rest")["noise_roll_deg"]
    assert not answer.ranked
    assert "step" in answer.reason


def test_a_frozen_filter_does_not_win():
    t = np.arange(0.0, 60.0, 0.01)
    moving = np.where(t > 46, np.sin(2 * (t - 46)), 0.0)
    truth = rotation.from_euler(0.3 * moving, 0.2 * moving, 0.5 * moving)
    rng = np.random.default_rng(0)
    honest = rotation.multiply(truth, rotation.from_rotvec(1e-4 * rng.standard_normal((len(t), 3))))
    frozen = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)) + 0 * honest
    rows = [flights.row(t, honest, "honest"), flights.row(t, frozen, "frozen"), flights.row(t, honest, "twin")]
    case = flights.case(rows, REST, (t[::4], truth[::4]))
    for axis in ("roll", "pitch", "heading"):
        column = {r.name: noise.compute(case, r, "rest")[f"noise_{axis}_deg"] for r in rows}
        assert column["frozen"].value < column["honest"].value
        assert not column["frozen"].ranked
        assert leaders(column, "low") == ["honest", "twin"]


def test_a_filter_that_never_moved_is_ranked_by_a_probe_and_only_if_it_can_be_replayed():
    t = np.arange(0.0, 20.0, 0.01)
    rng = np.random.default_rng(1)
    gyro = Stream(t, 1e-3 * rng.standard_normal((len(t), 3)), "rad/s", "FRD", "imu")
    acc = Stream(t, np.array([0.0, 0.0, -9.81]) + 0.02 * rng.standard_normal((len(t), 3)), "m/s^2", "FRD", "imu")
    rows = []
    for name in ("gyro", "mahony"):
        found = estimators.estimate(name, t, gyro.x, acc.x)
        rows.append(flights.row(found.t, found.q, name, estimator=name))
    case = flights.case(rows, [Segment("continuous", 0, 20), Segment("rest.long", 0, 20)])
    case.log.imus, case.log.imu = [Imu(0, gyro, acc)], 0
    for row in rows:
        np.testing.assert_allclose(probe.gains(case, row), 1.0, atol=0.03)
        assert noise.compute(case, row, "rest")["noise_roll_deg"].ranked
    rows[0].estimator = "unknown-file"
    case.forget()
    assert not noise.compute(case, rows[0], "rest")["noise_roll_deg"].ranked


def telemetry(sigma, step, seed=0):
    """A case at rest with a 10 Hz gyro of white noise (rad/s) logged in steps, and the row that integrates it."""
    t = np.arange(0.0, 60.0, 0.1)
    gyro = step * np.round(np.random.default_rng(seed).normal(0.0, sigma, (len(t), 3)) / step)
    acc = np.tile([0.0, 0.0, -9.81], (len(t), 1))
    found = estimators.estimate("gyro", t, gyro, acc)
    row = flights.row(found.t, found.q, "gyro", estimator="gyro")
    case = flights.case([row], [Segment("continuous", 0, 60), Segment("rest.long", 0, 59)])
    case.log.imus = [Imu(0, Stream(t, gyro, "rad/s", "FRD", "RAW_IMU"), Stream(t, acc, "m/s^2", "FRD", "RAW_IMU"))]
    case.log.imu = 0
    return case, row


@pytest.mark.parametrize("sigma", [2e-4, 3e-3])
def test_noise_that_the_steps_of_the_logged_gyro_hide_is_not_ranked(sigma):
    """Telemetry in mrad/s: a gyro that shows one value at rest makes the filter that only integrates it perfect."""
    case, row = telemetry(sigma, 1e-3)
    case.log.imus[0].gyro.x[-5:] = 0.02  # the vehicle moves at the end, in steps too
    answer = noise.compute(case, row, "rest")["noise_roll_deg"]
    assert answer.ranked == (sigma > 1e-3)
    assert answer.ranked or "steps of the logged gyro" in answer.reason


def test_the_noise_that_steps_hide_is_that_of_half_a_step_of_rate_noise():
    case, row = telemetry(3e-3, 1e-3)
    rate = np.degrees(0.5e-3) * np.random.default_rng(2).standard_normal((50, 1000))
    residual = noise.detrended(row.t[:50], 0.1 * np.cumsum(rate, axis=0))
    assert noise.quantisation_floor_deg(case)[0] == pytest.approx(np.sqrt(np.mean(residual**2)), rel=0.05)


def test_the_noise_of_a_gyro_that_never_changes_is_not_known():
    t, q = still(0.01)
    row = flights.row(t, q)
    case = flights.case([row], REST, reference=(t, q))
    frozen, level = np.zeros((len(t), 3)), np.tile([0.0, 0.0, -9.81], (len(t), 1))
    case.log.imus = [Imu(0, Stream(t, frozen, "rad/s", "FRD", "x"), Stream(t, level, "m/s^2", "FRD", "x"))]
    case.log.imu = 0
    answer = noise.compute(case, row, "rest")["noise_roll_deg"]
    assert (answer.ranked, "never changes" in answer.reason) == (False, True)
    assert np.isfinite(answer.floor)


def test_a_users_file_is_probed_itself_also_where_it_bears_the_name_of_a_built_in_filter(tmp_path):
    file = tmp_path / "mahony.py"
    file.write_text(
        '"""Believes in nothing."""\n'
        "def start(params, acc, mag, q0):\n    return q0\n"
        "def step(state, params, dt, gyr, acc, mag):\n    state[0] = 1.0\n"
    )
    case, row = telemetry(3e-3, 1e-3)
    for name, gain in (("mahony", 1.0), (str(file), 0.0)):
        row.estimator = name
        case.forget()
        np.testing.assert_allclose(probe.gains(case, row), gain, atol=0.1)  # half a sample of 10 Hz
