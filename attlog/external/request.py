"""Parse ``--truth``: a file, a folder or a topic, with ``:key=value`` behind it."""

from __future__ import annotations

import difflib
import math
import os
import re
from dataclasses import dataclass
from pathlib import Path

from attlog.core.errors import LogUnreadable, UsageError

KEYS = ("offset", "north", "topic")
# Suffixes of trajectory files; another name with a dot in it is taken for a file, too.
SUFFIXES = (".csv", ".txt", ".tum", ".tsv")
YES, NO = ("true", "yes", "1"), ("false", "no", "0")


@dataclass(frozen=True, slots=True)
class TruthRequest:
    """Parsed value of ``--truth``: ``name`` (file, folder or topic) and settings.

    ``offset``: approximate clock offset in s, None if unknown. ``north``: the first earth axis of the file is true
    north. ``topic``: pose or attitude within a log or bag.
    """

    name: str
    offset: float | None = None
    north: bool = False
    topic: str = ""

    @property
    def path(self) -> Path | None:
        """The file or folder named, None for a topic."""
        return Path(self.name) if os.path.exists(self.name) else None


def parse_truth(given: str) -> TruthRequest:
    """Parse a value of ``--truth``. UsageError for an unknown setting or invalid value."""
    name, keys = _split(given)
    values: dict[str, str] = {}
    for pair in filter(None, keys.split(",")):
        key, equals, value = pair.partition("=")
        if key not in KEYS or not equals:
            near = difflib.get_close_matches(key, KEYS, 1)
            hint = f"did you mean {near[0]}=?" if near else f"use {', '.join(KEYS)}"
            raise UsageError(f"--truth {given}: {pair!r} is no setting of a truth; {hint}")
        if key in values:
            raise UsageError(f"--truth {given}: {key} stands there twice")
        values[key] = value
    found = TruthRequest(
        name, _offset_seconds(given, values.get("offset")), _flag(given, values), values.get("topic", "")
    )
    if not name:
        raise UsageError(f"--truth {given!r}: name a file, a folder or a topic of the log")
    return found


def check_truth(given: str) -> None:
    """Check a value of ``--truth``. UsageError as :func:`parse_truth`, LogUnreadable for a missing file."""
    found = parse_truth(given)
    if found.path is None and _meant_as_file(found.name):
        raise LogUnreadable(f"{found.name}: no such file")


def _split(given: str) -> tuple[str, str]:
    """Split name and settings at the last colon before a key; names may contain colons."""
    found = re.search(r":([a-z]+=[^:]*)$", given)
    if os.path.exists(given) or found is None:
        return given, ""
    return given[: found.start()], found[1]


def _offset_seconds(given: str, text: str | None) -> float | None:
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(f"--truth {given}: offset {text!r} is no number of seconds")
    return value


def _flag(given: str, values: dict[str, str]) -> bool:
    text = values.get("north", "false").lower()
    if text not in YES + NO:
        raise UsageError(f"--truth {given}: north {text!r}: use true or false")
    return text in YES


def _meant_as_file(name: str) -> bool:
    """Return whether a name looks like a file: topics contain slashes, but no dots except ``name.N``."""
    last = re.split(r"[/\\]", name)[-1]
    return "." in last and not re.fullmatch(r"\w+\.\d+", last)
