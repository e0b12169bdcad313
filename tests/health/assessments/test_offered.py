"""What should be set, all questions together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from attlog.health.assessments import TOPICS, Setting, offered
from attlog.health.assessments.offered import number_text, sentence
from tests.health.assessments.made import MADE, OFFSET, REFUSED


def test_settings_stand_in_the_order_of_the_questions_each_once() -> None:
    first = replace(OFFSET, settings=[Setting("B", 1.0, 2.0), Setting("A", None, 3.0)])
    again = replace(REFUSED, settings=[Setting("C", 0.0, 1.0), Setting("B", 1.0, 2.0 * (1.0 + 1e-8))])
    assert offered([first, again]) == [Setting("B", 1.0, 2.0), Setting("A", None, 3.0), Setting("C", 0.0, 1.0)]
    assert offered([REFUSED]) == []


def test_where_two_questions_dispute_a_value_neither_offers_anything() -> None:
    """Half of an offset is worse than none."""
    one = replace(OFFSET, settings=[Setting("X", 0.0, 1.0), Setting("Y", 0.0, 5.0)])
    other = replace(REFUSED, settings=[Setting("X", 0.0, 2.0), Setting("Z", 0.0, 6.0)])
    third = replace(REFUSED, settings=[Setting("W", 0.0, 7.0)])
    assert offered([one, other, third]) == [Setting("W", 0.0, 7.0)]


@pytest.mark.parametrize("value", [145.0, -20.25, 0.0, -0.0, 1310988.0, 0.1, -12345.678, 3.4e-05])
def test_a_number_as_text_is_the_same_number_in_32_bits(value: float) -> None:
    text = number_text(value)
    assert np.float32(text) == pytest.approx(np.float32(value), rel=1e-6)
    assert not text.startswith("-0") or value


def test_what_to_set_as_a_sentence() -> None:
    assert sentence(offered(MADE)) == "Set COMPASS_OFS_X 145, COMPASS_OFS_Y -20.25."
    assert sentence([]) == ""


def test_every_question_has_words_and_a_kind_of_finding() -> None:
    assert all(topic.title and topic.finding for topic in TOPICS.values())
    titles = [topic.title for topic in TOPICS.values()]
    assert len(set(titles)) == len(titles)
