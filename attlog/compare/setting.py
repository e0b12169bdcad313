"""Configuration of a filter: its gains, and settings of the samples before it.

On the command line ``NAME[@PRESET][:key=value,...]`` or ``FILE.py[...]``, as in ``mahony:kp=0.3,lowpass=20,mag=off``. A
key is a parameter of the filter or one of :data:`SETTINGS`; a shared name means the filter's. The order of processing
is fixed: calibration, notches, low-pass, sample rate, latency.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from attlog import estimators
from attlog.core.errors import UsageError, suggestion
from attlog.estimators.interface import Estimator, cut_by_comma, number_spelled
from attlog.estimators.registry import AP_EKF2, AP_EKF2_REFUSAL, FLOWN

# Numbers, word or file of a setting.
Value = tuple[float, ...] | str

NUMBERS_PATTERN = re.compile(r"\s*([-+0-9.eE]+(?:/[-+0-9.eE]+)*)\s*(.*?)\s*$")
# Above the highest sample rate of any IMU on the market, some 30 kHz.
MAX_FREQUENCY_HZ = 1e5
# Suffixes of an estimator file, and of an attitude computed elsewhere.
FILE_SUFFIXES = (".py", ".csv")
# Firmware filters that can be run again, by prefixes of their parameters' names.
FLOWN_PREFIXES = {
    "EKF2_": "px4_ekf2",
    "SENS_GPS0_": "px4_ekf2",
    "EK3_": "ap_ekf3",
    "GPS_DELAY_MS": "ap_ekf3",
    "GPS1_DELAY_MS": "ap_ekf3",
}
# A firmware parameter and its value.
PARAMETER_PATTERN = re.compile(r"[A-Z][A-Z0-9]*_[A-Z0-9_]+=")
# Number followed by text that may be its unit.
WITH_UNIT = re.compile(r"((?>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?))\s*(\S.*)")


@dataclass(frozen=True, slots=True)
class InputSetting:
    """Setting of the samples: ``sizes`` numbers separated by slashes, a word, or a file."""

    name: str
    unit: str
    meaning: str
    sizes: tuple[int, ...] = (1,)
    low: float = 0.0
    high: float = MAX_FREQUENCY_HZ
    words: tuple[str, ...] = ()

    @property
    def form(self) -> str:
        """Describe the form of a value, for messages and help."""
        if self.words:
            return "|".join(self.words)
        if not self.sizes:
            return "FILE"
        shapes = {1: "A", 2: "A/B", 3: "A/B/C"}
        return " or ".join(shapes[n] for n in self.sizes) + (f" [{self.unit}]" if self.unit else "")

    def check(self, value: object) -> Value:
        """Parse a text, number, truth value or list. UsageError states the expected form."""
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
            limits = f"from {self.low:g} to {self.high:g}"
            raise UsageError(f"{self.name}={value} is out of range; give {self.form} {limits}")
        return numbers

    def _numbers(self, value: object) -> tuple[float, ...]:
        wrong = UsageError(f"{self.name}={value!r}: of the wrong type; give {self.form}")
        values = value if isinstance(value, list | tuple) else [value]
        if all(isinstance(x, int | float) and not isinstance(x, bool) for x in values):
            return tuple(map(float, values))
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
            (3,),
            -2000.0,
            2000.0,
        ),
        InputSetting("acc_offset", "m/s^2", "subtracted from the accelerometer, body axes", (3,), -200.0, 200.0),
        InputSetting("mag_offset", "uT", "subtracted from the magnetometer, body axes", (3,), -1000.0, 1000.0),
        InputSetting("gyro_scale", "", "the gyro without its offset times this", (1, 3), 0.01, 100.0),
        InputSetting("acc_scale", "", "the accelerometer without its offset times this", (1, 3), 0.01, 100.0),
        InputSetting("mag_scale", "", "the magnetometer without its offset times this", (1, 3), 0.01, 100.0),
        InputSetting(
            "imu_rotation",
            "deg",
            "gyro and accelerometer turned by roll / pitch / yaw, after offset and scale",
            (3,),
            -360.0,
            360.0,
        ),
        InputSetting("mag_rotation", "deg", "the magnetometer turned by roll / pitch / yaw", (3,), -360.0, 360.0),
        InputSetting(
            "params", "", "firmware parameters of this file in place of the log's, for filters that take them", ()
        ),
    )
}


def numbers_text(value: Value) -> str:
    """Format a setting's value for the command line."""
    return value if isinstance(value, str) else "/".join(f"{x:g}" for x in value)


def setting_text(name: str, value: Value) -> str:
    """Format a setting for display: ``low-pass 20 Hz``, ``no magnetometer``."""
    if name == "mag":
        return "no magnetometer" if value == "off" else "magnetometer"
    words = name.replace("lowpass", "low-pass").replace("_", " ").replace("rpm", "RPM")
    unit = "" if isinstance(value, str) else SETTINGS[name].unit
    return f"{words} {numbers_text(value)} {unit}".rstrip()


