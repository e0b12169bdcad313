import pickle

import numpy as np
import pytest

from attlog.core import rotation
from attlog.flight.model import TruthFit
from attlog.metrics import lag
from attlog.segments.model import Segment
from tests.metrics import flights
from tests.metrics.flights import motion, sampled

DELAY = 0.0073


def step_case(est, ref, kind="truth", **fields):
    row = flights.row(est.t, est.q, **fields)
    end = float(ref.t[-1])
    return flights.case([row], [Segment("continuous", 0, end), Segment("airborne", 1, end)], (ref.t, ref.q), kind), row


def test_a_filter_that_follows_half_is_no_pure_delay_and_its_gain_is_told():
    t, q = motion("steps", 40.0)
    half = rotation.from_rotvec(0.5 * rotation.to_rotvec(rotation.multiply(rotation.conjugate(q[0]), q)))
    case, row = step_case(sampled(t, half, 200.0), sampled(t, q, 25.0))
    answers = lag.LAG.ask(case, row, "all")
    assert answers["lag_ms"].value is None
    assert answers["lag_ms"].code == "not_a_pure_delay"
    assert answers["step_gain"].value == pytest.approx(0.5, abs=0.01)
    assert "50 %" in answers["lag_ms"].reason


def test_a_frozen_filter_has_no_distortion_and_still_does_not_win_it():
    t, q = motion("steps", 40.0)
    frozen = sampled(t, q, 200.0)
    frozen.q = np.tile(frozen.q[0], (len(frozen.t), 1))
    answer = lag.LAG.ask(*step_case(frozen, sampled(t, q, 25.0)), "all")["distortion_pct"]
    assert answer.value == pytest.approx(0.0, abs=1e-6)
    assert not answer.ranked


def test_a_causal_filter_that_comes_out_early_against_truth_is_not_judged_but_is_against_onboard():
    t, q = motion("steps", 40.0)
    early, ref = sampled(t, q, 200.0, delay=-0.02), sampled(t, q, 25.0)
    assert lag.LAG.ask(*step_case(early, ref), "all")["lag_ms"].code == "not_a_pure_delay"
    onboard = lag.LAG.ask(*step_case(early, ref, kind="onboard"), "all")["lag_ms"]
    assert onboard.value == pytest.approx(-20.0, abs=0.5)


def test_a_delay_beyond_the_range_is_no_answer():
    t, q = motion("steps", 40.0)
    case, row = step_case(sampled(t, q, 200.0, delay=0.4), sampled(t, q, 25.0))
    assert lag.LAG.ask(case, row, "all")["lag_ms"].code == "lag_at_edge"


def test_the_input_delay_is_subtracted_once():
    t, q = motion("steps", 40.0)
    case, row = step_case(sampled(t, q, 200.0, delay=0.0113), sampled(t, q, 25.0))
    case.reference.alignment.input_delay_s = 0.0113
    told = lag.LAG.ask(case, row, "all")["lag_ms"]
    assert told.value == pytest.approx(0.0, abs=0.3)
    assert told.taken_out == pytest.approx(11.3)


def test_the_clock_of_an_external_truth_is_part_of_the_interval_also_of_a_choice_of_events():
    t, q = motion("steps", 40.0)
    case, row = step_case(sampled(t, q, 200.0, delay=0.0073), sampled(t, q, 25.0))
    sure = lag.LAG.ask(case, row, "all")["lag_ms"]
    none = (0.0, 0.0, 0.0)
    case.reference.fit = TruthFit("m.tum", 1.0, 0.004, 0.0, 1.0, none, none, 0.99, 0.5, 100, 40.0, 0.1, 0.1)
    case.forget()
    unsure = lag.LAG.ask(case, row, "all")["lag_ms"]
    assert unsure.value == pytest.approx(sure.value)
    added = (unsure.ci95[1] - unsure.value) ** 2 - (sure.ci95[1] - sure.value) ** 2
    assert np.sqrt(added) == pytest.approx(8.0)
    assert unsure.units.on(unsure.units.ids).ci95 == pytest.approx(unsure.ci95)


def test_a_filter_that_corrects_the_input_delay_is_not_forgiven_it_again():
    t, q = motion("steps", 40.0)
    case, row = step_case(sampled(t, q, 200.0), sampled(t, q, 25.0))
    case.reference.alignment.input_delay_s = 0.0113
    row.quality["imu_lag_corrected_ms"] = 11.3
    assert lag.LAG.ask(case, row, "all")["lag_ms"].value == pytest.approx(0.0, abs=0.3)


def test_a_reference_below_5_hz_answers_no_lag():
    t, q = motion("yaw", 40.0)
    case, row = step_case(sampled(t, q, 200.0), sampled(t, q, 4.0))
    assert lag.LAG.ask(case, row, "all")["lag_ms"].code == "reference_too_slow"


@pytest.mark.parametrize("kind", ["steps", "yaw", "flips"])
def test_a_slow_row_is_compared_at_its_own_times(kind):
    t, q = motion(kind, 60.0)
    case, row = step_case(sampled(t, q, 10.0, delay=0.02), sampled(t, q, 200.0))
    told = lag.LAG.ask(case, row, "all")
    assert told["lag_ms"].value == pytest.approx(20.0, abs=2.0)
    assert told["step_gain"].value == pytest.approx(1.0, abs=0.01)
    assert told["distortion_pct"].value < 2.0


