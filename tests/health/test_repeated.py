"""What comes in dozens is one entry with its number; what comes a few times stands for itself."""

from __future__ import annotations

from attlog.flight.model import Problem
from attlog.health.repeated import MANY, SHOWN, joined


def damaged(number: int, **more: object) -> list[Problem]:
    return [Problem("part_failed", "error", f"Message M{k} is out.", count=k + 1, **more) for k in range(number)]  # type: ignore[arg-type]


def test_a_few_of_a_kind_stand_for_themselves() -> None:
    few = [*damaged(MANY), Problem("no_mag", "warning", "No field.")]
    assert joined(few) == few


def test_hundreds_of_a_kind_are_one_with_their_number_and_the_first_of_them() -> None:
    found = joined([Problem("no_mag", "warning", "No field."), *damaged(400, remedy="Report it.", value=3.0, unit="V")])
    assert [p.code for p in found] == ["no_mag", "part_failed"]
    one = found[1]
    assert one.count == 400 * 401 // 2
    assert one.text.startswith("400 of one kind: Message M0 is out. Message M1")
    assert one.text.endswith(f"And {400 - SHOWN} more.")
    assert (one.remedy, one.value, one.unit, len(one.text) < 200) == ("Report it.", None, "", True)


def test_severities_are_kept_apart_and_the_first_time_is_told() -> None:
    notes = [Problem("ev", "note", f"Event {k}.", t=10.0 - k, cause=str(k)) for k in range(9)]
    found = joined([*notes, Problem("ev", "error", "Event x.")])
    assert [(p.severity, p.t, p.cause) for p in found] == [("note", 2.0, ""), ("error", None, "")]
