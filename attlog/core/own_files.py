"""Kinds of files that attlog writes, recognised by their content: only these are replaced.

A file of an earlier run is replaced by one of its kind. Anything else under the name of an output is a user's file, and
the command ends with an OutputError. Marks are those of every version since 0.15.0.
"""

from __future__ import annotations

import csv
import errno
import hashlib
import json
import os
import re
import stat
import struct
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from attlog.core.errors import OutputError

# Bytes at both ends of a file that are searched for marks; a simulated DataFlash log has its own after 11 kB.
HEAD_BYTES, TAIL_BYTES = 1 << 18, 1 << 16
# Bytes of a table's heading.
MAX_HEADING_BYTES = 1 << 16
# Pixels of a PNG per millimetre of its SVG, and the difference by rounding.
PNG_DPI, MM_PER_INCH, PNG_ROUNDING = 300, 25.4, 1.5
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
# Text of a PNG, by its keyword and program.
PNG_TEXT = b"tEXtSoftware\0attlog "
# Where files name the log that they are about.
LOG_HASH = rb'(?i)sha-?256"?(?::\s*|</dt><dd class="mono">)"?([0-9a-f]{64})'


@dataclass(frozen=True, slots=True)
class FileKind:
    """A kind of file that attlog writes.

    ``name``: with article, for messages. ``marks``: patterns, one of which the beginning and end of such a file match.
    ``check``: another way to recognise one. ``logs``: SHA-256 of logs, one of which the file must be about; empty for
    any.
    """

    name: str
    marks: tuple[bytes, ...] = ()
    check: Callable[[Path], bool] = field(default=lambda _: False)
    logs: frozenset[str] = frozenset()

    def of(self, *logs: str) -> FileKind:
        """Return the kind for files about one of these logs (SHA-256)."""
        return replace(self, logs=frozenset(filter(None, logs)))

    def includes(self, path: Path) -> bool:
        """Return whether a file is of this kind, whichever log it is about."""
        try:
            ends = b"\0".join(_ends(path))
            return any(re.search(mark, ends) for mark in self.marks) or self.check(path)
        except Exception:  # whatever a stranger's file does to a parser, or Parquet without pyarrow
            return False


def require_replaceable(path: Path, kind: FileKind | None) -> None:
    """Raise OutputError if a file exists that is not of this kind; with None, if any exists.

    An empty file may be replaced, and what is written in place (:func:`is_special`).
    """
    if not os.path.lexists(path) or is_special(path) or (path.is_file() and not path.stat().st_size):
        return
    if path.is_dir():
        raise OutputError(f"{path}: cannot be written ({os.strerror(errno.EISDIR)}); choose another place with -o")
    if kind is None or not kind.includes(path):
        what = "exists" if kind is None else f"exists and is not {kind.name} of attlog"
        raise OutputError(f"{path}: {what}, so it is not replaced; choose another place with -o, or move it away")
    if kind.logs and (log_of(path) or min(kind.logs)) not in kind.logs:
        raise OutputError(f"{path}: is {kind.name} of another log, so it is not replaced; choose another place with -o")


def is_special(path: Path) -> bool:
    """Return whether a path is a device, pipe, socket, or name of an open file."""
    try:
        mode = path.stat().st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            return True
        where = os.path.realpath(path.parent)
        return stat.S_ISREG(mode) and (where in ("/dev", "/dev/fd") or where.startswith("/proc/"))
    except (OSError, ValueError):  # nothing there, or no name of a file: writing it says so
        return False


def log_of(path: Path) -> str:
    """Return the SHA-256 of the log that a file of attlog is about; empty if it names none."""
    with suppress(Exception):
        suffix = path.suffix.lower()
        if suffix == ".parquet":
            content = (getattr(_parquet_schema(path), "metadata", None) or {}).get(b"attlog", b"")
        else:
            content = (path.with_name(f"{path.name}.json") if suffix == ".csv" else path).read_bytes()
        return hash_named_in(content)
    return ""


