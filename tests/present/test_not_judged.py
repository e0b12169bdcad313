"""Who is not judged in an answer, and why."""

from __future__ import annotations

from attlog.present.not_judged import reasons
from attlog.result import Verdict


def test_rows_with_the_same_reason_stand_together_by_name_and_the_reference_itself_is_left_out():
    given = [("a@x-1", "short"), ("b", "short"), ("onboard", "it is the reference itself")]
    verdict = Verdict("lag", "", "", "lag_ms", "all", [], given)
    names = {"a@x-1": "A, X 1", "b": "B"}
    assert reasons(verdict, names, {"a@x-1", "b", "c"}) == [("A, X 1 and B", "short")]
    assert reasons(verdict, names, {"a@x-1", "b"}) == [("All filters", "short")]
