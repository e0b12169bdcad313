"""What is left of a row in windows: what scipy and numpy's least squares say of each, compiled and plain."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import detrend, lfilter
from scipy.spatial.transform import Rotation

from attlog import estimators
from attlog.core import rotation
from attlog.flight.model import Imu, Stream
from attlog.metrics import compute, noise, rank, windows
from attlog.metrics.correction_noise import correction_residual
from attlog.metrics.following import pulse_gain
from attlog.metrics.noise import gyro_noise_floor, rest_residual
from attlog.metrics.windows import SETTLING_S, detrended
from attlog.segments.model import Segment
from tests.conftest import few
from tests.metrics import flights

REST = [Segment("continuous", 0, 60), Segment("rest.long", 0, 40), Segment("airborne", 46, 60)]


def still(sigma_deg, seconds=60.0, hz=100.0, seed=0, tilt=0.1):
    t = np.arange(0.0, seconds, 1.0 / hz)
    wobble = np.radians(sigma_deg) * np.random.default_rng(seed).standard_normal((len(t), 3))
    return t, rotation.multiply(rotation.from_euler(tilt, -tilt, 2.0), rotation.from_rotvec(wobble))


def answers(row, window="rest", segments=REST, reference=None):
    return noise.NOISE.ask(flights.case([row], segments, reference), row, window)


def process(rng, n, step, time_constant):
    """Unit Gauss-Markov noise, white for a time constant of 0."""
    white = rng.standard_normal(n)
    if time_constant == 0:
        return white
    a = np.exp(-step / time_constant)
    return lfilter([np.sqrt(1 - a * a)], [1, -a], white, zi=[a * rng.standard_normal()])[0]


@pytest.mark.parametrize("time_constant", few([0.2, 1.0, 3.0], 1))
@pytest.mark.parametrize("seconds", few([5.0, 10.0, 20.0, 40.0], 2))
def test_the_interval_covers_the_typical_window_in_88_to_100_percent_of_200_runs(seconds, time_constant):
    rng, step = np.random.default_rng(11), 0.05
    n = 100
    many = [np.log(np.sum(detrend(process(rng, n, step, time_constant)) ** 2) / (n - 2)) for _ in range(3000)]
    truth = np.exp(np.mean(many) / 2)
    prior, hits = noise.PRIORS["rest"], 0
    ids = np.arange(round(seconds / 5.0))
    for _ in range(200):
        x = process(rng, n * len(ids), step, time_constant).reshape(len(ids), n)
        told = noise.typical(ids, np.log(np.sum(detrend(x) ** 2, axis=1) / (n - 2)), prior, 0.0, ids)
        hits += told.ci95[0] <= truth <= told.ci95[1]
    assert 0.88 <= hits / 200 <= 1.0


@pytest.mark.parametrize("sigma", [0.002, 0.01, 0.1])
def test_noise_is_told_in_degrees_per_axis(sigma):
    found = answers(flights.row(*still(sigma)))
    for axis in ("tilt", "roll", "pitch", "heading"):
        answer = found[f"noise_{axis}_deg"]
        assert answer.value == pytest.approx(sigma, rel=0.05)
        assert answer.ci95[0] < answer.value < answer.ci95[1]
        assert (answer.unit, answer.n, answer.seconds) == ("deg", 6, 30.0)


def test_one_burst_does_not_carry_the_value():
    t, q = still(0.01)
    burst = (t > 22) & (t < 23)
    q[burst] = rotation.multiply(q[burst], rotation.from_rotvec(np.radians(np.sin(40 * t[burst]))[:, None] * [1, 0, 0]))
    found = answers(flights.row(t, q))["noise_roll_deg"]
    assert found.value < 0.03  # pooled over the windows it would be 0.13
    assert found.value < found.ci95[1] < 0.2


def test_what_a_filter_does_while_it_settles_is_not_noise():
    t, q = still(0.001)
    early = rotation.from_rotvec(np.radians(5.0) * (np.exp(-t / 2.0) * np.sin(20 * t))[:, None] * [1.0, 0.0, 0.0])
    found = answers(flights.row(t, rotation.multiply(q, early)))["noise_roll_deg"]
    assert found.value < 0.002
    assert found.n in (4, 5)
    assert answers(flights.row(t, q))["noise_roll_deg"].n == 6


FLIGHT = [
    Segment("continuous", 0, 60),
    Segment("rest.long", 0, 20),
    Segment("idle", 20, 26),
    Segment("airborne", 26, 60),
    Segment("hover", 26, 41),
    Segment("cruise", 41, 60),
]


def flown(name="mahony", sigma_deg=0.2, seed=0):
    """A swaying vehicle with a noisy accelerometer, its gyro, and the row of one filter."""
    t = np.arange(0.0, 60.0, 0.01)
    rng = np.random.default_rng(seed)
    sway = 6.0 * np.sin(2 * np.pi * 0.5 * t)[:, None] * (t > 26)[:, None] * [1.0, -0.7, 0.5]
    q = rotation.from_euler(*np.radians(sway).T)
    rate = np.zeros((len(t), 3))
    rate[1:] = rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) / 0.01
    acc = rotation.rotate_inverse(q, np.tile([0.0, 0.0, -9.81], (len(t), 1)))
    shake = np.where(t > 20, 3.0, 0.05)[:, None]
    acc = acc + shake * rng.standard_normal((len(t), 3))
    gyro = rate + np.radians(0.1) * rng.standard_normal((len(t), 3))
    found = estimators.estimate(name, t, gyro, acc)
    row = flights.row(found.t, found.q, name, estimator=name)
    case = flights.case([row], FLIGHT, (t, q))
    case.log.imus, case.log.imu = [Imu(0, Stream(t, gyro, "rad/s", "FRD", ""), Stream(t, acc, "m/s^2", "FRD", ""))], 0
    return case, row


@pytest.mark.parametrize("phase", ["hover", "cruise", "idle"])
def test_in_motion_noise_is_that_of_the_error_though_no_reference_is_looked_at(phase):
    case, row = flown()
    told = noise.NOISE.ask(case, row, phase)["noise_tilt_deg"]
    e, squares = row.errors, []
    for start in ids_to_s(told):
        i, j = np.searchsorted(e.t, [start, start + 5.0])
        apart = rotation.to_rotvec(rotation.earth_error(e.q_est[i:j], e.q_ref[i:j]))[:, :2]
        squares.append(np.mean(np.sum(detrended(e.t[i:j], np.degrees(apart)) ** 2, axis=0)) / (j - i - 2))
    # the error holds the gyro's own walk too: 0.1 deg/s at 100 Hz is 0.006 deg in 5 s
    assert told.value == pytest.approx(np.exp(np.mean(np.log(squares)) / 2), rel=0.05)
    case.reference.q[:] = rotation.from_euler(0.3, 0.2, 0.1)
    case.forget()
    assert noise.NOISE.ask(case, row, phase)["noise_tilt_deg"].value == told.value


def ids_to_s(answer):
    return answer.units.ids / 1000.0


def test_phases_stand_apart_and_flight_is_never_rest():
    case, row = flown()
    told = {w: noise.NOISE.ask(case, row, w)["noise_tilt_deg"] for w in ("all", "rest", "idle", "hover", "cruise")}
    assert told["all"].value == told["rest"].value
    assert told["hover"].value > 5 * told["rest"].value
    assert told["rest"].gyro_share == 0.0 < told["hover"].gyro_share
    assert {w: a.seconds for w, a in told.items()} == {"all": 10, "rest": 10, "idle": 5, "hover": 15, "cruise": 15}
    assert noise.NOISE.ask(case, row, "airborne") == {}
    own = noise.NOISE.ask(case, row, "15:40")["noise_tilt_deg"]
    assert own.seconds == 5.0


def test_the_noise_of_integrated_gyro_means_nothing_in_the_air_and_is_not_ranked_at_rest():
    case, row = flown("gyro")
    at_rest = noise.NOISE.ask(case, row, "rest")["noise_tilt_deg"]
    assert at_rest.value > 0
    assert (at_rest.ranked, at_rest.reason) == (False, "it is not corrected by gravity")
    for phase in ("idle", "hover", "cruise"):
        assert noise.NOISE.ask(case, row, phase)["noise_tilt_deg"].code == "not_applicable"


def test_the_step_of_logged_values_is_taken_out_and_noise_below_it_is_not_ranked():
    t, q = still(0.02)
    euler = np.radians(np.round(np.degrees(rotation.to_euler(q)) / 0.05) * 0.05)
    coarse = flights.row(t, rotation.from_euler(*euler.T), step_deg=0.05)
    answer = answers(coarse)["noise_roll_deg"]
    assert not answer.ranked or answer.value == pytest.approx(0.02, rel=0.15)
    quiet = flights.row(*still(0.001), step_deg=0.05)
    answer = answers(quiet)["noise_roll_deg"]
    assert not answer.ranked
    assert "step" in answer.reason
    constant = flights.row(t, np.tile(q[0], (len(t), 1)), step_deg=0.05)
    assert np.isfinite(answers(constant)["noise_roll_deg"].value)


def test_a_frozen_filter_does_not_win():
    t = np.arange(0.0, 60.0, 0.01)
    moving = np.where(t > 46, np.sin(2 * (t - 46)), 0.0)
    truth = rotation.from_euler(0.3 * moving, 0.2 * moving, 0.5 * moving)
    rng = np.random.default_rng(0)
    honest = rotation.multiply(truth, rotation.from_rotvec(1e-4 * rng.standard_normal((len(t), 3))))
    loud = rotation.multiply(truth, rotation.from_rotvec(1e-3 * rng.standard_normal((len(t), 3))))
    frozen = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)) + 0 * honest
    rows = [flights.row(t, q, name) for name, q in (("honest", honest), ("frozen", frozen), ("loud", loud))]
    case = flights.case(rows, REST, (t[::4], truth[::4]))
    table = {r.name: compute(case, r, ["rest"]) for r in rows}
    marks = rank(table, rows)
    for axis in ("roll", "pitch", "heading", "tilt"):
        column = f"noise_{axis}_deg"
        assert table["frozen"]["rest"][column].value < table["honest"]["rest"][column].value
        assert not table["frozen"]["rest"][column].ranked
        assert (marks.best["rest"][column], marks.worst["rest"][column]) == (["honest"], ["loud"])


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
        np.testing.assert_allclose([pulse_gain(case, row, axis) for axis in range(3)], 1.0, atol=0.03)
        assert noise.NOISE.ask(case, row, "rest")["noise_roll_deg"].ranked == (row.name == "mahony")
    rows[1].estimator = "unknown-file"
    case.forget()
    assert not noise.NOISE.ask(case, rows[1], "rest")["noise_roll_deg"].ranked


def telemetry(sigma, step, seed=0, name="mahony"):
    """A case at rest with a 10 Hz gyro of white noise (rad/s) logged in steps, and the row of a filter."""
    t = np.arange(0.0, 60.0, 0.1)
    gyro = step * np.round(np.random.default_rng(seed).normal(0.0, sigma, (len(t), 3)) / step)
    acc = np.tile([0.0, 0.0, -9.81], (len(t), 1))
    found = estimators.estimate(name, t, gyro, acc)
    row = flights.row(found.t, found.q, name, estimator=name)
    case = flights.case([row], [Segment("continuous", 0, 60), Segment("rest.long", 0, 59)])
    case.log.imus = [Imu(0, Stream(t, gyro, "rad/s", "FRD", "RAW_IMU"), Stream(t, acc, "m/s^2", "FRD", "RAW_IMU"))]
    case.log.imu = 0
    return case, row


@pytest.mark.parametrize("sigma", [2e-4, 3e-3])
def test_noise_that_the_steps_of_the_logged_gyro_hide_is_not_ranked(sigma):
    """Telemetry in mrad/s: a gyro that shows one value at rest makes the filter that follows it perfect."""
    case, row = telemetry(sigma, 1e-3)
    case.log.imus[0].gyro.x[-5:] = 0.02  # the vehicle moves at the end, in steps too
    answer = noise.NOISE.ask(case, row, "rest")["noise_roll_deg"]
    assert answer.ranked == (sigma > 1e-3)
    assert answer.ranked or "steps of the logged gyro" in answer.reason


def test_the_noise_that_steps_hide_is_that_of_half_a_step_of_rate_noise():
    case, row = telemetry(3e-3, 1e-3)
    rate = np.degrees(0.5e-3) * np.random.default_rng(2).standard_normal((50, 1000))
    residual = detrended(row.t[:50], 0.1 * np.cumsum(rate, axis=0))
    assert noise.quantisation_noise_deg(case, 0)[0] == pytest.approx(np.sqrt(np.mean(residual**2)), rel=0.05)


def test_the_noise_of_a_gyro_that_never_changes_is_not_known():
    t, q = still(0.01)
    row = flights.row(t, q)
    case = flights.case([row], REST, reference=(t, q))
    frozen, level = np.zeros((len(t), 3)), np.tile([0.0, 0.0, -9.81], (len(t), 1))
    case.log.imus = [Imu(0, Stream(t, frozen, "rad/s", "FRD", "x"), Stream(t, level, "m/s^2", "FRD", "x"))]
    case.log.imu = 0
    for axis in ("roll", "tilt"):
        answer = noise.NOISE.ask(case, row, "rest")[f"noise_{axis}_deg"]
        assert (answer.ranked, "never changes" in answer.reason) == (False, True)
        assert np.isfinite(answer.floor)


def test_a_filter_that_corrects_the_lag_of_its_sensor_does_not_add_the_lag():
    """Its attitude at a stamp is the one that the gyro shows 20 ms later: at 40 deg/s 0.8 deg, and no noise."""
    case, row = flown()
    added_by_it = noise.NOISE.ask(case, row, "hover")["noise_tilt_deg"].value
    late = case.log.imus[0].gyro.t_best - 0.02
    row.q = rotation.slerp(late, row.q, row.t.clip(late[0], late[-1]))
    case.forget()
    assert noise.NOISE.ask(case, row, "hover")["noise_tilt_deg"].value > 1.1 * added_by_it
    case.forget()
    row.quality = {"imu_lag_corrected_ms": 20.0}
    assert noise.NOISE.ask(case, row, "hover")["noise_tilt_deg"].value == pytest.approx(added_by_it, rel=0.05)


EDGES = np.array([0, 60, 140])
STEP = 0.01


def attitudes(shaken_rad, headings=(0.4, -2.0), seed=1):
    """Attitudes (140, 4) of two windows, tilted, about these headings; turned by small vectors in the earth."""
    rng = np.random.default_rng(seed)
    middle = Rotation.from_euler("ZYX", [(yaw, 0.1, -0.2) for yaw in np.repeat(headings, np.diff(EDGES))])
    q = (Rotation.from_rotvec(shaken_rad * rng.normal(size=(140, 3))) * middle).as_quat()
    return np.ascontiguousarray(np.roll(q, 1, axis=1))


def level(vectors, q):
    """Vectors (n, 3) seen along the headings of the windows' mean attitudes."""
    own = [Rotation.from_quat(np.roll(part, -1, axis=1)).mean() for part in np.split(q, EDGES[1:-1])]
    yaw = np.repeat([one.as_euler("ZYX")[0] for one in own], np.diff(EDGES))
    return Rotation.from_euler("Z", yaw[:, None]).inv().apply(vectors), own


