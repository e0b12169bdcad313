"""Loops as machine code: their signature, key and text, what is kept, found, checked, and never stale."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from attlog.core import jit
from attlog.core.errors import PluginError
from attlog.core.jit import compile, loops, store
from attlog.core.jit.loops import Cells, Group, Loop, with_constants, with_globals
from tests.conftest import few

FACTOR = 2.0


class Pair(NamedTuple):
    """Two arrays."""

    x: jit.Out1
    weights: jit.F2


def weighted(pair: Any, i: int, offset: int) -> float:
    """Return a product."""
    return float(FACTOR * pair.x[i] * pair.weights[i, offset])


@jit.loop("a sum")
def total(pair: Pair, n: int, negative: bool, start: float) -> float:
    """Return the sum of the products, sines and ``start``."""
    s = start
    for i in range(n):
        s += weighted(pair, i, 0) + math.sin(pair.x[i])
    pair.x[0] = s
    return -s if negative else s


def allocates(x: jit.Out1, n: int) -> float:
    """Return a number by way of an array."""
    return float(np.zeros(n).sum() + x[0] + n)


def raises(x: jit.Out1, n: int) -> float:
    """Raise for a negative number."""
    if n < 0:
        raise ValueError
    return float(x[0] + n)


def args(n: int = 5) -> tuple[Any, ...]:
    return Pair(np.arange(1.0, n + 1.0), np.full((n, 1), 3.0)), n, False, 0.5


def expected(n: int = 5) -> float:
    x = np.arange(1.0, n + 1.0)
    return float(6.0 * x.sum() + np.sin(x).sum() + 0.5)


def fresh(function: Any = total.function, **given: Any) -> Loop[..., Any]:
    """A loop that no process has loaded yet."""
    return Loop(function, "a sum", given)


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A user's cache folder of its own, and no shipped objects."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(store, "SHIPPED", tmp_path / "none")
    store.own_place.cache_clear()
    yield tmp_path
    store.own_place.cache_clear()


@pytest.fixture(scope="module")
def made() -> store.ObjectCode:
    """The object of ``total``, compiled once for all tests of this file."""
    return compile.object_code(fresh())


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, made: store.ObjectCode) -> list[str]:
    """The keys of what would be compiled."""
    keys: list[str] = []

    def compiled(loop: Loop[..., Any]) -> store.ObjectCode:
        keys.append(loop.key)
        return made

    monkeypatch.setattr(compile, "object_code", compiled)
    return keys


def objects(home: Path) -> list[Path]:
    return sorted(home.rglob("*.o"))


def test_the_annotations_are_the_signature() -> None:
    pair = Group(Pair, (Cells("f8", 1, True), Cells("f8", 2)))
    assert total.signature == ((pair, Cells("i8", 0), Cells("b1", 0), Cells("f8", 0)), "f8")


def test_machine_code_gives_what_the_text_gives(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loop, x = fresh(), args()
    assert loop(*x) == total.function(*args()) == pytest.approx(expected(), rel=1e-15)
    assert x[0].x[0] == loop(*args())  # what it writes arrives
    assert loop(*args()[:2], True, 0.5) == -loop(*args())
    monkeypatch.setenv("ATTLOG_NO_JIT", "1")
    monkeypatch.setattr(compile, "obtain", lambda _: pytest.fail("compiled"))
    assert fresh()(*args()) == pytest.approx(expected(), rel=1e-15)


def test_the_same_text_gives_the_same_bytes(made: store.ObjectCode) -> None:
    assert compile.object_code(fresh()) == made


def test_the_key_follows_the_text_of_all_functions_and_the_constants() -> None:
    other = with_globals(weighted, {"FACTOR": 3.0})
    keys = {total.key, fresh(FACTOR=1.0).key, fresh(weighted=other).key, fresh(allocates).key}
    assert len(keys) == 3  # total itself does not use FACTOR
    assert fresh().key == total.key
    assert "FACTOR = 2.0" in total.text
    assert "def weighted" in total.text
    assert "def allocates" not in total.text


def test_a_constant_that_was_changed_is_in_the_key_of_a_new_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    before = fresh().key
    monkeypatch.setitem(weighted.__globals__, "FACTOR", 5.0)
    assert "FACTOR = 5.0" in fresh().text
    assert fresh().key != before


def test_constants_are_replaced_in_all_functions_that_a_loop_uses() -> None:
    pair = Pair(np.array([1.0, 2.0]), np.ones((2, 2)))
    other = with_constants(total.function, "total_of_three", {"FACTOR": 3.0})
    assert weighted(pair, 1, 0) == 4.0
    assert other.__globals__["weighted"](pair, 1, 0) == 6.0
    made = Loop(other, "another sum")
    assert made.name == f"{__name__}.total_of_three"
    assert made.key != total.key
    assert "FACTOR = 3.0" in made.text


def test_what_a_loop_cannot_use_is_named() -> None:
    with pytest.raises(PluginError, match="weighted, a dict; use numbers"):
        _ = fresh(weighted={}).key

    def inner(n: int) -> int:
        return n + len(captured)

    captured = [1]
    with pytest.raises(PluginError, match="outer function"):
        _ = Loop(inner, "").key


def test_it_is_kept_and_found_again(home: Path, quick: list[str]) -> None:
    assert compile.at_hand(fresh()) is None
    fresh().compiled()
    (kept,) = objects(home)
    assert kept.stat().st_mode & 0o777 == 0o600
    again = compile.at_hand(fresh())
    assert again is not None
    assert again(*args()) == pytest.approx(expected())
    assert quick == [total.key]


def test_nothing_is_kept_of_a_file_that_changed_while_the_process_ran(
    home: Path, quick: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loops, "STARTED", 0.0)
    assert fresh().compiled()(*args()) == pytest.approx(expected())
    assert objects(home) == []


@pytest.mark.parametrize("damage", ["truncated", "a bit", "empty", "text", "longer"])
def test_a_damaged_object_is_never_loaded_and_made_anew(home: Path, quick: list[str], damage: str) -> None:
    fresh().compiled()
    (file,) = objects(home)
    whole = file.read_bytes()
    middle = len(whole) // 2
    file.write_bytes(
        {
            "truncated": whole[:-100],
            "a bit": whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :],
            "empty": b"",
            "text": b"[1, 2]\nnothing",
            "longer": whole + b"\0",
        }[damage]
    )
    assert compile.at_hand(fresh()) is None
    assert fresh().compiled()(*args()) == pytest.approx(expected())
    assert file.read_bytes() == whole


X, W = np.arange(5.0), np.zeros((5, 1))


@pytest.mark.parametrize(
    "wrong",
    [
        (Pair(X.astype(np.float32), W), 5, False, 0.0),
        (Pair(np.arange(10.0)[::2], W), 5, False, 0.0),
        (Pair(X, X), 5, False, 0.0),
        (Pair(list(range(5)), W), 5, False, 0.0),
        (Pair(np.frombuffer(bytes(40)), W), 5, False, 0.0),  # the loop writes it
        ((X, W), 5, False, 0.0),
        (Pair(X, W), 5),
        (Pair(X, W), "five", False, 0.0),
    ],
    ids=["kind", "stride", "dimensions", "list", "read only", "plain tuple", "too few", "word"],
)
def test_what_does_not_fit_is_refused_before_the_call(home: Path, quick: list[str], wrong: tuple[Any, ...]) -> None:
    loop = fresh().compiled()
    with pytest.raises(Exception, match=r"contiguous array|takes 4 arguments|takes a Pair|wrong type"):
        loop(*wrong)
    with pytest.raises(Exception, match=r"contiguous array|takes 4 arguments|takes a Pair|integer"):
        loop.bound(*wrong)  # type: ignore[attr-defined]


def test_a_bound_loop_reads_its_arrays_anew_at_each_call(home: Path, quick: list[str]) -> None:
    weights = np.arange(6.0).reshape(3, 2)
    for call in (fresh().bound, total.bound):
        pair = Pair(np.ones(3), weights)
        run = call(pair, ..., ..., 0.0)
        for n, negative in ((3, 1), (1, 0), (2, 1)):
            pair.x[:] = n, 0.5, -1.0
            sum_ = sum(2.0 * float(weights[i, 0]) * pair.x[i] + np.sin(pair.x[i]) for i in range(n))
            assert run(n, negative) == pytest.approx(-sum_ if negative else sum_, rel=1e-14)
        with pytest.raises(ValueError, match="zip"):
            run(3)


@pytest.mark.parametrize("function", few([allocates, raises], 1))
def test_what_needs_numba_when_it_runs_stays_with_numba_and_says_so(
    home: Path, function: Any, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(compile.NeedsNumba, match=r"NRT|numba|Py"):
        compile.object_code(fresh(function))
    assert fresh(function)(np.ones(3), 3) == function(np.ones(3), 3)
    assert "compiled at every start" in caplog.text


def test_objects_of_a_level_that_this_processor_lacks_are_passed_over(
    home: Path, quick: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for level in ("x86-64-v3", "x86-64-v2"):
        place = store.place_of_level(home / "shipped", level)
        place.mkdir(parents=True)
        store.write(place / f"{total.key}.o", store.ObjectCode(level, (), b"code"))
    monkeypatch.setattr(store, "SHIPPED", home / "shipped")
    for levels, symbol in ((("x86-64-v3", "x86-64-v2"), "x86-64-v3"), (("x86-64-v2",), "x86-64-v2"), ((), None)):
        monkeypatch.setattr(store, "levels", lambda levels=levels: levels)
        chosen = store.find(total.key)
        assert (chosen and chosen.symbol) == symbol


@pytest.mark.slow
def test_the_second_process_needs_no_compiler_and_several_may_compile_at_once(home: Path) -> None:
    code = (
        "import sys, numpy as np, attlog; from pathlib import Path; from attlog.core.jit import store;"
        "store.SHIPPED = Path('none'); e = attlog.estimate('gyro', np.arange(9) / 100, np.ones((9, 3)));"
        "print(repr(float(e.q[-1, 0])), 'numba' in sys.modules)"
    )
    environment = {k: v for k, v in os.environ.items() if k != "ATTLOG_NO_JIT"}
    command, pipe = [sys.executable, "-c", code], subprocess.PIPE
    running = [subprocess.Popen(command, env=environment, stdout=pipe, text=True) for _ in range(3)]
    outputs = {p.communicate()[0] for p in running}
    assert [p.returncode for p in running] == [0, 0, 0]
    assert len(objects(home)) == 1
    last = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    assert {last.replace("False", "True")} == outputs
    assert last.endswith("False\n")
