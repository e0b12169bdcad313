"""A filter from a file runs in a process of its own: whatever it does, this one goes on and says what happened."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import attlog
from attlog import estimators
from attlog.core import workers
from attlog.core.errors import PluginError, PluginTimeout, UsageError
from attlog.estimators import Estimate, LogFacts, LogInfo, plugins
from attlog.estimators.batch import estimate_batch
from attlog.estimators.registry import from_file, load_here
from tests.conftest import few

pytestmark = pytest.mark.usefixtures("interruptible")

HOW = {
    "raise": "raise ValueError('no good')",
    "exit": "sys.exit(4)",
    "end": "os._exit(3)",
    "abort": "os.abort()",
    "crash": "ctypes.string_at(0)",
    "kill": "os.kill(os.getpid(), signal.SIGKILL)",
    "recurse": "deep(0)",
    "overflow": "ctypes.memset(ctypes.addressof(ctypes.create_string_buffer(8)), 255, 1 << 30)",
    "fill": "np.ones(1 << 36)",
    "ask": "input()",
    "nonsense": "return 'an estimate'",
    "complex": "return attlog.estimators.Estimate(t, np.full((len(t), 4), 1j))",
    "words": "return attlog.estimators.Estimate(t, np.full((len(t), 4), 'a'))",
    "bias": "return attlog.estimators.Estimate(t, np.ones((len(t), 4)), bias=np.zeros((2, 3)))",
    "aux": "return attlog.estimators.Estimate(t, np.ones((len(t), 4)), aux={'sigma_tilt': np.zeros(3)})",
    "counts": "return attlog.estimators.Estimate(t, np.ones((len(t), 4)), skipped={'x': 'some'})",
    "talk": "raise ValueError('x' * 3_000_000)",
    "spoil": "[os.write(f, b'\\xff' * 64) for f in range(3, 64) if is_socket(f)]",
    "mute": "raise Mute",
    "strange": "return attlog.estimators.Estimate(t, np.zeros((len(t), 4)), quality={'x': lambda: 0})",
}
WHOLE = """import ctypes, os, signal, stat, sys
import numpy as np
import attlog.estimators
print("at import")
os.system("echo from a shell")

def deep(n):
    return deep(n + 1) + 1

def is_socket(f):
    try:
        return stat.S_ISSOCK(os.fstat(f).st_mode)
    except OSError:
        return False

class Mute(Exception):
    def __str__(self):
        raise RuntimeError

