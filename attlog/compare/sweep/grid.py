"""Which settings to try: lists, ranges and switches of a filter's parameters, and all combinations of them.

=====================  =========================================
``kp=0.6,1.1,2``       these values
``ki=0..0.05/6``       6 values from 0 to 0.05, evenly spaced
``ki=1e-4..0.1/7log``  7 values, each the same factor above the last
``mag_form=heading,vector``  words of a switch
=====================  =========================================

A number may carry the parameter's own unit (``declination=3deg``); another one is refused.
"""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Literal

from attlog.base.errors import UsageError
from attlog.base.limits import MAX_SETS, MAX_VALUES
from attlog.compare.configurations.configuration import checked
from attlog.estimators import Parameter
from attlog.estimators.base import Estimator
from attlog.estimators.spelling import A_FEW, WITH_COMMA, range_spelled

Value = float | str
Setting = dict[str, Value]
"""One combination: parameter name -> value."""

RANGE = re.compile(r"(?P<low>.+?)\.\.(?P<high>.+?)(?:/(?P<count>[^/]*?)\s*(?P<log>log)?)?")
DIGITS = 12
LOG_DIGITS = 4
"""Values of a range are rounded to so many digits, so that 0..0.05/6 holds 0.03; nobody needs more of a log range."""


@dataclass(frozen=True, slots=True)
class GridAxis:
    """A parameter and the values it takes. ``spacing`` says how they follow each other, for drawing."""

    name: str
    unit: str
    values: tuple[Value, ...]
    spacing: Literal["linear", "log", "words"]


