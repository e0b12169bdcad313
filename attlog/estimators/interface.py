"""What an estimator is: parameters, start and step, the result; and errors of plug-ins with their line."""

from __future__ import annotations

import math
import os
import re
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from numbers import Real
from types import MappingProxyType
from typing import Any, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from attlog.core.brief import brief
from attlog.core.errors import AttlogError, PluginError, UsageError, suggestion
from attlog.core.limits import MAX_ERROR_LETTERS


def broken(where: str, error: BaseException) -> PluginError:
    """Return a PluginError with the innermost line of the plug-in file ``where`` that led to ``error``."""
    if isinstance(error, SyntaxError) and error.lineno is not None:
        return PluginError(f"{error.filename or where}, line {error.lineno}: {error.msg}")
    lines = [
        f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename in (where, os.path.abspath(where))
    ]
    at = f"{where}, line {lines[-1]}" if lines else where
    return PluginError(f"{at}: {type(error).__name__}: {_words(error)}")


def _words(error: BaseException) -> str:
    """Return the text of an exception of a plug-in: of any length, or none."""
    try:
        said = str(error)
    except Exception:
        return "its own words cannot be had"
    return said if len(said) <= MAX_ERROR_LETTERS else f"{said[:MAX_ERROR_LETTERS]}... ({len(said)} letters)"


@contextmanager
def plugin_errors(origin: str) -> Iterator[None]:
    """Whatever code of ``origin`` raises inside becomes a PluginError with file and line; our own errors stay."""
    try:
        yield
    except AttlogError:
        raise
    except Exception as error:
        if origin == "attlog":
            raise
        raise broken(origin, error) from error


# What people write where the command line takes a number, and how it is written there.

NUMBER = r"[-+]?(?>\d+\.?\d*|\.\d+)(?>[eE][-+]?\d+)?"
WITH_COMMA = re.compile(r"([-+]?\d+),(\d+)")
LIKE_A_RANGE = re.compile(rf"({NUMBER})\s*(?:\.\.+|-|\u2013|:|to)\s*({NUMBER})")
CUT = re.compile(r"(\w+)=([-+]?\d+)$")
# Values in the range that a sentence proposes.
A_FEW = 12


def number_spelled(name: str, value: str) -> str:
    """Return a hint for a decimal comma or a range in place of a number; empty for other texts."""
    if found := WITH_COMMA.fullmatch(value.strip()):
        return f"did you mean {name}={found[1]}.{found[2]}?"
    if found := LIKE_A_RANGE.fullmatch(value.strip()):
        return f"attlog sweep takes a range, written {name}={range_spelled(value)}/{A_FEW}"
    return ""


def range_spelled(value: str) -> str:
    """Return a range in dashes, colons or words as ``LOW..HIGH``; empty for other texts."""
    found = LIKE_A_RANGE.fullmatch(value.strip())
    return f"{found[1]}..{found[2]}" if found else ""


def cut_by_comma(before: str, item: str) -> str:
    """Return the end of an error sentence where a decimal comma has cut ``kp=0,3`` in two, else empty."""
    found = CUT.search(before)
    return f"; did you mean {found[1]}={found[2]}.{item}?" if found and item.isdecimal() else ""


# What an estimator is: parameters, a start, a step, and what a run returns.
#
# An estimator knows numbers only: no log, no vehicle, no files. Its file holds a
# docstring with equations and source, a few constants (:mod:`attlog.estimators.registry`
# lists them) and two plain functions that numba can compile, ``start`` and ``step``, or one
# that takes whole segments, ``run``. What follows from a log about a filter's own parameters
# reaches it as :class:`LogFacts`.

