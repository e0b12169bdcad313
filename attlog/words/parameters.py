"""Display texts of a vehicle's parameters: value, default, what was set during the log."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from attlog.flight.parameters import Origin, ParameterHistory
from attlog.result import Result
from attlog.words.numbers import MINUS, moment
from attlog.words.text import plain_value

# Changes of a parameter in the table. Statistics change every 30 s; the JSON result has all.
MAX_CHANGES_SHOWN = 10
# Significant digits of a value that is no whole number: parameters are float32.
VALUE_DIGITS = 7
# Words for the origin of a value that is neither the firmware's default nor set.
ORIGINS = {"airframe": "by the airframe", "file": "by the parameter file"}


class ParameterChange(NamedTuple):
    """New value of a parameter at ``t`` s; ``flying``: in the air."""

    t: float
    value: str
    flying: bool


@dataclass(frozen=True, slots=True)
class ParameterLine:
    """Line of the table; ``remark``: on the value, ``more``: number of changes that are not listed.

    ``kind``: origin of the value, as of :class:`ParameterHistory`.
    """

    name: str
    value: str
    default: str
    remark: str
    kind: str
    changes: list[ParameterChange] = field(default_factory=list)
    more: int = 0

    @property
    def for_script(self) -> list[Any]:
        """The line as a list, for the page's script."""
        changes = [[round(c.t, 3), moment(c.t), c.value, c.flying] for c in self.changes]
        return [self.name, self.value, self.default, self.remark, self.kind, changes, self.more]


def parameter_lines(result: Result) -> list[ParameterLine]:
    """Return all parameters of a result by name; of one read from JSON those not at their default."""
    flights = (result.log.get("timeline") or {}).get("airborne") or []
    histories = result.parameters or _written_histories(result.log)
    return [_line(history, flights) for history in histories]


def _written_histories(log: dict[str, Any]) -> list[ParameterHistory]:
    """Return the parameters that a JSON result lists as not at their default, or as set during the log."""
    changed, later = dict(log.get("params_changed") or {}), dict(log.get("params_in_flight") or {})
    first = dict(log.get("params") or {})
    origins: dict[str, Origin] = dict(log.get("params_origin") or {})
    found = []
    for name in sorted(first.keys() | changed.keys() | later.keys()):
        now, default = changed.get(name, (None, None))
        value, origin = first.get(name, now), origins.get(name)
        default = value if origin == "default" else default
        usual: Origin = "unknown" if default is None else "default" if value == default else "set"
        changes = [(t, value) for t, value in later.get(name, [])]
        found.append(ParameterHistory(name, value, default, origin or usual, changes))
    return found


def _line(history: ParameterHistory, flights: list[list[float]]) -> ParameterLine:
    changes = [
        ParameterChange(t, value_text(value), any(a <= t <= b for a, b in flights))
        for t, value in history.changes[:MAX_CHANGES_SHOWN]
    ]
    default = "not logged" if history.default is None else value_text(history.default)
    more = len(history.changes) - len(changes)
    remark = ORIGINS.get(history.origin, "")
    return ParameterLine(history.name, value_text(history.value), default, remark, history.origin, changes, more)


def value_text(value: Any) -> str:
    """Format a value: whole numbers with every digit, others with seven digits."""
    if isinstance(value, float) and not value.is_integer():
        return f"{value:.{VALUE_DIGITS}g}".replace("-", MINUS)
    if isinstance(value, int | float):
        return f"{value:.0f}".replace("-", MINUS)
    return plain_value(value)


def parameter_counts(lines: list[ParameterLine]) -> str:
    """Return how many parameters there are, set, of the airframe, and set during the log."""
    kinds = Counter(line.kind for line in lines)
    during = sum(bool(line.changes) for line in lines)
    parts = [f"{kinds['set']:,} set" if kinds["set"] else ""]
    parts += [f"{kinds['airframe']:,} by the airframe" if kinds["airframe"] else ""]
    parts += [f"{during:,} set during the log" if during else ""]
    return ", ".join([f"{len(lines):,}", *filter(None, parts)])
