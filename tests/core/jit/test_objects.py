"""Kernels as object code: kept, found, checked, called without the compiler, and never stale."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from attlog.core.jit import call, compile, store
from attlog.core.jit import kernel as generate
from attlog.core.jit.call import Call, bound
from attlog.core.jit.compile import at_hand, by_numba, made_object, obtained
from attlog.core.jit.kernel import LINE, Kernel
from tests.conftest import ROOT, few

TEXT = """
def total(x, weights, n, negative):
    s = {start}
    for i in range(n):
        s += x[i] * weights[i, 0] + math.sin(x[i])
    x[0] = s
    return -s if negative else s
"""
SIGNATURE = "f8(f8[::1], i4[:, ::1], i8, b1)"


def kernel(start: float = 0.0, **changed: Any) -> Kernel:
    told = {"name": "total", "entry": "total", "text": lambda: TEXT.format(start=start), "signature": SIGNATURE}
    return Kernel(**{**told, "what": "a sum", **changed})


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A user's cache folder of its own, and no shipped objects."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(store, "SHIPPED", tmp_path / "none")
    forget()
    yield tmp_path
    forget()


@pytest.fixture(scope="module")
def made() -> store.Object:
    """The object of ``kernel()``, compiled once for all tests of this file."""
    return made_object(kernel(), store.key_of(kernel()))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, made: store.Object) -> list[str]:
    """Compiling is told, and done before."""
    told: list[str] = []

    def compiled(kernel: Kernel, key: str) -> store.Object:
        told.append(key)
        return made

    monkeypatch.setattr(compile, "made_object", compiled)
    return told


def forget() -> None:
    """What a new process knows."""
    for known in (store.folder, store.sources_state, store._digest, store._shipped):
        known.cache_clear()


def objects(home: Path) -> list[Path]:
    return sorted(home.rglob("*.o"))


def args(n: int = 5) -> tuple[Any, ...]:
    return np.arange(1.0, n + 1.0), np.full((n, 1), 2, np.int32), n, False


def expected(n: int = 5) -> float:
    x = np.arange(1.0, n + 1.0)
    return float(2.0 * x.sum() + np.sin(x).sum())


def test_an_object_gives_what_numba_gives_to_the_bit(home: Path) -> None:
    function = obtained(kernel())
    x = args()
    assert function(*x) == by_numba(kernel())(*args()) == pytest.approx(expected(), rel=1e-15)
    assert x[0][0] == function(*args())  # what it writes arrives
    assert function(*args()[:3], True) == -function(*args())


def test_the_same_text_gives_the_same_bytes(made: store.Object) -> None:
    assert made_object(kernel(), store.key_of(kernel())) == made


def test_whole_numbers_reach_a_function_as_one_kind_of_argument() -> None:
    """numba would compile ``nth`` for 0, for 2 and for a number that is not known: three times instead of once."""
    text = generate.with_helpers({"chosen": chosen}, jit=True)
    assert "nth(x, np.int64(0)) + nth(x, np.int64(LAST)) + nth(x, n)" in text
    assert "x[2]" in text  # an index is no argument


LAST = 2


def nth(x: Any, i: int) -> float:
    return float(x[i])


def chosen(x: Any, n: int) -> float:
    return nth(x, 0) + nth(x, LAST) + nth(x, n) + float(x[2])


def test_it_is_kept_and_found_again(home: Path, quick: list[str]) -> None:
    assert at_hand(kernel()) is None
    obtained(kernel())
    (kept,) = objects(home)
    before = kept.stat().st_ino
    again = at_hand(kernel())
    assert again is not None
    assert again(*args()) == pytest.approx(expected())
    assert kept.stat().st_ino == before
    assert len(quick) == 1


def test_other_text_is_another_object(home: Path) -> None:
    obtained(kernel())
    assert at_hand(kernel(1.0)) is None
    assert obtained(kernel(1.0))(*args()) == pytest.approx(expected() + 1.0)
    assert len(objects(home)) == 2


@pytest.mark.parametrize("damage", ["truncated", "a bit", "empty", "text", "longer"])
def test_a_damaged_object_is_never_loaded_and_made_anew(home: Path, quick: list[str], damage: str) -> None:
    obtained(kernel())
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
    assert at_hand(kernel()) is None
    assert obtained(kernel())(*args()) == pytest.approx(expected())
    assert file.read_bytes() == whole


@pytest.mark.parametrize(
    "wrong",
    [
        (np.arange(5.0, dtype=np.float32), *args()[1:]),
        (np.arange(10.0)[::2], *args()[1:]),
        (np.zeros((5, 1)), *args()[1:]),
        (list(range(5)), *args()[1:]),
        (args()[0], np.zeros((5, 1), np.int64), 5, False),
        (np.frombuffer(bytes(40)), *args()[1:]),  # the kernel writes it
        args()[:3],
        (*args()[:2], "five", False),
    ],
    ids=["kind", "stride", "dimensions", "list", "integers", "read only", "too few", "word"],
)
def test_what_does_not_fit_is_refused_before_the_call(home: Path, quick: list[str], wrong: tuple[Any, ...]) -> None:
    with pytest.raises((TypeError, Exception), match=r"must be an array|takes 4 arguments|wrong type"):
        obtained(kernel())(*wrong)


def test_read_only_arrays_and_scratch(home: Path) -> None:
    text = (
        "def f(data, n, out, room):\n    room[1] += n\n    for i in range(n):\n        out[i] = data[i] + room[0]\n"
        "    return room[1]\n"
    )
    told = {"entry": "f", "text": lambda: text, "signature": "f8((u1[::1]), i8, i8[::1])", "scratch": (("f8", (2,)),)}
    function, out = obtained(kernel(**told)), np.zeros(3, np.int64)
    data = np.frombuffer(b"abc", np.uint8)
    assert [function(data, 3, out), function(data, 3, out)] == [3.0, 3.0]  # scratch is zero at every call
    assert bytes(out.astype(np.uint8)) == b"abc"
    assert by_numba(kernel(**told))(data, 3, out) == 3.0


def test_a_bound_kernel_reads_its_arrays_anew_at_each_call_and_takes_numbers_in_their_order(home: Path) -> None:
    weights = np.arange(6, dtype=np.int32).reshape(3, 2)
    for function in (obtained(kernel()), by_numba(kernel())):
        x = np.ones(3)
        call = bound(function, x, weights, ..., ...)
        for n, negative in ((3, 1), (1, 0), (2, 1)):
            x[:] = n, 0.5, -1.0
            expected = sum(float(weights[i, 0]) * x[i] + np.sin(x[i]) for i in range(n))
            assert call(n, negative) == pytest.approx(-expected if negative else expected, rel=1e-14)
        with pytest.raises(ValueError, match="zip"):
            call(3)


def test_to_bind_what_does_not_fit_is_refused(home: Path) -> None:
    x, weights = np.ones(3), np.ones((3, 2), np.int32)
    for wrong in ((x[::-1], weights, ..., 0), (..., weights, 3, 0), (x, weights.astype(float), 3, 0), (x, weights, 3)):
        with pytest.raises(TypeError, match="argument"):
            bound(obtained(kernel()), *wrong)


def test_each_thread_has_scratch_of_its_own(home: Path) -> None:
    told = kernel(entry="f", signature="void(i8)", scratch=(("f8", (2,)), ("i8", (3, 4))))
    call = Call(told, lambda number, *places: seen[number].append(places), None)
    seen: dict[int, list[tuple[int, ...]]] = {0: [], 1: []}
    with ThreadPoolExecutor(1) as other:
        for _ in range(2):
            call(0)
            other.submit(call, 1).result()
    first, second = seen.values()
    assert first[0] == first[1]
    assert second[0] == second[1]
    assert {first[0][0], first[0][2]}.isdisjoint({second[0][0], second[0][2]})
    assert [p % LINE for p in (first[0][0], first[0][2])] == [0, 0]
    assert (first[0][1], *first[0][3:]) == (2, 3, 4)


@pytest.mark.parametrize(
    ("line", "why"),
    few(
        [
            ("x = np.zeros(n)", "NRT|numba|Py"),
            ("if n < 0:\n        raise ValueError", "NRT|numba|Py"),
            ("print(n)", "NRT|numba|Py"),
        ],
        1,
    ),
)
def test_what_needs_numba_when_it_runs_stays_with_numba_and_says_so(
    home: Path, line: str, why: str, caplog: pytest.LogCaptureFixture
) -> None:
    text = f"def f(x, n):\n    {line}\n    return x[0] + n\n"
    told = kernel(entry="f", text=lambda: text, signature="f8(f8[::1], i8)")
    with pytest.raises(compile.NeedsNumba, match=why):
        compile.emit(told, "f_")
    assert obtained(told)(np.ones(3), 3) == by_numba(told)(np.ones(3), 3)
    assert "cannot run without numba" in caplog.text


def test_only_the_c_library_may_be_called() -> None:
    assert compile.needed(["llvm.sin.f64", "memset", "llvm.sqrt.f64", "llvm.memcpy.p0.p0.i64"]) == (
        "memcpy",
        "memset",
        "sin",
    )
    for foreign in ("NRT_Allocate", "numba_gil_ensure", "PyErr_SetString", "llvm.sin.v4f64", "llvm.pow.f32", "system"):
        with pytest.raises(compile.NeedsNumba, match=foreign):
            compile.needed([foreign])


def from_file(file: Path) -> Kernel:
    return kernel(text=file.read_text, sources=(file.name,))


def test_changed_source_is_never_answered_with_an_old_kernel(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = home / "loop.py"
    monkeypatch.setattr(store, "PACKAGE", home)
    file.write_text(TEXT.format(start=0.0))
    os.utime(file, (1, 1))
    assert obtained(from_file(file))(*args()) == pytest.approx(expected())
    assert store.known_key(from_file(file)) == store.key_of(from_file(file))
    forget()
    file.write_text(TEXT.format(start=7.0))
    os.utime(file, (1, 1))  # as old as before, and of the same size
    assert obtained(from_file(file))(*args()) == pytest.approx(expected() + 7.0)


def test_nothing_is_learnt_of_a_file_that_changed_while_the_process_ran(
    home: Path, quick: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = home / "loop.py"
    monkeypatch.setattr(store, "PACKAGE", home)
    file.write_text(TEXT.format(start=0.0))
    obtained(from_file(file))
    assert store.known_key(from_file(file)) is None


@pytest.mark.parametrize("content", ["", "0" * 32, "0" * 32 + " " + "1" * 64, "../../etc x"])
def test_a_damaged_note_is_not_believed(
    home: Path, quick: list[str], monkeypatch: pytest.MonkeyPatch, content: str
) -> None:
    file = home / "loop.py"
    monkeypatch.setattr(store, "PACKAGE", home)
    file.write_text(TEXT.format(start=0.0))
    os.utime(file, (1, 1))
    obtained(from_file(file))
    (note,) = home.rglob("n_*")
    note.write_text(content)
    assert obtained(from_file(file))(*args()) == pytest.approx(expected())
    assert store.known_key(from_file(file)) == store.key_of(from_file(file))


def test_objects_of_a_level_that_this_processor_lacks_are_passed_over(
    home: Path, quick: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    obtained(kernel())
    (own,) = objects(home)
    key = store.key_of(kernel())
    for level in ("x86-64-v3", "x86-64-v2"):
        place = home / "shipped" / f"{store.machine()}-{level}"
        place.mkdir(parents=True)
        (place / f"{key}.o").write_bytes(store.Object(level, (), b"code").packed())
    own.unlink()
    monkeypatch.setattr(store, "SHIPPED", home / "shipped")
    for levels, found in ((("x86-64-v3", "x86-64-v2"), "x86-64-v3"), (("x86-64-v2",), "x86-64-v2"), ((), None)):
        monkeypatch.setattr(store, "levels", lambda levels=levels: levels)
        chosen = store.find(key)
        assert (chosen and chosen.symbol) == found


@pytest.mark.slow
def test_the_second_process_needs_no_compiler(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom attlog.estimators import get\nfrom attlog.estimators.engine import loop\n"
        "from attlog.kernels import store\nfrom pathlib import Path\nstore.SHIPPED = Path('none')\n"
        "loop.kernel(get('gyro'))\nprint('numba' in sys.modules)"
    )
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "HOME": str(tmp_path), "LOCALAPPDATA": str(tmp_path)}
    environment.pop("ATTLOG_NO_JIT", None)
    told = [
        subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    ]
    assert [t.strip() for t in told] == ["True", "False"]


@pytest.mark.slow
def test_processes_may_compile_the_same_kernel_at_once(home: Path) -> None:
    code = (
        "import numpy as np, attlog; from pathlib import Path; from attlog.kernels import store;"
        "store.SHIPPED = Path('none'); e = attlog.estimate('gyro', np.arange(9) / 100, np.ones((9, 3)));"
        "print(repr(float(e.q[-1, 0])))"
    )
    running = [subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) for _ in range(4)]
    told = {p.communicate()[0] for p in running}
    assert [p.returncode for p in running] == [0, 0, 0, 0]
    assert len(told) == 1
    assert len(objects(home)) == 1


# The bird in the mine: a release of numba that breaks how kernels become object code is named in one sentence.

CANARY_TEXT = """
def running(x, gain, out, work):
    for i in range(len(x)):
        work[0] += gain * (math.sin(x[i]) - work[0])
        out[i] = work[0]
    return len(x)
