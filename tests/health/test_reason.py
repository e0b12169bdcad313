"""A reason becomes a sentence; a name from the log is not respelled."""

from __future__ import annotations

import pytest

from attlog.health.reason import as_sentence


@pytest.mark.parametrize(
    ("reason", "sentence"),
    [
        ("vehicle_attitude is tilted by 29 deg", "vehicle_attitude is tilted by 29 deg."),
        ("the gyro and the attitude differ", "The gyro and the attitude differ."),
        ("There is no gyro.", "There is no gyro."),
        ("AHR2 is late", "AHR2 is late."),
    ],
)
def test_a_reason_becomes_a_sentence_and_a_name_from_the_log_stays(reason, sentence):
    assert as_sentence(reason) == sentence
