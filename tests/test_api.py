"""The public names: there at once, complete, and light until used."""

import inspect
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import attlog


def test_the_public_names_are_listed_before_their_first_use_and_import_nothing() -> None:
    code = (
        "import sys, attlog\n"
        "assert {'AttlogError', 'Config', 'Result', 'analyze', 'estimate', 'read'} <= set(dir(attlog))\n"
        "print(sorted({'numpy', 'pydantic', 'numba', 'pandas', 'attlog.pipeline'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("room", ["attlog", "attlog.estimators", "attlog.metrics"])
def test_every_public_name_is_there_and_no_other(room: str) -> None:
    """Those that are imported late too."""
    module = import_module(room)
    assert all(getattr(module, name) is not None for name in module.__all__)
    assert set(module.__all__) <= set(dir(module))
    assert room != "attlog" or all(getattr(module, name).__name__ == name for name in module.__all__)
    with pytest.raises(AttributeError, match="nothing_of_that_name"):
        module.nothing_of_that_name  # noqa: B018


@pytest.mark.parametrize("name", attlog.__all__)
def test_help_tells_what_each_public_name_does_and_shows_no_address(name: str) -> None:
    told = getattr(attlog, name)
    assert len(inspect.getdoc(told) or "") > 100
    if name != "AttlogError":
        assert " object at 0x" not in str(inspect.signature(told))


@pytest.mark.parametrize("name", ["read", "analyze", "prepare", "evaluate", "estimate"])
def test_help_of_a_public_function_tells_every_argument_and_what_goes_wrong(name: str) -> None:
    function = getattr(attlog, name)
    told = inspect.getdoc(function) or ""
    arguments = [p for p in inspect.signature(function).parameters if p != "config"]
    assert [p for p in arguments if f"``{p}``" not in told] == []
    assert "config" not in inspect.signature(function).parameters or "mapping" in told
    assert "UsageError" in told


PROGRAM = """
from typing import assert_type

import numpy as np
from numpy.typing import NDArray

import attlog
from attlog import Aids, Config, Result, analyze, estimate, evaluate, prepare, read
from attlog.estimators import Estimate, Measurements, place
from attlog.flight.model import FlightLog
from attlog.simulate.fly import fly
from attlog.simulate.scenario import Scenario, load_scenario
from attlog.testing import check_estimator

log = read("x.ulg", imu=0)
assert_type(log, FlightLog)
assert_type(log.imus[0].gyro.x, NDArray[np.float64])
result = analyze(log, {"estimators": ["default"], "score_from": 20})
assert_type(result, Result)
assert_type(result.verdicts[0].sentence, str)
assert_type(result.to_json(), str)
result.table("airborne").to_csv("x.csv")
row = evaluate(prepare(log, Config(reference="onboard")), ["mahony:kp=0.3"], only=["lag_ms"]).estimators[0]
assert_type(row.metrics["all"]["lag_ms"].value, float | None)
assert_type(row.metrics["all"]["lag_ms"].ci95, tuple[float, float] | None)
t = np.arange(0.0, 10.0, 0.01)
found = estimate("mahony", t, np.zeros((1000, 3)), np.zeros((1000, 3)), aids=Aids(baro=Measurements(t, t)), kp=0.5)
assert_type(found, Estimate)
assert_type(found.q, NDArray[np.float64])
assert_type(place(t, t[::4], found.q[::4, :3]), NDArray[np.float64])
assert_type(load_scenario("hover").changed(seconds=20.0), Scenario)
assert_type(fly(load_scenario("hover")).truth.q, NDArray[np.float64])
print([outcome.name for outcome in check_estimator("mahony")], attlog.__version__)
try:
    read("none")
except attlog.AttlogError as error:
    assert_type(error.exit_code, int)
"""


@pytest.mark.slow
def test_a_typed_program_passes_a_strict_checker_and_knows_every_type(tmp_path: Path) -> None:
    """``py.typed`` promises it; ``assert_type`` refuses what has silently become Any."""
    api = pytest.importorskip("mypy.api")
    (tmp_path / "program.py").write_text(PROGRAM)
    cache = ["--cache-dir", str(tmp_path / "cache")]
    told, wrong, code = api.run(["--strict", "--follow-imports=silent", *cache, str(tmp_path / "program.py")])
    assert (code, wrong) == (0, ""), told
