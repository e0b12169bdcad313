"""What people write where the command line takes something else: the answer names how it is written here."""

from __future__ import annotations

import pytest

LOG = "copter_yaw_turns.bin"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("analyze", LOG, "--estimators", "mahony:kp=0,3"), "did you mean kp=0.3?"),
        (("analyze", LOG, "--estimators", "gyro,mahony:ki=0.1,kp=1,25"), "did you mean kp=1.25?"),
        (("extract", LOG, "--estimates", "mahony:kp=0,3"), "did you mean kp=0.3?"),
        (("compare", LOG, "mahony", "mahony:ki=1,kp=0,3"), "did you mean kp=0.3?"),
        (("sweep", LOG, "mahony:kp=0,3", "ki=0..1/3"), "did you mean kp=0.3?"),
        (("sweep", LOG, "mahony", "kp=0,5..2/4"), "did you mean kp=0.5?"),
        (("tune", LOG, "mahony", "kp=0,3..2"), "did you mean kp=0.3?"),
        (("sweep", LOG, "mahony", "kp=0.1-2"), "kp=0.1..2/12"),
        (("sweep", LOG, "mahony", "kp=1e-2:2"), "kp=1e-2..2/12"),
        (("sweep", LOG, "mahony", "kp=0.1..2"), "kp=0.1..2/12"),
        (("tune", LOG, "mahony", "kp=0.1-2"), "kp=0.1..2,"),
        (("compare", LOG, "gyro", "mahony:kp=0.1-2"), "attlog sweep takes a range, written kp=0.1..2/12"),
        (("analyze", LOG, "--estimators", "mahony:latency=20,kp=1"), "compare LOG mahony mahony:latency=20,kp=1"),
        (("extract", LOG, "--estimates", "mahony:lowpass=20"), "attlog compare LOG mahony mahony:lowpass=20"),
        (("compare", LOG, "mahony:kp=0.6", "mahony:kp=0.60"), "is the same configuration as mahony:kp=0.6; a"),
        (("compare", LOG, "mahony", "mahony"), "mahony is given twice; a comparison needs two that differ"),
        (("compare", LOG, "mahony"), "a comparison needs two configurations or more"),
    ],
)
def test_the_answer_to_another_writing_names_ours(attlog, samples, monkeypatch, words, said):
    monkeypatch.chdir(samples)
    done = attlog(*words)
    assert done.code == 2
    assert said in done.err
    assert len(done.err.splitlines()) == 1


@pytest.mark.parametrize("text", ["kp=-1", "kp=1e-3", "ki=0,1", "kp=5Hz", "kp=x"])
def test_what_is_no_other_writing_is_not_taken_for_one(text):
    """Numbers below zero and with exponents, lists and units stay what they are."""
    from attlog.estimators.spelling import number_spelled

    name, _, value = text.partition("=")
    assert bool(number_spelled(name, value)) == (text == "ki=0,1")


def test_a_list_of_two_whole_numbers_is_swept_and_said_to_be_two(attlog, samples, tmp_path):
    given = ("--reference", "onboard", "-q", "-o", tmp_path)
    done = attlog("sweep", samples / LOG, "mahony", "kp=0,3", *given)
    assert done.code == 0
    assert done.err == "attlog: kp=0,3 are two values, 0 and 3; the number is written 0.3\n"
    assert attlog("sweep", samples / LOG, "mahony", "kp=0,3.0", *given).err == ""


def test_a_configuration_that_is_given_twice_beside_another_is_compared_once(attlog, samples, tmp_path):
    given = ("--reference", "onboard", "-q", "-o", tmp_path)
    done = attlog("compare", samples / LOG, "gyro", "mahony:kp=1", "mahony:kp=1.0", *given)
    assert done.code == 0
    assert done.err == "attlog: mahony:kp=1.0 is the same configuration as mahony:kp=1; it is compared once\n"
