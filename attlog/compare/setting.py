"""What may stand before a filter, by name: each setting's unit, size, range and meaning, and values checked against it.

Samples pass through them in this order, whatever the order in which they are written:
calibration, notches, low-pass, sample rate, latency.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

from attlog import estimators
from attlog.core.errors import UsageError, suggestion
from attlog.estimators import LogInfo
from attlog.estimators.interface import Estimator, cut_by_comma, number_spelled

Value = tuple[float, ...] | str
"""The numbers of a setting, or its word or file."""

NUMBERS_PATTERN = re.compile(r"\s*([-+0-9.eE]+(?:/[-+0-9.eE]+)*)\s*(.*?)\s*$")
MAX_FREQUENCY_HZ = 1e5


@dataclass(frozen=True, slots=True)
class InputSetting:
    """One thing that can be done to the samples. ``sizes``: how many numbers, with slashes between; ``words`` instead.

    Without sizes and words the value is a file.
    """

    name: str
    unit: str
    meaning: str
    sizes: tuple[int, ...] = (1,)
    low: float = 0.0
    high: float = MAX_FREQUENCY_HZ
    words: tuple[str, ...] = ()

    @property
    def form(self) -> str:
        """How a value looks, for messages and help."""
        if self.words:
            return "|".join(self.words)
        if not self.sizes:
            return "FILE"
        shapes = {1: "A", 2: "A/B", 3: "A/B/C"}
        return " or ".join(shapes[n] for n in self.sizes) + (f" [{self.unit}]" if self.unit else "")

    def check(self, value: object) -> Value:
        """The value of a text, number, truth value or list. UsageError says what is wrong and what is wanted."""
        if self.words:
            text = {True: "on", False: "off"}.get(value, str(value)) if isinstance(value, bool) else str(value)
            if text not in self.words:
                raise UsageError(f"{self.name}={text}: give {' or '.join(self.words)}")
            return text
        if not self.sizes:
            if not isinstance(value, str) or not value.strip():
                raise UsageError(f"{self.name}={value!r}: give the name of a file")
            return value.strip()
        numbers = self._numbers(value)
        if len(numbers) not in self.sizes:
            raise UsageError(f"{self.name}={value}: {len(numbers)} numbers; give {self.form}")
        if not all(math.isfinite(x) and self.low <= x <= self.high for x in numbers):
            raise UsageError(
                f"{self.name}={value} is out of range; give {self.form} from {self.low:g} to {self.high:g}"
            )
        return numbers

    def _numbers(self, value: object) -> tuple[float, ...]:
        wrong = UsageError(f"{self.name}={value!r}: of the wrong type; give {self.form}")
        if isinstance(value, bool):
            raise wrong
        if isinstance(value, int | float):
            return (float(value),)
        if isinstance(value, list | tuple):
            if not all(isinstance(x, int | float) and not isinstance(x, bool) for x in value):
                raise wrong
            return tuple(map(float, value))
        found = NUMBERS_PATTERN.match(value) if isinstance(value, str) else None
        if found is None:
            raise wrong
        if found[2] and found[2] != self.unit:
            wanted = f"is given in {self.unit}" if self.unit else "has no unit"
            raise UsageError(f"{self.name}={value}: {self.name} {wanted}, not in {found[2]}")
        try:
            return tuple(map(float, found[1].split("/")))
        except ValueError:
            raise wrong from None


THREE_NUMBERS = (3,)
SETTINGS: dict[str, InputSetting] = {
    s.name: s
    for s in (
        InputSetting("lowpass", "Hz", "second-order Butterworth low-pass on gyro and accelerometer", low=0.01),
        InputSetting("gyro_lowpass", "Hz", "the same on the gyro alone", low=0.01),
        InputSetting("acc_lowpass", "Hz", "the same on the accelerometer alone", low=0.01),
        InputSetting("notch", "Hz", "notch on gyro and accelerometer: centre / width", (2,), low=0.01),
        InputSetting(
            "rpm_notch",
            "Hz",
            "notches that follow the logged rotor speeds: width / harmonics (1 if not given)",
            (1, 2),
            low=0.01,
        ),
        InputSetting("rate", "Hz", "means of so many IMU samples that this rate comes out", low=0.01),
        InputSetting("pick", "Hz", "one of so many IMU samples that this rate comes out, the others dropped", low=0.01),
        InputSetting("mag", "", "off: the filter runs without magnetometer", (), words=("on", "off")),
        InputSetting("mag_rate", "Hz", "one of so many magnetometer samples that this rate comes out", low=0.001),
        InputSetting("latency", "ms", "all samples come so much later", low=0.0, high=10_000.0),
        InputSetting(
            "gyro_offset",
            "deg/s",
            "subtracted from the gyro, body axes; a bias that rest shows is subtracted after it",
            THREE_NUMBERS,
            -2000.0,
            2000.0,
        ),
        InputSetting(
            "acc_offset", "m/s^2", "subtracted from the accelerometer, body axes", THREE_NUMBERS, -200.0, 200.0
        ),
        InputSetting("mag_offset", "uT", "subtracted from the magnetometer, body axes", THREE_NUMBERS, -1000.0, 1000.0),
        InputSetting("gyro_scale", "", "the gyro without its offset times this", (1, 3), 0.01, 100.0),
        InputSetting("acc_scale", "", "the accelerometer without its offset times this", (1, 3), 0.01, 100.0),
        InputSetting("mag_scale", "", "the magnetometer without its offset times this", (1, 3), 0.01, 100.0),
        InputSetting(
            "imu_rotation",
            "deg",
            "gyro and accelerometer turned by roll / pitch / yaw, after offset and scale",
            THREE_NUMBERS,
            -360.0,
            360.0,
        ),
        InputSetting(
            "mag_rotation", "deg", "the magnetometer turned by roll / pitch / yaw", THREE_NUMBERS, -360.0, 360.0
        ),
        InputSetting(
            "params", "", "firmware parameters of this file in place of the log's, for filters that take them", ()
        ),
    )
}
"""What may stand before a filter, by name."""


def setting_argument(name: str, value: Value) -> str:
    """``NAME=VALUE`` as the command line takes it."""
    return f"{name}={value if isinstance(value, str) else '/'.join(f'{x:g}' for x in value)}"


def setting_text(name: str, value: Value) -> str:
    """A setting for people: ``low-pass 20 Hz``, ``no magnetometer``."""
    if name == "mag":
        return "no magnetometer" if value == "off" else "magnetometer"
    words = name.replace("lowpass", "low-pass").replace("_", " ").replace("rpm", "RPM")
    if isinstance(value, str):
        return f"{words} {value}"
    unit = SETTINGS[name].unit
    return f"{words} {'/'.join(f'{x:g}' for x in value)}{' ' + unit if unit else ''}"


# What a configuration is: a filter with its gains, and what comes before it.
#
# On the command line ``NAME[@PRESET][:key=value,...]`` or ``FILE.py[...]``; a key is a parameter of
# the filter or one of :data:`attlog.compare.setting.SETTINGS`, as in
# ``mahony:kp=0.3,lowpass=20,mag=off``.
# Where a filter has a parameter of the same name as a setting the key is the filter's.

FILE_SUFFIXES = (".py", ".csv")
"""What an estimator file and an attitude computed elsewhere are called."""
WITH_UNIT = re.compile(r"((?>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))\s*(\S.*)")
"""A number with something behind it that may be its unit."""


@dataclass(frozen=True, slots=True)
class Configuration:
    """One way to get an attitude from a log: ``row`` the filter, ``before`` what is done to its samples, by setting.

    ``name`` is what its row is called everywhere; ``text`` writes it as the command line takes it.
    """

    name: str
    row: estimators.EstimatorSpec
    before: Mapping[str, Value] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """The configuration as :func:`parse` reads it."""
        settings = ",".join(setting_argument(name, value) for name, value in self.before.items())
        estimator = self.row.estimator
        own = self.row.name
        if estimator.origin != "attlog" and estimator.origin.lower().endswith(FILE_SUFFIXES):
            own = estimator.origin + own.removeprefix(estimator.name)
        return own + ((":" if not self.row.params else ",") + settings if settings else "")

    @property
    def params(self) -> Path | None:
        """The file whose firmware parameters stand in for those of the log."""
        return Path(str(self.before["params"])) if "params" in self.before else None

    def with_value(self, key: str, value: object, name: str | None = None) -> Configuration:
        """The same with one parameter or setting changed. UsageError for a key or value that does not exist."""
        row, before = dict(self.row.params), dict(self.before)
        if is_parameter(self.row.estimator, key):
            row[key] = check_parameter(self.row.estimator, key, value)
        elif key in SETTINGS:
            before[key] = SETTINGS[key].check(value)
        else:
            raise unknown_key_error(self.row.estimator, key)
        changed = replace(self, row=estimators.EstimatorSpec(self.row.estimator, self.row.preset, row), before=before)
        _check_exclusive(changed.before)
        return replace(changed, name=name or changed.text)


def parse_configuration(text: str, name: str | None = None) -> Configuration:
    """The configuration that ``NAME[@PRESET][:key=value,...]`` names; UsageError tells everything wrong with it."""
    text = text.strip()
    begin = next((text.lower().find(f) + len(f) for f in FILE_SUFFIXES if f in text.lower()), 0)
    head, _, tail = text[begin:].partition(":")
    values: dict[str, object] = {}
    problems = []
    for before, pair in pairwise(["", *(p.strip() for p in tail.split(",") if p.strip())]):
        key, equals, value = pair.partition("=")
        if not equals or key.strip() in values:
            cut = cut_by_comma(before, pair)
            problems.append(f"{key.strip()} is given twice" if equals else f"{pair} is not NAME=VALUE{cut}")
            continue
        values[key.strip()] = value.strip()
    return build_configuration(text[:begin] + head, values, name, problems, where=text)


def build_configuration(
    filter_name: str,
    values: Mapping[str, object],
    name: str | None = None,
    problems: Sequence[str] = (),
    where: str = "",
) -> Configuration:
    """A configuration from a filter (``NAME[@PRESET]`` or a file) and values by key.

    UsageError with one line for each thing that is wrong, ``problems`` found before among them.
    """
    found = list(problems)
    try:
        row = estimators.parse(filter_name)
    except UsageError as error:
        raise UsageError("\n".join(_with_place([*found, str(error)], where))) from None
    params, before = dict(row.params), {}
    for key, value in values.items():
        try:
            if is_parameter(row.estimator, key):
                params[key] = check_parameter(row.estimator, key, value)
            elif key in SETTINGS:
                before[key] = SETTINGS[key].check(value)
            else:
                raise unknown_key_error(row.estimator, key)
        except UsageError as error:
            found.append(str(error))
    try:
        _check_exclusive(before)
        row = estimators.EstimatorSpec(row.estimator, row.preset, params)
        row.resolved()
    except UsageError as error:
        found.append(str(error))
    if found:
        raise UsageError("\n".join(_with_place(found, where)))
    made = Configuration(name or "", row, before)
    return replace(made, name=name or made.text)


def check_parameter(estimator: Estimator, key: str, value: object) -> float | str:
    """A parameter's value of a text or number; its own unit may stand behind it. UsageError otherwise."""
    parameter = estimator.parameter(key)
    if isinstance(value, str) and not parameter.choices:
        found = WITH_UNIT.fullmatch(value.strip())
        if found is not None and found[2] != parameter.unit:
            wanted = f"is given in {parameter.unit}" if parameter.unit else "has no unit"
            hint = number_spelled(key, value) or f"{key} {wanted}, not in {found[2]}"
            raise UsageError(f"{estimator.name}: {key}={value}: {hint}")
        value = found[1] if found is not None else value
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise UsageError(f"{estimator.name}: {key}={value!r} is of the wrong type; give a number or a word")
    return parameter.check(value, estimator.name)