def hash_named_in(content: bytes) -> str:
    """Return the SHA-256 that a document gives of its log, empty without one."""
    found = re.search(LOG_HASH, content)
    return found[1].decode() if found else ""


def grown_from(log: Path, earlier: Any) -> str:
    """Return the SHA-256 of an earlier, shorter state of a log; empty if the log did not grow from it.

    ``earlier``: the part ``log`` of a result, with ``sha256`` and ``size``.
    """
    with suppress(OSError, KeyError, TypeError, ValueError):
        digest, left = hashlib.sha256(), int(earlier["size"])
        if left < log.stat().st_size:
            with log.open("rb") as file:
                while left and (part := file.read(min(left, 1 << 20))):
                    digest.update(part)
                    left -= len(part)
            if digest.hexdigest() == earlier["sha256"]:
                return digest.hexdigest()
    return ""


def _ends(path: Path) -> tuple[bytes, bytes]:
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
        file.seek(max(os.fstat(file.fileno()).st_size - TAIL_BYTES, 0))
        return head, file.read(TAIL_BYTES)


def _mark(*patterns: str) -> tuple[bytes, ...]:
    return tuple(pattern.encode() for pattern in patterns)


def _page(title: str) -> str:
    """Return the pattern of a page: its policy, then its title."""
    policy, metas = r'<meta http-equiv="Content-Security-Policy" content="default-src [^>]*>', r"(\s*<meta [^>]*>)*\s*"
    return rf"\A<!doctype html>\s*<html[^>]*><head>{metas}{policy}{metas}<title>[^<]*{title}</title>"


def _document(*keys: str) -> str:
    """Return the pattern of a JSON document that begins with these keys or values."""
    return r"\A\{\s*" + r"[^\0]*".join(keys)


def _is_table_parquet(path: Path) -> bool:
    metadata = [field.metadata or {} for field in _parquet_schema(path)]
    return bool(metadata) and {b"metric", b"window", b"row", b"unit"} == metadata[-1].keys()


def _parquet_schema(path: Path) -> Any:
    from pyarrow import parquet

    return parquet.read_schema(path) if path.suffix.lower() == ".parquet" else ()


def _is_data(path: Path) -> bool:
    """Recognise data of a log: Parquet with its source, CSV with a JSON beside it that names its columns, that JSON."""
    if path.suffix.lower() == ".parquet":
        return b"attlog" in (getattr(_parquet_schema(path), "metadata", None) or {})
    if path.suffix.lower() == ".json":
        return bool(_about_data(path))
    about = _about_data(path.with_name(f"{path.name}.json"))
    with path.open("rb") as file:
        heading = file.readline(MAX_HEADING_BYTES).decode("utf-8", "replace")
    columns = next(csv.reader([heading]), [])
    return bool(about) and columns[:1] == ["time_s"] and {c.lstrip("'") for c in columns} >= about["units"].keys()


def _about_data(path: Path) -> dict[str, Any]:
    """Return the description of a table of a log, empty if the file is none."""
    if not path.is_file() or path.stat().st_size > HEAD_BYTES:
        return {}
    found = json.loads(path.read_bytes())
    known = isinstance(found, dict) and found.keys() >= {"log", "sha256", "attlog", "frame", "table", "units"}
    return found if known and isinstance(found["units"], dict) else {}


def _is_picture(path: Path) -> bool:
    """Recognise an SVG by the name of its figure; a PNG by its text, of older versions by the size of its SVG."""
    head, _ = _ends(path)
    if path.suffix == ".svg":
        return _drawn(path, head) is not None
    if not head.startswith(PNG_MAGIC) or PNG_TEXT in head:
        return head.startswith(PNG_MAGIC)
    svg = path.with_suffix(".svg")
    drawn = _drawn(svg, _ends(svg)[0])
    (width,) = struct.unpack(">I", head[16:20])
    return drawn is not None and abs(width - float(drawn[1]) / MM_PER_INCH * PNG_DPI) <= PNG_ROUNDING


