"""The resolved configuration: the same names as the options, read from TOML and written back.

``Config.load`` refuses unknown keys with a suggestion and reports all problems of a
file at once. The resolved configuration stands in every result and can be fed back.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from attlog import estimators
from attlog.base.errors import UsageError, suggestion
from attlog.base.files.settings_file import text_of, toml_of
from attlog.base.setting_values import Kind, either, number, or_none, text, truth, whole, words


@dataclass
class Config:
    """What an analysis does. Defaults serve; options are for experts.

    ``estimators``: row specifications (``default``, ``all``, ``NAME[@PRESET][:k=v,...]``,
    ``FILE.py``). ``imu``, ``mag``: instance to replay, None for the choice of the log,
    ``"all"`` / ``"none"``. ``window``: the window that table and verdicts show beside the
    standard ones. ``gyro_bias``: what is taken off the gyro for every filter alike: its mean over the
    rest before take-off, nothing, or the onboard estimator's own.
    ``params``: a parameter file for what the log does not tell. Times are seconds
    on the log's clock (0 = first IMU sample). Whatever is set is checked: UsageError.
    """

    estimators: list[str] = field(default_factory=lambda: ["default"])
    imu: int | Literal["all"] | None = None
    mag: int | Literal["none"] | None = None
    reference: str = "auto"
    window: str | None = None
    score_from: float | None = None
    clock: Literal["sample", "publication"] = "sample"
    declination: float | Literal["auto", "model", "param"] = "auto"
    trim: bool = True
    input_delay: float | Literal["auto", "off"] = "auto"
    gyro_bias: Literal["rest", "none", "onboard"] = "rest"
    boot: int | None = None
    system: int | None = None
    params: str | None = None

    def __setattr__(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, _checked(name, value))

    @classmethod
    def of(cls, config: Config | Mapping[str, Any] | None) -> Config:
        """A configuration from itself, a mapping with the same names, or None for the defaults. UsageError as below."""
        if isinstance(config, Config):
            return config
        return cls.build(dict(config or {}), origin="config")

    @classmethod
    def build(cls, values: dict[str, Any], origin: str = "options") -> Config:
        """A configuration from plain values. UsageError lists every problem, with suggestions for unknown names."""
        lines = []
        for name, value in values.items():
            try:
                _checked(name, value)
            except UsageError as wrong:
                lines.append(f"{origin}: {wrong}")
        if lines:
            raise UsageError("\n".join(lines))
        return cls(**values)

    @classmethod
    def load(cls, path: Path, **options: Any) -> Config:
        """A configuration from a TOML or JSON file, overridden by ``options``.

        A file that begins like a JSON object is one: the names at its top, or a result of
        ``attlog analyze``, of which the configuration it was made with is taken: filter files that a result
        names run only where ``options`` name ``estimators``, because results come from others.
        LogUnreadable if the file cannot be opened, UsageError for everything wrong in it.
        """
        text = text_of(path)
        values = _from_json(text, path, options) if text.lstrip().startswith("{") else toml_of(text, path)
        return cls.build(values | options, origin=str(path))

    def resolved(self) -> dict[str, Any]:
        """Plain values for the result and for TOML; keys that are None are left out."""
        return {name: value for name, value in asdict(self).items() if value is not None}


def _rows(value: Any) -> list[str]:
    if isinstance(value, str):
        return estimators.items(value)
    if not isinstance(value, (list, tuple)) or not all(isinstance(item, str) for item in value):
        raise ValueError
    return list(value)


def _reference(value: Any) -> str:
    if not isinstance(value, str) or not (
        value in ("auto", "truth", "smoother", "onboard", "none") or value.startswith("onboard:")
    ):
        raise ValueError
    return value


KINDS = {
    "estimators": Kind(("a list of text",), _rows),
    "imu": or_none(either(whole(), words("all"))),
    "mag": or_none(either(whole(), words("none"))),
    "reference": Kind(
        ("auto", "truth", "smoother", "onboard", "onboard:NAME (such as onboard:AHR2)", "none"), _reference
    ),
    "window": or_none(text()),
    "score_from": or_none(number(0.0, 1e6)),
    "clock": words("sample", "publication"),
    "declination": either(number(-180.0, 180.0), words("auto", "model", "param")),
    "trim": truth(),
    "input_delay": either(number(-1000.0, 1000.0), words("auto", "off")),
    "gyro_bias": words("rest", "none", "onboard"),
    "boot": or_none(whole(0)),
    "system": or_none(whole(0, 255)),
    "params": or_none(text()),
}
"""What each key may be."""


def _checked(name: str, value: Any) -> Any:
    """The value as the configuration holds it. UsageError tells what would do."""
    if name not in KINDS:
        raise UsageError(f"unknown key {name!r}{suggestion(str(name), KINDS)}")
    try:
        return KINDS[name].checked(value)
    except ValueError as error:
        raise UsageError(f"{name}: {error}") from None


def _from_json(text: str, path: Path, options: Mapping[str, Any]) -> dict[str, Any]:
    """The names of a configuration: of the object itself, or of the result that it is.

    UsageError for what is none, and for a result whose filters are code that nobody has named here.
    """
    try:
        document: dict[str, Any] = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path}: not valid JSON: {error}") from error
    if "schema" not in document:
        return document
    if not isinstance(document.get("config"), dict):
        raise UsageError(f"{path}: holds no configuration: it has a schema but no object named config")
    found = dict(document["config"])
    rows = [] if "estimators" in options else found.get("estimators", [])
    code = [item for item in rows if isinstance(item, str) and ".py" in item.lower()] if isinstance(rows, list) else []
    if code:
        raise UsageError(
            f"{path}: is a result that ran a filter from a file, {', '.join(code)}; it is not run because a result "
            f"names it. If you trust it: --estimators {shlex.quote(','.join(map(str, rows)))}"
        )
    return found
