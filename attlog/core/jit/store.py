"""Which instructions may a kernel use?

Objects that are shipped are made for a level that many processors share, objects that are made on this machine for its
own. numba does not contract or reorder floating point unless told so, and no kernel tells it: all of them give the same
bits, up to what the C library's sin, exp and log give.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import attlog
from attlog.core.files import installed_version, private_folder
from attlog.core.jit.kernel import Kernel

LEVELS = {
    "x86-64-v3": "avx avx2 bmi bmi2 f16c fma lzcnt movbe sse4.2 popcnt",
    "x86-64-v2": "cx16 popcnt sse3 sse4.1 sse4.2 ssse3",
}
"""Architecture levels of the x86-64 ABI, best first, and what they need (names as LLVM writes them)."""


@lru_cache(maxsize=1)
def target() -> tuple[str, str]:
    """Name and features of the processor that numba compiles for here; it heeds these variables as well."""
    import llvmlite.binding as llvm

    name = os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES")
    if features is None:
        features = "" if "NUMBA_CPU_NAME" in os.environ else llvm.get_host_cpu_features().flatten()
    return name, features


def portable() -> tuple[str, ...]:
    """The levels for which objects are shipped on this kind of machine, best first."""
    if platform.machine().lower() in ("x86_64", "amd64"):
        return tuple(LEVELS)
    return ("generic",)


@lru_cache(maxsize=1)
def levels() -> tuple[str, ...]:
    """Those of them that this machine can run, best first."""
    import llvmlite.binding as llvm

    have = {name for name, there in llvm.get_host_cpu_features().items() if there}
    return tuple(level for level in portable() if set(LEVELS.get(level, "").split()) <= have)


def machine() -> str:
    """Which object files this system loads: their format and architecture."""
    return f"{sys.platform}-{platform.machine().lower()}"


# Where is machine code kept that this machine made? In a folder that nobody else can write.


@functools.lru_cache(maxsize=1)
def folder() -> Path | None:
    """The user's cache, a private temporary folder, or None."""
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    version = f"attlog-{attlog.__version__}-python-{python}-numba-{installed_version('numba')}-{platform.machine()}"
    return private_folder("kernels", version)


def write(path: Path, content: bytes) -> None:
    """Write atomically, with a fixed time stamp: numba compares it, and two writers must agree."""
    handle, temporary = tempfile.mkstemp(prefix=f".{path.stem}.", dir=path.parent)
    with os.fdopen(handle, "wb") as file:
        file.write(content)
    os.utime(temporary, (1, 1))
    os.replace(temporary, path)


# Did the files change from which a kernel's text is made? Asked at each start, so it must be cheap: 3 ms.

PACKAGE = Path(__file__).resolve().parents[2]
STARTED = time.time()
"""When this module was loaded, which is before any text of a kernel is made."""


@lru_cache(maxsize=16)
def sources_state(sources: tuple[str, ...]) -> str:
    """A hash of the Python files that ``sources``, files and folders below the package, hold now."""
    found = hashlib.sha256()
    for path in _files(sources):
        found.update(f"{path.relative_to(PACKAGE).as_posix()}\0".encode())
        found.update(_digest(path))
    return found.hexdigest()


@lru_cache(maxsize=256)
def _digest(path: Path) -> bytes:
    """The hash of one file: most kernels depend on the same folders."""
    return hashlib.sha256(path.read_bytes()).digest()


def edited(sources: tuple[str, ...]) -> bool:
    """True where a file may be another than the one this process has imported."""
    return any(path.stat().st_mtime >= STARTED - 2.0 for path in _files(sources))


def _files(sources: tuple[str, ...]) -> list[Path]:
    roots = [PACKAGE / name for name in sources]
    return sorted(p for root in roots for p in (root.rglob("*.py") if root.is_dir() else (root,)) if p.is_file())


# Objects on disk: shipped with the package, or kept in the user's folder. What is damaged counts as not there.
#
# An object file is a line of JSON (symbol, the library's functions it calls, checksum) and the code. It is named by
# the
# hash of the kernel's text and its entry. Which text a kernel has takes 0.3 s to find out for six filters, so an
# index
# tells it for a state of the source files (:mod:`sources`): shipped with the objects, or learnt here.