def is_parameter(estimator: Estimator, key: str) -> bool:
    """Whether a key is a parameter of the filter."""
    return any(p.name == key for p in estimator.parameters)


def unknown_key_error(estimator: Estimator, key: str) -> UsageError:
    """What to say about a key that is neither a parameter of the filter nor a setting before it."""
    own = [p.name for p in estimator.parameters]
    hint = suggestion(key, [*own, *SETTINGS])
    return UsageError(f"{estimator.name} has no parameter {key}, and no setting before a filter is called so{hint}")


def labels(configurations: Sequence[Configuration]) -> dict[str, str]:
    """What a configuration is called in a sentence, by name: what is the same in all of them is left out.

    ``mahony:kp=0.3`` and ``mahony:kp=0.6`` are ``kp 0.3`` and ``kp 0.6``. A name of the user's own stays.
    """
    named = {c.name for c in configurations if c.name != c.text}
    alike = len({(c.row.estimator.origin, c.row.estimator.name, c.row.preset) for c in configurations}) == 1
    parts = {c.name: _parts(c) for c in configurations}
    shared = set.intersection(*(set(p) for p in parts.values())) if alike and len(parts) > 1 else set()
    found = {}
    for c in configurations:
        head = c.row.estimator.name + (f"@{c.row.preset}" if c.row.preset else "")
        own = " ".join(p for p in parts[c.name] if p not in shared)
        text = own if alike and len(parts) > 1 else f"{head} {own}".strip()
        found[c.name] = c.name if c.name in named else text or head
    called = list(found.values())
    return {key: text if called.count(text) == 1 else key for key, text in found.items()}


