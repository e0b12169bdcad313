"""Parameter values to try: lists, ranges and switches, their grid, and a search.

=====================  =========================================
``kp=0.6,1.1,2``       these values
``ki=0..0.05/6``       6 values from 0 to 0.05, evenly spaced
``ki=1e-4..0.1/7log``  7 values, each the same factor above the last
``mag_form=heading,vector``  words of a switch
=====================  =========================================

A number may carry the parameter's own unit (``declination=3deg``); another one is refused.

The search is scipy's differential evolution (Storn1997): a whole generation goes to one batch (``vectorized``); it
needs no gradient and has a seed. optuna and nevergrad ask for one setting after the other.
"""

from __future__ import annotations

import itertools
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from attlog.compare.setting import check_parameter, flown_filter, refusal_of
from attlog.core.errors import UsageError
from attlog.core.limits import MAX_SETS, MAX_VALUES
from attlog.estimators import Parameter
from attlog.estimators.interface import A_FEW, COMMON, WITH_COMMA, Estimator, range_spelled

Value = float | str
# One combination: parameter name -> value.
Setting = dict[str, Value]

RANGE_PATTERN = re.compile(r"(?P<low>.+?)\.\.(?P<high>.+?)(?:/(?P<count>[^/]*?)\s*(?P<log>log)?)?")
# Significant digits of the values of a range: 0..0.05/6 then contains exactly 0.03.
VALUE_DIGITS = 12
LOG_DIGITS = 4


@dataclass(frozen=True, slots=True)
class GridAxis:
    """Parameter and its values; ``spacing`` is for drawing."""

    name: str
    unit: str
    values: tuple[Value, ...]
    spacing: Literal["linear", "log", "words"]