Array = NDArray[np.float64]
T = TypeVar("T")
MAX_VALUE_LETTERS = 60
# With the attitude at which end of its time a step compares vectors: the one it is given, or the one it has turned.
VectorsAt = Literal["start", "end"]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A setting of a filter: what it means, its unit, range, default, and where the default comes from.

    ``choices`` names the values of a switch; the kernel sees the position in the
    tuple as a float.
    """

    name: str
    default: float | str
    unit: str
    low: float
    high: float
    meaning: str
    source: str
    choices: tuple[str, ...] = ()

    def check(self, value: float | str, owner: str = "") -> float | str:
        """Return the value as float or as one of the choices. UsageError if it is neither or out of range."""
        where = f"{owner}: {self.name}" if owner else self.name
        if self.choices:
            if value in self.choices:
                return str(value)
            raise UsageError(f"{where}={_short(value)} is not known{suggestion(_short(value), self.choices)}")
        try:
            number = float(value)
        except (TypeError, ValueError):
            hint = number_spelled(self.name, str(value)) or f"give one {self._range()}"
            raise UsageError(f"{where}={_short(value)} is not a number; {hint}") from None
        except OverflowError:  # an integer beyond all floats
            number = math.inf
        if not (math.isfinite(number) and self.low <= number <= self.high):
            raise UsageError(f"{where}={_short(value)} is out of range; give a value {self._range()}")
        return number

    def code(self, value: float | str) -> float:
        """Return what the kernel sees: the number, or the position of the choice."""
        return float(self.choices.index(str(value))) if self.choices else float(value)

    def _range(self) -> str:
        return f"from {self.low:g} to {self.high:g} {self.unit}".rstrip()


def choice(name: str, values: tuple[str, ...], meaning: str, source: str, default: str = "") -> Parameter:
    """Return a switch; its default is the first of its values."""
    return Parameter(name, default or values[0], "", 0, 1, meaning, source, values)


@dataclass(frozen=True, slots=True)
class LogInfo:
    """What is known about a flight, in numbers; None where the log lacks it.

    ``declination_deg`` at the place and date of the flight, positive east. ``imu_rate_hz``,
    ``mag_rate_hz`` of the replayed sensors (no magnetometer: None). ``gyro_noise`` [rad/s/sqrt(Hz)]
    and ``acc_noise`` [m/s^2/sqrt(Hz)]: white noise densities at rest, mean of the three axes,
    measured over ``rest_s`` seconds. ``forward``: whether the vehicle moves where its nose points.
    ``since_boot_s``: how long the autopilot had been running at the first IMU sample.
    """

    declination_deg: float | None = None
    imu_rate_hz: float | None = None
    mag_rate_hz: float | None = None
    gyro_noise: float | None = None
    acc_noise: float | None = None
    rest_s: float = 0.0
    forward: bool | None = None
    since_boot_s: float | None = None


@dataclass(frozen=True, slots=True)
class LogFacts:
    """What ``from_log(params, info)`` is given: the log's parameters by name, and what is known about the flight.

    ``given``: parameters that the user set in the firmware's terms ("what if"); they override the log's.
    """

    params: Mapping[str, float] = field(default_factory=dict)
    info: LogInfo = LogInfo()
    given: Mapping[str, float] = field(default_factory=dict)
    __repr__ = brief


INIT = choice(
    "init",
    ("average", "first", "identity"),
    "start attitude: accelerometer and magnetometer averaged, at rest over 0.5 s, in motion over 3 s in axes that the "
    "gyro holds still; or the first good sample; or q = (1, 0, 0, 0): level, nose to magnetic north",
    "attlog; in motion a single sample is 37 deg off in the mean; identity is Fan section 4",
)
TO_TRUE_NORTH = "angle from true to magnetic north, positive east: turns the estimated heading to true north"
DECLINATION = Parameter("declination", 0.0, "deg", -180, 180, TO_TRUE_NORTH, "attlog; 0 keeps magnetic north")
# Parameters that the shared loop handles for every filter; the kernel does not see them.
COMMON = (INIT, DECLINATION)

SENSORS = frozenset({"gyro", "acc", "mag"})
# What ``uses`` may name beside the sensors.
AIDS = frozenset({"gnss", "baro", "airspeed", "at_rest"})
# What ``needs`` may name.
NEEDED = SENSORS | {"gnss"}


class PluginProcess(Protocol):
    """A process that runs an estimator's functions, see :mod:`attlog.estimators.plugins`. ``name``: what it loads."""

    name: str

    def call(self, function: Callable[..., T], *arguments: Any, also_s: float = 0.0, **options: Any) -> T:
        """``function(estimator, *arguments, **options)`` there; ``also_s``: time that is not the filter's own."""


