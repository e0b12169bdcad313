"""What a file that is not attlog's did wrong, as an error that names its line."""

from __future__ import annotations

import os
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from attlog.base.errors import AttlogError, PluginError
from attlog.base.limits import MAX_ERROR_LETTERS


def broken(where: str, error: BaseException) -> PluginError:
    """A PluginError that names the innermost line of the plug-in file ``where`` that led to ``error``."""
    if isinstance(error, SyntaxError) and error.lineno is not None:
        return PluginError(f"{error.filename or where}, line {error.lineno}: {error.msg}")
    lines = [
        f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename in (where, os.path.abspath(where))
    ]
    at = f"{where}, line {lines[-1]}" if lines else where
    return PluginError(f"{at}: {type(error).__name__}: {_words(error)}{_moved(error)}")


def _words(error: BaseException) -> str:
    """What an exception of a file says: it may say anything, at any length, or fail to."""
    try:
        said = str(error)
    except Exception:
        return "its own words cannot be had"
    return said if len(said) <= MAX_ERROR_LETTERS else f"{said[:MAX_ERROR_LETTERS]}... ({len(said)} letters)"


def _moved(error: BaseException) -> str:
    """The remedy where a file imports a module of this package from where an older version had it."""
    name = (error.name or "") if isinstance(error, ModuleNotFoundError) else ""
    if not name.startswith("attlog."):
        return ""
    package = Path(__file__).parents[1]
    found = sorted(package.rglob(f"{name.rpartition('.')[2]}.py"))
    if not found:
        return "; this version of attlog has no such module (attlog new writes a file that fits it)"
    here = ".".join(("attlog", *found[0].relative_to(package).with_suffix("").parts))
    return f"; in this version of attlog it is {here}"


@contextmanager
def plugin_errors(origin: str) -> Iterator[None]:
    """Whatever code of ``origin`` raises inside becomes a PluginError with file and line; our own errors stay."""
    try:
        yield
    except AttlogError:
        raise
    except Exception as error:
        if origin == "attlog":
            raise
        raise broken(origin, error) from error
