"""Contents of a ULog: information, parameters, texts and dropouts; columns of topics; implausible records."""

from __future__ import annotations

import struct
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.core.limits import MAX_DROPOUTS, MAX_INFO, MAX_LAYOUTS, MAX_PARAM_CHANGES, MAX_TEXT_LENGTH, MAX_TEXTS
from attlog.core.timestamps import Offsets, far_from_median
from attlog.formats.file_bytes import gather
from attlog.formats.table import DamageLog, Field, ParamChange, Table, Text
from attlog.formats.ulog.layout import (
    AIRFRAME_DEFAULT,
    TopicLayout,
    decode_ulog_text,
    info_value,
    parameter_value,
    split_key,
)
from attlog.formats.ulog.walk import DATA_HEADER_BYTES, Bytes

# Start times from here on do not fit the clocks of a flight.
MAX_START_US = 2**63


class Content:
    """Collector of information, parameters, texts and dropouts, in file order.

    ``time_before(position)`` gives the time (us) of a parameter change, None or 0 without data before it.
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
        """Information of the log; multi-part values are joined."""
        return self._info | {
            name: [type(group[0])().join(group) if isinstance(group, list) else group for group in groups]
            for name, groups in self._parts.items()
            if name not in self._info
        }

    @property
    def dropouts_ms(self) -> list[int]:
        """Durations of the logger's dropouts."""
        return self._dropouts.tolist()

    def report(self, losses: DamageLog) -> None:
        """Report exceeded limits of a log."""
        kept = {"parameters": MAX_PARAM_CHANGES, "texts": MAX_TEXTS, "statements": MAX_INFO, "dropouts": MAX_DROPOUTS}
        for what, most in kept.items():
            if n := self._left_out[what]:
                losses.add_limit(f"The log holds {most + n} {what}; the first {most} are kept.", count=n)

    def start(self, version: int, start_us: int) -> None:
        """Add a file header with the logger's ``version`` and start time in us; the first one is kept."""
        self._start_us, self.in_data = start_us if start_us < MAX_START_US else 0, False
        self._info.setdefault("ulog_version", version)
        self._info.setdefault("ulog_start_us", self._start_us)

    def take(self, kind: int, payload: bytes, position: int) -> None:
        """Add one record. IndexError or struct.error if it is too short for its type."""
        match chr(kind):
            case "I":
                key_type, name, raw = split_key(payload)
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
        key_type, name, raw = split_key(payload[1:])
        value = info_value(key_type, raw)
        groups = self._parts.setdefault(name, []) if len(self._parts) < MAX_INFO else self._parts.get(name, [])
        if payload[0] and groups and isinstance(groups[-1], list) and type(groups[-1][0]) is type(value):
            groups[-1].append(value)  # joined at the end; a message may have a million parts
        elif self._is_room("statements", self._n_parts, MAX_INFO):
            self._n_parts += 1
            groups.append([value] if isinstance(value, str | bytes) else value)

    def _take_parameter(self, kind: int, payload: bytes, position: int) -> None:
        key_type, name, raw = split_key(payload[1:] if kind == ord("Q") else payload)
        value = parameter_value(key_type, raw)
        if value is None or not name or not self._is_room("parameters", len(self.params), MAX_PARAM_CHANGES):
            return
        is_default = kind == ord("Q")
        changed = self.in_data and not is_default
        t_us = (self._time_before(position) or self._start_us) if changed else None
        firmware_only = is_default and not payload[0] & AIRFRAME_DEFAULT
        self.params.append(ParamChange(name, value, t_us, is_default, position, firmware_only))

    def _take_text(self, kind: int, payload: bytes, position: int) -> None:
        self.in_data = True
        at = 1 if kind == ord("L") else 3
        (t_us,) = struct.unpack_from("<Q", payload, at)
        if self._is_room("texts", len(self.texts), MAX_TEXTS):
            level = min(max(payload[0] - ord("0"), 0), 7)
            said = decode_ulog_text(payload[at + 8 : at + 8 + 4 * MAX_TEXT_LENGTH])[:MAX_TEXT_LENGTH]
            self.texts.append(Text(said, level, t_us, position))


