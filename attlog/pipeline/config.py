"""Analysis configuration: option names, read from TOML or JSON, kept in every result."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypedDict

from attlog import estimators
from attlog.core.errors import UsageError
from attlog.core.files import parse_toml, read_settings_text
from attlog.core.settings import NumberRange, ParsedBy, validated

# Filters and attitudes from files, in any case and with any settings behind them.
NAMES_A_FILE = re.compile(r"\.(py|csv)", re.IGNORECASE)
REFERENCES = ("auto", "truth", "smoother", "onboard", "none")


def reference_of(value: Any) -> str:
    """Validate the name of a reference. ValueError for an unknown one."""
    if isinstance(value, str) and (value in REFERENCES or value.startswith("onboard:")):
        return value
    raise ValueError("must be auto, truth, smoother, onboard, onboard:NAME (such as onboard:AHR2) or none")


def gyro_bias_of(value: Any) -> str:
    """Validate the source of the gyro bias to subtract. ValueError for an unknown one."""
    if value in ("rest", "none", "onboard"):
        return str(value)
    raise ValueError("must be rest, none or onboard")


def _rows(value: Any) -> Any:
    return estimators.items(value) if isinstance(value, str) else value


class Options(TypedDict, total=False):
    """Options of :class:`Config` as keywords of a function."""

    estimators: list[str] | str
    imu: int | Literal["all"] | None
    mag: int | Literal["none"] | None
    reference: str
    truth: str | None
    window: str | None
    score_from: float | None
    clock: Literal["sample", "publication"]
    declination: float | Literal["auto", "model", "param"]
    trim: bool
    input_delay: float | Literal["auto", "off"]
    gyro_bias: Literal["rest", "none", "onboard"]
    boot: int | None
    system: int | None
    params: str | None
    signals: Literal["none", "standard", "all"]


@dataclass
class Config:
    """Configuration of an analysis, validated on assignment. UsageError for a wrong value.

    ``estimators``: row specifications (``default``, ``all``, ``NAME[@PRESET][:k=v,...]``, ``FILE.py``). ``imu``,
    ``mag``: instance to replay; None for the log's own choice, ``"all"`` / ``"none"``. ``window``: shown in table and
    verdicts beside the standard ones. ``gyro_bias``: subtracted from the gyro for every filter: its mean over the rest
    before take-off, nothing, or the onboard bias. ``params``: a parameter file for values that are not logged.
    ``signals``: fields that the page can draw, ``standard`` those of the messages that people look at.
    ``truth``: a trajectory, another log, a folder of them or a message of the log (:mod:`attlog.external.attitude`).
    Times are s on the log's clock, 0 at the first IMU sample.
    """

    estimators: Annotated[list[str], ParsedBy(_rows)] = field(default_factory=lambda: ["default"])
    imu: Annotated[int, NumberRange()] | Literal["all"] | None = None
    mag: Annotated[int, NumberRange()] | Literal["none"] | None = None
    reference: Annotated[str, ParsedBy(reference_of)] = "auto"
    truth: str | None = None
    window: str | None = None
    score_from: Annotated[float, NumberRange(0.0, 1e6)] | None = None
    clock: Literal["sample", "publication"] = "sample"
    declination: Annotated[float, NumberRange(-180.0, 180.0)] | Literal["auto", "model", "param"] = "auto"
    trim: bool = True
    input_delay: Annotated[float, NumberRange(-1000.0, 1000.0)] | Literal["auto", "off"] = "auto"
    gyro_bias: Annotated[Literal["rest", "none", "onboard"], ParsedBy(gyro_bias_of)] = "rest"
    boot: Annotated[int, NumberRange(0)] | None = None
    system: Annotated[int, NumberRange(0, 255)] | None = None
    params: str | None = None
    signals: Literal["none", "standard", "all"] = "standard"
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    def __setattr__(self, name: str, value: Any) -> None:
        if not _is_default(name, value):
            value = getattr(Config.build({name: value}), name)
        object.__setattr__(self, name, value)

    @classmethod
    def of(cls, config: Config | Mapping[str, Any] | None, options: Mapping[str, Any] | None = None) -> Config:
        """Convert a mapping of option names to a configuration; None gives the defaults.

        ``options`` replace those of the configuration, which without any is returned unchanged. UsageError as of
        :meth:`build`.
        """
        if isinstance(config, Config) and not options:
            return config
        if config is not None and not isinstance(config, Config | Mapping):
            raise UsageError(f"config must be attlog.Config or a mapping of options, not {type(config).__name__}")
        given = config.resolved() if isinstance(config, Config) else dict(config or {})
        given |= {name: _plain_path(value) for name, value in (options or {}).items()}
        return cls.build(given, origin="config") if given else cls()

    @classmethod
    def build(cls, values: dict[str, Any], origin: str = "") -> Config:
        """Build a configuration from plain values.

        UsageError lists every problem, with suggestions for misspelt names.
        """
        return validated(cls, values, origin)

    @classmethod
    def trusted(cls, values: Mapping[str, Any]) -> Config:
        """Build a configuration without validation, from values already checked."""
        config = cls()
        config.__dict__.update(values)
        return config

    @classmethod
    def load(cls, path: Path, **options: Any) -> Config:
        """Read a configuration from a TOML or JSON file, overridden by ``options``.

        A JSON file is an object of option names, or a result of ``attlog analyze`` with its configuration. Files named
        in a result (filters, truth, parameters) are opened only where ``options`` name them: results come from others.
        LogUnreadable if the file cannot be opened, UsageError for everything wrong in it.
        """
        text = read_settings_text(path)
        values, of_others = _from_json(text, path) if text.lstrip().startswith("{") else (parse_toml(text, path), False)
        config = cls.build(values | options, origin=str(path))
        if of_others:
            _refuse_files(config, path, options)
        return config

    @property
    def truth_place(self) -> str:
        """File, folder or topic of the truth without its settings; empty without one."""
        if self.truth is None:
            return ""
        from attlog.external.read import parse_truth

        return parse_truth(self.truth).name

    def resolved(self) -> dict[str, Any]:
        """Plain values for the result and for TOML, without None."""
        return {name: value for name, value in asdict(self).items() if value is not None}


DEFAULTS: dict[str, Any] = {f.name: f.default for f in fields(Config)} | {"estimators": ["default"]}


def _plain_path(value: Any) -> Any:
    """Return a path, or each path of a list, as text; others unchanged."""
    if isinstance(value, list | tuple):
        return [_plain_path(one) for one in value]
    return str(value) if isinstance(value, Path) else value


def _is_default(name: str, value: Any) -> bool:
    """Compare a value with the default of its option."""
    return name in DEFAULTS and type(value) is type(DEFAULTS[name]) and value == DEFAULTS[name]


def _from_json(text: str, path: Path) -> tuple[dict[str, Any], bool]:
    """Return configuration options of their own JSON object or of a result, and whether it is a result.

    UsageError for other JSON.
    """
    try:
        document: dict[str, Any] = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path}: not valid JSON: {error}") from error
    if "schema" not in document:
        return document, False
    if not isinstance(document.get("config"), dict):
        raise UsageError(f"{path}: holds no configuration: it has a schema but no object named config")
    return dict(document["config"]), True


def _refuse_files(config: Config, path: Path, options: Mapping[str, Any]) -> None:
    """Raise UsageError if the configuration of a result names a file that ``options`` do not name."""
    if "estimators" not in options and any(NAMES_A_FILE.search(item) for item in config.estimators):
        raise UsageError(
            f"{path}: is a result that ran a filter from a file, {', '.join(config.estimators)}; it is not run because "
            f"a result names it. If you trust it: --estimators {shlex.quote(','.join(config.estimators))}"
        )
    for name, value in (("truth", config.truth), ("params", config.params)):
        if name not in options and value is not None and (name == "params" or _is_a_file(value)):
            raise UsageError(
                f"{path}: is a result that used a file, {value}; it is not read because a result names it. If you "
                f"trust it: --{name} {shlex.quote(value)}"
            )


def _is_a_file(truth: str) -> bool:
    from attlog.external.read import meant_as_file, parse_truth

    found = parse_truth(truth)
    return found.path is not None or meant_as_file(found.name)
