"""What stands beside the data in a ULog: information, parameters, texts and what the logger lost."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from attlog.formats.base import ParamChange, Text
from attlog.formats.ulog.records import info_value, keyed, parameter_value, text
from attlog.limits import MAX_PARAM_CHANGES, MAX_TEXT_LENGTH, MAX_TEXTS


class Content:
    """Collects the records that are neither data nor definitions, in file order.

    ``time_before(position)`` is the time (us) that a parameter changed at, None or 0 where no data stands before.
    """

    def __init__(self, time_before: Callable[[int], int | None]) -> None:
        self.info: dict[str, Any] = {}
        self.params: list[ParamChange] = []
        self.texts: list[Text] = []
        self.dropouts_ms: list[int] = []
        self.in_data = False
        self._start_us = 0
        self._time_before = time_before

    def start(self, version: int, start_us: int) -> None:
        """A file header with the logger's version and start time (us); what is known of the file is the first one's."""
        self._start_us, self.in_data = start_us, False
        self.info.setdefault("ulog_version", version)
        self.info.setdefault("ulog_start_us", start_us)

    def take(self, kind: int, payload: bytes, position: int) -> None:
        """One record. IndexError or struct.error if it is too short for its type."""
        match chr(kind):
            case "I":
                key_type, name, raw = keyed(payload)
                self.info[name] = info_value(key_type, raw)
            case "M":
                self._take_info_part(payload)
            case "P" | "Q":
                self._take_parameter(kind, payload, position)
            case "L" | "C":
                self._take_text(kind, payload, position)
            case "O":
                self.dropouts_ms.append(struct.unpack_from("<H", payload)[0])

    def _take_info_part(self, payload: bytes) -> None:
        key_type, name, raw = keyed(payload[1:])
        value = info_value(key_type, raw)
        parts = self.info.setdefault(name, [])
        if not isinstance(parts, list):
            return
        if payload[0] and parts and type(parts[-1]) is type(value) and isinstance(value, str | bytes):
            parts[-1] += value
        elif len(parts) < MAX_TEXTS:
            parts.append(value)

    def _take_parameter(self, kind: int, payload: bytes, position: int) -> None:
        key_type, name, raw = keyed(payload[1:] if kind == ord("Q") else payload)
        value = parameter_value(key_type, raw)
        if value is None or not name or len(self.params) >= MAX_PARAM_CHANGES:
            return
        is_default = kind == ord("Q")
        changed = self.in_data and not is_default
        t_us = (self._time_before(position) or self._start_us) if changed else None
        self.params.append(ParamChange(name, value, t_us, is_default, position))

    def _take_text(self, kind: int, payload: bytes, position: int) -> None:
        self.in_data = True
        at = 1 if kind == ord("L") else 3
        if len(self.texts) < MAX_TEXTS:
            t_us = struct.unpack_from("<Q", payload, at)[0]
            level = min(max(payload[0] - ord("0"), 0), 7)
            self.texts.append(Text(text(payload[at + 8 :])[:MAX_TEXT_LENGTH], level, t_us, position))