@dataclass(frozen=True, slots=True)
class Configuration:
    """Filter ``row`` with settings ``before`` it.

    ``name`` names its row everywhere. ``text`` is its form on the command line.
    """

    name: str
    row: estimators.EstimatorSpec
    before: Mapping[str, Value] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """Return the configuration as :func:`parse_configuration` reads it."""
        settings = ",".join(f"{name}={numbers_text(value)}" for name, value in self.before.items())
        estimator = self.row.estimator
        own = self.row.name
        if estimator.origin != "attlog" and estimator.origin.lower().endswith(FILE_SUFFIXES):
            own = estimator.origin + own.removeprefix(estimator.name)
        return own + ((":" if not self.row.params else ",") + settings if settings else "")

    @property
    def is_flown(self) -> bool:
        """Return whether this is a firmware's own filter, run again on the log's inputs."""
        return self.row.estimator.name in FLOWN

    @property
    def params(self) -> Path | None:
        """Return the parameter file that replaces the log's firmware parameters."""
        return Path(str(self.before["params"])) if "params" in self.before else None

    def with_value(self, key: str, value: object, name: str | None = None) -> Configuration:
        """Return a copy with one parameter or setting changed. UsageError if invalid."""
        row, before = dict(self.row.params), dict(self.before)
        _assign(self.row.estimator, key, value, row, before)
        changed = replace(self, row=estimators.EstimatorSpec(self.row.estimator, self.row.preset, row), before=before)
        _check_exclusive(changed.before)
        return replace(changed, name=name or changed.text)


def flown_filter(text: str) -> str:
    """Return the firmware filter of a text such as ``EKF2_GPS_DELAY=250``, else ""."""
    return next((name for prefix, name in FLOWN_PREFIXES.items() if text.startswith(prefix) and "=" in text), "")


def refusal_of(text: str) -> str:
    """Return why a text such as ``EK2_MAG_M_NSE=0.2`` sets no parameter of a filter that is run again, else ""."""
    is_ap_ekf2 = text.startswith("EK2_") or text.partition(":")[0] == AP_EKF2
    if flown_filter(text) or not (is_ap_ekf2 or PARAMETER_PATTERN.match(text)):
        return ""
    if is_ap_ekf2:
        return AP_EKF2_REFUSAL
    return "no parameter of EKF2 or EKF3; a whole set is given by --params FILE"


def parse_configuration(text: str, name: str | None = None) -> Configuration:
    """Parse a configuration ``NAME[@PRESET][:key=value,...]``. UsageError lists every error.

    A text that begins with a parameter of a firmware's EKF means the flown filter.
    """
    text = text.strip()
    if flown := flown_filter(text):
        text = f"{flown}:{text}"
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
    """Build a configuration of a filter (``NAME[@PRESET]`` or file) from values by key.

    UsageError has one line per problem, including earlier ``problems``.
    """
    wrong = list(problems)
    try:
        row = estimators.parse(filter_name)
    except UsageError as error:
        raise UsageError(_located([*wrong, str(error)], where)) from None
    params: dict[str, Any] = dict(row.params)
    before: dict[str, Value] = {}
    for key, value in values.items():
        try:
            _assign(row.estimator, key, value, params, before)
        except UsageError as error:
            wrong.append(str(error))
    try:
        _check_exclusive(before)
        row = estimators.EstimatorSpec(row.estimator, row.preset, params)
        row.resolved()
    except UsageError as error:
        wrong.append(str(error))
    if wrong:
        raise UsageError(_located(wrong, where))
    made = Configuration(name or "", row, before)
    return replace(made, name=name or made.text)


def _assign(estimator: Estimator, key: str, value: object, params: dict[str, Any], before: dict[str, Value]) -> None:
    """Check a value and store it with the filter's parameters or its settings."""
    own = any(p.name == key for p in estimator.parameters)
    if not own and key in SETTINGS:
        before[key] = SETTINGS[key].check(value)
        return
    if not own and estimator.name not in FLOWN:
        hint = suggestion(key, [*(p.name for p in estimator.parameters), *SETTINGS])
        raise UsageError(f"{estimator.name} has no parameter {key}, and no setting before a filter is called so{hint}")
    params[estimator.parameter(key).name] = check_parameter(estimator, key, value)


def check_parameter(estimator: Estimator, key: str, value: object) -> float | str:
    """Parse a parameter's value, with or without its unit. UsageError otherwise."""
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


def labels(configurations: Sequence[Configuration]) -> dict[str, str]:
    """Return short names for sentences, without the part common to all configurations.

    ``mahony:kp=0.3`` and ``mahony:kp=0.6`` become ``kp 0.3`` and ``kp 0.6``. Names given by the user are kept.
    """
    one_filter = len({(c.row.estimator.origin, c.row.estimator.name, c.row.preset) for c in configurations}) == 1
    parts = {c.name: _parts(c) or ["as flown"] * c.is_flown for c in configurations}
    without_head = one_filter and len(parts) > 1
    shared = set.intersection(*(set(p) for p in parts.values())) if without_head else set()
    found = {}
    for c in configurations:
        head = c.row.estimator.name + (f"@{c.row.preset}" if c.row.preset else "")
        own = " ".join(p for p in parts[c.name] if p not in shared)
        text = own if without_head else f"{head} {own}".strip()
        found[c.name] = c.name if c.name != c.text else text or head
    texts = list(found.values())
    return {key: text if texts.count(text) == 1 else key for key, text in found.items()}


def _parts(c: Configuration) -> list[str]:
    gains = [f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}" for k, v in c.row.params.items()]
    return gains + [setting_text(name, value) for name, value in c.before.items()]


def _check_exclusive(before: Mapping[str, Value]) -> None:
    """Raise UsageError for settings that exclude each other."""
    if "rate" in before and "pick" in before:
        raise UsageError("rate and pick exclude each other: rate takes means, pick drops samples")
    for sensor in ("gyro", "acc"):
        if "lowpass" in before and f"{sensor}_lowpass" in before:
            raise UsageError(f"lowpass and {sensor}_lowpass exclude each other: lowpass acts on both sensors")
    off = [name for name in before if name.startswith("mag_")] if before.get("mag") == "off" else []
    if off:
        raise UsageError(f"{', '.join(off)}: there is no magnetometer with mag=off")


def _located(problems: Iterable[str], where: str) -> str:
    return "\n".join(f"{where}: {p}" if where and not p.startswith(where) else p for p in problems)
