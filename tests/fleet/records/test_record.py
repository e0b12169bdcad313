"""What an earlier run of a folder says of a log: which ends are for good, and which failure is the same."""

from __future__ import annotations

import pytest

from attlog.fleet.records.record import Record


@pytest.mark.parametrize(
    ("code", "for_good"), [(0, True), (2, True), (65, True), (66, False), (70, False), (73, False), (75, False)]
)
def test_only_what_content_and_settings_decide_is_for_good(code: int, for_good: bool) -> None:
    """A timeout, too little memory, a bug or a full disk may end otherwise next time."""
    assert Record("a.ulg", "a", "key", code).for_good is for_good


def test_a_failure_is_the_same_only_of_the_same_known_content_and_code() -> None:
    failed = Record("a.ulg", "a", "key", 65)
    assert failed.fails_as(Record("b.ulg", "b", "key", 65))
    assert not failed.fails_as(Record("a.ulg", "a", "other", 65))
    assert not failed.fails_as(Record("a.ulg", "a", "key", 75))
    assert not failed.fails_as(None)
    assert not Record("a.ulg", "a", "", 66).fails_as(Record("a.ulg", "a", "", 66))
    assert not Record("a.ulg", "a", "key", 0).fails_as(Record("a.ulg", "a", "key", 0))