@dataclass(frozen=True, slots=True)
class SettingGrid:
    """All combinations of the axes' values; the last axis changes fastest."""

    axes: tuple[GridAxis, ...]

    def __len__(self) -> int:
        return prod(len(axis.values) for axis in self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """How many values each axis has."""
        return tuple(len(axis.values) for axis in self.axes)

    def __iter__(self) -> Iterator[Setting]:
        for values in itertools.product(*(axis.values for axis in self.axes)):
            yield {axis.name: value for axis, value in zip(self.axes, values, strict=True)}


def is_axis(word: str) -> bool:
    """Whether a word of the command line is an axis (``kp=...``), not a log or a filter."""
    return re.match(r"[A-Za-z_]\w*=", word) is not None


def grid(texts: Iterable[str], estimator: Estimator) -> SettingGrid:
    """The grid that texts such as ``kp=0.6,1.1,2`` name. UsageError tells everything that is wrong in them."""
    axes: dict[str, GridAxis] = {}
    wrong: list[str] = []
    for text in texts:
        try:
            found = axis(text, estimator)
            if found.name in axes:
                raise UsageError(f"{text}: {found.name} is given twice; put all its values in one list")
            axes[found.name] = found
        except UsageError as error:
            wrong.append(str(error))
    if not axes and not wrong:
        raise UsageError(f"nothing to sweep; give values such as {_example(estimator)}")
    made = SettingGrid(tuple(axes.values()))
    if len(made) > MAX_SETS:
        sizes = " x ".join(map(str, made.shape))
        wrong.append(
            f"{sizes} are {len(made):,} settings; up to {MAX_SETS:,} are swept. Take fewer values, or attlog tune, "
            "which looks where it pays"
        )
    if wrong:
        raise UsageError("\n".join(wrong))
    return made


def axis(text: str, estimator: Estimator) -> GridAxis:
    """The axis that ``NAME=VALUES`` names. UsageError with the text and what is wrong in it."""
    name, _, values = (part.strip() for part in text.partition("="))
    parameter = estimator.parameter(name)
    where = f"{estimator.name}: {text}"
    if not values:
        raise UsageError(f"{where}: no values; give some such as {name}={_range_of(parameter)}")
    if parameter.choices:
        if ".." in values:
            raise UsageError(f"{where}: {name} is a switch; give words of {', '.join(parameter.choices)}")
        words = tuple(dict.fromkeys(str(parameter.check(w.strip(), estimator.name)) for w in values.split(",")))
        return GridAxis(name, parameter.unit, words, "words")
    if ".." not in values and (meant := range_spelled(values)):
        raise UsageError(f"{where}: a range is written {name}={meant}/{A_FEW}, or {name}={meant}/{A_FEW}log")
    if ".." not in values:
        listed = [_number(v, name, where, estimator) for v in values.split(",")]
        return _checked(name, parameter, listed, "linear", estimator)
    found = RANGE.fullmatch(values)
    if found is None or not (found["count"] or "").strip().isdecimal():
        example = f"{name}={meant}/{A_FEW}" if (meant := range_spelled(values)) else _range_of(parameter)
        raise UsageError(f"{where}: a range is LOW..HIGH/COUNT or LOW..HIGH/COUNTlog, such as {example}")
    low, high = (_number(found[end], name, where, estimator) for end in ("low", "high"))
    count = int(found["count"])
    if not low < high:
        raise UsageError(f"{where}: the range is empty; give the smaller value first")
    if not 2 <= count <= MAX_VALUES:
        raise UsageError(f"{where}: {count} values; a range has 2 to {MAX_VALUES}")
    if found["log"] and low <= 0.0:
        raise UsageError(f"{where}: a log range begins above 0; list 0 by itself or take a linear range")
    return _checked(
        name, parameter, spaced(low, high, count, bool(found["log"])), "log" if found["log"] else "linear", estimator
    )


def like_decimal_commas(texts: Iterable[str]) -> list[str]:
    """A sentence for each axis that may be a number with a decimal comma: ``kp=0,3`` are two values."""
    pairs = [(text.partition("=")[0].strip(), WITH_COMMA.fullmatch(text.partition("=")[2].strip())) for text in texts]
    return [
        f"{name}={found[0]} are two values, {found[1]} and {found[2]}; the number is written {found[1]}.{found[2]}"
        for name, found in pairs
        if found
    ]


def spaced(low: float, high: float, count: int, log: bool) -> list[float]:
    """``count`` values from low to high, both among them."""
    shares = [k / (count - 1) for k in range(count)]
    found = [low * (high / low) ** s if log else low + (high - low) * s for s in shares]
    digits = LOG_DIGITS if log else DIGITS
    return [low, *(float(f"{x:.{digits}g}") for x in found[1:-1]), high]


def text_of(setting: Setting) -> str:
    """A setting as the command line takes it: ``kp=0.6,ki=0.01``."""
    return ",".join(f"{k}={v:.{DIGITS}g}" if isinstance(v, float) else f"{k}={v}" for k, v in setting.items())


def _checked(
    name: str, parameter: Parameter, values: Sequence[float], spacing: Literal["linear", "log"], estimator: Estimator
) -> GridAxis:
    return GridAxis(
        name, parameter.unit, tuple(dict.fromkeys(parameter.check(v, estimator.name) for v in values)), spacing
    )


def _number(text: str, name: str, where: str, estimator: Estimator) -> float:
    """The number of a text with or without the parameter's unit, within its range. UsageError otherwise."""
    if not text.strip():
        raise UsageError(f"{where}: a value is missing")
    return float(checked(estimator, name, text.strip()))


def _range_of(parameter: Parameter) -> str:
    middle = parameter.default if isinstance(parameter.default, float) and parameter.default > 0 else 1.0
    return ",".join(parameter.choices) or f"{middle / 3:.2g}..{middle * 3:.2g}/5"


def _example(estimator: Estimator) -> str:
    own = next(iter(estimator.own), None)
    return "kp=0.3..2/8" if own is None else f"{own.name}={_range_of(own)}"


@dataclass(frozen=True, slots=True)
class SearchRequest:
    """Logs (files, folders, patterns), the filter's text and the axes' texts."""

    logs: list[Path]
    filter: str
    axes: list[str]


def search_request(words: Sequence[str], example: str) -> SearchRequest:
    """``LOG... FILTER NAME=VALUES...``: an axis is NAME=... that is no file, the filter is the last of the others.

    UsageError with the ``example`` where logs or filter are missing.
    """
    axes = [w for w in words if is_axis(w) and not os.path.exists(w)]
    others = [w for w in words if w not in axes]
    if len(others) < 2:
        missing = "a log and a filter are" if not others else "a log or the filter is"
        raise UsageError(f"{missing} missing; give logs, then a filter, then what to vary: {example}")
    if os.path.isdir(others[-1]) or (os.path.isfile(others[-1]) and not others[-1].endswith(".py")):
        raise UsageError(f"{others[-1]} is a file or folder; the filter comes after the logs: {example}")
    return SearchRequest([Path(w) for w in others[:-1]], others[-1], axes)
