"""Numbers of many seeds as one number with an interval, and what an interval says about a claim.

A claim about a size holds where the whole 95 % interval lies on its side, does not hold where the whole interval lies
on the other, and cannot be judged where the interval holds the limit. Ratios are paired: both numbers of a pair
come from the same seed, and it is the mean of their logarithms that has the interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from attlog.compare.differences.pooled import pool
from attlog.present.numbers import between, interval, listed, quantity
from attlog.reproduce.paper import PaperNumber, Verdict


def mean(what: str, values: Sequence[float], unit: str) -> PaperNumber:
    """The mean of a number over seeds with Student's interval. Seeds without one (NaN) are left out and not counted."""
    return _pooled(what, [v for v in values if math.isfinite(v)], unit)


def difference(what: str, ours: Sequence[float], other: Sequence[float], unit: str) -> PaperNumber:
    """The mean of ``ours - other``, seed by seed."""
    return mean(what, [a - b for a, b in zip(ours, other, strict=True)], unit)


def ratio(what: str, ours: Sequence[float], other: Sequence[float], unit: str = "ratio") -> PaperNumber:
    """The geometric mean of ``ours / other``, seed by seed. Pairs in which either is not positive are left out."""
    pairs = [(a, b) for a, b in zip(ours, other, strict=True) if a > 0.0 and b > 0.0]
    logs = _pooled(what, [math.log(a / b) for a, b in pairs], unit)
    if logs.value is None:
        return logs
    ends = None if logs.ci95 is None else (math.exp(logs.ci95[0]), math.exp(logs.ci95[1]))
    return PaperNumber(what, math.exp(logs.value), unit, ends, logs.n)


def typical(values: Sequence[float], unit: str = "deg") -> PaperNumber:
    """The geometric mean with its interval. What is not positive is left out."""
    return ratio("", values, [1.0] * len(values), unit)


def mean_text(values: Sequence[float], unit: str) -> str:
    """The mean over seeds as a table shows it."""
    return quantity(mean("", values, unit).value, unit)


def numbers_text(numbers: Sequence[PaperNumber]) -> str:
    """Numbers with their intervals in words."""
    return listed([quantity(n.value, n.unit) + (f" ({interval(n.ci95, n.unit)})" if n.ci95 else "") for n in numbers])


def ends(numbers: Sequence[PaperNumber]) -> tuple[PaperNumber, PaperNumber]:
    """The smallest and the largest of numbers of one kind; those that could not be measured are neither."""
    known = [n for n in numbers if n.value is not None] or list(numbers)
    return min(known, key=lambda n: n.value or 0.0), max(known, key=lambda n: n.value or 0.0)


def span(numbers: Sequence[PaperNumber], unit: str) -> str:
    """From the smallest to the largest of numbers, in words: ``0.93 to 0.94×``, or one where they look alike."""
    low, high = ends(numbers)
    return between(quantity(low.value, unit), quantity(high.value, unit))


def led(first: Sequence[PaperNumber], numbers: Sequence[PaperNumber]) -> tuple[PaperNumber, ...]:
    """Numbers of a claim, ``first`` ahead of the others."""
    return (*first, *(n for n in numbers if n not in first))


def share(what: str, hits: Sequence[bool]) -> PaperNumber:
    """The percentage of seeds on which something is so, with Wilson's interval (1927)."""
    n = len(hits)
    if n == 0:
        return PaperNumber(what, None, "pct", None, 0)
    p, z2 = sum(hits) / n, 1.959964**2
    middle, half = (
        (p + z2 / (2 * n)) / (1 + z2 / n),
        math.sqrt(z2 * (p * (1 - p) / n + z2 / (4 * n * n))) / (1 + z2 / n),
    )
    return PaperNumber(what, 100 * p, "pct", (100 * max(0.0, middle - half), 100 * min(1.0, middle + half)), n)


def below(number: PaperNumber, limit: float) -> Verdict:
    """Whether a number is smaller than a limit."""
    if number.value is None or number.ci95 is None:
        return "cannot be judged"
    low, high = number.ci95
    return "holds" if high < limit else "does not hold" if low >= limit else "cannot be judged"


def above(number: PaperNumber, limit: float) -> Verdict:
    """Whether a number is larger than a limit."""
    if number.value is None or number.ci95 is None:
        return "cannot be judged"
    low, high = number.ci95
    return "holds" if low > limit else "does not hold" if high <= limit else "cannot be judged"


def together(verdicts: Sequence[Verdict]) -> Verdict:
    """The verdict on a claim of several parts: of one mind, or in part where one part holds and another does not.

    Without a part that holds, one that does not decides: "A and B" is false when A is.
    """
    found = set(verdicts)
    if len(found) == 1:
        return verdicts[0]
    if found & {"holds", "holds in part"}:
        return "holds in part"
    return "does not hold" if "does not hold" in found else "cannot be judged"


def alternatives(verdicts: Sequence[Verdict]) -> Verdict:
    """The verdict on a claim that is tried under several readings of what the paper does not print.

    In part where it holds under some; false only where it is under each: a reading that cannot be judged may be theirs.
    """
    found = set(verdicts)
    if len(found) == 1:
        return verdicts[0]
    return "holds in part" if found & {"holds", "holds in part"} else "cannot be judged"


def _pooled(what: str, values: Sequence[float], unit: str) -> PaperNumber:
    if not values:
        return PaperNumber(what, None, unit, None, 0)
    found = pool(values, [None] * len(values))
    return PaperNumber(what, found.value, unit, found.ci95 if len(values) > 1 else None, len(values))