@pytest.mark.parametrize("loop", [rest_residual.function, rest_residual], ids=["plain", "compiled"])
def test_at_rest_the_rotation_from_the_windows_mean_is_left_without_its_line(loop):
    q, t = attitudes(0.004), 3.0 + STEP * np.arange(140)
    means = rotation.group_means(q, EDGES)
    out = np.empty((140, 3))
    loop(out, t, q, means, np.ascontiguousarray(rotation.to_euler(means)[:, 2]), EDGES)
    _, own = level(np.zeros((140, 3)), q)
    pairs = zip(np.split(q, [60]), own, strict=True)
    apart = np.concatenate([(Rotation.from_quat(np.roll(p, -1, axis=1)) * m.inv()).as_rotvec() for p, m in pairs])
    wanted = np.concatenate([detrend(part, axis=0) for part in np.split(np.degrees(level(apart, q)[0]), [60])])
    np.testing.assert_allclose(out[:, :2], wanted[:, :2], atol=1e-9)
    np.testing.assert_allclose(out[:, 2], wanted[:, 2], atol=2e-3)  # the heading's angle, not the vector's part


def test_a_heading_that_turns_through_south_is_unwrapped_and_no_window_goes_on_from_the_one_before():
    t = STEP * np.arange(140)
    yaw = np.concatenate([np.linspace(-2.5, 2.5, 60) + np.pi, np.linspace(1.0, 1.1, 80)])
    wave = 0.01 * np.sin(9.0 * t)
    q = rotation.from_euler(0.0 * yaw, 0.0 * yaw, yaw + wave)
    means = rotation.group_means(q, EDGES)
    out = np.empty((140, 3))
    rest_residual(out, t, q, means, np.ascontiguousarray(rotation.to_euler(means)[:, 2]), EDGES)
    wanted = np.concatenate([detrend(part) for part in np.split(np.degrees(wave), [60])])
    np.testing.assert_allclose(out[:, 2], wanted, atol=1e-9)