"""
CANARY = Kernel("running", "running", lambda: CANARY_TEXT, "i8((f8[::1]), f8, f8[::1])", "a mean", (), (("f8", (1,)),))


def broken(step: str, error: object) -> str:
    return (
        f"numba {numba.__version__} broke how attlog makes object code ({step}: {error}); "
        "lower the bound of numba in pyproject.toml and hatch_build.py until attlog/kernels/emit.py is mended"
    )


def run_as_object_code() -> None:
    """One kernel through each step of the path; a failure names the release and the step."""
    x, out, step = np.linspace(0.0, 3.0, 20), np.zeros(20), ""
    try:
        step = "numba.cfunc"
        compiled = compile.cfunc(CANARY)
        step = "inspect_llvm"
        text = compiled.inspect_llvm()
        step = "object file"
        code, needs = compile.objectified(text, "canary_of_attlog")
        step = "call"
        count = call.load(CANARY, code, "canary_of_attlog")(x, 0.5, out)
    except Exception as error:
        pytest.fail(broken(step, f"{type(error).__name__}: {error}"))
    mean, expected = 0.0, []
    for value in np.sin(x):
        mean += 0.5 * (value - mean)
        expected.append(mean)
    if count != 20 or not np.allclose(out, expected, rtol=1e-12, atol=0.0) or not set(needs) <= {"sin"}:
        pytest.fail(broken("call", f"{count} numbers, calls {needs}, the last {out[-1]} for {expected[-1]}"))


def test_this_release_of_numba_still_makes_object_code() -> None:
    run_as_object_code()


@pytest.mark.parametrize(("name", "step"), [("cfunc", "numba.cfunc"), ("objectified", "object file")])
def test_a_release_that_breaks_the_path_is_named_with_the_step(
    name: str, step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(*_: Any) -> None:
        raise AttributeError("no such thing any more")

    monkeypatch.setattr(numba, "__version__", "9.87")
    monkeypatch.setattr(compile, name, gone)
    with pytest.raises(pytest.fail.Exception, match=rf"numba 9\.87 broke .*{step}: AttributeError: no such"):
        run_as_object_code()


def test_only_releases_of_numba_that_were_tried_are_installed() -> None:
    """The bound stands in two files, since the build needs numba before the package is there."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (needed,) = [d for d in project["dependencies"] if d.startswith("numba")]
    assert f'"{needed}"' in (ROOT / "hatch_build.py").read_text(encoding="utf-8")
    bound = re.search(r"<(\d+)\.(\d+)$", needed)
    assert bound is not None
    assert tuple(map(int, numba.__version__.split(".")[:2])) < tuple(map(int, bound.groups()))
