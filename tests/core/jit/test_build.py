"""What is compiled when the package is built: which kernels, for which wheel, and what a failure costs."""

from __future__ import annotations

import ast
import contextlib
import importlib
import importlib.util
import inspect
import io
import json
import os
import platform
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.core.jit import build, compile, store
from attlog.core.jit.compile import at_hand
from attlog.core.jit.kernel import Kernel
from tests.conftest import SAMPLES, few

ROOT = Path(attlog.__file__).parent.parent
KERNELS = {k.name: k for k in build.kernels()}


@pytest.fixture
def hook() -> Any:
    """The build hook as a module, without building anything."""
    pytest.importorskip("hatchling")
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def building(hook: Any, target: str = "wheel") -> tuple[Any, dict[str, Any], list[str]]:
    """A hook that builds a target, what it tells the builder, and its warnings."""
    warnings: list[str] = []
    made = hook.BundleHook.__new__(hook.BundleHook)
    for name, value in {
        "_BuildHookInterface__root": str(ROOT),
        "_BuildHookInterface__target_name": target,
        "_BuildHookInterface__app": SimpleNamespace(display_warning=warnings.append),
    }.items():
        setattr(made, name, value)
    return made, {"artifacts": [], "pure_python": True}, warnings


def test_a_wheel_with_kernels_is_for_one_system_and_every_python(hook: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bool] = []
    monkeypatch.setenv("ATTLOG_BUNDLE", "full")
    monkeypatch.setattr(hook, "compile_kernels", lambda root, editable: asked.append(editable))
    made, data, warnings = building(hook)
    made.initialize("standard", data)
    assert (asked, warnings, data["pure_python"]) == ([False], [], False)
    assert data["tag"] == f"py3-none-{hook.system()}"
    assert data["tag"].endswith(platform.machine().lower())
    assert any("kernels/objects" in a for a in data["artifacts"])
    assert any("numba" in d for d in made.dependencies())


