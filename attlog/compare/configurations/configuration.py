"""What a configuration is: a filter with its gains, and what comes before it.

On the command line ``NAME[@PRESET][:key=value,...]`` or ``FILE.py[...]``; a key is a parameter of
the filter or one of :data:`attlog.compare.configurations.settings.SETTINGS`, as in
``mahony:kp=0.3,lowpass=20,mag=off``.
Where a filter has a parameter of the same name as a setting the key is the filter's.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

from attlog import estimators
from attlog.base.errors import UsageError, suggestion
from attlog.compare.configurations.settings import SETTINGS, Value, setting_text, written
from attlog.estimators.base import Estimator
from attlog.estimators.spelling import cut_by_comma, number_spelled

FILES = (".py", ".csv")
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
        settings = ",".join(written(name, value) for name, value in self.before.items())
        estimator = self.row.estimator
        own = self.row.name
        if estimator.origin != "attlog" and estimator.origin.lower().endswith(FILES):
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
            row[key] = checked(self.row.estimator, key, value)
        elif key in SETTINGS:
            before[key] = SETTINGS[key].check(value)
        else:
            raise unknown(self.row.estimator, key)
        changed = replace(self, row=estimators.EstimatorSpec(self.row.estimator, self.row.preset, row), before=before)
        _together(changed.before)
        return replace(changed, name=name or changed.text)


def parse(text: str, name: str | None = None) -> Configuration:
    """The configuration that ``NAME[@PRESET][:key=value,...]`` names; UsageError tells everything wrong with it."""
    text = text.strip()
    begin = next((text.lower().find(f) + len(f) for f in FILES if f in text.lower()), 0)
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
    return build(text[:begin] + head, values, name, problems, where=text)


def build(
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
        raise UsageError("\n".join(_placed([*found, str(error)], where))) from None
    params, before = dict(row.params), {}
    for key, value in values.items():
        try:
            if is_parameter(row.estimator, key):
                params[key] = checked(row.estimator, key, value)
            elif key in SETTINGS:
                before[key] = SETTINGS[key].check(value)
            else:
                raise unknown(row.estimator, key)
        except UsageError as error:
            found.append(str(error))
    try:
        _together(before)
        row = estimators.EstimatorSpec(row.estimator, row.preset, params)
        row.resolved()
    except UsageError as error:
        found.append(str(error))
    if found:
        raise UsageError("\n".join(_placed(found, where)))
    made = Configuration(name or "", row, before)
    return replace(made, name=name or made.text)


def checked(estimator: Estimator, key: str, value: object) -> float | str:
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


def unknown(estimator: Estimator, key: str) -> UsageError:
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


def _together(before: Mapping[str, Value]) -> None:
    """UsageError for settings that exclude each other."""
    if "rate" in before and "pick" in before:
        raise UsageError("rate and pick exclude each other: rate takes means, pick drops samples")
    for sensor in ("gyro", "acc"):
        if "lowpass" in before and f"{sensor}_lowpass" in before:
            raise UsageError(f"lowpass and {sensor}_lowpass exclude each other: lowpass acts on both sensors")
    off = [name for name in before if name.startswith("mag_")] if before.get("mag") == "off" else []
    if off:
        raise UsageError(f"{', '.join(off)}: there is no magnetometer with mag=off")


def _placed(problems: Iterable[str], where: str) -> list[str]:
    return [f"{where}: {p}" if where and not p.startswith(where) else p for p in problems]
