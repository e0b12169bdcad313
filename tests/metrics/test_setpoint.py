"""The response to a step of the set-point from records in closed form: a first-order lag behind a delay."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter, lti
from scipy.signal import step as step_of

from attlog.core import rotation
from attlog.flight.model import Attitude, TimeLine
from attlog.metrics import setpoint
from attlog.segments.model import Segment
from tests.conftest import few
from tests.metrics import flights

FINE_S = 0.001


@functools.lru_cache(maxsize=8)
def plant(hertz, damping, dead_s, seconds=50.0, noise_deg=0.0, seed=0):
    """Roll and pitch (n,) deg of a moving set-point and of a second-order loop after a dead time, every ms."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, FINE_S)
    a = np.exp(-2 * np.pi * 1.0 * FINE_S)
    wanted, flown = [], []
    w = 2 * np.pi * hertz
    for _ in range(2):
        x = lfilter([1 - a], [1, -a], lfilter([1 - a], [1, -a], rng.standard_normal(len(t))))
        x *= 8.0 / np.std(x)
        shift = round(dead_s / FINE_S)
        late = np.concatenate([np.full(shift, x[0]), x[: len(x) - shift]])
        b, c, _ = cont2discrete(([w * w], [1, 2 * damping * w, w * w]), FINE_S, "foh")
        y = x[0] + lfilter(b.ravel(), c, late - x[0])
        wanted.append(x)
        flown.append(y + noise_deg * rng.standard_normal(len(t)))
    return t, np.array(wanted).T, np.array(flown).T


def known(hertz, damping, dead_s):
    """Delay, rise (s), peak and settling (s) of the plant, from scipy's step response."""
    w = 2 * np.pi * hertz
    t, y = step_of(lti([w * w], [1, 2 * damping * w, w * w]), T=np.arange(0.0, 3.0, 1e-4))
    at = [t[np.argmax(y >= level)] for level in (0.1, 0.5, 0.9)]
    settled = t[np.flatnonzero(np.abs(y - 1) > 0.05)[-1]]
    return at[1] + dead_s, at[2] - at[0], y.max(), settled + dead_s


def flight(hertz=3.0, damping=0.7, dead_s=0.02, hz=100.0, noise_deg=0.02):
    t, wanted, flown = plant(hertz, damping, dead_s, noise_deg=noise_deg)
    every = round(1.0 / hz / FINE_S)
    t, wanted, flown = t[::every], np.radians(wanted[::every]), np.radians(flown[::every])
    q_set, q = (rotation.from_euler(x[:, 0], x[:, 1], 0.3) for x in (wanted, flown))
    row = flights.row(t, q, "onboard")
    row.kind = "onboard"
    case = flights.case([row], [Segment("continuous", 0, 50), Segment("airborne", 2, 49)])
    case.log.attitudes, case.log.onboard = {"ATT": Attitude(t, q, "ATT")}, "ATT"
    case.log.setpoints.attitude = Attitude(t, q_set, "ATT.Des")
    return case, row


@pytest.mark.parametrize("plant_of", few([[3.0, 0.7, 0.02], [3.0, 0.5, 0.02], [1.5, 0.7, 0.05]], 1))
@pytest.mark.parametrize("noise_deg", few([0.0, 0.3], 1))
def test_a_known_plant_comes_back_to_3_ms_and_5_percent(plant_of, noise_deg):
    found = setpoint.SETPOINT.ask(*flight(*plant_of, noise_deg=noise_deg), "all")
    delay, rise, peak, settled = known(*plant_of)
    assert found["setpoint_delay_ms"].value == pytest.approx(1000 * delay, abs=3.0)
    assert found["setpoint_rise_ms"].value == pytest.approx(1000 * rise, rel=0.05)
    assert found["setpoint_peak_pct"].value == pytest.approx(100 * peak, abs=3.0)
    if noise_deg == 0.0:
        assert found["setpoint_settling_s"].value == pytest.approx(settled, abs=0.03)


@pytest.mark.slow
def test_an_attitude_that_ignores_its_set_point_has_no_response():
    case, row = flight()
    case.log.attitudes["ATT"].q = np.roll(case.log.attitudes["ATT"].q, 4000, axis=0)
    found = setpoint.SETPOINT.ask(case, row, "all")
    assert found["setpoint_delay_ms"].value is None
    assert found["setpoint_delay_ms"].code == "did_not_move"
    assert found["tracking_rms_deg"].value > 3.0