@dataclass(frozen=True, slots=True)
class SettingGrid:
    """All combinations of values; the last axis changes fastest."""

    axes: tuple[GridAxis, ...]

    def __len__(self) -> int:
        return prod(len(axis.values) for axis in self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the number of values of each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    def __iter__(self) -> Iterator[Setting]:
        for values in itertools.product(*(axis.values for axis in self.axes)):
            yield {axis.name: value for axis, value in zip(self.axes, values, strict=True)}


def is_axis(word: str) -> bool:
    """Return whether a word of the command line defines an axis (``kp=...``)."""
    return re.match(r"[A-Za-z_]\w*=", word) is not None


def parse_grid(texts: Iterable[str], estimator: Estimator) -> SettingGrid:
    """Parse texts such as ``kp=0.6,1.1,2`` to a grid. UsageError lists every error."""
    axes: dict[str, GridAxis] = {}
    wrong: list[str] = []
    for text in texts:
        try:
            found = parse_axis(text, estimator)
            if found.name in axes:
                raise UsageError(f"{text}: {found.name} is given twice; put all its values in one list")
            axes[found.name] = found
        except UsageError as error:
            wrong.append(str(error))
    if not axes and not wrong:
        raise UsageError(f"nothing to sweep; give values such as {_grid_example(estimator)}")
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


def parse_axis(text: str, estimator: Estimator) -> GridAxis:
    """Parse the axis ``NAME=VALUES``. UsageError with the text and its problem."""
    name, _, values = (part.strip() for part in text.partition("="))
    parameter = estimator.parameter(name)
    name = parameter.name
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
        listed = [_axis_number(v, name, where, estimator) for v in values.split(",")]
        return _checked_axis(name, parameter, listed, "linear", estimator)
    found = RANGE_PATTERN.fullmatch(values)
    if found is None or not (found["count"] or "").strip().isdecimal():
        example = f"{name}={meant}/{A_FEW}" if (meant := range_spelled(values)) else _range_of(parameter)
        raise UsageError(f"{where}: a range is LOW..HIGH/COUNT or LOW..HIGH/COUNTlog, such as {example}")
    low, high = (_axis_number(found[end], name, where, estimator) for end in ("low", "high"))
    count = int(found["count"])
    if not low < high:
        raise UsageError(f"{where}: the range is empty; give the smaller value first")
    if not 2 <= count <= MAX_VALUES:
        raise UsageError(f"{where}: {count} values; a range has 2 to {MAX_VALUES}")
    if found["log"] and low <= 0.0:
        raise UsageError(f"{where}: a log range begins above 0; list 0 by itself or take a linear range")
    return _checked_axis(
        name,
        parameter,
        spaced_values(low, high, count, bool(found["log"])),
        "log" if found["log"] else "linear",
        estimator,
    )


def decimal_comma_hints(texts: Iterable[str]) -> list[str]:
    """Warn about values that may be a decimal comma: ``kp=1,5`` are two values.

    UsageError for ``kp=0,3`` and ``kp=1,05``, which hardly anybody writes for two values.
    """
    hints, wrong = [], []
    for text in texts:
        name, _, values = (part.strip() for part in text.partition("="))
        if found := WITH_COMMA.fullmatch(values):
            number = f"{found[1]}.{found[2]}"
            if int(found[1]) == 0 or found[2].startswith("0"):
                wrong.append(f"{text}: write {name}={number} for one number, {name}={found[1]}.0,{found[2]} for two")
            else:
                hints.append(f"{text} are two values, {found[1]} and {found[2]}; the number is written {number}")
    if wrong:
        raise UsageError("\n".join(wrong))
    return hints


def spaced_values(low: float, high: float, count: int, log: bool) -> list[float]:
    """Return ``count`` values from low to high, both included."""
    shares = [k / (count - 1) for k in range(count)]
    found = [low * (high / low) ** s if log else low + (high - low) * s for s in shares]
    digits = LOG_DIGITS if log else VALUE_DIGITS
    return [low, *(float(f"{x:.{digits}g}") for x in found[1:-1]), high]


def setting_text(setting: Setting) -> str:
    """Format a setting for the command line: ``kp=0.6,ki=0.01``."""
    return ",".join(f"{k}={v:.{VALUE_DIGITS}g}" if isinstance(v, float) else f"{k}={v}" for k, v in setting.items())


def _checked_axis(
    name: str, parameter: Parameter, values: Sequence[float], spacing: Literal["linear", "log"], estimator: Estimator
) -> GridAxis:
    return GridAxis(
        name, parameter.unit, tuple(dict.fromkeys(parameter.check(v, estimator.name) for v in values)), spacing
    )


def _axis_number(text: str, name: str, where: str, estimator: Estimator) -> float:
    """Parse a number with or without the parameter's unit. UsageError outside its range."""
    if not text.strip():
        raise UsageError(f"{where}: a value is missing")
    return float(check_parameter(estimator, name, text.strip()))


def _range_of(parameter: Parameter) -> str:
    middle = parameter.default if isinstance(parameter.default, float) and parameter.default > 0 else 1.0
    return ",".join(parameter.choices) or f"{middle / 3:.2g}..{middle * 3:.2g}/5"


def _grid_example(estimator: Estimator) -> str:
    own = next(iter(estimator.own), None)
    return "kp=0.3..2/8" if own is None else f"{own.name}={_range_of(own)}"


@dataclass(frozen=True, slots=True)
class SearchRequest:
    """Logs (files, folders, patterns), the text of the filter and those of the axes."""

    logs: list[Path]
    filter: str
    axes: list[str]


def search_request(words: Sequence[str], example: str) -> SearchRequest:
    """Parse ``LOG... FILTER NAME=VALUES...``.

    The filter is the last word that is no axis. Parameters of one firmware's EKF need no filter: the flown one is
    meant. UsageError with the ``example`` where logs or filter are missing.
    """
    axes = [w for w in words if is_axis(w) and not os.path.exists(w)]
    others = [w for w in words if w not in axes]
    flown = {flown_filter(axis) for axis in axes}
    if others and len(flown) == 1 and "" not in flown and (os.path.exists(others[-1]) or set("*?[") & set(others[-1])):
        others.append(flown.pop())
    if len(others) < 2 and (refused := [f"{axis}: {why}" for axis in axes if (why := refusal_of(axis))]):
        raise UsageError("\n".join(refused))
    if len(others) < 2:
        missing = "a log and a filter are" if not others else "a log or the filter is"
        raise UsageError(f"{missing} missing; give logs, then a filter, then what to vary: {example}")
    if os.path.isdir(others[-1]) or (os.path.isfile(others[-1]) and not others[-1].endswith(".py")):
        raise UsageError(f"{others[-1]} is a file or folder; the filter comes after the logs: {example}")
    return SearchRequest([Path(w) for w in others[:-1]], others[-1], axes)


Array = NDArray[np.float64]
Costs = Callable[[list[Setting]], Array]

# Settings per generation, as many as a batch of :mod:`attlog.compare.search`.
GENERATION_SIZE = 32
# Significant digits of gains: equal ones are run once.
GAIN_DIGITS = 3
# Range of a gain without limits: its default divided and multiplied by this factor.
DEFAULT_RANGE_FACTOR = 20.0
# Largest number of gains searched, by default and in total: a few flights do not determine more.
MAX_DEFAULT_GAINS, MAX_GAINS = 4, 8


@dataclass(frozen=True, slots=True)
class FreeParameter:
    """Gain searched between two values, on a logarithmic scale where ``log``."""

    name: str
    unit: str
    low: float
    high: float
    log: bool

    def value(self, share: float) -> float:
        """Return the value at a share of the range, rounded to GAIN_DIGITS."""
        if self.log:
            x = self.low * (self.high / self.low) ** share
        else:
            x = self.low + (self.high - self.low) * share
        return min(max(float(f"{x:.{GAIN_DIGITS}g}"), self.low), self.high)

    def share(self, value: float) -> float:
        """Return the position of a value in the range, 0 to 1."""
        value = min(max(value, self.low), self.high)
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


def parse_free_parameters(texts: Sequence[str], estimator: Estimator) -> list[FreeParameter]:
    """Parse gains such as ``kp=0.05..5log``; without texts return the filter's own gains.

    Its own gains are numbers with a positive default. UsageError lists every error.
    """
    if not texts:
        own = [p for p in estimator.own if not p.choices and p not in COMMON and float(p.default) > 0.0]
        if not own:
            raise UsageError(f"{estimator.name} has no gains to tune; give ranges such as NAME=0.1..10log")
        if len(own) > MAX_DEFAULT_GAINS:
            names, example = ", ".join(p.name for p in own), _default_range(own[0])
            raise UsageError(
                f"{estimator.name} has {len(own)} numbers ({names}), too many to look for at once; "
                f"name up to {MAX_GAINS} with ranges, such as "
                f"{example.name}={example.low:g}..{example.high:g}log"
            )
        return [_default_range(p) for p in own]
    if len(texts) > MAX_GAINS:
        raise UsageError(f"{len(texts)} gains; up to {MAX_GAINS} can be looked for at once")
    found, wrong = [], []
    for text in texts:
        try:
            found.append(_parse_free(text, estimator))
        except UsageError as error:
            wrong.append(str(error))
    if wrong:
        raise UsageError("\n".join(wrong))
    return found


def _default_range(parameter: Parameter) -> FreeParameter:
    """Return a gain with a range about its default."""
    default = float(parameter.default)
    low, high = (
        float(f"{x:.{GAIN_DIGITS}g}") for x in (default / DEFAULT_RANGE_FACTOR, default * DEFAULT_RANGE_FACTOR)
    )
    return FreeParameter(parameter.name, parameter.unit, max(low, parameter.low), min(high, parameter.high), True)


def _parse_free(text: str, estimator: Estimator) -> FreeParameter:
    name, _, values = (part.strip() for part in text.partition("="))
    parameter: Parameter = estimator.parameter(name)
    name = parameter.name
    log = values.endswith("log")
    ends = RANGE_PATTERN.fullmatch(values.removesuffix("log").strip())
    if parameter.choices or ends is None or ends["count"] is not None:
        example = range_spelled(values.removesuffix("log").partition("/")[0]) or "0.1..10log"
        raise UsageError(f"{estimator.name}: {text}: give a range such as {name}={example}, or attlog sweep for a list")
    low, high = (float(check_parameter(estimator, name, ends[end].strip())) for end in ("low", "high"))
    if not low < high:
        raise UsageError(f"{estimator.name}: {text}: the range is empty; give the smaller value first")
    if log and low <= 0.0:
        raise UsageError(f"{estimator.name}: {text}: a log range begins above 0")
    return FreeParameter(name, parameter.unit, low, high, log)


@dataclass(frozen=True, slots=True)
class SearchResult:
    """Best setting, its cost, and all settings tried with their costs, in order."""

    setting: Setting
    cost: float
    tried: list[tuple[Setting, float]]


def minimize(free: Sequence[FreeParameter], costs: Costs, start: Setting, generations: int, seed: int) -> SearchResult:
    """Minimise the cost over settings, with ``start`` in the first generation.

    ``costs`` takes a whole generation. The same ``seed`` gives the same result. UsageError where scipy is not
    installed.
    """
    try:
        from scipy.optimize import differential_evolution  # type: ignore[import-untyped, unused-ignore]
        from scipy.stats import qmc  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        raise UsageError(
            'attlog tune needs scipy: pip install scipy, or pip install ".[tune]" in the source folder'
        ) from None
    tried: dict[str, tuple[Setting, float]] = {}

    def cost(x: Array) -> Any:
        settings: list[Setting] = [
            {f.name: f.value(float(s)) for f, s in zip(free, column, strict=True)} for column in x.T
        ]
        found = costs(settings)
        for setting, value in zip(settings, found.tolist(), strict=True):
            tried.setdefault(setting_text(setting), (setting, value))
        return found

    first = qmc.LatinHypercube(len(free), rng=np.random.default_rng(seed)).random(GENERATION_SIZE)
    first[0] = [f.share(float(start[f.name])) for f in free]
    differential_evolution(
        cost,
        [(0.0, 1.0)] * len(free),
        init=first,
        maxiter=generations,
        rng=np.random.default_rng(seed),
        tol=1e-3,
        polish=False,
        vectorized=True,
        updating="deferred",
    )
    best = min(tried.values(), key=lambda one: one[1])
    return SearchResult(best[0], best[1], list(tried.values()))