PARAMETERS = (attlog.estimators.Parameter("how", "well", "", 0, 1, "what it does", "test", ("well", {names})),)
def run(t, gyr, acc, mag, aids, params):
    print("in run", flush=True)
    how = params["how"]
    if how == "well":
        return attlog.estimators.Estimate(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)))
    if how == "loop":
        while True:
            pass
{branches}
"""
BROKEN = {
    "pickle.dumps = None; pickle.loads = None": "",
    "sys.stdout = sys.stderr = None": "",
    "os.chdir('/'); os.environ.clear(); sys.path.clear(); np.seterr(all='raise')": "",
    "os.closerange(3, 64)": "cannot answer any more",
    "sys.modules.clear()": "cannot answer any more",
}
STEPPING = '''"""Gyro alone."""
import numpy as np
from attlog.estimators import Parameter
from attlog.estimators.vectors import turn
PARAMETERS = (Parameter("scale", 1.0, "", 0, 2, "of the rates", "test"),)
def from_log(params, info):
    return {"scale": params.get("SCALE", 1.0)}
def start(params, acc, mag, q0):
    return q0.copy()
def step(state, params, dt, gyr, acc, mag):
    if acc[0] > 100.0:
        raise ValueError("beyond")
    turn(state, params[0] * gyr[0], params[0] * gyr[1], params[0] * gyr[2], dt, 0.0)
'''
T = 0.01 * np.arange(200)
GYR = np.tile([0.1, 0.2, 0.3], (200, 1))
ACC = np.tile([0.0, 0.0, -9.8], (200, 1))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plug") / "whole.py"
    branches = "\n".join(f"    if how == {name!r}:\n        {body}" for name, body in HOW.items())
    path.write_text(WHOLE.format(names=", ".join(map(repr, [*HOW, "loop"])), branches=branches))
    return path


@pytest.fixture(scope="module")
def stepping(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plug") / "stepping.py"
    path.write_text(STEPPING)
    return path


def run(path: Path, how: str = "well") -> Estimate:
    return estimators.estimate(f"{path}:how={how}", T, GYR, ACC)


SAYS = {
    "raise": "ValueError: no good",
    "exit": "SystemExit",
    "end": "exit status 3",
    "abort": "SIGABRT",
    "crash": "SIGSEGV",
    "kill": "signal 9",
    "recurse": "RecursionError",
    "fill": "emoryError",
    "ask": "EOFError",
    "complex": "complex128",
    "words": "<U1",
    "bias": "(2, 3)",
    "aux": "'sigma_tilt' has shape (3,)",
    "counts": "skipped must be",
    "talk": "(3000000 letters)",
    "spoil": "nonsense",
    "mute": "cannot be had",
    "nonsense": "must return",
    "strange": "quality must be",
}


@pytest.mark.skipif(sys.platform != "linux", reason="limits and signals as Linux knows them")
@pytest.mark.parametrize("how", few(HOW, 5))
def test_whatever_a_file_does_is_an_error_of_that_filter(whole: Path, how: str) -> None:
    with pytest.raises(PluginError) as told:
        run(whole, how)
    assert str(whole) in str(told.value)
    assert SAYS.get(how, "") in str(told.value)
    if how == "raise":
        line = WHOLE.format(names="", branches="").count("\n") + 1
        assert f"line {line}:" in str(told.value)


def test_it_serves_again_after_it_died(whole: Path) -> None:
    with pytest.raises(PluginError):
        run(whole, "end")
    assert len(run(whole).q) == 200


@pytest.mark.slow
def test_what_a_file_prints_goes_to_standard_error(whole: Path, capfd: pytest.CaptureFixture[str]) -> None:
    os.utime(whole)  # loaded again
    run(whole)
    out, err = capfd.readouterr()
    assert out == ""
    assert err.splitlines() == ["at import", "from a shell", "in run"]


@pytest.mark.slow
def test_an_endless_one_is_ended_and_not_tried_again(whole: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.utime(whole)
    row = estimators.parse(f"{whole}:how=loop")
    monkeypatch.setenv(plugins.TIMEOUT_VARIABLE, "0.5")
    with pytest.raises(PluginTimeout, match=r"took longer than 0\.5 s"):
        estimators.estimate(row, T, GYR, ACC)
    began = time.monotonic()
    with pytest.raises(PluginTimeout):
        estimators.estimate(row, T, GYR, ACC)
    assert time.monotonic() - began < 0.2
    os.utime(whole)


@pytest.mark.slow
def test_what_a_compiled_step_raises_has_file_and_line(stepping: Path) -> None:
    acc = ACC.copy()
    acc[100, 0] = 101.0
    with pytest.raises(
        PluginError,
        match=rf"stepping\.py, line {STEPPING[: STEPPING.index('raise')].count(chr(10)) + 1}: ValueError: beyond",
    ):
        estimators.estimate(str(stepping), T, GYR, acc)


def test_results_are_those_of_this_process_to_the_bit(stepping: Path) -> None:
    here, there = from_file(stepping), estimators.get(str(stepping))
    assert (here.process, there.process is None) == (None, False)
    for sampling in ("interval", "instant"):
        one, other = (estimators.estimate(e, T, GYR, ACC, sampling=sampling, scale=0.9) for e in (here, there))
        assert np.array_equal(one.q, other.q)
        assert np.array_equal(one.t, other.t)
    sets = [{"scale": 0.8}, {"scale": 1.1}]
    for one, other in zip(
        estimate_batch(here, sets, T, GYR, ACC), estimate_batch(there, sets, T, GYR, ACC), strict=True
    ):
        assert np.array_equal(one.q, other.q)
    facts = LogFacts({"SCALE": 1.5}, LogInfo())
    assert there.resolve(log=facts) == here.resolve(log=facts)
    assert there.resolve(log=facts)["scale"] == (1.5, "log")


def test_a_file_that_never_loads_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "slow.py").write_text("import time\ntime.sleep(100)\n")
    monkeypatch.setenv(plugins.TIMEOUT_VARIABLE, "0.3")
    with pytest.raises(PluginTimeout):
        estimators.get(str(tmp_path / "slow.py"))


def test_built_in_filters_start_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError("a process")

    monkeypatch.setattr(workers.subprocess, "Popen", forbidden)
    assert estimators.estimate("gyro", T, GYR, ACC).q.shape == (200, 4)


@pytest.mark.parametrize("code", few(BROKEN, 1))
def test_what_a_file_breaks_is_its_own(tmp_path: Path, capfd: pytest.CaptureFixture[str], code: str) -> None:
    path = tmp_path / "breaks.py"
    path.write_text(f"import os, pickle, sys\n{STEPPING.replace('return q0', f'{code}; return q0')}")
    before = (os.getcwd(), dict(os.environ), list(sys.path), np.geterr())
    if BROKEN[code]:
        with pytest.raises(PluginError, match=BROKEN[code]):
            estimators.estimate(str(path), T, GYR, ACC)
    else:
        assert len(estimators.estimate(str(path), T, GYR, ACC).q) == 200
    assert (os.getcwd(), dict(os.environ), list(sys.path), np.geterr()) == before
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("state", few(["q0 * 1j", "[1.0, None, 0.0, 0.0]", "'abcd'", "None"], 1))
def test_a_start_that_is_no_real_state_is_refused(tmp_path: Path, state: str) -> None:
    path = tmp_path / "starts.py"
    path.write_text(STEPPING.replace("return q0.copy()", f"return {state}"))
    with pytest.raises(PluginError, match=r"start returns .* where real numbers are wanted"):
        estimators.estimate(str(path), T, GYR, ACC)


@pytest.mark.parametrize("values", few(["{'scale': 1j}", "{'scale': [1]}", "{1: 2}", "{'scale': 10**400}", "None"], 2))
def test_values_from_a_log_that_are_no_numbers_are_told(tmp_path: Path, values: str) -> None:
    path = tmp_path / "values.py"
    path.write_text(STEPPING.replace('{"scale": params.get("SCALE", 1.0)}', values))
    with pytest.raises(PluginError, match="values") as told:
        estimators.get(str(path)).resolve(log=LogFacts({}, LogInfo()))
    assert len(str(told.value)) < 300


def test_a_file_called_like_a_built_in_filter_is_a_row_of_its_own(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mahony.py").write_text(STEPPING)
    mine, other = tmp_path / "a" / "mahony.py", tmp_path / "b" / "mahony.py"
    assert [row.name for row in estimators.select(f"mahony,{mine},{mine}")] == ["mahony", "mahony.py"]
    with pytest.raises(UsageError, match=r"both called mahony\.py; rename one"):
        estimators.select(f"{mine},{other}")


LATER = """import time
from attlog.estimators import estimate
NEEDS, USES = {"gyro", "acc"}, {"mag"}
calls = []