@dataclass(slots=True)
class Topic:
    """Records of a topic, in parts of one layout each."""

    layouts: list[TopicLayout]
    parts: list[tuple[int, Offsets]] = field(default_factory=list)
    left_out: int = 0
    decoder: _TopicDecoder | None = None

    def add(self, layout: TopicLayout, offsets: Offsets) -> None:
        """Add records of one layout, in file order."""
        if self.layouts[-1] != layout:
            if len(self.layouts) >= MAX_LAYOUTS:
                self.left_out += len(offsets)
                return
            self.layouts.append(layout)
        self.parts.append((len(self.layouts) - 1, offsets))

    def table(self, data: Bytes, name: str, multi: int, losses: DamageLog, *, own_starts: bool = False) -> Table:
        """Return the table of the fields common to all layouts, and release the parts.

        ``own_starts``: copy the starts; a view would keep the starts of all topics in memory.
        """
        parts, self.parts = self.parts, []
        one = len(parts) == 1 and not own_starts
        starts = parts[0][1] if one else np.concatenate([offsets for _, offsets in parts])
        which = None
        if len(self.layouts) > 1:
            which = np.repeat(np.array([k for k, _ in parts], np.int8), [len(offsets) for _, offsets in parts])
        if any(after[0] < before[-1] for (_, before), (_, after) in pairwise(parts)):
            order = starts.argsort(kind="stable")
            starts, which = starts[order], None if which is None else which[order]
        self.decoder = _TopicDecoder(data, self.layouts, starts, which)
        return Table(name, multi, self._fields, starts, self.decoder, losses)

    def forget(self) -> None:
        """Release the gathered records."""
        if self.decoder is not None:
            self.decoder.forget()

    def _fields(self) -> dict[str, Field]:
        first, *others = self.layouts
        if not others:
            return first.fields
        return {n: f for n, f in first.fields.items() if all(o.fields.get(n) == f for o in others)}


class _TopicDecoder:
    """Decoder of a topic's columns as views of a single copy of its records.

    ``which`` (n,): layout of each record, None if there is only one.
    """

    def __init__(
        self, data: Bytes, layouts: Sequence[TopicLayout], starts: Offsets, which: NDArray[np.int8] | None = None
    ) -> None:
        self._data, self._layouts, self._starts, self._which = data, layouts, starts, which
        self._of: Offsets | None = None
        self._gathered: list[tuple[NDArray[np.bool_] | slice, NDArray[np.void]]] = []

    def forget(self) -> None:
        self._of, self._gathered = None, []

    def __call__(self, column: str, offsets: Offsets) -> NDArray[Any]:
        if self._of is not offsets:
            self._gathered = list(self._gather(offsets))
            self._of = offsets
        if len(self._gathered) == 1:
            return self._gathered[0][1][column]
        first = self._gathered[0][1][column]
        found = np.empty((len(offsets), *first.shape[1:]), first.dtype)
        for here, rows in self._gathered:
            found[here] = rows[column]
        return found

    def _gather(self, offsets: Offsets) -> Iterator[tuple[NDArray[np.bool_] | slice, NDArray[np.void]]]:
        body = self._data[DATA_HEADER_BYTES:]
        if self._which is None:
            yield slice(None), gather(body, offsets, self._layouts[0].record)
            return
        which = self._which[self._starts.searchsorted(offsets)]
        for k, layout in enumerate(self._layouts):
            here = which == k
            yield here, gather(body, offsets[here], layout.record)


# Magnitudes outside are no measurements: the largest real ones are times in us, the smallest variances.
MAX_MAGNITUDE, MIN_MAGNITUDE = 1e15, 1e-30
# A column with a larger share beyond the limits was logged so, for instance not initialised.
MAX_IMPLAUSIBLE_SHARE = 0.01
# Topics with fewer records have no outliers.
MIN_RECORDS = 5


def implausible(table: Table) -> NDArray[np.bool_]:
    """Select records with an implausible time or number.

    ULog has no checksums, and damage within a record can leave the framing intact. Random bytes usually form
    implausible exponents or times. It is applied to damaged files only, so that intact logs are read unchanged.
    """
    found = np.zeros(len(table), bool)
    if len(table) < MIN_RECORDS:
        return found
    for name, described in table.fields.items():
        if name == "timestamp" and described.dtype.kind == "u":
            odd = far_from_median(table[name])
        elif described.dtype.base.kind == "f":
            odd = _beyond_magnitudes(table[name])
        else:
            continue
        if 0 < np.count_nonzero(odd) <= max(1, MAX_IMPLAUSIBLE_SHARE * len(odd)):
            found |= odd
    return found


def _beyond_magnitudes(column: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Select the records with a finite number of impossible magnitude."""
    with np.errstate(invalid="ignore"):  # random bytes hold signalling NaN too
        size = np.abs(column)
        beyond: NDArray[np.bool_] = (size > MAX_MAGNITUDE) & np.isfinite(size) | (size < MIN_MAGNITUDE) & (size > 0)
    return np.logical_or.reduce(beyond, axis=1) if beyond.ndim == 2 else beyond
