"""What of a file cannot be used, counted."""

from __future__ import annotations

from attlog.base.limits import MAX_DAMAGE
from attlog.formats.losses import Losses


def test_bytes_are_counted_once_and_a_kind_is_always_listed() -> None:
    losses = Losses()
    for k in range(MAX_DAMAGE + 5):
        losses.add(1000 + 10 * k, 3, "bytes", "next")
    losses.add_kind(500, 30, "definitions", "next")
    losses.add_kind(700, 40, "of the places above", "next", counted=True)
    assert (losses.places, losses.bytes) == (MAX_DAMAGE + 7, 3 * (MAX_DAMAGE + 5) + 30)
    assert len(losses.listed) == MAX_DAMAGE
    assert [d.offset for d in losses.listed[:3]] == [500, 700, 1000]
