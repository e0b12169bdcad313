"""A verdict on its card."""

from __future__ import annotations

import pytest

from attlog.present.cards import lead_and_tail, reasons
from attlog.result import Verdict


@pytest.mark.parametrize(
    ("sentence", "lead"),
    [
        ("vqf is quietest: within 0.003° at rest. More.", "vqf is quietest: within 0.003° at rest."),
        ("Mahony Xu 0.6 lags most: +12 ms; more.", "Mahony Xu 0.6 lags most: +12 ms;"),
        ("Cannot be judged: no rest.", "Cannot be judged:"),
        ("No filter can be ranked: a (diverged).", "No filter can be ranked:"),
        ("Nothing", "Nothing"),
        (
            "A has the least noise: 0.1° (1 sigma; 0.1 to 0.2) at rest; more.",
            "A has the least noise: 0.1° (1 sigma; 0.1 to 0.2) at rest;",
        ),
    ],
)
def test_the_first_words_of_a_verdict_are_bold(sentence, lead):
    assert lead_and_tail(sentence)[0] == lead


def test_rows_with_the_same_reason_stand_together_by_name_and_the_reference_itself_is_left_out():
    given = [("a@x-1", "short"), ("b", "short"), ("onboard", "it is the reference itself")]
    verdict = Verdict("lag", "", "", "lag_ms", "all", [], given)
    names = {"a@x-1": "A, X 1", "b": "B"}
    assert reasons(verdict, names, {"a@x-1", "b", "c"}) == [("A, X 1 and B", "short")]
    assert reasons(verdict, names, {"a@x-1", "b"}) == [("All filters", "short")]
