"""The resolved configuration: the same names as the options, read from TOML and written back.

``Config.load`` refuses unknown keys with a suggestion and reports all problems of a
file at once. The resolved configuration stands in every result and can be fed back.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from attlog import estimators
from attlog.errors import UsageError
from attlog.settings_file import text_of, toml_of


class Config(BaseModel):
    """What an analysis does. Defaults serve; options are for experts.

    ``estimators``: row specifications (``default``, ``all``, ``NAME[@PRESET][:k=v,...]``,
    ``FILE.py``). ``imu``, ``mag``: instance to replay, None for the choice of the log,
    ``"all"`` / ``"none"``. ``window``: the window that table and verdicts show beside the
    standard ones. ``gyro_bias``: what is taken off the gyro for every filter alike: its mean over the
    rest before take-off, nothing, or the onboard estimator's own.
    ``params``: a parameter file for what the log does not tell. Times are seconds
    on the log's clock (0 = first IMU sample).
    """

    model_config = ConfigDict(extra="forbid", validate_assignment=True)

    estimators: list[str] = Field(default_factory=lambda: ["default"])
    imu: int | Literal["all"] | None = None
    mag: int | Literal["none"] | None = None
    reference: str = "auto"
    window: str | None = None
    score_from: Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)] | None = None
    clock: Literal["sample", "publication"] = "sample"
    declination: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)] | Literal["auto", "model", "param"] = (
        "auto"
    )
    trim: bool = True
    input_delay: Annotated[float, Field(ge=-1000, le=1000, allow_inf_nan=False)] | Literal["auto", "off"] = "auto"
    gyro_bias: Literal["rest", "none", "onboard"] = "rest"
    boot: int | None = Field(default=None, ge=0)
    system: int | None = Field(default=None, ge=0, le=255)
    params: str | None = None

    @field_validator("estimators", mode="before")
    @classmethod
    def _split(cls, value: Any) -> Any:
        return estimators.items(value) if isinstance(value, str) else value

    @field_validator("reference")
    @classmethod
    def _known_reference(cls, value: str) -> str:
        if value in ("auto", "truth", "smoother", "onboard", "none") or value.startswith("onboard:"):
            return value
        raise ValueError("use auto, truth, smoother, onboard, onboard:NAME (such as onboard:AHR2) or none")

    @classmethod
    def of(cls, config: Config | Mapping[str, Any] | None) -> Config:
        """A configuration from itself, a mapping with the same names, or None for the defaults. UsageError as below."""
        if isinstance(config, Config):
            return config
        return cls.build(dict(config or {}), origin="config")

    @classmethod
    def build(cls, values: dict[str, Any], origin: str = "options") -> Config:
        """A configuration from plain values. UsageError lists every problem, with suggestions for unknown names."""
        try:
            return cls(**values)
        except ValidationError as error:
            raise UsageError(
                "\n".join(f"{origin}: {line}" for line in _explain(error, list(cls.model_fields)))
            ) from None

    @classmethod
    def load(cls, path: Path, **options: Any) -> Config:
        """A configuration from a TOML or JSON file, overridden by ``options``.

        A file that begins like a JSON object is one: the names at its top, or a result of
        ``attlog analyze``, of which the configuration it was made with is taken.
        LogUnreadable if the file cannot be opened, UsageError for everything wrong in it.
        """
        text = text_of(path)
        values = _from_json(text, path) if text.lstrip().startswith("{") else toml_of(text, path)
        return cls.build(values | options, origin=str(path))

    def resolved(self) -> dict[str, Any]:
        """Plain values for the result and for TOML; keys that are None are left out."""
        return self.model_dump(exclude_none=True)

    def to_toml(self) -> str:
        """The configuration as TOML text that ``load`` accepts."""
        import tomli_w

        return tomli_w.dumps(self.resolved())


def _from_json(text: str, path: Path) -> dict[str, Any]:
    """The names of a configuration: of the object itself, or of the result that it is."""
    try:
        document: dict[str, Any] = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{path}: not valid JSON: {error}") from error
    if "schema" not in document:
        return document
    if not isinstance(document.get("config"), dict):
        raise UsageError(f"{path}: holds no configuration: it has a schema but no object named config")
    return dict(document["config"])


def _explain(error: ValidationError, known: list[str]) -> list[str]:
    """One line per thing that is wrong; a union of types reports once."""
    lines: dict[str, str] = {}
    for item in error.errors():
        name = str(item["loc"][0]) if item["loc"] else ""
        if item["type"] == "extra_forbidden":
            close = difflib.get_close_matches(name, known, 1)
            hint = f"; did you mean {close[0]!r}?" if close else f"; known are {', '.join(known)}"
            lines[name] = f"unknown key {name!r}{hint}"
        else:
            message = item["msg"].removeprefix("Value error, ")
            lines[name] = (
                f"{lines[name]}, or: {message}" if name in lines else f"{name}: {message} (got {item['input']!r})"
            )
    return list(lines.values())