@pytest.mark.parametrize("loop", [correction_residual.function, correction_residual], ids=["plain", "compiled"])
def test_in_flight_an_offset_and_a_constant_in_body_axes_are_fitted_by_least_squares(loop):
    q, t, correction = attitudes(0.1), STEP * np.arange(140), attitudes(0.01, seed=2)
    centre, means, out = rotation.group_means(correction, EDGES), rotation.group_means(q, EDGES), np.empty((140, 3))
    room = np.empty((140, 9)), np.zeros(9), np.zeros(9), np.zeros(9), np.zeros(3)
    loop(out, t, q, correction, centre, np.ascontiguousarray(rotation.to_euler(means)[:, 2]), EDGES, *room)
    left = []
    for k, (a, b) in enumerate([(0, 60), (60, 140)]):
        mean = Rotation.from_quat(np.roll(centre[k], -1))
        x = (Rotation.from_quat(np.roll(correction[a:b], -1, axis=1)) * mean.inv()).as_rotvec()
        r = Rotation.from_quat(np.roll(q[a:b], -1, axis=1)).as_matrix()
        m = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(0.5 * STEP * (r[1:] + r[:-1]), axis=0)])
        columns = np.concatenate([np.tile(np.eye(3), (b - a, 1, 1)), m], axis=2).reshape(-1, 6)
        fit = columns @ np.linalg.lstsq(columns, x.ravel(), rcond=None)[0]
        left.append(np.degrees(x - fit.reshape(-1, 3)))
    np.testing.assert_allclose(out, level(np.concatenate(left), q)[0], atol=1e-9)