@dataclass(frozen=True, slots=True)
class Estimator:
    """A registered estimator.

    ``needs`` is a subset of {"gyro", "acc", "mag", "gnss"}: what it cannot run without;
    ``uses`` is what it takes when there. ``start(params, acc, mag, q0) -> state`` and
    ``step(state, params, dt, gyr, acc, mag)`` for stepping filters, or ``run`` for
    whole-run estimators. ``state[0:4]`` is the quaternion; ``slices`` names other
    parts of the state (``bias`` in rad/s, auxiliary outputs). ``equations`` and
    ``text`` are the module docstring for people. ``causal`` is False where it
    looks ahead. ``hold_mag`` is True where the filter wants the last magnetometer
    vector propagated with the gyro between samples (continuous gains), False where
    it wants new samples only (Kalman filters). ``vectors_at`` is ``start`` where a step compares
    ``acc`` and ``mag`` with the attitude that it is given, ``end`` where it turns that attitude first.
    ``from_log(params, info) -> values`` gives the
    filter's own parameters that follow from a log (:class:`LogInfo`); a step whose ``uses``
    names aids takes one argument more (:mod:`attlog.estimators.aids`). Filters with one ``equation``
    differ in gains and numerics alone. ``without_gnss``: the built-in filter that runs in its place where the aids hold
    no GNSS. ``aliases``: other versions' names of its parameters. ``not_offered``: reasons by the beginning of a
    firmware parameter's name. ``process``: the process that runs its functions, which are then placeholders; None where
    this one does.
    """

    name: str
    title: str
    text: str
    source: str
    needs: frozenset[str]
    uses: frozenset[str]
    parameters: tuple[Parameter, ...]
    presets: Mapping[str, Mapping[str, float | str]]
    state_size: int = 4
    slices: Mapping[str, slice] = field(default_factory=dict)
    start: Callable[..., Any] | None = None
    step: Callable[..., Any] | None = None
    run: Callable[..., Any] | None = None
    causal: bool = True
    origin: str = "attlog"
    hold_mag: bool = True
    vectors_at: VectorsAt = "start"
    from_log: Callable[..., Any] | None = None
    equation: str = ""
    without_gnss: str = ""
    aliases: Mapping[str, str] = field(default_factory=dict)
    not_offered: Mapping[str, str] = field(default_factory=dict)
    process: PluginProcess | None = None
    __repr__ = brief

    @property
    def aided(self) -> bool:
        """Return whether its step takes the argument ``aid``."""
        return self.step is not None and bool(self.uses & AIDS)

    @property
    def own(self) -> tuple[Parameter, ...]:
        """The parameters that the kernel sees, in the order of its ``params`` array."""
        return tuple(p for p in self.parameters if p not in COMMON)

    @property
    def outputs(self) -> int:
        """How many leading entries of the state are kept for every sample."""
        return max(4, *(int(s.stop) for s in self.slices.values()), 4)

    def parameter(self, name: str) -> Parameter:
        """Return the parameter of that name or alias. UsageError with the reason or a suggestion if there is none."""
        for p in self.parameters:
            if p.name == self.aliases.get(name, name):
                return p
        reasons = {begin: why for begin, why in self.not_offered.items() if name.startswith(begin)}
        if reasons:
            raise UsageError(f"{self.name} does not offer {name}: {reasons[max(reasons, key=len)]}")
        raise UsageError(f"{self.name} has no parameter {name}{suggestion(name, [p.name for p in self.parameters])}")

    def resolve(
        self,
        preset: str | None = None,
        params: Mapping[str, float | str] | None = None,
        origin: str = "option",
        *,
        log: LogFacts | None = None,
    ) -> dict[str, tuple[float | str, str]]:
        """Return every parameter's value and origin (default, log, file, preset, or ``origin``), all checked.

        What is asked for by name wins: ``params``, then the preset, then what follows from the
        ``log``, then the default; ``file`` is what would be another without the log's ``given``.
        UsageError for unknown presets or names and for values out of range; PluginError if the
        filter's ``from_log`` fails or gives such.
        """
        if preset is not None and preset not in self.presets:
            raise UsageError(f"{self.name} has no preset {preset}{suggestion(preset, self.presets)}")
        values: dict[str, tuple[float | str, str]] = {p.name: (p.default, "default") for p in self.parameters}
        for given, source in ((self.presets[preset] if preset else {}, "preset"), (params or {}, origin)):
            for name, value in given.items():
                parameter = self.parameter(name)
                values[parameter.name] = (parameter.check(value, self.name), source)
        if log is not None:
            left = {name for name, (_, source) in values.items() if source == "default"}
            own = self.values_of(replace(log, given={}), left) if log.given else None
            for name, value in self.values_of(log, left).items():
                values[name] = (value, "log" if own is None or own.get(name) == value else "file")
        return values

    def values_of(self, log: LogFacts, wanted: Collection[str]) -> dict[str, float | str]:
        """Return the ``wanted`` parameters that follow from a log. PluginError as in :meth:`resolve`.

        The declination does for every filter that has one, unless its own ``from_log`` says otherwise.
        """
        values: dict[str, float | str] = {}
        if log.info.declination_deg is not None and log.info.mag_rate_hz is not None:
            values |= {p.name: log.info.declination_deg for p in self.parameters if p == DECLINATION}
        if self.from_log is not None:
            with plugin_errors(self.origin):
                followed = dict(self.from_log(MappingProxyType({**log.params, **log.given}), log.info))
            for name, value in followed.items():
                if not isinstance(name, str) or not isinstance(value, str | Real):
                    raise PluginError(f"{self.name}: from_log gives {_short(name)}={_short(value)}, no name and number")
            values |= followed
        try:
            known = {name: self.parameter(name) for name in values}
            return {name: p.check(values[name]) for name, p in known.items() if name in wanted}
        except UsageError as error:
            raise PluginError(f"{self.name}: from_log gives {error}") from None

    def pack(self, values: Mapping[str, float | str]) -> Array:
        """Return the kernel's ``params`` array (float64) of resolved values."""
        return np.array([p.code(values[p.name]) for p in self.own], np.float64)


