"""A filter in C through ctypes, as docs/filter_in_c shows it: as steps, and as whole segments."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog.estimators import get, not_compiled
from attlog.estimators.engine.batch import estimate_batch
from attlog.testing import about, check_estimator, swing

EXAMPLE = Path(__file__).parents[2] / "docs" / "filter_in_c"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library, built, with ``steps.py`` and ``segments.py`` beside it."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    made = tmp_path_factory.mktemp("c")
    for name in ("complementary.c", "steps.py", "segments.py"):
        shutil.copy(EXAMPLE / name, made)
    arguments = ["-O2", "-Wall", "-Werror", "-shared", "-fPIC", "complementary.c", "-o", "complementary.so", "-lm"]
    subprocess.run([compiler, *arguments], cwd=made, check=True)
    return made


@pytest.mark.parametrize(
    "name", [pytest.param("steps.py", marks=pytest.mark.slow), pytest.param("segments.py", marks=pytest.mark.slow)]
)
def test_a_filter_in_c_passes_every_check(folder: Path, name: str) -> None:
    failed = [f"{o.name}: {o.message}" for o in check_estimator(str(folder / name)) if not o.passed]
    assert not failed


@pytest.mark.slow
def test_both_forms_give_what_the_same_filter_gives_in_python(folder: Path) -> None:
    m = swing(10.0)
    wanted = attlog.estimate("mahony:kp=0.6,ki=0", *m.sensors, q0=m.q[0])
    steps = attlog.estimate(str(folder / "steps.py"), *m.sensors, q0=m.q[0])
    assert np.abs(steps.q - wanted.q).max() < 1e-9
    whole = attlog.estimate(str(folder / "segments.py"), *m.sensors)
    again = attlog.estimate("mahony:kp=0.6,ki=0,init=first", *m.sensors)
    assert np.abs(whole.q - again.q).max() < 1e-9


def test_a_step_in_c_is_told_to_be_slow_and_why(folder: Path) -> None:
    steps, whole = get(str(folder / "steps.py")), get(str(folder / "segments.py"))
    assert "update" in not_compiled(steps)
    assert not_compiled(whole) == ""
    assert not_compiled(get("mahony")) == ""
    assert "plain Python" in about(steps)[0]
    assert "whole segments" in about(whole)[0]
    assert about("mahony") == []


def test_a_batch_of_a_step_in_c_equals_runs_one_by_one(folder: Path) -> None:
    m = swing(2.0)
    steps = get(str(folder / "steps.py"))
    for one, kp in zip(estimate_batch(steps, [{"kp": 0.5}, {"kp": 2.0}], *m.sensors), (0.5, 2.0), strict=True):
        assert np.array_equal(one.q, attlog.estimate(steps, *m.sensors, kp=kp).q)


def test_an_analysis_says_that_a_step_in_c_is_slow(folder: Path) -> None:
    log = Path(__file__).parents[2] / "sample_logs" / "copter_yaw_turns.bin"
    result = attlog.analyze(log, {"estimators": ["gyro", *(str(folder / n) for n in ("steps.py", "segments.py"))]})
    notes = [p.text for p in result.findings if p.kind == "estimator_not_compiled"]
    assert len(notes) == 1
    assert notes[0].startswith("steps: its step runs in plain Python")
    assert {r.name: r.status for r in result.estimators}["steps"] == "ok"
