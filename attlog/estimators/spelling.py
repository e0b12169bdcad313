"""What people write where the command line takes a number, and how it is written there."""

from __future__ import annotations

import re

NUMBER = r"[-+]?(?>\d+\.?\d*|\.\d+)(?>[eE][-+]?\d+)?"
WITH_COMMA = re.compile(r"([-+]?\d+),(\d+)")
LIKE_A_RANGE = re.compile(rf"({NUMBER})\s*(?:\.\.+|-|\u2013|:|to)\s*({NUMBER})")
CUT = re.compile(r"(\w+)=([-+]?\d+)$")
A_FEW = 12
"""Values in the range that a sentence proposes."""


def number_spelled(name: str, value: str) -> str:
    """What to write instead of a decimal comma or a range in place of a number; empty for other texts."""
    if found := WITH_COMMA.fullmatch(value.strip()):
        return f"did you mean {name}={found[1]}.{found[2]}?"
    if found := LIKE_A_RANGE.fullmatch(value.strip()):
        return f"attlog sweep takes a range, written {name}={range_spelled(value)}/{A_FEW}"
    return ""


def range_spelled(value: str) -> str:
    """A range in dashes, colons or words as ``LOW..HIGH``; empty for other texts."""
    found = LIKE_A_RANGE.fullmatch(value.strip())
    return f"{found[1]}..{found[2]}" if found else ""


def cut_by_comma(before: str, item: str) -> str:
    """The end of an error sentence where a decimal comma has cut ``kp=0,3`` in two; empty where none did."""
    found = CUT.search(before)
    return f"; did you mean {found[1]}={found[2]}.{item}?" if found and item.isdecimal() else ""
