"""What the autopilot said, and which of it a pilot looks for first."""

from __future__ import annotations

import re

from attlog.result import Result

ALARM = re.compile(r"fail[- ]?safe|crash|emergency|lost|terminat|\bland(ing)? now\b|parachute", re.IGNORECASE)
"""Texts that a pilot looks for first whatever their level."""

LEVELS = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")
CRITICAL, WARNING = 2, 4


def messages(result: Result) -> list[tuple[float, int, str]]:
    """The autopilot's messages in time order: (t, level, text)."""
    found = (result.log.get("timeline") or {}).get("texts") or []
    return sorted(((float(t), int(level), str(text)) for t, level, text in found), key=lambda m: m[0])


def alarming(level: int, text: str) -> bool:
    """Whether a message is one that a pilot looks for first."""
    return level <= CRITICAL or bool(ALARM.search(text))


def level_name(level: int) -> str:
    """A syslog level in words."""
    return LEVELS[level] if 0 <= level < len(LEVELS) else str(level)
