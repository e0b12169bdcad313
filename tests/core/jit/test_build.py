"""What is compiled when the package is built: which loops, for which wheel, and what a failure costs."""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import attlog
from attlog.batch.sources import Source
from attlog.cli.progress import compile_first
from attlog.core.jit import build, compile, store
from attlog.core.jit.loops import Loop
from attlog.estimators import get
from attlog.estimators.registry import BUILT_IN
from attlog.estimators.run import loop_of
from tests.conftest import SAMPLES, few

ROOT = Path(attlog.__file__).parent.parent
WIND = "attlog.simulate.environment:filtered"


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


def filtered_noise() -> np.ndarray[Any, Any]:
    """What a short loop makes of noise: sums of products, which a compiler that contracts would compute otherwise."""
    from attlog.simulate.environment import filtered

    out = np.zeros((500, 3))
    Loop(filtered.function, "wind")(np.random.default_rng(0).standard_normal((500, 3)), 0.97, out)
    return out


@pytest.mark.slow
def test_objects_of_each_level_are_written_found_and_agree_to_the_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    places = {store.place_of_level(tmp_path, level): level for level in store.levels()}
    build.compile_all(places, [WIND], lambda *_: None)
    monkeypatch.setattr(store, "SHIPPED", tmp_path)
    monkeypatch.setattr(store, "own_place", lambda: None)
    monkeypatch.setattr(compile, "object_code", lambda *_: pytest.fail("compiled"))
    found = set()
    for level in list(store.levels()):
        (file,) = store.place_of_level(tmp_path, level).glob("*.o")
        assert file.stat().st_mode & 0o444 == 0o444
        monkeypatch.setattr(store, "levels", lambda level=level: (level,))
        found.add(filtered_noise().tobytes())
    assert len(found) == 1


def test_a_build_counts_what_it_makes_keeps_what_is_there_and_drops_what_is_old(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of two loops one is asked for first: the second build makes the other, the third nothing."""
    two = [WIND, "attlog.segments.increments:sum_gyro"]
    monkeypatch.setattr(build, "all_names", lambda: two)
    monkeypatch.setattr(build, "object_code", lambda loop: store.ObjectCode(loop.name, (), b"code"))

    def here(places: dict[Path, str], names: list[str], progress: Any) -> None:
        build.compile_share(next(iter(places)), names, 0o644)
        progress(len(names), len(names))

    monkeypatch.setattr(build, "compile_all", here)
    made = []
    for chosen in (two[1:], two, two):
        build.build(tmp_path, store.levels()[:1], chosen)
        made.append(len(list(tmp_path.glob("*/*.o"))))
    said = capsys.readouterr().out
    assert made == [1, 2, 2]
    assert said.count("compiling 1 loops of filters, readers and metrics, about") == 2
    old = next(iter(tmp_path.glob("*/*.o"))).with_name("old.o")
    old.write_bytes(b"")
    build.build(tmp_path, store.levels()[:1], two)
    assert not old.exists()


def test_a_first_run_says_how_much_it_compiles_and_compiles_it_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(store, "own_place", lambda: tmp_path)
    monkeypatch.setattr(store, "SHIPPED", tmp_path / "none")
    asked: list[list[str]] = []
    monkeypatch.setattr(build, "compile_all", lambda places, names, progress: asked.append(names))
    names = build.names_for(["gyro", "mekf"])
    with caplog.at_level("INFO", "attlog.compiling"):
        build.prepare(names, lambda *_: None)
        build.prepare([WIND], lambda *_: None)
    assert asked == [names]
    assert caplog.text.count(f"compiling {len(names)} loops, once, about ") == 1


def test_before_a_first_run_the_filter_that_flew_is_compiled_for_its_logs_alone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[set[str]] = []
    monkeypatch.setattr(build, "prepare", lambda names, progress: asked.append(set(names)))
    ekf2, ekf3 = "attlog.estimators.ekf2.loop:run_filter", "attlog.estimators.ekf3.loop:run_filter"
    for rows, logs in ((["default"], ["a.ulg"]), (["all"], ["b.BIN", "c.ulg.gz"]), (["mekf"], ["a.ulg"])):
        sources = [Source(str(tmp_path / log)) for log in logs]
        before = len(asked)
        compile_first(rows, sources, True)
        assert len(asked) == before, "logs that are missing need no loops"
        for source in sources:
            Path(source.place).touch()
        monkeypatch.setattr(store, "is_shipped", lambda: False)
        compile_first(rows, sources, True)
        monkeypatch.setattr(store, "is_shipped", lambda: True)
        compile_first(rows, sources, True)
        for source in sources:
            Path(source.place).unlink()
    assert [names & {ekf2, ekf3} for names in asked] == [{ekf2}, {ekf2}, {ekf2, ekf3}, {ekf2, ekf3}, set()]
    assert {ekf2, ekf3} <= set(build.default_names())


@pytest.mark.parametrize("log", few(["px4_hover.ulg", "copter_steps_stabilize.tlog", "copter_yaw_turns.bin"], 1))
@pytest.mark.slow
def test_an_analysis_with_defaults_runs_only_loops_that_were_made_for_it(log: str) -> None:
    """In a fresh process, since one that runs knows its loops already."""
    code = (
        "import sys; from attlog.core.jit import compile; load, keys = compile.load, set();"
        "compile.load = lambda loop, found: (keys.add(loop.key), load(loop, found))[1];"
        "import attlog; attlog.analyze(sys.argv[1]); print(*sorted(keys), sep='\\n')"
    )
    done = subprocess.run([sys.executable, "-c", code, str(SAMPLES / log)], capture_output=True, text=True, check=True)
    ran, known = set(done.stdout.split()), {build.loop_by_name(name).key: name for name in build.default_names()}
    assert ran <= set(known)
    assert {"filter:mekf", "attlog.estimators.filters.navigation.forward:forward"} <= {known[key] for key in ran}


def test_every_loop_of_the_package_is_built() -> None:
    """Also of every filter with a step: whoever adds a loop adds its module to the list."""
    found = set()
    for module in pkgutil.walk_packages(attlog.__path__, "attlog."):
        if "__main__" not in module.name:
            own = vars(importlib.import_module(module.name)).items()
            found |= {x.key for name, x in own if isinstance(x, Loop) and x.name == f"{module.name}.{name}"}
    found |= {loop_of(get(name)).key for name in BUILT_IN if get(name).step is not None}
    assert {build.loop_by_name(name).key for name in build.all_names()} == found


@pytest.mark.slow
@pytest.mark.parametrize("name", build.all_names())
def test_every_loop_of_the_package_runs_without_numba(name: str, caplog: pytest.LogCaptureFixture) -> None:
    loop = build.loop_by_name(name)
    loop.compiled()
    assert "compiled at every start" not in caplog.text
    assert compile.at_hand(loop) is not None