def test_windows_are_looked_at_some_at_a_time_and_none_is_lost(monkeypatch):
    monkeypatch.setattr(windows, "SAMPLES_AT_ONCE", 100)
    inside = [slice(0, 40), slice(50, 90), slice(90, 300), slice(310, 320)]
    found = list(windows.sample_batches(inside))
    assert [part for own, _, _ in found for part in own] == inside
    assert len(found) > 1
    for own, at, edges in found:
        assert [slice(at[a], at[b - 1] + 1) for a, b in pairwise(edges)] == own
    assert list(windows.sample_batches([])) == []


# What does the gyro itself wander by?

HOVER = [Segment("continuous", 0, 200), Segment("airborne", 0, 200), Segment("hover", 0, 200)]


def flown_with_share(gyro, hz):
    """A case with a gyro (n, 3) in deg/s and nothing else, in hover all the time."""
    t = np.arange(len(gyro)) / hz
    case = flights.case([], HOVER)
    acc = Stream(t, np.tile([0.0, 0.0, -9.81], (len(t), 1)), "m/s^2", "FRD", "made")
    case.log.imus, case.log.imu = [Imu(0, Stream(t, np.radians(gyro), "rad/s", "FRD", "made"), acc)], 0
    return case


def wander(gyro, hz):
    """The typical window's deviation about its own line of an integrated rate (n,), by scipy."""
    windows = np.cumsum(gyro / hz)[: len(gyro) // round(5 * hz) * round(5 * hz)].reshape(-1, round(5 * hz))
    return np.exp(np.mean(np.log(np.var(detrend(windows, axis=1), axis=1))) / 2)


@pytest.mark.parametrize("hz", [50.0, 250.0])
def test_it_is_what_white_noise_of_the_gyro_becomes_when_it_is_integrated(hz):
    gyro = np.random.default_rng(3).standard_normal((round(200 * hz), 3)) * [0.2, 0.4, 0.8]
    roll, pitch, heading, tilt = gyro_noise_floor(flown_with_share(gyro, hz), 0, "hover")
    for k, found in enumerate((roll, pitch, heading)):
        # the typical of few degrees of freedom lies below the mean: 0.8 of it
        assert wander(gyro[:, k], hz) == pytest.approx(0.85 * found, rel=0.2)
    assert tilt == pytest.approx(np.sqrt((roll**2 + pitch**2) / 2))


# Where windows are laid, which samples fill one, and what counts as settling: closed forms.


def test_a_window_needs_twenty_samples_without_a_gap_up_to_both_ends() -> None:
    t = 0.02 * np.arange(1000)
    assert windows.filled_samples(t, (5.0, 10.0)) == slice(250, 500)
    slow = 0.25 * np.arange(80)
    assert windows.filled_samples(slow, (5.0, 10.0)) == slice(20, 40)
    assert windows.filled_samples(slow, (5.0, 9.75)) is None
    for lost, filled in ((0.22, True), (0.28, False)):
        for begin in (5.0, 7.0):
            kept = t[(t < begin - 1e-9) | (t >= begin + lost - 1e-9)]
            assert (windows.filled_samples(kept, (5.0, 10.0)) is not None) is filled
    for end, filled in ((9.75, True), (9.69, False)):  # 50 ms are nobody's
        assert (windows.filled_samples(t[t < end], (5.0, 10.0)) is not None) is filled


@pytest.mark.parametrize("column", [2, 3])
def test_leading_windows_of_more_than_four_times_the_later_median_settle(column: int) -> None:
    v = np.ones((8, 4))
    v[:3, column] = 50.0, 4.5, 3.9
    assert noise.unsettled(v) == 2
    v[:, :2] = 100.0 * np.arange(8, 0, -1)[:, None] ** 4.0  # roll and pitch alone settle nothing
    assert noise.unsettled(v) == 2
    assert noise.unsettled(np.ones((8, 4))) == 0


@pytest.mark.parametrize(("kind", "left"), [("rest.long", 11), ("hover", 12)])
def test_windows_that_settle_are_left_out_at_rest_alone(kind: str, left: int) -> None:
    """A heading that swings by ten times as much in the first of twelve windows."""
    t = np.arange(0.0, 80.0, 0.02)
    size = np.radians(np.where(t < 25.0, 1.0, 0.1))
    q = rotation.from_euler(0.0 * t, 0.0 * t, size * np.sin(2.0 * np.pi * t))
    row, phase = flights.row(t, q), kind.partition(".")[0]
    case = flights.case([row], [Segment("continuous", 0, 80), Segment(kind, 20, 80)])
    gyro, acc = (Stream(t, np.tile(x, (len(t), 1)), "", "FRD", "made") for x in ((0.0, 0.0, 0.0), (0.0, 0.0, -9.8)))
    case.log.imus, case.log.imu = [Imu(0, gyro, acc)], 0
    found = noise.phase_variances(case, row, phase, phase)
    assert found is not None
    assert len(found.t0) == len(found.variances) == left


def test_a_row_is_measured_in_all_spans_of_a_phase_together() -> None:
    t = np.arange(0.0, 100.0, 0.02)
    q = rotation.from_euler(np.radians(0.1) * np.sin(2.0 * np.pi * t), 0.0 * t, 0.0 * t)
    row = flights.row(t, q)
    spans = [Segment("continuous", 0, 100), Segment("rest.long", 20, 41), Segment("rest.long", 60, 93)]
    found = noise.phase_variances(flights.case([row], spans), row, "rest", "all")
    assert found is not None
    assert found.t0.tolist() == [20.0, 25.0, 30.0, 35.0, 60.0, 65.0, 70.0, 75.0, 80.0, 85.0]
    assert found.seconds == pytest.approx(50.0)
    assert np.sqrt(found.variances[:, 0]) == pytest.approx(0.1 / np.sqrt(2.0), rel=0.02)


# Windows that a row is measured in.


@pytest.mark.parametrize(("start", "first"), [(0.0, 10.0), (1.0, 15.0), (5.0, 15.0)])
def test_no_window_holds_the_seconds_in_which_a_row_settles(start: float, first: float) -> None:
    """10 s after its start; windows of 5 s are laid from the begin of the span on, the same for all rows."""
    assert SETTLING_S == 10.0
    t = np.arange(0.0, 30.0, 0.02)
    row = flights.row(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)), start=start)
    case = flights.case([row], [Segment("continuous", 0, 30), Segment("rest.long", 0, 30)])
    found = windows.span_windows(case, row, "rest", (0.0, 30.0))
    assert [w[0] for w, _ in found] == np.arange(first, 30.0, 5.0).tolist()
