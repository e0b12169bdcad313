"""From the smallest to the largest of several numbers, in words."""

from __future__ import annotations

from collections.abc import Sequence

from attlog.present.numbers import below as bound
from attlog.present.numbers import number, quantity
from attlog.reproduce.judge import ends
from attlog.reproduce.paper import PaperNumber


def ratio_range(ratios: Sequence[PaperNumber]) -> str:
    """Ratios: ``0.93 to 0.94×``, or one where they look alike."""
    low, high = (n.value for n in ends(ratios))
    same = quantity(low, "ratio") == quantity(high, "ratio")
    return quantity(high, "ratio") if same else f"{number(low, 'ratio')} to {quantity(high, 'ratio')}"


def reach(numbers: list[PaperNumber], unit: str) -> str:
    """Where the numbers lie, in words: from the smallest to the largest, or that all are too small to see."""
    values = [n.value for n in numbers if n.value is not None]
    largest = max(map(abs, values))
    if largest < {"s": 0.05, "deg": 0.05}[unit]:
        return f"less than {bound(largest, unit)} either way"
    return f"{quantity(min(values), unit, True)} to {quantity(max(values), unit, True)}"
