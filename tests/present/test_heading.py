"""One rule says which heading reference is quoted."""

from __future__ import annotations

import pytest

from attlog.present.heading import quoted_heading_reference
from tests.present.made import drift, result, row


@pytest.mark.parametrize(
    ("there", "said"),
    [
        (("mag", "onboard", "truth"), "truth"),
        (("mag", "onboard"), "onboard"),
        (("course", "mag"), "mag"),
        (("onboard", "gnss_yaw"), "gnss_yaw"),
        (("gnss_yaw", "smoother"), "smoother"),
    ],
)
def test_the_first_that_is_there_is_quoted_whatever_it_ranks(there, said):
    unranked = {"ranked": False, "reason": "rests disagree"}
    found = result([row(f"f{i}", drift(9.0, against=name, **unranked)) for i, name in enumerate(there)])
    assert quoted_heading_reference(found) == said


def test_a_value_of_an_onboard_row_makes_no_heading_reference_quoted():
    rows = [row("onboard:AHR2", drift(1.0, against="truth")), row("a", drift(2.0, against="mag"))]
    assert quoted_heading_reference(result(rows)) == "mag"
