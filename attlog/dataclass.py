"""Dataclasses as Python's own, at a fifth of what it costs to define them.

Python writes, compiles and runs the text of up to seven methods for each class, 0.3 to 0.5 ms in a program that
starts: 60 ms of a short ``analyze``, which defines 150 of them, an eighth of an ``info``. Here the text of ``__init__``
alone is compiled; the other methods are closures over the names of the fields, alike for every class. Fields,
``replace``, ``fields``, ``asdict``, defaults, ``__post_init__``, slots, ``match`` and what Python refuses are Python's.
Left out because nothing here needs it: ``order`` (taken from Python as it is) and ``InitVar``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any


class _NotGiven:
    """The default of an argument whose value a factory makes, shown by ``help`` as Python's own dataclasses do."""

    def __repr__(self) -> str:
        return "<factory>"


NOT_GIVEN = _NotGiven()


def lean(
    kind: type | None = None, /, *, frozen: bool = False, eq: bool = True, order: bool = False, **how: bool
) -> Any:
    """A class decorator with the arguments and the meaning of ``dataclasses.dataclass``."""
    if kind is None:
        return lambda kind: lean(kind, frozen=frozen, eq=eq, order=order, **how)
    if order:
        return dataclasses.dataclass(frozen=frozen, eq=eq, order=order, **how)(kind)
    made: Any = dataclasses.dataclass(init=False, repr=False, eq=False, **how)(kind)
    fields = dataclasses.fields(made)
    methods: dict[str, Any] = {"__init__": _initialiser(made, fields, frozen), "__repr__": _shown}
    compared = _of([f.name for f in fields if f.compare])
    if eq:
        methods["__eq__"] = _equality(compared)
        methods["__hash__"] = (lambda self: hash(compared(self))) if frozen else None
    if frozen:
        methods |= {"__setattr__": _refuse, "__delattr__": _refuse}
        methods |= {"__getstate__": _state, "__setstate__": _restore} if how.get("slots") else {}
    own = vars(made)
    for name, method in methods.items():
        if name not in own or (name == "__hash__" and own[name] is None):
            setattr(made, name, method)
    return made


if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:
    dataclass = lean


def _initialiser(kind: type, fields: tuple[dataclasses.Field[Any], ...], frozen: bool) -> Any:
    """``__init__`` of a class: an argument for each field, kept under its name."""
    scope: dict[str, Any] = {"_NOT_GIVEN": NOT_GIVEN, "_SET": object.__setattr__, "__name__": kind.__module__}
    words, lines = ["self"], []
    for field in sorted(fields, key=lambda field: bool(field.kw_only)):
        name = word = value = field.name
        if field.default_factory is not dataclasses.MISSING:
            scope["_MAKE_" + name] = field.default_factory
            value = f"_MAKE_{name}() if {name} is _NOT_GIVEN else {name}" if field.init else f"_MAKE_{name}()"
            word = f"{name}=_NOT_GIVEN"
        elif field.default is not dataclasses.MISSING:
            scope["_DEFAULT_" + name] = field.default
            value = name if field.init else f"_DEFAULT_{name}"
            word = f"{name}=_DEFAULT_{name}"
        if field.kw_only and "*" not in words:
            words.append("*")
        if field.init:
            words.append(word)
        if field.init or value is not name:
            lines.append(f" _SET(self, {name!r}, {value})" if frozen else f" self.{name} = {value}")
    if hasattr(kind, "__post_init__"):
        lines.append(" self.__post_init__()")
    exec(f"def __init__({', '.join(words)}):\n" + ("\n".join(lines) or " pass"), scope)
    made = scope["__init__"]
    made.__qualname__ = f"{kind.__qualname__}.__init__"
    made.__annotations__ = {f.name: f.type for f in fields if f.init} | {"return": None}
    return made


def _of(names: list[str]) -> Callable[[object], Any]:
    """What gives the values of an object's fields as a tuple."""
    if len(names) > 1:
        return attrgetter(*names)
    return lambda value: tuple(getattr(value, name) for name in names)


def _equality(compared: Callable[[object], Any]) -> Callable[[object, object], Any]:
    def equal(self: object, other: object) -> Any:
        return compared(self) == compared(other) if type(other) is type(self) else NotImplemented

    return equal


@recursive_repr()
def _shown(self: Any) -> str:
    values = ", ".join(f"{f.name}={getattr(self, f.name)!r}" for f in dataclasses.fields(self) if f.repr)
    return f"{type(self).__qualname__}({values})"


def _refuse(self: object, name: str, *value: object) -> None:
    raise dataclasses.FrozenInstanceError(f"cannot {'assign to' if value else 'delete'} field {name!r}")


def _state(self: Any) -> dict[str, Any]:
    return {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}


def _restore(self: object, state: dict[str, Any]) -> None:
    for name, value in state.items():
        object.__setattr__(self, name, value)
