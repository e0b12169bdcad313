"""Dataclasses as plain JSON values, and back: the types of the fields are the contract, checked on the way in."""

from __future__ import annotations

import dataclasses
import functools
import math
import types
import typing
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")
Build = Callable[[Any], Any]

IN_JSON = "json"
"""A field that stays out of the document says so: ``field(metadata={IN_JSON: False})``."""
DIGITS = "digits"
"""A field of numbers that are written with so many digits says so: ``field(metadata={DIGITS: 6})``."""
OLDER = "*"
"""Among the keys that may lack: unknown ones may be there."""


def plain(value: Any) -> Any:
    """Dataclasses, arrays and numpy scalars as JSON types; non-finite numbers become None."""
    kind: Any = type(value)
    if kind is float:
        return value if math.isfinite(value) else None
    if kind in AS_THEY_ARE:
        return value
    if kind is dict:
        return {str(k): v if type(v) in AS_THEY_ARE else plain(v) for k, v in value.items()}
    if kind is list or kind is tuple:
        return [v if type(v) in AS_THEY_ARE else plain(v) for v in value]
    written = _written(kind)
    if written is None:
        return _less_common(value)
    document = {}
    for name, digits in written:
        item = getattr(value, name)
        if type(item) not in AS_THEY_ARE:
            item = plain(item) if digits is None else _rounded(plain(item), digits)
        document[name] = item
    return document


AS_THEY_ARE = frozenset((str, int, bool, type(None)))


@functools.cache
def _written(kind: type) -> tuple[tuple[str, int | None], ...] | None:
    """The fields of a dataclass that its document has, each with its digits; None for other types."""
    if not dataclasses.is_dataclass(kind):
        return None
    return tuple((f.name, f.metadata.get(DIGITS)) for f in dataclasses.fields(kind) if f.metadata.get(IN_JSON, True))


def _less_common(value: Any) -> Any:
    """What remains: sets, arrays, numpy's scalars, subclasses of plain types; anything else as its text."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(v) for v in (sorted(value) if isinstance(value, (set, frozenset)) else value)]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return str(value)


def _rounded(value: Any, digits: int | None) -> Any:
    """A plain value, or the numbers of a list with so many digits."""
    return value if digits is None else [None if v is None else float(f"{v:.{digits}g}") for v in value]


def without(value: Any, keys: tuple[str, ...]) -> Any:
    """The document with the named keys left out at every level."""
    if isinstance(value, dict):
        return {k: without(v, keys) for k, v in value.items() if k not in keys}
    if isinstance(value, list):
        return [without(v, keys) for v in value]
    return value


class Misfit(ValueError):
    """A plain value that is not what the field's type says; ``place`` names it from the top of the document."""

    def __init__(self, what: str, place: str = "") -> None:
        super().__init__(what)
        self.what, self.place = what, place

    def __str__(self) -> str:
        return f"{self.place.lstrip('.') or 'the document'}: {self.what}"

    def within(self, place: str) -> Misfit:
        """The same misfit, seen from one level up."""
        return Misfit(self.what, place + self.place)


def restored(cls: type[T], value: Any, *, may_lack: tuple[str, ...] = (), older: bool = False) -> T:
    """The dataclass that :func:`plain` made ``value`` of.

    Misfit where a key is missing, unknown or of another type. Keys with a default may lack (fields are added), and the
    keys ``may_lack`` at every level, which become None. A null for a number is NaN. ``older``: a version with other
    fields wrote it, so that unknown keys are left out.
    """
    build: Build = _dataclass(typing.cast(type, cls), (*may_lack, OLDER) if older else may_lack)
    found: T = build(value)
    return found