FORMAT = 1
"""Counts changes of the file's form and of how entries are compiled and called."""
SHIPPED = Path(__file__).resolve().parent / "objects"
INDEX = "index.json"


@dataclass(frozen=True, slots=True)
class Object:
    """Code that defines ``symbol`` and calls the library's functions ``needs``."""

    symbol: str
    needs: tuple[str, ...]
    code: bytes

    def packed(self) -> bytes:
        """The file's content."""
        head = {"symbol": self.symbol, "needs": self.needs}
        digest = hashlib.sha256(json.dumps(head).encode() + self.code).hexdigest()
        return json.dumps({**head, "sha256": digest}).encode() + b"\n" + self.code


def unpacked(content: bytes) -> Object | None:
    """The object of a file's content, None where it is damaged: loading it would end the process."""
    line, _, code = content.partition(b"\n")
    try:
        head = json.loads(line)
        digest = head.pop("sha256")
        whole = hashlib.sha256(json.dumps(head).encode() + code).hexdigest() == digest
        return Object(str(head["symbol"]), tuple(head["needs"]), code) if whole else None
    except (ValueError, KeyError, TypeError, AttributeError):
        return None


def key_of(kernel: Kernel) -> str:
    """What the kernel's object is named: a hash of its text, its entry and the form of both."""
    told = f"{FORMAT}\0{kernel.entry}\0{kernel.signature}\0{kernel.scratch}\0{kernel.text()}"
    return hashlib.sha256(told.encode()).hexdigest()[:32]


def known_key(kernel: Kernel) -> str | None:
    """The key without making the text, where an index knows it for the source files as they are."""
    if not kernel.sources:
        return None
    state = sources_state(kernel.sources)
    shipped = _shipped().get(state, {}).get(kernel.name)
    if shipped:
        return str(shipped)
    own = folder()
    try:
        found = (own / _note(state, kernel)).read_text(encoding="ascii").split() if own else []
    except (OSError, ValueError):
        return None
    return found[0] if len(found) == 2 and hashlib.sha256(found[0].encode()).hexdigest() == found[1] else None


def learn_key(kernel: Kernel, key: str) -> None:
    """Note the key for these source files, unless one was written since this process began."""
    own = folder()
    if own is None or not kernel.sources or edited(kernel.sources):
        return
    digest = hashlib.sha256(key.encode()).hexdigest()
    write(own / _note(sources_state(kernel.sources), kernel), f"{key} {digest}\n".encode())


def find(key: str) -> Object | None:
    """The object of that key: the shipped one of the best level that runs here, else that of the user's folder."""
    for place in _places():
        path = place / f"{key}.o"
        try:
            found = unpacked(path.read_bytes())
        except OSError:
            continue
        if found is not None:
            return found
    return None


def _places() -> Iterator[Path]:
    """Where objects that run here may lie, the best first; the user's folder is looked for last."""
    if SHIPPED.is_dir():
        yield from (SHIPPED / f"{machine()}-{level}" for level in levels())
    own = own_place()
    if own is not None:
        yield own


def keep(key: str, found: Object) -> None:
    """Put an object into the user's folder."""
    place = own_place()
    if place is not None:
        place.mkdir(mode=0o700, exist_ok=True)
        write(place / f"{key}.o", found.packed())


def own_place() -> Path | None:
    """The user's folder for this processor and compiler."""
    own = folder()
    name = hashlib.sha256("\0".join([installed_version("numba"), machine(), *target()]).encode()).hexdigest()
    return own / f"objects-{name[:16]}" if own else None


def _note(state: str, kernel: Kernel) -> str:
    return "n_" + hashlib.sha256(f"{FORMAT}\0{state}\0{kernel.name}".encode()).hexdigest()[:24]


@lru_cache(maxsize=1)
def _shipped() -> dict[str, Any]:
    """Keys by the state of the sources and the kernel's name, as they were when the package was built."""
    try:
        told = json.loads((SHIPPED / INDEX).read_text(encoding="ascii"))
        return dict(told["keys"]) if told["format"] == FORMAT else {}
    except (OSError, ValueError, KeyError, TypeError):
        return {}
