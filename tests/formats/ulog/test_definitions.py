"""What a ULog defines on the way, within the limits of what a log may ask for."""

from __future__ import annotations

from attlog.base.limits import MAX_RESUBSCRIBED
from attlog.formats.ulog.definitions import Definitions


def test_an_id_that_changes_its_topic_too_often_keeps_the_last_one() -> None:
    found = Definitions()
    for name in ("one", "two"):
        found.declare(f"{name}:uint64_t timestamp;float x;")
    for k in range(MAX_RESUBSCRIBED + 3):
        now = found.subscription(7, ("one", "two")[k % 2], 0)
        assert now is not None
        found.by_id[7] = now
    kept = found.by_id[7].name
    other = {"one": "two", "two": "one"}[kept]
    again = found.subscription(7, other, 0)
    assert again is not None
    assert again.name == kept
    assert [r.code for r in found.remarks()] == ["log_limit"]
