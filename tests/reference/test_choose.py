"""The best reference is taken, wrong ones are refused, and every step is told."""

from __future__ import annotations

import numpy as np
import pytest

from attlog import segments
from attlog.base import rotation
from attlog.base.errors import UsageError
from attlog.flight.model import Attitude, Stream, TimeLine
from attlog.reference import Reference, ReferenceOptions, choose, heading_references
from attlog.segments.model import Segment, Segments

from .flights import SECONDS, attitude_at, flight, sampled


def chosen(log, **options) -> Reference:
    """The reference of a log."""
    return choose(log, segments.build(log), ReferenceOptions(**options))


def step(reference: Reference, name: str):
    """One step by name."""
    return next(s for s in reference.steps if s.name == name)


def test_truth_comes_before_the_onboard_attitude_and_that_before_nothing():
    assert chosen(flight(truth_hz=50.0)).kind == "truth"
    assert chosen(flight()).kind == "onboard"
    log = flight()
    log.attitudes, log.onboard = {}, None
    nothing = chosen(log)
    assert nothing.kind == "none"
    assert "neither truth nor an onboard attitude" in nothing.steps[0].text


def test_the_user_decides():
    log = flight(truth_hz=50.0)
    log.attitudes["AHR2"] = sampled(5.0, source="AHR2")
    assert chosen(log, reference="onboard").source == "ATT"
    named = chosen(log, reference="onboard:AHR2")
    assert (named.kind, named.source, named.name) == ("onboard", "AHR2", "AHR2")
    assert chosen(log, reference="none").kind == "none"


def test_a_true_heading_that_was_brought_changes_no_onboard_attitude_that_is_asked_for():
    log = flight()
    plain = chosen(log, reference="onboard")
    t = np.arange(0.0, SECONDS, 0.2)
    log.true_heading = Stream(t, np.full((len(t), 1), 2.0), "rad", "NED", "dual-antenna yaw")
    beside = chosen(log, reference="onboard")
    np.testing.assert_array_equal(beside.q, plain.q)
    assert (beside.kind, beside.heading_by) == ("onboard", plain.heading_by)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"reference": "truth"}, "holds no truth"),
        ({"reference": "onboard:XKQ.7"}, "onboard:ATT"),
        ({"reference": "best"}, "use auto, truth"),
        ({"reference": "truth:ATT"}, "use auto, truth"),
        ({"clock": "wall"}, "use sample or publication"),
        ({"declination": "north"}, "use auto, model, param or degrees"),
        ({"input_delay": "late"}, "use auto, off or milliseconds"),
    ],
)
def test_what_the_log_does_not_hold_is_a_usage_error_that_helps(options, words):
    with pytest.raises(UsageError, match=words):
        chosen(flight(), **options)


def test_every_step_is_told_with_its_switch():
    reference = chosen(flight(truth_hz=50.0))
    switches = {s.name: s.option for s in reference.steps}
    for name, option in (
        ("reference", "--reference"),
        ("clock", "config: clock"),
        ("input_delay", "config: input_delay"),
        ("declination", "config: declination"),
        ("trim", "config: trim"),
        ("scoring_start", "config: score_from"),
    ):
        assert switches[name] == option
    assert {"resampling", "resets", "replay_floor", "gravity_check"} <= switches.keys()
    assert all(s.text for s in reference.steps)


def test_times_of_measurement_are_used_unless_the_user_wants_those_of_publication():
    log = flight()
    log.attitudes["ATT"].t_sample = log.attitudes["ATT"].t - 0.007
    reference = chosen(log)
    np.testing.assert_allclose(reference.t, log.attitudes["ATT"].t_sample)
    assert step(reference, "clock").value == pytest.approx(7.0)
    np.testing.assert_allclose(chosen(log, clock="publication").t, log.attitudes["ATT"].t)


def test_an_attitude_that_gravity_contradicts_is_refused_unless_asked_for():
    """A board on its back with the rotation not set: agreement with such an attitude means nothing."""
    log = flight()
    attitude = log.attitudes["ATT"]
    attitude.q = rotation.multiply(attitude.q, rotation.from_euler(np.radians(30.0), 0, 0))
    refused = chosen(log)
    assert refused.kind == "none"
    assert "disagrees with gravity at rest by 30 deg" in refused.fault
    assert refused.refused == {"onboard": refused.fault}
    kept = chosen(log, reference="onboard")
    assert kept.kind == "onboard"
    assert kept.fault == refused.fault


def test_a_truth_that_gravity_contradicts_gives_way_to_the_onboard_attitude():
    log = flight(truth_hz=50.0)
    log.truth.q = rotation.multiply(log.truth.q, rotation.from_euler(np.radians(30.0), 0, 0))
    reference = chosen(log)
    assert reference.source == "ATT"
    assert "truth refused: SIM disagrees with gravity" in reference.steps[0].text
    assert list(reference.refused) == ["truth"]
    assert list(heading_references(log, segments.build(log), reference)) == ["onboard"]