def _parts(c: Configuration) -> list[str]:
    gains = [f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}" for k, v in c.row.params.items()]
    return gains + [setting_text(name, value) for name, value in c.before.items()]


def _check_exclusive(before: Mapping[str, Value]) -> None:
    """UsageError for settings that exclude each other."""
    if "rate" in before and "pick" in before:
        raise UsageError("rate and pick exclude each other: rate takes means, pick drops samples")
    for sensor in ("gyro", "acc"):
        if "lowpass" in before and f"{sensor}_lowpass" in before:
            raise UsageError(f"lowpass and {sensor}_lowpass exclude each other: lowpass acts on both sensors")
    off = [name for name in before if name.startswith("mag_")] if before.get("mag") == "off" else []
    if off:
        raise UsageError(f"{', '.join(off)}: there is no magnetometer with mag=off")


def _with_place(problems: Iterable[str], where: str) -> list[str]:
    return [f"{where}: {p}" if where and not p.startswith(where) else p for p in problems]


# Which parameter of an autopilot is a filter's own gain? Asked of the filter: what it makes of a log's parameters.

PROBE_FACTORS = (0.9, 1.2)
"""Two values that differ from each other and from the default: what follows both is the parameter itself."""


class _RecordingParams(Mapping[str, float]):
    """A log that holds every parameter that is asked for, and remembers their names."""

    def __init__(self, values: Mapping[str, float]) -> None:
        self.values_, self.names = values, set[str]()

    def __getitem__(self, name: str) -> float:
        self.names.add(name)
        return self.values_.get(name, 1.0)

    def __iter__(self) -> Iterator[str]:
        return iter(self.values_)

    def __len__(self) -> int:
        return len(self.values_)


def firmware_names(estimator: Estimator) -> dict[str, str]:
    """Parameter of the filter -> parameter of the autopilot that it is, for those that are taken as they stand."""
    if estimator.from_log is None:
        return {}
    if estimator.process is not None:
        return estimator.process.call(firmware_names)
    sizes = {p.name: float(p.default) for p in estimator.own if not p.choices}
    try:
        probe = _RecordingParams({})
        estimator.from_log(probe, LogInfo())
        found = {}
        for firmware in sorted(probe.names):
            for own, size in sizes.items():
                values = [size * f for f in PROBE_FACTORS]
                values_there = [estimator.from_log(_RecordingParams({firmware: v}), LogInfo()).get(own) for v in values]
                if size and values_there == values:
                    found[own] = firmware
        return found
    except Exception:  # a plug-in's function may want more than a log's parameters: then no name is known
        return {}