def _drawn(path: Path, head: bytes) -> re.Match[bytes] | None:
    """Return the width (mm) and name of a figure, whose file must bear it."""
    found = re.search(rb'\A<svg class="main-svg"[^>]* width="([\d.]+)mm"[\s\S]*?<defs id="defs-(\w+)-"', head)
    return found if found and path.stem.endswith(f"_{found[2].decode()}") else None


_VERSION = r'"version":\s*"[^"]*"'
ANY_FILE = FileKind("a file", check=lambda _: True)
REPORT = FileKind("a report", _mark(_page(" · attitude report"), _document(r'"schema":\s*"attlog-result/')))
FIGURES = FileKind("a figure", check=_is_picture)
INDEX = FileKind("the index of a batch", _mark(_page(r" · attitude of [\d,]+ logs?")))
RESULTS = FileKind(
    "the table of a batch", _mark(r"\Alog,report,sha256,date_utc,", r"\APAR1[\s\S]*attlog\.units[\s\S]*PAR1\Z")
)
RECORD = FileKind("a record", _mark(_document(r'"schema":\s*"attlog-(record|batch)/')))
COMPARISON = FileKind(
    "a comparison",
    _mark(
        _page(" · attitude comparison"),
        _document(r'"attlog":\s*\{' + _VERSION, r'"configurations":'),
        r"\Ametric,window,unit,scale,log,configuration,",
    ),
)
DIFFERENCE = FileKind(
    "a comparison of results",
    _mark(
        _page(" · what changed"),
        _document(r'"schema":\s*"attlog-diff/'),
        r"\A### [^\n]*\n\n(the same log|two logs)[,:] ",
        r"\A- [^\n]*: only in (OLD|NEW)\n",
    ),
)
SWEEP = FileKind(
    "a sweep",
    _mark(
        _page(r": [\d,]+ settings? on [\d,]+ logs?"),
        _document(r'"schema":\s*"attlog-sweep/'),
        r"\Asetting,[^\n]*log,metric,window,unit,value,",
    ),
)
TUNING = FileKind("a tuning", _mark(_page(r": gains from [^<]*"), _document(r'"schema":\s*"attlog-tune/')))
PAPER = FileKind(
    "a paper run again",
    _mark(_page(": a paper run again · attlog"), _document(r'"key":\s*"\w+",\s*"title":\s*"[^"]*",\s*"citation":')),
)
TABLE = FileKind(
    "a table",
    _mark(
        r"\Alog,date,vehicle,firmware,sha256,|\A\w+,logs,[^\n]* q25,[^\n]* median,",
        r"\A\| log \| date \|[^\0]*\0[^\0]*\n\| 75 % \|  \|[^\n]*\n\| logs \|",
        r"\A\| \w+ \| logs \|",
        r"\A\\begin\{tabular\}\{l+r*\}\n\\toprule\n(log & date|\w+ & logs) &",
        r"\A\S+, \S+(, in [^\n]*)?\n(log +date +|\w+ +logs +)",
    ),
    _is_table_parquet,
)
DATA = FileKind("data", check=_is_data)
PARAMETERS = FileKind("a parameter file", _mark(r"\A# attlog \S+: what to set, found in "))
SIMULATED_LOG = FileKind(
    "a simulated log",
    _mark(
        r"\AULog[\s\S]*ver_hwSITL_ATTLOG",
        r"\A(\xa3\x95|[\s\S]{8}[\xfd\xfe])[\s\S]*attlog \S+ simulated this flight, seed \d",
        r"\A\x89MCAP0\r\n\x01[\s\S]{8}\x04\0\0\0ros2\x06\0\0\0attlog",
    ),
)
JUNIT = FileKind("a JUnit file", _mark(r'\A<\?xml [^\n]*\n<testsuites name="attlog">'))
SUMMARY = FileKind("a summary", _mark("\\A## (✅ |❌ )?attlog: "))
