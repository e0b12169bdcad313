"""Number formats of report, answers and terminal.

Angles get 3 decimals below 0.1, 2 below 1, else 1, none from 100 on. Drifts get 2 below 1, else 1, and always a sign;
ms and % are whole. Minus is the true minus sign. A value too small to show is "<0.001", never 0.
"""

from __future__ import annotations

import math
import re
from typing import TypeGuard

MINUS = "\u2212"

UNITS = {
    "1": "",
    "deg": "°",
    "deg/s": "°/s",
    "deg/min": "°/min",
    "deg/h": "°/h",
    "deg/sqrt(h)": "°/√h",
    "deg/sqrt_h": "°/√h",
    "pct": "%",
    "us": "µs",
    "degC": "°C",
    "uT": "µT",
    "m/s^2": "m/s²",
    "ratio": "×",
}

# Times above this are written as h:mm:ss.
CLOCK_FROM_S = 600.0

# Units whose sign has a meaning: direction of a drift, lag or lead.
SIGNED = ("deg/min", "ms")


# Above the first, ratios are written as factors; above the second, two values are not comparable.
FACTOR, NOT_COMPARABLE = 10.0, 100.0


def unit_sign(unit: str) -> str:
    """Return the symbol of a unit: ``deg/min`` is °/min."""
    return UNITS.get(unit, unit)


def number(value: float | None, unit: str = "", signed: bool | None = None) -> str:
    """Format a value without its unit; empty for None and non-finite values."""
    if value is None or not math.isfinite(value):
        return ""
    size = abs(value)
    places = decimals(size, unit)
    signed = unit in SIGNED if signed is None else signed
    text = f"{size:.{places}f}"
    if float(text) == 0 and size > 0 and not signed and places:
        return f"{MINUS if value < 0 else ''}<{10.0**-places:.{places}f}"
    zero = float(text) == 0
    sign = MINUS if value < 0 and not zero else "+" if signed and not zero else ""
    if float(text) >= 10_000:
        text = f"{float(text):,.{places}f}"
    return sign + text


def decimals(size: float, unit: str) -> int:
    """Return the number of decimals for a size and unit."""
    if unit in ("deg", "deg/min") and size >= 99.95:
        return 0
    if unit == "deg":
        return 3 if size < 0.0995 else 2 if size < 0.995 else 1
    if unit == "deg/min":
        return 2 if size < 0.995 else 1
    if unit in ("ms", "pct", "%", "ns", "Hz"):
        return 0 if size >= 9.5 or unit != "Hz" else 1
    if unit == "s":
        return 1 if size < 99.5 else 0
    return 3 if size < 0.0995 else 2 if size < 9.95 else 1 if size < 99.5 else 0


def quantity(value: float | None, unit: str = "", signed: bool | None = None) -> str:
    """Format a value with its unit: ``0.012°``, ``+12 ms``, ``−1.2°/min``."""
    text = number(value, unit, signed)
    sign = unit_sign(unit)
    if not text or not sign:
        return text
    return text + sign if sign.startswith(("°", "×")) else f"{text} {sign}"


def change(ratio: float, *, signed: bool = True) -> str:
    """Format a ratio as a change (``−24 %``) or a factor."""
    if not 1.0 / NOT_COMPARABLE <= ratio <= NOT_COMPARABLE:
        return "not comparable"
    if ratio >= FACTOR:
        return f"{ratio:.0f} times"
    size = abs(100.0 * (ratio - 1.0))
    text = f"{size:.{0 if size >= 9.95 else 1}f}"
    if float(text) == 0.0:
        return "<0.1 %" if size > 0.0 else "0 %"
    return f"{'' if not signed else MINUS if ratio < 1.0 else '+'}{text} %"


def change_end(ratio: float, *, signed: bool = True) -> str:
    """Format the end of a ratio's interval: ``over 100 times`` beyond 100."""
    text = change(ratio, signed=signed)
    return text if text != "not comparable" else "over 100 times" if ratio > 1.0 else f"{MINUS * signed}99 %"


def between(low: str, high: str) -> str:
    """Format a range of two quantities: ``0.4 to 1.2°``, ``up to 3 ms``."""
    if low == high:
        return high
    if low.startswith("<"):
        return f"up to {high}"
    unit = re.search(r"[^\d.,]*$", high)
    return f"{low.removesuffix(unit[0]) if unit else low} to {high}"


def below(value: float, unit: str = "") -> str:
    """Format an upper bound with its unit, rounded up."""
    size = abs(value)
    scale = 10.0 ** decimals(size, unit)
    return quantity(math.ceil(size * scale - 1e-9) / scale, unit, signed=False)


Interval = tuple[float, float] | list[float] | None


def _is_known(ci95: Interval) -> TypeGuard[tuple[float, float] | list[float]]:
    return ci95 is not None and all(x is not None and math.isfinite(x) for x in ci95)


def interval(ci95: Interval, unit: str = "") -> str:
    """Format an interval, ``−6.7 to −2.7``; empty without one."""
    return f"{number(ci95[0], unit)} to {number(ci95[1], unit)}" if _is_known(ci95) else ""


def bracketed(ci95: Interval, unit: str = "") -> str:
    """Format an interval for a table, ``[−6.7, −2.7]``; empty without one."""
    return f"[{number(ci95[0], unit)}, {number(ci95[1], unit)}]" if _is_known(ci95) else ""


def half_width(ci95: Interval, unit: str = "") -> str:
    """Format half of an interval, ``±2.0``; empty without one."""
    return f"±{number(0.5 * (ci95[1] - ci95[0]), unit, False)}" if _is_known(ci95) else ""


def moment(t: float, places: int = 1) -> str:
    """Format a time on the log's clock: ``103.4 s``, from ten minutes on ``0:17:23``."""
    if abs(t) >= CLOCK_FROM_S:
        whole = round(abs(t))
        return f"{MINUS if t < 0 else ''}{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"
    text = f"{abs(t):.{places}f}"
    return f"{MINUS if t < 0 and float(text) else ''}{text} s"


def counted(n: int, thing: str) -> str:
    """Format a number with its noun: ``1 step``, ``28 steps``."""
    return f"{n:,} {thing}{'' if n == 1 else 's'}"


def duration(seconds: float | None) -> str:
    """Format a duration: ``36 s``, ``4.0 min``, ``2 h 05 min``."""
    if seconds is None or not math.isfinite(seconds):
        return ""
    if seconds < 9.95:
        return f"{seconds:.1f} s"
    if seconds < 119.5:
        return f"{seconds:.0f} s"
    if seconds < 3600:
        return f"{seconds / 60:.1f} min"
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min"


def listed(names: list[str]) -> str:
    """Join names: ``a``, ``a and b``, ``a, b and c``."""
    return " and ".join(x for x in (", ".join(names[:-1]), names[-1]) if x) if names else ""
