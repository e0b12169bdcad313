"""How far may a number move before it counts as another one?"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase

from attlog.base.errors import UsageError, suggestion
from attlog.result import MEASURED_TIMES

SMALLEST = {
    "deg": 0.01,
    "ms": 0.5,
    "deg/min": 0.1,
    "deg/s": 0.01,
    "1/s": 0.02,
    "%": 0.5,
    "s": 0.1,
    "1": 0.005,
    "deg/h": 0.5,
    "deg/sqrt(h)": 0.005,
    "deg/sqrt_h": 0.005,
}
"""Differences up to this, by unit, mean nothing to anybody who flies."""
SHARE = 0.02
"""Nor does this share of the older value."""
NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)", re.S)


@dataclass(frozen=True, slots=True)
class Rule:
    """What one option says: the metrics that its pattern names may move by ``size`` in their unit, or by ``share``."""

    pattern: str
    size: float | None
    share: float | None


@dataclass(frozen=True, slots=True)
class Tolerances:
    """The rules of the user, of which the last that fits a metric counts; without one SMALLEST or SHARE, the larger."""

    rules: tuple[Rule, ...] = ()

    def rule(self, metric: str) -> Rule | None:
        """The rule that was given for a metric, None where there is none."""
        return next((r for r in reversed(self.rules) if fnmatchcase(metric, r.pattern)), None)

    def of(self, metric: str, unit: str, old: float) -> float:
        """How far a metric may move from ``old``, in its unit."""
        rule = self.rule(metric)
        if rule is None:
            return max(SMALLEST.get(unit, 0.0), SHARE * abs(old))
        return rule.size if rule.size is not None else (rule.share or 0.0) * abs(old)


def tolerances(texts: Iterable[str], units: Mapping[str, str]) -> Tolerances:
    """The rules of texts such as ``lag_ms=2``, ``noise_tilt_deg=0.01deg``, ``noise_*=5%`` (or ``5pct``).

    ``units``: metric id -> its unit. A percent sign means a share of the older value, also of a metric in percent.
    UsageError tells everything that is wrong in them.
    """
    rules, wrong = [], []
    for text in texts:
        try:
            rules.append(_rule(text, units))
        except UsageError as error:
            wrong.append(str(error))
    if wrong:
        raise UsageError("\n".join(wrong))
    return Tolerances(tuple(rules))


def _rule(text: str, units: Mapping[str, str]) -> Rule:
    pattern, sign, value = (part.strip() for part in text.partition("="))
    if not sign or not pattern:
        raise UsageError(f"--tolerance {text}: give METRIC=VALUE, such as lag_ms=2 or noise_*=5%")
    meant = [name for name in units if fnmatchcase(name, pattern)]
    if not meant:
        measured = pattern in MEASURED_TIMES
        why = (
            "is measured anew in each run and not compared" if measured else "is no metric" + suggestion(pattern, units)
        )
        raise UsageError(f"--tolerance {text}: {pattern} {why}")
    found = NUMBER.fullmatch(value)
    number = float(found[1]) if found else math.nan
    if found is None or not (math.isfinite(number) and number >= 0.0):
        raise UsageError(
            f"--tolerance {text}: {value or 'nothing'} is no size; give a number from 0 on, or a share as 5%"
        )
    unit = found[2].strip()
    if unit in ("%", "pct"):
        return Rule(pattern, None, number / 100.0)
    others = sorted({units[name] for name in meant} - {unit})
    if unit and others:
        raise UsageError(f"--tolerance {text}: {pattern} is in {' or '.join(others)}, not in {unit}")
    return Rule(pattern, number, None)
