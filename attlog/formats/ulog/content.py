"""What stands beside the data in a ULog: information, parameters, texts and what the logger lost."""

from __future__ import annotations

import struct
from array import array
from collections import Counter
from collections.abc import Callable
from typing import Any

from attlog.base.limits import MAX_DROPOUTS, MAX_INFO, MAX_PARAM_CHANGES, MAX_TEXT_LENGTH, MAX_TEXTS
from attlog.formats.base import ParamChange, Remark, Text
from attlog.formats.ulog.records import info_value, keyed, parameter_value, text

RUN = 1 << 16
"""Bytes of parameters looked at together."""
PARAMETER, DEFAULT = b"PQ"
_INT, _FLOAT = struct.Struct("<i").unpack_from, struct.Struct("<f").unpack_from
LATEST_US = 2**63
"""Times from here on do not fit the clocks of a flight; no logger ever ran so long."""


class Content:
    """Collects the records that are neither data nor definitions, in file order.

    ``time_before(position)`` is the time (us) that a parameter changed at, None or 0 where no data stands before.
    """

    def __init__(self, time_before: Callable[[int], int | None]) -> None:
        self.params: list[ParamChange] = []
        self.texts: list[Text] = []
        self.in_data = False
        self._info: dict[str, Any] = {}
        self._parts: dict[str, list[Any]] = {}
        self._n_parts = 0
        self._dropouts = array("H")
        self._left_out: Counter[str] = Counter()
        self._start_us = 0
        self._time_before = time_before

    @property
    def info(self) -> dict[str, Any]:
        """The log's statements; those that come in parts as lists of what was put together."""
        return self._info | {
            name: [type(group[0])().join(group) if isinstance(group, list) else group for group in groups]
            for name, groups in self._parts.items()
            if name not in self._info
        }

    @property
    def dropouts_ms(self) -> list[int]:
        """How long the logger lost what it should have written."""
        return self._dropouts.tolist()

    def remarks(self) -> list[Remark]:
        """What was left out because there is more of it than a log can sensibly hold."""
        kept = {"parameters": MAX_PARAM_CHANGES, "texts": MAX_TEXTS, "statements": MAX_INFO, "dropouts": MAX_DROPOUTS}
        return [
            Remark("log_limit", f"The log holds {most + n} {what}; the first {most} are kept.", count=n)
            for what, most in kept.items()
            if (n := self._left_out[what])
        ]

    def start(self, version: int, start_us: int) -> None:
        """A file header with the logger's version and start time (us); what is known of the file is the first one's."""
        self._start_us, self.in_data = start_us if start_us < LATEST_US else 0, False
        self._info.setdefault("ulog_version", version)
        self._info.setdefault("ulog_start_us", self._start_us)

    def take(self, kind: int, payload: bytes, position: int) -> None:
        """One record. IndexError or struct.error if it is too short for its type."""
        match chr(kind):
            case "I":
                key_type, name, raw = keyed(payload)
                if name in self._info or self._is_room("statements", len(self._info), MAX_INFO):
                    self._info[name] = info_value(key_type, raw)
            case "M":
                self._take_info_part(payload)
            case "P" | "Q":
                self._take_parameter(kind, payload, position)
            case "L" | "C":
                self._take_text(kind, payload, position)
            case "O":
                (lost_ms,) = struct.unpack_from("<H", payload)
                if self._is_room("dropouts", len(self._dropouts), MAX_DROPOUTS):
                    self._dropouts.append(lost_ms)

    def _is_room(self, what: str, held: int, most: int) -> bool:
        if held >= most:
            self._left_out[what] += 1
        return held < most

    def _take_info_part(self, payload: bytes) -> None:
        key_type, name, raw = keyed(payload[1:])
        value = info_value(key_type, raw)
        groups = self._parts.setdefault(name, []) if len(self._parts) < MAX_INFO else self._parts.get(name, [])
        if payload[0] and groups and isinstance(groups[-1], list) and type(groups[-1][0]) is type(value):
            groups[-1].append(value)  # joined at the end: a message may come in a million parts
        elif self._is_room("statements", self._n_parts, MAX_INFO):
            self._n_parts += 1
            groups.append([value] if isinstance(value, str | bytes) else value)

    def _take_parameter(self, kind: int, payload: bytes, position: int) -> None:
        key_type, name, raw = keyed(payload[1:] if kind == ord("Q") else payload)
        value = parameter_value(key_type, raw)
        if value is None or not name or not self._is_room("parameters", len(self.params), MAX_PARAM_CHANGES):
            return
        is_default = kind == ord("Q")
        changed = self.in_data and not is_default
        t_us = (self._time_before(position) or self._start_us) if changed else None
        self.params.append(ParamChange(name, value, t_us, is_default, position))

    def take_parameters(self, raw: memoryview, position: int, stop: int) -> int:
        """Take in parameters that stand one behind the other, all but the last; the position of that one.

        Each looks as strictly as :func:`attlog.formats.ulog.records.is_record` demands and is followed by one that
        does: most definitions of a log are parameters, and taken one by one they cost more than all its data.
        """
        chunk = bytes(raw[position : min(position + RUN, stop)])
        before = (self._time_before(position) or self._start_us) if self.in_data else None
        found: list[ParamChange] = []
        at, length, whole = 0, len(chunk), 0
        while at + 12 < length:
            is_default = chunk[at + 2] == DEFAULT
            if chunk[at + 2] != PARAMETER and not is_default:
                break
            key = at + 4 if is_default else at + 3
            end, behind_name = at + 3 + (chunk[at] | chunk[at + 1] << 8), key + 1 + chunk[key]
            if not 6 < chunk[key] < 64 or end != behind_name + 4 or end > length or (is_default and chunk[at + 3] > 15):
                break
            if chunk.startswith(b"int32_t ", key + 1):
                name, (value,) = chunk[key + 9 : behind_name], _INT(chunk, behind_name)
            elif chunk.startswith(b"float ", key + 1):
                name, (value,) = chunk[key + 7 : behind_name], _FLOAT(chunk, behind_name)
            else:
                break
            t_us = None if is_default else before
            found.append(ParamChange(name.decode("utf-8", "replace"), value, t_us, is_default, position + at))
            whole, at = at, end
        room = max(MAX_PARAM_CHANGES - len(self.params), 0)
        taken = [change for change in found[:-1] if change.name]
        self.params += taken[:room]
        self._left_out["parameters"] += len(taken[room:])
        return position + whole

    def _take_text(self, kind: int, payload: bytes, position: int) -> None:
        self.in_data = True
        at = 1 if kind == ord("L") else 3
        (t_us,) = struct.unpack_from("<Q", payload, at)
        if self._is_room("texts", len(self.texts), MAX_TEXTS):
            level = min(max(payload[0] - ord("0"), 0), 7)
            said = text(payload[at + 8 : at + 8 + 4 * MAX_TEXT_LENGTH])[:MAX_TEXT_LENGTH]
            self.texts.append(Text(said, level, t_us, position))