def run(t, gyr, acc, mag, aids, params):
    calls.append(len(t))
    if len(calls) == 2:
        time.sleep(30)
    return estimate("mahony", t, gyr, acc, mag)
"""


@pytest.mark.slow
def test_a_filter_that_hangs_when_a_metric_tries_it_costs_a_sentence_and_not_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "later.py"
    file.write_text(LATER)
    monkeypatch.setenv(plugins.TIMEOUT_VARIABLE, "3")
    log = Path(__file__).parents[2] / "sample_logs" / "copter_yaw_turns.bin"
    result = attlog.analyze(log, {"estimators": ["gyro", str(file)]})
    row = next(r for r in result.estimators if r.name == "later")
    assert row.status == "ok"
    assert next(p.text for p in result.findings if p.kind == "estimator_timed_out").startswith("later: in a later run")


STARTING = """
import os, pathlib, subprocess, sys, time
import numpy as np
import attlog.estimators
CHOICES = ("answer", "die", "loop")
PARAMETERS = (attlog.estimators.Parameter("how", "answer", "", 0, 1, "what it does", "test", CHOICES),)
def run(t, gyr, acc, mag, aids, params):
    child = subprocess.Popen(["sleep", "60"])
    pathlib.Path(__file__).with_suffix(".pid").write_text(str(child.pid))
    if params["how"] == "die":
        os._exit(3)
    while params["how"] == "loop":
        pass
    return attlog.estimators.Estimate(t, np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1)))
"""


def lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] != "Z"


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="no process groups")
@pytest.mark.parametrize("how", few(["answer", "die", "loop"], 1))
def test_what_a_filter_starts_ends_with_its_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str) -> None:
    monkeypatch.setenv(plugins.TIMEOUT_VARIABLE, "2")
    path = tmp_path / f"starting_{how}.py"
    path.write_text(STARTING)
    filter_ = plugins.from_file(path, load_here)
    assert filter_.process is not None
    if how == "answer":
        run(path, how)
        assert lives(int(path.with_suffix(".pid").read_text())), "it may be needed for the next run"
        filter_.process.end()
    else:
        with pytest.raises(PluginError):
            run(path, how)
    pid = int(path.with_suffix(".pid").read_text())
    until = time.monotonic() + 5.0
    while lives(pid) and time.monotonic() < until:
        time.sleep(0.02)
    assert not lives(pid)
