"""Words of a command line that are taken as they were typed: text, paths, and what was not given at all.

Typer asks pydantic about each parameter, given or not. To import it and have it asked is a fifth of the time of
``attlog info``; numbers, and paths that may not be read, still go that way.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints


class AsTyped:
    """A Typer command or group whose parameters pass what needs no check."""

    def get_params(self, ctx: Any) -> list[Any]:
        found: list[Any] = super().get_params(ctx)  # type: ignore[misc]
        new = [parameter for parameter in found if "process_value" not in vars(parameter)]
        hints = get_type_hints(self.callback) if new else {}  # type: ignore[attr-defined]
        for parameter in new:
            made = WORDS.get(_item(hints.get(parameter.name)))
            parameter.process_value = partial(_processed, parameter, parameter.process_value, made)
        return found


def _item(hint: Any) -> Any:
    """The type of a value, or of each of a list, where it may be None as well."""
    others = [kind for kind in get_args(hint) if kind is not NoneType]
    return _item(others[0]) if len(others) == 1 or get_origin(hint) is list else hint


def _processed(
    parameter: Any, by_typer: Callable[..., Any], made: Callable[[str], Any] | None, context: Any, value: Any
) -> Any:
    """The value that the command gets."""
    many = parameter.multiple or parameter.nargs == -1
    if value is None and not parameter.required:
        found: Any = () if many else None
    elif isinstance(value, (bool, int, float, Path)):  # a flag, a count or a default
        found = value
    elif made is None or not value:
        return by_typer(context, value)
    else:
        words = value if many else (value,)
        items = tuple(made(word) if type(word) is str else None for word in words)
        if None in items:
            return by_typer(context, value)
        found = items if many else items[0]
    return found if parameter.callback is None else parameter.callback(context, parameter, found)


def _path(word: str) -> Path | None:
    """None where Typer may have something to say of a path."""
    return Path(word) if not os.path.lexists(word) or os.access(word, os.R_OK) else None


WORDS: dict[Any, Callable[[str], Any]] = {str: str, Path: _path}