def test_an_editable_install_compiles_for_its_machine_and_an_sdist_nothing(
    hook: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[bool] = []
    monkeypatch.setenv("ATTLOG_BUNDLE", "full")
    monkeypatch.setattr(hook, "compile_kernels", lambda root, editable: asked.append(editable))
    made, data, _ = building(hook)
    made.initialize("editable", data)
    assert asked == [True]
    assert "tag" not in data
    sdist, data, _ = building(hook, "sdist")
    sdist.initialize("standard", data)
    assert asked == [True]
    assert (data["artifacts"], sdist.dependencies()) == ([], [])


def test_without_a_compiler_the_install_succeeds_and_says_what_is_left_out(
    hook: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> None:
        raise RuntimeError("no numba here")

    monkeypatch.setenv("ATTLOG_BUNDLE", "full")
    monkeypatch.setattr(hook, "run", fails)
    made, data, warnings = building(hook)
    made.initialize("standard", data)
    assert data == {"artifacts": [], "pure_python": True}
    assert "no numba here" in warnings[0]
    monkeypatch.setenv("ATTLOG_KERNELS", "none")
    made.initialize("standard", data)
    assert len(warnings) == 1
    assert made.dependencies() == []
    monkeypatch.setenv("ATTLOG_KERNELS", "all")
    with pytest.raises(RuntimeError, match="no numba here"):
        made.initialize("standard", data)


@pytest.mark.slow
def test_objects_of_each_level_are_written_found_and_agree_to_the_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One kernel of sums of products, which a compiler that contracts would compute otherwise, as the hook makes it."""
    chosen = "simulate filtered"
    code = (
        "import sys; from attlog import prebuilt; every = list(prebuilt.kernels());"
        f"prebuilt.kernels = lambda: iter([k for k in every if k.name == {chosen!r}]); prebuilt.main()"
    )
    for level in store.levels():
        command = [sys.executable, "-c", code, str(tmp_path), "--share", "0", "1", "--all"]
        environment = {**os.environ, build.LEVEL: level}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        assert done.stdout == f"{build.MADE} {chosen}\n"
    keys = {store.sources_state(KERNELS[chosen].sources): {chosen: store.key_of(KERNELS[chosen])}}
    (tmp_path / store.INDEX).write_text(json.dumps({"format": store.FORMAT, "keys": keys}))
    monkeypatch.setattr(store, "SHIPPED", tmp_path)
    monkeypatch.setattr(store, "folder", lambda: None)
    monkeypatch.setattr(compile, "made_object", lambda *_: pytest.fail("compiled"))
    store._shipped.cache_clear()
    noise, found = np.random.default_rng(0).standard_normal((500, 3)), set()
    try:
        for level in list(store.levels()):
            (file,) = tmp_path.glob(f"{store.machine()}-{level}/*.o")
            assert file.stat().st_mode & 0o444 == 0o444
            monkeypatch.setattr(store, "levels", lambda level=level: (level,))
            assert store.known_key(KERNELS[chosen]) == file.stem
            function, out = at_hand(KERNELS[chosen]), np.zeros((500, 3))
            assert function is not None
            function(noise, 0.97, out)
            found.add(out.tobytes())
    finally:
        store._shipped.cache_clear()
    assert len(found) == 1
    assert out.any()


@pytest.mark.slow
def test_two_builds_go_through_sets_in_the_same_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else two wheels of one source differ in some bytes: code of ``px4_q`` did for one of five hash seeds."""
    told: list[dict[str, str]] = []

    class Compiler(subprocess.Popen[bytes]):
        def __init__(self, command: list[str], env: dict[str, str], **how: Any) -> None:
            told.append(env)
            super().__init__([sys.executable, "-c", ""], env=env, **how)

    monkeypatch.setattr(build.subprocess, "Popen", Compiler)
    monkeypatch.setenv("PYTHONHASHSEED", "17")
    build.build(tmp_path, store.portable(), every=False)
    assert {env["PYTHONHASHSEED"] for env in told} == {"0"}
    assert {env[build.LEVEL] for env in told} == set(store.portable())


def test_a_build_counts_what_it_makes_and_keeps_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of two kernels one is asked for first: the second build makes the other, the third nothing."""
    two = [KERNELS["simulate filtered"], KERNELS["segments summed_gyro"]]
    monkeypatch.setattr(build, "kernels", lambda: iter(two))
    monkeypatch.setattr(build, "of_defaults", lambda: iter(two[1:]))

    def here(command: list[str], **how: Any) -> Any:
        monkeypatch.setenv(build.LEVEL, how["env"][build.LEVEL])
        part, parts = map(int, command[command.index("--share") + 1 :][:2])
        capsys.readouterr()
        build.compile_share(build._place(tmp_path, store.levels()[0]), part, parts, "--all" in command)
        said = SimpleNamespace(stdout=capsys.readouterr().out.splitlines(True), stderr=io.StringIO(), returncode=0)
        return contextlib.nullcontext(said)

    monkeypatch.setattr(build.os, "cpu_count", lambda: 1)
    monkeypatch.setattr(build.subprocess, "Popen", here)
    made = []
    for every in (False, True, True):
        build.build(tmp_path, store.levels()[:1], every)
        files = {file.stem for file in tmp_path.glob("*/*.o")}
        index = json.loads((tmp_path / store.INDEX).read_text())["keys"]
        assert {key for found in index.values() for key in found.values()} == files
        made.append((len(files), capsys.readouterr().out.strip()))
    assert made == [(1, "1"), (2, "1"), (2, "")]


@pytest.mark.slow
@pytest.mark.parametrize("log", few(["px4_hover.ulg", "copter_steps_stabilize.tlog", "copter_yaw_turns.bin"], 1))
def test_an_analysis_with_defaults_runs_only_kernels_that_were_made_for_it(
    log: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a fresh process, since one that runs knows its kernels already."""
    code = (
        "import sys; from attlog.core.jit import obtain, calling; load, names = calling.load, set();"
        "calling.load = lambda kernel, *more: (names.add(kernel.name), load(kernel, *more))[1];"
        "import attlog; attlog.analyze(sys.argv[1]); print(*sorted(names), sep='\\n')"
    )
    done = subprocess.run([sys.executable, "-c", code, str(SAMPLES / log)], capture_output=True, text=True, check=True)
    ran = set(done.stdout.splitlines())
    assert {"loop attlog.estimators.filters.mekf 4 9 True False", "navigation forward"} <= ran
    assert ran <= {kernel.name for kernel in build.of_defaults()}


def test_the_shipped_index_tells_what_the_sources_say() -> None:
    """Where objects were built for just these sources, each name leads to the kernel's present text."""
    known = {k.name: store._shipped().get(store.sources_state(k.sources), {}).get(k.name) for k in KERNELS.values()}
    if not any(known.values()):
        pytest.skip("no objects were built from these sources")
    assert {name: key for name, key in known.items() if key} == {
        name: store.key_of(KERNELS[name]) for name, key in known.items() if key
    }


def below(module: ModuleType) -> set[Path]:
    """The files of the package that a module imports, with those that they import."""
    found: set[Path] = set()
    waiting = [module.__name__]
    while waiting:
        name = waiting.pop()
        try:
            file = Path(str(importlib.import_module(name).__file__))
        except ModuleNotFoundError:
            continue  # a function, not a module
        if file in found:
            continue
        found.add(file)
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("attlog"):
                waiting += [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
    return found


@pytest.mark.parametrize("name", [n for n in KERNELS if n.startswith(("loop attlog.estimators.filters.m", "navig"))])
def test_every_file_that_a_kernel_may_depend_on_is_watched(name: str) -> None:
    kernel = KERNELS[name]
    module = importlib.import_module(name.split()[1] if name.startswith("loop") else owner(kernel))
    watched = set(store._files(kernel.sources))
    package = {store.PACKAGE / "__init__.py"}  # defines nothing that a kernel uses
    assert {p.resolve() for p in below(module)} - watched - package == set()


def owner(kernel: Kernel) -> str:
    file = {"ahead": "turns", "chain": "turns"}.get(kernel.entry, kernel.entry)
    return f"attlog.estimators.filters.navigation.{file}"


def test_the_kernels_of_all_built_in_filters_are_built() -> None:
    from attlog.estimators import get
    from attlog.estimators.registry import BUILT_IN

    stepping = {get(n).step for n in BUILT_IN if get(n).step is not None}
    built = {name.split()[1] for name in KERNELS if name.startswith("loop")}
    assert {inspect.getmodule(step).__name__ for step in stepping} == built  # type: ignore[union-attr]


@pytest.mark.slow
@pytest.mark.parametrize("name", KERNELS)
def test_every_kernel_of_the_package_runs_without_numba(name: str, caplog: pytest.LogCaptureFixture) -> None:
    compile.obtained(KERNELS[name])
    assert "cannot run without numba" not in caplog.text
    assert at_hand(KERNELS[name]) is not None
