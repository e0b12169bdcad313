"""The legend above a figure stays inside the column and no entry covers another."""

from __future__ import annotations

from itertools import pairwise

import pytest

from attlog.report.journal.legend import Key, legend, text_width
from attlog.report.journal.style import WIDTH

LEFT = 54.0


@pytest.mark.parametrize("count", [1, 2, 7, 12])
def test_entries_stand_one_after_the_other_and_fit(count: int) -> None:
    keys = [Key(f"Filter number {i}" * (1 + i % 2), "#123456") for i in range(count)]
    shapes, texts, height = legend(keys, LEFT, 10.0)
    assert len(shapes) == len(texts) == count
    places = [
        (s["y0"], s["x0"] + LEFT, t["xshift"] + LEFT + text_width(t["text"]))
        for s, t in zip(shapes, texts, strict=True)
    ]
    assert all(0.0 <= start and end <= WIDTH for _, start, end in places)
    for (y, _, end), (next_y, start, _) in pairwise(places):
        assert next_y < y or start > end
    assert all(10.0 < y < 10.0 + height for y, _, _ in places)


def test_nothing_to_tell_takes_no_room() -> None:
    assert legend([], LEFT, 0.0) == ([], [], 0.0)


@pytest.mark.parametrize("symbol", ["circle", "diamond", "square", "triangle-up", "triangle-down", "pentagon"])
def test_a_symbol_is_drawn_filled_or_hollow(symbol: str) -> None:
    [full], _, _ = legend([Key("at rest", "#123456", symbol=symbol)], LEFT, 0.0)
    [hollow], _, _ = legend([Key("at rest", "#123456", symbol=symbol, full=False)], LEFT, 0.0)
    assert (full["fillcolor"], hollow["fillcolor"]) == ("#123456", "#ffffff")
    assert full["type"] == ("circle" if symbol == "circle" else "path")
