"""Object files of loops: shipped with the package, or kept in the user's cache folder.

A file is named by its loop's key. It is a line of JSON (symbol, functions of the C library that it calls, checksum) and
the code. A damaged file counts as missing. Files are written whole or not at all, so processes may compile the same
loop at once, and the installation may be read-only.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import attlog
from attlog.core.files import installed_version, private_folder

SHIPPED = Path(__file__).resolve().parent / "objects"
# Levels of the x86-64 ABI for which objects are shipped, best first, and the features that they need (LLVM's names).
LEVELS = {
    "x86-64-v3": "avx avx2 bmi bmi2 f16c fma lzcnt movbe sse4.2 popcnt",
    "x86-64-v2": "cx16 popcnt sse3 sse4.1 sse4.2 ssse3",
}


class ObjectCode(NamedTuple):
    """Machine code that defines ``symbol`` and calls the functions ``needs`` of the C library."""

    symbol: str
    needs: tuple[str, ...]
    code: bytes

    def packed(self) -> bytes:
        """Return the file's content."""
        head = {"symbol": self.symbol, "needs": self.needs}
        digest = hashlib.sha256(json.dumps(head).encode() + self.code).hexdigest()
        return json.dumps({**head, "sha256": digest}).encode() + b"\n" + self.code


def unpacked(content: bytes) -> ObjectCode | None:
    """Return the object of a file's content, None where it is damaged: loading it would end the process."""
    line, _, code = content.partition(b"\n")
    try:
        head = json.loads(line)
        digest = head.pop("sha256")
        whole = hashlib.sha256(json.dumps(head).encode() + code).hexdigest() == digest
        return ObjectCode(str(head["symbol"]), tuple(head["needs"]), code) if whole else None
    except (ValueError, KeyError, TypeError, AttributeError):
        return None


def read(path: Path) -> ObjectCode | None:
    """Return the object in a file, None where there is none or it is damaged."""
    try:
        return unpacked(path.read_bytes())
    except OSError:
        return None


def write(path: Path, found: ObjectCode, mode: int = 0o600) -> None:
    """Write an object atomically."""
    handle, temporary = tempfile.mkstemp(prefix=f".{path.stem}.", dir=path.parent)
    with os.fdopen(handle, "wb") as file:
        file.write(found.packed())
    os.chmod(temporary, mode)
    os.replace(temporary, path)


def find(key: str) -> ObjectCode | None:
    """Return the object of a key: the shipped one of the best level that runs here, else the user's own."""
    return next(filter(None, (read(place / f"{key}.o") for place in _places())), None)


def has(key: str) -> bool:
    """Return whether there is an object of a key."""
    return any((place / f"{key}.o").is_file() for place in _places())


def is_shipped() -> bool:
    """Return whether the package holds objects for this kind of machine."""
    return any(SHIPPED.glob("*/*.o"))


def keep(key: str, found: ObjectCode) -> None:
    """Put an object into the user's folder."""
    own = own_place()
    if own is not None:
        write(own / f"{key}.o", found)


def _places() -> Iterator[Path]:
    if SHIPPED.is_dir():
        yield from (place_of_level(SHIPPED, level) for level in levels())
    own = own_place()
    if own is not None:
        yield own


@functools.lru_cache(maxsize=1)
def own_place() -> Path | None:
    """Return the user's folder for this version, processor and compiler, None where none can be written."""
    used = [attlog.__version__, installed_version("numba"), sys.platform, platform.machine(), *target()]
    return private_folder("loops", hashlib.sha256("\0".join(used).encode()).hexdigest()[:24])


def place_of_level(folder: Path, level: str) -> Path:
    """Return where objects for a level of processor lie below a folder."""
    return folder / f"{sys.platform}-{platform.machine().lower()}-{level}"


@functools.lru_cache(maxsize=1)
def target() -> tuple[str, str]:
    """Return name and features of the processor that is compiled for; numba heeds the same variables."""
    import llvmlite.binding as llvm

    name = os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES")
    if features is None:
        features = "" if "NUMBA_CPU_NAME" in os.environ else llvm.get_host_cpu_features().flatten()
    return name, features


def portable_levels() -> tuple[str, ...]:
    """Return the levels for which objects are shipped on this kind of machine, best first."""
    return tuple(LEVELS) if platform.machine().lower() in ("x86_64", "amd64") else ("generic",)


@functools.lru_cache(maxsize=1)
def levels() -> tuple[str, ...]:
    """Return those of them that this machine can run, best first."""
    import llvmlite.binding as llvm

    have = {name for name, there in llvm.get_host_cpu_features().items() if there}
    return tuple(level for level in portable_levels() if set(LEVELS.get(level, "").split()) <= have)
