"""Names from logs, archives and servers as names of files: harmless, short enough, each once.

A log is a stranger's file, and so is what it calls its messages. No such name is ever used as a path: what could lead
out of a folder, mean a device, hide a file or not be written at all is replaced here, and only here.
"""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Iterable

LONGEST = 200
"""Bytes of UTF-8; file systems end at 255, and a number, suffixes and what temporary files need are added."""
SUFFIX = 24
"""Bytes of an ending that a shortened name keeps (``.ulg.gz``): it says what the file was."""
FORBIDDEN = frozenset('/\\:*?"<>|')
"""What separates folders, drives and streams somewhere, or what some file system refuses."""
DEVICE = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³]) *(\..*)?", re.IGNORECASE)
"""Names that mean a device on Windows, whatever follows the first dot."""


def file_name(text: str, longest: int = LONGEST) -> str:
    """A name from outside as the name of one file: no separator, control or direction sign, at most ``longest`` bytes.

    It begins with no dot (hidden), dash (an option to other programs) or blank and ends with neither dot nor blank.
    What is forbidden becomes ``_``; a name that has to be shortened keeps its beginning and ending around a hash of
    the whole. Names without fault stay as they are, letters of all scripts included.
    """
    name = "".join("_" if c in FORBIDDEN or not c.isprintable() else c for c in text)
    name = re.sub(r"^[ .\-]+", _underlined, name)
    name = re.sub(r"[ .]+$", _underlined, name)
    if DEVICE.fullmatch(name):
        name = f"_{name}"
    return _shortened(name, text, longest) or "unnamed"


def file_names(texts: Iterable[str], taken: Iterable[str] = (), longest: int = LONGEST) -> list[str]:
    """The file name of each text; a second of the same name gets a number, in the order given.

    Names that some file systems do not distinguish (case, composed accents) count as the same. ``taken`` are names
    that are in use already.
    """
    used = {_key(name) for name in taken}
    next_number: dict[str, int] = {}
    names = []
    for text in texts:
        own = name = file_name(text, longest)
        number = next_number.get(_key(own), 1)
        while _key(name) in used:
            number += 1
            name = f"{own}-{number}"
        next_number[_key(own)] = number
        used.add(_key(name))
        names.append(name)
    return names


def _underlined(match: re.Match[str]) -> str:
    return "_" * len(match[0])


def _shortened(name: str, text: str, longest: int) -> str:
    """The name in at most ``longest`` bytes, distinguished from others that begin alike by a hash of the whole text."""
    if len(name.encode()) <= longest:
        return name
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:10]
    dots = re.search(r"(\.\w{1,12}){1,2}$", name)
    suffix = dots[0] if dots and len(dots[0].encode()) <= SUFFIX else ""
    room = longest - len(digest) - len(suffix.encode()) - 1
    return f"{name.encode()[:room].decode(errors='ignore')}~{digest}{suffix}"


def _key(name: str) -> str:
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())
