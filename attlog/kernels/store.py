"""Objects on disk: shipped with the package, or kept in the user's folder. What is damaged counts as not there.

An object file is a line of JSON (symbol, the library's functions it calls, checksum) and the code. It is named by the
hash of the kernel's text and its entry. Which text a kernel has takes 0.3 s to find out for six filters, so an index
tells it for a state of the source files (:mod:`sources`): shipped with the objects, or learnt here.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from attlog.base.files.private_folder import version_of
from attlog.kernels import processor, sources
from attlog.kernels.folder import folder, write
from attlog.kernels.kernel import Kernel

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
    state = sources.state(kernel.sources)
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
    if own is None or not kernel.sources or sources.edited(kernel.sources):
        return
    digest = hashlib.sha256(key.encode()).hexdigest()
    write(own / _note(sources.state(kernel.sources), kernel), f"{key} {digest}\n".encode())


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
        yield from (SHIPPED / f"{processor.machine()}-{level}" for level in processor.levels())
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
    name = hashlib.sha256(
        "\0".join([version_of("numba"), processor.machine(), *processor.target()]).encode()
    ).hexdigest()
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
