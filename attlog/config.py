"""The resolved configuration: the same names as the options, read from TOML and written back.

``Config.load`` refuses unknown keys with a suggestion and reports all problems of a
file at once. The resolved configuration stands in every result and can be fed back.
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from attlog import estimators
from attlog.errors import LogUnreadable, UsageError


class Config(BaseModel):
    """What an analysis does. Defaults serve; options are for experts.

    ``estimators``: row specifications (``default``, ``all``, ``NAME[@PRESET][:k=v,...]``,
    ``FILE.py``). ``imu``, ``mag``: instance to replay, None for the choice of the log,
    ``"all"`` / ``"none"``. ``window``: the window that table and verdicts show beside the
    standard ones. ``params``: a parameter file for what the log does not tell. Times are
    seconds on the log's clock (0 = first IMU sample).
    """

    model_config = ConfigDict(extra="forbid", validate_assignment=True)

    estimators: list[str] = Field(default_factory=lambda: ["default"])
    imu: int | Literal["all"] | None = None
    mag: int | Literal["none"] | None = None
    reference: str = "auto"
    window: str | None = None
    score_from: float | None = Field(default=None, ge=0)
    clock: Literal["sample", "publication"] = "sample"
    declination: float | Literal["auto", "model", "param"] = "auto"
    trim: bool = True
    input_delay: float | Literal["auto", "off"] = "auto"
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
        if value in ("auto", "truth", "onboard", "none") or value.startswith("onboard:"):
            return value
        raise ValueError("use auto, truth, onboard, onboard:NAME (such as onboard:AHR2) or none")

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
        """A configuration from a TOML file, overridden by ``options``.

        LogUnreadable if the file cannot be opened, UsageError for everything wrong in it.
        """
        try:
            values = tomllib.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise LogUnreadable(f"{path}: cannot be read ({error.strerror})") from error
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise UsageError(f"{path}: not valid TOML: {error}") from error
        return cls.build(values | options, origin=str(path))

    def resolved(self) -> dict[str, Any]:
        """Plain values for the result and for TOML; keys that are None are left out."""
        return self.model_dump(exclude_none=True)

    def to_toml(self) -> str:
        """The configuration as TOML text that ``load`` accepts."""
        import tomli_w

        return tomli_w.dumps(self.resolved())


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
