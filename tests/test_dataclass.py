"""Classes of ``attlog.dataclass`` behave as those of Python, and cost less to define."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import itertools
import pickle
import time
from collections.abc import Callable
from dataclasses import field
from typing import Any

import pytest

from attlog.dataclass import dataclass, lean

Decorator = Callable[..., Any]


def point(decorator: Decorator, **how: bool) -> Any:
    @decorator(**how)
    class Point:
        """A place with names that the text of a method could be confused by."""

        default: float
        set: float = 2.0
        self_: str = field(default="x", repr=False)
        tags: list[str] = field(default_factory=list, compare=False)
        made: int = field(default=7, init=False)

        def __post_init__(self) -> None:
            object.__setattr__(self, "made", self.made + int(self.default))

    return Point


HOWS: list[dict[str, bool]] = [
    {"frozen": frozen, "slots": slots, "eq": eq} for frozen, slots, eq in itertools.product((False, True), repeat=3)
]
both = pytest.mark.parametrize("how", HOWS, ids=lambda how: " ".join(k for k, v in how.items() if v) or "plain")


@both
def test_it_shows_compares_and_hashes_as_pythons_own(how: dict[str, bool]) -> None:
    for kind in (point(lean, **how), point(dataclasses.dataclass, **how)):
        one, same, other = kind(1.0), kind(1.0, tags=["a"]), kind(1.0, 3.0)
        assert repr(one) == "point.<locals>.Point(default=1.0, set=2.0, tags=[], made=8)"
        assert (one == same, one == other, one == (1.0, 2.0, "x", 8)) == (how["eq"], False, False)
        assert one == one
        assert dataclasses.replace(one, default=4.0, tags=["b"]).made == 11
        if not how["eq"]:
            assert hash(one) == object.__hash__(one)
        elif how["frozen"]:
            assert hash(one) == hash((1.0, 2.0, "x", 8)) == hash(same)
        else:
            assert kind.__hash__ is None
        assert one.tags is not kind(1.0).tags


@both
def test_it_is_told_and_refuses_as_pythons_own(how: dict[str, bool]) -> None:
    ours, python = point(lean, **how), point(dataclasses.dataclass, **how)
    assert [(p.name, p.kind, p.annotation) for p in inspect.signature(ours).parameters.values()] == [
        (p.name, p.kind, p.annotation) for p in inspect.signature(python).parameters.values()
    ]
    assert ours.__match_args__ == python.__match_args__
    assert hasattr(ours, "__slots__") == how["slots"]
    assert [f.name for f in dataclasses.fields(ours)] == [f.name for f in dataclasses.fields(python)]
    for kind in (ours, python):
        for given in ({}, {"default": 1.0, "made": 2}, {"default": 1.0, "other": 1}):
            with pytest.raises(TypeError):
                kind(**given)
        if how["frozen"]:
            with pytest.raises(dataclasses.FrozenInstanceError, match="cannot assign to field 'set'"):
                kind(1.0).set = 3.0
            with pytest.raises(dataclasses.FrozenInstanceError, match="cannot delete field 'set'"):
                del kind(1.0).set
        else:
            moved = kind(1.0)
            moved.set = 3.0
            assert moved.set == 3.0


@dataclass(frozen=True, slots=True)
class Kept:
    """At the top of a module, so that it can be pickled."""

    name: str
    value: list[int] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Measured:
    """With one field."""

    value: float


def test_a_frozen_value_with_slots_travels_between_processes() -> None:
    kept = Kept("a", [1, 2])
    for found in (pickle.loads(pickle.dumps(kept)), copy.copy(kept), copy.deepcopy(kept)):
        assert found == kept
        assert found is not kept


def test_values_that_are_the_same_object_are_equal_as_in_a_tuple() -> None:
    nan = float("nan")
    assert Measured(nan) == Measured(nan)
    assert Measured(nan) != Measured(float("nan"))


def test_what_holds_itself_can_be_shown() -> None:
    @dataclass(slots=True)
    class Node:
        next: Any = None

    node = Node()
    node.next = node
    assert repr(node).endswith("Node(next=...)")


def test_methods_that_a_class_has_of_its_own_stay() -> None:
    @dataclass(frozen=True, slots=True)
    class Own:
        x: int

        def __repr__(self) -> str:
            return "mine"

        def __eq__(self, other: object) -> bool:
            return True

        def __hash__(self) -> int:
            return 5

    assert (repr(Own(1)), Own(1) == 3, hash(Own(1))) == ("mine", True, 5)


def test_fields_of_a_class_above_come_first() -> None:
    @dataclass(frozen=True, slots=True)
    class Above:
        x: int
        y: int = 2

    @dataclass(frozen=True, slots=True)
    class Below(Above):
        z: int = field(default=3, kw_only=True)

    assert Below(1, z=5) == Below(1, 2, z=5) != Above(1, 2)
    assert repr(Below(1)).endswith("Below(x=1, y=2, z=3)")
    with pytest.raises(TypeError):
        Below(1, 2, 5)  # type: ignore[call-arg]


def test_orders_are_pythons_own() -> None:
    @dataclass(frozen=True, order=True)
    class Ranked:
        x: int

    assert sorted([Ranked(2), Ranked(1)]) == [Ranked(1), Ranked(2)]


def test_a_default_that_all_would_share_is_refused() -> None:
    with pytest.raises(ValueError, match="mutable default"):

        @dataclass
        class Shared:
            x: list[int] = []  # noqa: RUF012


def test_a_frozen_class_is_defined_in_less_than_half_of_pythons_time() -> None:
    def seconds(decorator: Decorator) -> float:
        times = []
        for _ in range(30):
            begin = time.perf_counter()
            point(decorator, frozen=True, slots=True)
            times.append(time.perf_counter() - begin)
        return min(times)

    assert seconds(lean) < 0.5 * seconds(dataclasses.dataclass)