@pytest.mark.slow
def test_modes_that_command_no_attitude_and_times_disarmed_are_left_out():
    case, row = flight()
    whole = setpoint.SETPOINT.ask(case, row, "all")["setpoint_delay_ms"].seconds
    case.log.state.mode = TimeLine(np.array([0.0, 25.5]), ["Stabilized", "Acro"], "made")
    half = setpoint.SETPOINT.ask(case, row, "all")["setpoint_delay_ms"].seconds
    assert half == pytest.approx(0.5 * whole, abs=8.0)
    case.segments.segments.append(Segment("armed", 0, 13))
    assert setpoint.SETPOINT.ask(case, row, "all")["setpoint_delay_ms"].seconds < 0.55 * half
    case.log.state.mode = TimeLine(np.array([0.0]), ["ACRO"], "made")
    assert setpoint.SETPOINT.ask(case, row, "all")["setpoint_delay_ms"].code == "not_covered"


def test_without_a_set_point_there_is_a_code():
    case, row = flight()
    case.log.setpoints.attitude = None
    assert {a.code for a in setpoint.SETPOINT.ask(case, row, "all").values()} == {"no_setpoint"}


def test_only_the_onboard_row_has_a_controller():
    case, row = flight()
    row.name = "mahony"
    assert setpoint.SETPOINT.ask(case, row, "all") == {}


def test_two_samples_of_set_point_and_attitude_at_the_least_rate_are_needed():
    """Which code, by how many samples there are and how fast they are."""

    def code(first, second, slower=1.0):
        case, _ = flight()
        log, flew = case.log, case.log.onboard_attitude
        whole = log.setpoints.attitude
        slower = slower * whole.rate / setpoint.MIN_RATE_HZ if slower != 1.0 else 1.0
        log.setpoints.attitude = dataclasses.replace(whole, t=slower * whole.t[:first], q=whole.q[:first])
        log.attitudes[log.onboard] = dataclasses.replace(flew, t=flew.t[:second], q=flew.q[:second])
        found = setpoint.flown_angles(case, "airborne")[1]
        return None if found is None else found[0]

    assert code(1, None) == code(None, 1) == "no_setpoint"
    assert code(2, None) != "no_setpoint"
    assert code(None, 2) != "no_setpoint"
    assert code(None, None) is None
    assert code(None, None, 1.02) == "rate_too_low"
    assert code(None, None, 0.98) != "rate_too_low"


STEP = 0.02
T = STEP * np.arange(6000)
DELAY, LAG = 0.06, 0.1


def flown(gain: float = 1.0, seed: int = 1) -> setpoint.ResponseEquations:
    """Set-points that jump every half second, other ones for each axis, and what follows them."""
    rng = np.random.default_rng(seed)
    wanted = np.repeat(rng.normal(size=(240, 2)) * [10.0, 6.0], 25, axis=0)
    after = np.arange(0.0, 3.0, STEP)
    impulse = np.where(after >= DELAY, np.exp(-(after - DELAY) / LAG), 0.0)
    impulse /= impulse.sum()
    follows = np.column_stack([np.convolve(x, impulse)[: len(x)] for x in wanted.T])
    blocks = setpoint.blocks_of([(T, wanted, gain * follows)])
    assert blocks is not None
    return blocks


def test_the_response_is_that_of_the_filter_behind_its_delay_and_ends_at_one() -> None:
    t, step = setpoint.step_response(flown())
    exact = np.where(t >= DELAY, 1.0 - np.exp(-(t - DELAY + 0.5 * STEP) / LAG), 0.0)
    np.testing.assert_allclose(step, exact, atol=0.04)
    assert np.mean(step[t >= 0.8]) == pytest.approx(1.0)
    half, rise, peak, settled = setpoint.response_features(t, step)
    assert half == pytest.approx(DELAY + LAG * np.log(2.0) - 0.5 * STEP, abs=0.01)
    assert rise == pytest.approx(LAG * np.log(9.0), abs=0.015)
    assert peak == pytest.approx(1.0, abs=0.02)
    assert settled == pytest.approx(DELAY + LAG * np.log(20.0) - 0.5 * STEP, abs=0.03)


@pytest.mark.parametrize(("gain", "known"), [(0.25, True), (0.15, False), (-1.0, False)])
def test_what_follows_a_fifth_of_its_set_point_or_less_has_no_response(gain: float, known: bool) -> None:
    _, step = setpoint.step_response(flown(gain))
    assert bool(np.isfinite(step).all()) is known
    assert bool(np.isfinite(setpoint.response_features(T[: len(step)], step)).all()) is known
