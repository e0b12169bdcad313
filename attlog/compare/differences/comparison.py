"""The result of a comparison: one JSON document, its schema versioned, read back by ``Comparison.load``."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from attlog.base.errors import UsageError
from attlog.base.files.settings_file import bytes_of
from attlog.base.limits import MAX_RESULT_BYTES
from attlog.base.plain import plain
from attlog.base.validation import checked
from attlog.compare.differences.paired import Direction, Scale
from attlog.compare.differences.pooled import PooledMean

SCHEMA = "attlog-comparison/2"


@dataclass(slots=True)
class ConfigurationSummary:
    """A configuration: ``name`` as its rows are called, ``label`` in sentences, ``text`` for the command line.

    ``parameters`` are those set by hand, ``before`` what comes before the filter.
    """

    name: str
    label: str
    text: str
    parameters: dict[str, str] = field(default_factory=dict)
    before: dict[str, str] = field(default_factory=dict)


@dataclass(slots=True)
class LogLine:
    """One log: what it is and was compared with, or why it could not be used (``code`` as of the command line).

    ``same_as`` names the log of the same flight that counts in its place where logs are pooled.
    """

    name: str
    path: str
    sha256: str = ""
    vehicle: str = ""
    firmware: str = ""
    seconds: float | None = None
    reference: str = ""
    code: int = 0
    reason: str = ""
    same_as: str = ""


@dataclass(slots=True)
class ConfigurationAnswer:
    """A configuration on a log: the answer as ``attlog analyze`` gives it, or the reason for none."""

    value: float | None
    ci95: tuple[float, float] | None = None
    n: int = 0
    window: str = ""
    status: str = "ok"
    reason: str = ""


@dataclass(slots=True)
class LogDifference:
    """A configuration beside the first on one log, on ``n`` common units of evidence.

    ``value`` is the ratio or the difference of sizes (below one, below zero: nearer to perfect), ``first``
    and ``second`` what it is of; None with the ``reason``. ``error`` is the standard error of the logarithm of
    the ratio, or of the difference; ``floor`` the size below which it counts as none.
    """

    log: str
    value: float | None
    ci95: tuple[float, float] | None = None
    p: float | None = None
    n: int = 0
    first: float | None = None
    second: float | None = None
    error: float | None = None
    floor: float = 0.0
    direction: Direction = "not significant"
    window: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class PooledDifference(PooledMean):
    """The differences of all logs that have a value as one; of ratios ``value`` and ``ci95`` are ratios again.

    ``tau`` stays on the scale of their logarithm. ``floor``: the size below which it counts as none.
    """

    floor: float
    direction: Direction


@dataclass(slots=True)
class Contrast:
    """One configuration beside the first: log by log, and over all of them (None where no log has a value)."""

    configuration: str
    logs: list[LogDifference] = field(default_factory=list)
    over: PooledDifference | None = None


@dataclass(slots=True)
class Question:
    """One metric in one kind of window (of several names the first in which a log has a value)."""

    id: str
    metric: str
    windows: list[str]
    title: str
    unit: str
    better: str
    scale: Scale
    main: bool
    cells: dict[str, dict[str, ConfigurationAnswer]] = field(default_factory=dict)
    """log -> configuration -> cell"""
    contrasts: list[Contrast] = field(default_factory=list)


@dataclass(slots=True)
class ConfigurationSentences:
    """What a configuration is worth beside the first, in sentences: the lead, and one for each further question."""

    configuration: str
    lead: str
    more: list[str] = field(default_factory=list)


@dataclass(slots=True)
class Comparison:
    """Everything ``attlog compare`` found out. The first of ``configurations`` is what the others are compared with.

    ``unanswered``: question id -> why no log answers it.
    """

    attlog: dict[str, str]
    command: str
    config: dict[str, Any]
    configurations: list[ConfigurationSummary] = field(default_factory=list)
    logs: list[LogLine] = field(default_factory=list)
    questions: list[Question] = field(default_factory=list)
    unanswered: dict[str, str] = field(default_factory=dict)
    verdicts: list[ConfigurationSentences] = field(default_factory=list)
    definitions: dict[str, str] = field(default_factory=dict)
    schema: str = SCHEMA
    __pydantic_config__: ClassVar[dict[str, Any]] = {"strict": True, "extra": "forbid"}

    def to_json(self, path: str | Path | None = None) -> str:
        """The JSON text; also written to ``path`` (atomically) where given. OutputError if it cannot be."""
        text = json.dumps(plain(self), ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"
        text = text.encode("utf-8", "surrogatepass").decode("utf-8", "replace")
        if path is not None:
            from attlog.base.files.output import write_atomic

            write_atomic(Path(path), text)
        return text

    @classmethod
    def load(cls, path: str | Path) -> Comparison:
        """What ``to_json`` wrote. LogUnreadable if the file cannot be opened, UsageError for what is no comparison."""
        try:
            document = json.loads(bytes_of(Path(path), MAX_RESULT_BYTES).decode("utf-8"))
        except (ValueError, RecursionError) as error:
            raise UsageError(f"{path}: not a comparison of attlog: no valid JSON: {error}") from None
        schema = document.get("schema") if isinstance(document, dict) else None
        if schema != SCHEMA:
            raise UsageError(f"{path}: not a comparison of attlog: its schema is {schema!r}, not {SCHEMA}")
        return checked(cls, document, f"{path}: not a comparison of attlog", strict=True)