@functools.cache
def _builder(hint: Any, may_lack: tuple[str, ...]) -> Build:
    """What checks a plain value and makes it an instance of a type; made once for each type."""
    if hint is Any:
        return _as_it_is
    if hint is float:
        return _number
    if hint in (int, str, bool):
        return functools.partial(_exactly, hint)
    if dataclasses.is_dataclass(hint):
        return _dataclass(typing.cast(type, hint), may_lack)
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if hasattr(origin, "__value__"):  # ``type X[T] = ...``, as numpy 2.5 says NDArray where Python knows how (3.12)
        return _builder(origin.__value__[args], may_lack)
    if origin in (typing.Union, types.UnionType):
        others = tuple(_builder(a, may_lack) for a in args if a is not types.NoneType)
        return functools.partial(_one_of, others, types.NoneType in args)
    if origin is typing.Literal:
        return functools.partial(_word, args)
    if origin is np.ndarray:
        number: Any = typing.get_args(args[1])[0]
        one = functools.partial(_exactly, int) if np.issubdtype(number, np.integer) else _number
        return functools.partial(_array, functools.partial(_list, one), number)
    if origin is list:
        return functools.partial(_list, _builder(args[0], may_lack))
    if origin is tuple:
        return functools.partial(_tuple, tuple(_builder(a, may_lack) for a in args))
    if origin is dict and args[0] is str:
        return functools.partial(_dict, _builder(args[1], may_lack))
    raise TypeError(f"{hint} is no type of a JSON document")


@functools.cache
def _dataclass(cls: type, may_lack: tuple[str, ...]) -> Build:
    hints = typing.get_type_hints(cls)
    names = [f.name for f in dataclasses.fields(cls) if f.metadata.get(IN_JSON, True)]
    builders = {name: _builder(hints[name], may_lack) for name in names}
    has_default = {
        f.name
        for f in dataclasses.fields(cls)
        if f.default is not dataclasses.MISSING or f.default_factory is not dataclasses.MISSING
    }
    optional = set(may_lack)

    def build(value: Any) -> Any:
        if not isinstance(value, dict):
            raise Misfit(f"{_kind(value)} instead of an object")
        if value.keys() - builders.keys() and OLDER not in optional:
            raise Misfit("unknown key", f".{min(value.keys() - builders.keys())}")
        found = {}
        for name, make in builders.items():
            if name in value:
                try:
                    found[name] = make(value[name])
                except Misfit as misfit:
                    raise misfit.within(f".{name}") from None
            elif name in has_default:
                continue
            elif name not in optional:
                raise Misfit("is missing", f".{name}")
            else:
                found[name] = None
        try:
            return cls(**found)
        except ValueError as error:
            raise Misfit(str(error)) from None

    return build


def _as_it_is(value: Any) -> Any:
    return value


def _number(value: Any) -> Any:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise Misfit(f"{_kind(value)} instead of a number")
    return value


def _exactly(kind: type, value: Any) -> Any:
    if type(value) is not kind:
        raise Misfit(f"{_kind(value)} instead of {WORDS[kind]}")
    return value


def _one_of(others: tuple[Build, ...], may_be_none: bool, value: Any) -> Any:
    if value is None and may_be_none:
        return None
    misfits = []
    for make in others:
        try:
            return make(value)
        except Misfit as misfit:
            misfits.append(misfit)
    raise misfits[0] if len(misfits) == 1 else Misfit(" and ".join(m.what for m in misfits), misfits[0].place)


def _word(words: tuple[Any, ...], value: Any) -> Any:
    if value not in words:
        raise Misfit(f"{value!r} instead of one of {', '.join(map(repr, words))}")
    return value


def _array(items: Build, number: Any, value: Any) -> Any:
    return np.asarray(items(value), number)


def _list(make: Build, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise Misfit(f"{_kind(value)} instead of a list")
    return [_at(make, item, f"[{k}]") for k, item in enumerate(value)]


def _tuple(makes: tuple[Build, ...], value: Any) -> tuple[Any, ...]:
    if not isinstance(value, list) or len(value) != len(makes):
        raise Misfit(f"{_kind(value)} instead of a list of {len(makes)}")
    return tuple(_at(make, item, f"[{k}]") for k, (make, item) in enumerate(zip(makes, value, strict=True)))


def _dict(make: Build, value: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise Misfit(f"{_kind(value)} instead of an object")
    return {key: _at(make, item, f".{key}") for key, item in value.items()}


def _at(make: Build, value: Any, place: str) -> Any:
    try:
        return make(value)
    except Misfit as misfit:
        raise misfit.within(place) from None


WORDS: dict[type, str] = {
    type(None): "null",
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "a text",
    list: "a list",
    dict: "an object",
}


def _kind(value: Any) -> str:
    return WORDS.get(type(value), type(value).__name__)