def test_a_truth_that_never_moves_while_the_gyro_turns_is_none():
    log = flight(truth_hz=50.0)
    log.truth.q[:] = [1.0, 0.0, 0.0, 0.0]
    log.imus[0].acc.x[:] = [0.0, 0.0, -9.81]
    assert "never changes while the gyro turns" in chosen(log).steps[0].text
    assert chosen(log, reference="truth").kind == "truth"


@pytest.mark.parametrize(("seconds", "start"), [(60.0, 15.0), (30.5, 15.0), (24.0, 8.0), (6.0, 2.0)])
def test_scoring_starts_after_fifteen_seconds_or_a_third_of_a_short_log(seconds, start):
    assert chosen(flight(seconds)).scoring_start == pytest.approx(start, abs=0.01)


def test_the_user_may_start_scoring_elsewhere():
    assert chosen(flight(), score_from=3.0).scoring_start == 3.0


def test_the_first_seconds_after_a_restart_are_not_scored():
    log = flight()
    for stream in (log.imus[0].gyro, log.imus[0].acc):
        keep = (stream.t < 20.0) | (stream.t > 21.0)
        stream.t, stream.x = stream.t[keep], stream.x[keep]
    reference = chosen(log)
    assert reference.unscored == [(pytest.approx(21.0, abs=0.02), pytest.approx(36.0, abs=0.02))]
    assert "1 restarts" in step(reference, "scoring_start").text
    assert np.unique(reference.gap_segment).tolist() == [0, 1]


def test_comparisons_end_at_an_impact():
    log = flight()
    found = segments.build(log)
    found.segments.append(Segment("impact", 50.0, SECONDS, "8 g with a tumble"))
    reference = choose(log, found, ReferenceOptions())
    assert reference.end == 50.0
    assert step(reference, "scoring_end").value == 50.0


def test_pieces_end_at_resets_and_gaps_and_runs_at_gaps_only():
    log = flight()
    attitude = log.attitudes["ATT"]
    attitude.resets = np.array([600])
    keep = (attitude.t < 40) | (attitude.t > 43)
    attitude.t, attitude.q = attitude.t[keep], attitude.q[keep]
    reference = chosen(log)
    assert np.unique(reference.gap_segment).tolist() == [0, 1]
    assert np.unique(reference.segment).tolist() == [0, 1, 2]
    assert reference.t[np.argmax(reference.segment == 1)] == pytest.approx(30.0)
    assert step(reference, "resets").value == 1.0


def test_samples_that_are_no_attitude_do_not_enter_the_reference():
    log = flight()
    attitude = log.attitudes["ATT"]
    attitude.q[100] = np.nan
    attitude.q[101] = 0.0
    attitude.t[102] = attitude.t[99]
    reference = chosen(log)
    assert len(reference.t) == len(attitude.t) - 3
    assert np.isfinite(reference.q).all()
    np.testing.assert_allclose(np.linalg.norm(reference.q, axis=1), 1.0)


def test_a_slow_reference_says_that_lag_cannot_be_judged():
    assert "too slow for lag" in step(chosen(flight(onboard_hz=4.0)), "resampling").text
    assert "too slow" not in step(chosen(flight(onboard_hz=10.0)), "resampling").text


def test_the_reference_of_a_log_without_imu_is_still_compared():
    log = flight(truth_hz=50.0)
    log.imus, log.imu = [], None
    reference = chosen(log)
    assert reference.kind == "truth"
    assert reference.scoring_start == pytest.approx(15.0)


def test_an_instance_that_flew_is_the_reference_and_not_the_first():
    """The trap: instance 0 analysed though instance 1 flew."""
    log = flight()
    log.attitudes = {
        "estimator_attitude.0": sampled(20.0, source="0"),
        "estimator_attitude.1": sampled(20.0, source="1"),
    }
    log.onboard = "estimator_attitude.1"
    assert chosen(log).source == "1"


def test_choosing_without_segments_or_options_works():
    log = flight()
    log.armed = TimeLine(np.zeros(1), [True], "vehicle_status")
    assert choose(log, Segments()).kind == "onboard"
    np.testing.assert_allclose(np.abs(np.sum(choose(log, Segments()).q * attitude_at(log.attitudes["ATT"].t), 1)), 1.0)


def test_an_attitude_that_covers_only_a_rest_is_not_called_frozen():
    log = flight()
    attitude = log.attitudes["ATT"]
    log.attitudes["ATT"] = Attitude(attitude.t[:5], np.tile(attitude.q[0], (5, 1)), "ATT")
    log.imus[0].gyro.x[log.imus[0].gyro.t <= attitude.t[4]] = 0.0
    assert chosen(log).kind == "onboard"


def test_equal_reasons_of_resets_are_given_once():
    log = flight()
    log.attitudes["ATT"].resets = np.array([100, 200, 300])
    text = step(chosen(log), "resets").text
    assert text.startswith("3 resets, cut out: ")
    assert ";" not in text