@dataclass(slots=True)
class Estimate:
    """What a run returns, at the input's own good samples.

    ``t`` (n,) s, ``q`` (n, 4) unit quaternions w, x, y, z that turn body axes (forward-right-down) into earth axes
    (north-east-down, north as in :func:`~attlog.estimators.estimate`), ``bias`` (n, 3) rad/s or None: what is to be
    subtracted from the gyro, ``aux`` named (n, k) arrays, ``segment`` (n,) int counts restarts after gaps, ``skipped``
    counts input that was not used by reason (``nan``, ``time_not_rising``, ``saturated``, ``zero_vector``,
    ``gap_bridged``, ``restart``, ``bias_beyond_clip``) and samples before the heading's first field where that came
    after the start (``late_field``); ``no_heading`` are these times, (begin, end) in s.
    ``ns_per_update`` is the measured cost.
    ``quality`` is what a whole run says of itself, by name: numbers, or words such as what it was aided by.
    Estimators that know how sure they are give ``aux["sigma_tilt"]`` and ``aux["sigma_heading"]`` (n,) in rad.
    """

    t: Array
    q: Array
    bias: Array | None = None
    aux: dict[str, Array] = field(default_factory=dict)
    segment: NDArray[np.int64] | None = None
    skipped: dict[str, int] = field(default_factory=dict)
    ns_per_update: float = 0.0
    causal: bool = True
    no_heading: list[tuple[float, float]] = field(default_factory=list)
    quality: dict[str, float | str] = field(default_factory=dict)
    __repr__ = brief


def _short(value: object) -> str:
    """Return a value as text for a sentence, cut to a length."""
    try:
        text = str(value)
    except Exception:
        return f"a {type(value).__name__}"
    return text if len(text) <= MAX_VALUE_LETTERS else f"{text[:MAX_VALUE_LETTERS]}..."


# Parameters that several filters share, so that a name means the same everywhere.
#
# Measured: with the vector f/g the tilt error on BROAD falls from 4.2 to 2.5 deg (mahony, kp 0.6), because vectors
# average to gravity and directions do not. The heading form keeps a disturbed field out of roll and pitch. The
# first-order step is that of Lyu 8-10, Fan 3 and Xu 6-10. The papers do not say what ki is per.

CANCEL = "gravity error from f/|f|, or from f/g, in which accelerations cancel"
ACC_FORM = choice("acc_form", ("direction", "vector"), CANCEL, "attlog; BROAD tilt 4.2 -> 2.5 deg", "vector")
MAG_FORM = choice(
    "mag_form", ("heading", "vector"), "the field corrects heading alone, or all axes", "attlog; spares the tilt"
)
INTEGRATOR = choice("integrator", ("exact", "first_order"), "attitude step, exponential map or the papers'", "attlog")
KI_PER = choice("ki_per", ("second", "sample"), "whether ki is per second or per sample", "attlog")
MAG_GAIN = Parameter("mag_gain", 1.0, "1", 0, 10, "weight of the heading error; 0 leaves heading to the gyro", "attlog")
# What the papers' presets share: unit vectors and the first-order step.
AS_PRINTED = {"acc_form": "direction", "integrator": "first_order"}
