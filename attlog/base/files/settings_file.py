"""Files that people write for attlog (options, parameters, scenarios, gates): their bytes, text and TOML."""

from __future__ import annotations

import stat
from pathlib import Path
from typing import Any

from attlog.base.errors import LogUnreadable, UsageError
from attlog.base.limits import MAX_SETTINGS_BYTES


def bytes_of(path: Path, largest: int = MAX_SETTINGS_BYTES) -> bytes:
    """What a file holds. LogUnreadable if it cannot be opened, UsageError where it is no file (a device or a pipe
    may never end) or larger than ``largest`` bytes."""
    try:
        status = path.stat()
        mode = status.st_mode
        if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
            raise UsageError(f"{path}: is no file but a device or a pipe; write it to a file first")
        if stat.S_ISREG(mode) and status.st_size > largest:
            raise _too_large(path, largest)
        with path.open("rb") as file:
            content = file.read(largest + 1)
    except OSError as error:
        raise LogUnreadable(f"{path}: cannot be read ({error.strerror or error})") from error
    except ValueError as error:  # a NUL in the name
        raise UsageError(f"{str(path)!r}: no name of a file ({error})") from None
    if len(content) > largest:
        raise _too_large(path, largest)
    return content


def _too_large(path: Path, largest: int) -> UsageError:
    return UsageError(f"{path}: larger than {largest / 1e6:,.0f} MB, which no such file is")


def text_of(path: Path, largest: int = MAX_SETTINGS_BYTES) -> str:
    """The text of a file, with or without a byte order mark. Errors as of :func:`bytes_of`, and UsageError where it
    is no UTF-8."""
    try:
        return bytes_of(path, largest).decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise UsageError(f"{path}: no UTF-8 text at byte {error.start}") from error


def toml_of(text: str, path: Path) -> dict[str, Any]:
    """The values of a TOML text, which ``path`` names in messages. UsageError with line and column."""
    import tomllib

    try:
        return tomllib.loads(text)
    except RecursionError:
        raise UsageError(f"{path}: not valid TOML: nested too deeply") from None
    except ValueError as error:  # also what tomllib leaves to Python: numbers of thousands of digits, dates in year 0
        raise UsageError(f"{path}: not valid TOML: {error}") from error
