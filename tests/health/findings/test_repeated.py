"""What comes in dozens is one sign with its number; what comes a few times stands for itself."""

from __future__ import annotations

from attlog.health.findings.finding import Finding
from attlog.health.findings.repeated import MANY, joined


def damaged(number: int, **more: object) -> list[Finding]:
    return [Finding("part_failed", "serious", f"Message M{k} is out.", count=k + 1, **more) for k in range(number)]  # type: ignore[arg-type]


def test_a_few_of_a_kind_stand_for_themselves() -> None:
    few = [*damaged(MANY), Finding("no_mag", "warning", "No field.")]
    assert joined(few) == few


def test_hundreds_of_a_kind_are_one_with_their_number_and_the_first_of_them() -> None:
    found = joined([Finding("no_mag", "warning", "No field."), *damaged(400, action="Report it.", value=3.0, unit="V")])
    assert [f.kind for f in found] == ["no_mag", "part_failed"]
    one = found[1]
    assert one.count == 400 * 401 // 2
    assert one.text == "Message M0 is out, and 399 more of the kind."
    assert one.evidence[0] == "Message M1 is out."
    assert (one.action, one.value, one.unit) == ("Report it.", None, "")


def test_severities_are_kept_apart_and_the_first_time_is_told() -> None:
    notes = [Finding("ev", "note", f"Event {k}.", t=10.0 - k, cause=str(k)) for k in range(9)]
    found = joined([*notes, Finding("ev", "serious", "Event x.")])
    assert [(f.severity, f.t, f.cause) for f in found] == [("note", 2.0, ""), ("serious", None, "")]