def test_two_events_are_too_few_and_none_is_none():
    t, q = motion("yaw", 10.5)
    answers = lag.LAG.ask(*step_case(sampled(t, q, 200.0), sampled(t, q, 25.0)), "all")
    assert answers["lag_yaw_ms"].code == "too_few_events"
    assert answers["lag_roll_ms"].code == "no_events"


def found_with(**changes):
    case, row = step_case(sampled(*motion("steps", 30.0), 200.0, DELAY), sampled(*motion("steps", 30.0), 25.0))
    found = lag.evidence(case, row, "all").fits["all"]
    for name, value in changes.items():
        setattr(found.sums if name == "heavy" else found, name, value)
    return found


@pytest.mark.parametrize(
    ("changes", "sound", "word"),
    [
        ({}, True, None),
        ({"gain": 0.94}, True, "94 %"),
        ({"gain": 1.06}, True, "106 %"),
        ({"gain": 0.951}, True, None),
        ({"gain": 1.049}, True, None),
        ({"distortion": 0.149}, True, None),
        ({"share": 0.24}, False, None),
        ({"share": 0.14, "heavy": 0.03}, True, None),
        ({"distortion": 0.16}, True, "shape error 16 %"),
        ({"share": 0.71}, True, "71 %"),
        ({"share": 0.69}, True, None),
        ({"share": 0.3}, False, "diverged"),
        ({"share": 0.2, "heavy": 0.03}, True, "2 g"),
        ({"share": 0.2, "heavy": 0.01}, True, None),
    ],
)
def test_a_lag_is_judged_only_where_the_row_keeps_the_movements_shape(changes, sound, word):
    why = lag.why_no_pure_delay(found_with(**changes), sound=sound, half_width=0.001, lag=0.0, earliest=-0.0025)
    assert (why is None) if word is None else (word in why)


def test_an_early_row_needs_both_its_interval_and_half_a_sample_to_be_refused():
    found = found_with()
    early = {"sound": True, "lag": -0.004}
    assert "early" in lag.why_no_pure_delay(found, half_width=0.003, earliest=-0.0025, **early)
    assert lag.why_no_pure_delay(found, half_width=0.005, earliest=-0.0025, **early) is None
    assert lag.why_no_pure_delay(found, half_width=0.003, earliest=-0.005, **early) is None


def test_the_interval_adds_clock_shape_and_aiding_to_the_jackknife():
    found = found_with(shape_s=0.010, aiding_shift_s=-0.020)
    found.left_out = np.full((5, 4), DELAY)
    assert lag.half_width(found) == pytest.approx(np.hypot(0.0005, np.hypot(0.003, 0.003)))
    assert lag.half_width(found, common=0.0) == pytest.approx(np.hypot(0.003, 0.003))


def test_units_of_a_lag_are_pseudo_values_and_answer_again_on_a_choice():
    case, row = step_case(sampled(*motion("steps", 40.0), 200.0, DELAY), sampled(*motion("steps", 40.0), 25.0))
    told = lag.LAG.ask(case, row, "all")["lag_ms"]
    units = pickle.loads(pickle.dumps(told.units))
    assert units.kind == "lag_event"
    assert np.mean(units.values) == pytest.approx(told.value, abs=0.05)
    whole, some = units.on(units.ids), units.on(units.ids[:5])
    assert whole.value == pytest.approx(told.value)
    assert whole.ci95 == pytest.approx(told.ci95)
    assert some.value == pytest.approx(1000 * DELAY, abs=0.2)


def test_scale_of_the_logged_gyro_stays_in_the_interval_of_a_gain():
    t, q = motion("steps", 40.0)
    gain = lag.LAG.ask(*step_case(sampled(t, q, 200.0), sampled(t, q, 25.0)), "all")["step_gain"]
    assert gain.ci95[0] <= gain.value - lag.COMMON_GAIN
    assert gain.ci95[1] == pytest.approx(gain.value + lag.COMMON_GAIN, rel=1e-3)


@pytest.mark.parametrize(("own_ms", "known_ms"), [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (-8.0, 0.0)])
def test_an_attitude_computed_elsewhere_has_its_own_delay_and_not_that_of_the_logged_imu(own_ms, known_ms):
    """Truth itself came out early by the IMU's delay; a clock that is ahead is no impossible filter."""
    t, q = motion("steps", 40.0)
    est = sampled(t, q, 200.0, delay=1e-3 * own_ms)
    case, row = step_case(est, sampled(t, q, 25.0), estimator="estimate.csv", parameters={"delay": known_ms})
    case.reference.alignment.input_delay_s = 0.00375
    told = lag.LAG.ask(case, row, "all")["lag_ms"]
    assert told.value == pytest.approx(own_ms - known_ms, abs=0.3)
    assert told.ci95[0] < own_ms - known_ms < told.ci95[1]
    assert told.taken_out == known_ms


@pytest.mark.parametrize(("gain", "ranked"), [(0.949, False), (0.951, True), (1.049, True), (1.051, False)])
def test_a_distortion_is_ranked_where_the_row_follows_the_whole_step(gain, ranked):
    case, row = step_case(sampled(*motion("steps", 30.0), 200.0, DELAY), sampled(*motion("steps", 30.0), 25.0))
    seen = lag.evidence(case, row, "all")
    seen.fits["all"].gain = gain
    answer = lag._of_axis(case, row, "all", "all", seen)["distortion_pct"]
    assert (answer.ranked, answer.reason) == (ranked, None if ranked else f"follows {100 * gain:.0f} % of the step")
