"""The public names: there at once, complete, and light until used."""

import inspect
import subprocess
import sys
from dataclasses import fields
from importlib import import_module
from pathlib import Path

import pytest

import attlog
from attlog.pipeline.config import Options


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
    assert room != "attlog" or all(getattr(module, name).__name__.rpartition(".")[2] == name for name in module.__all__)
    with pytest.raises(AttributeError, match="nothing_of_that_name"):
        module.nothing_of_that_name  # noqa: B018


def test_a_mistyped_public_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(AttributeError, match="no attribute 'analyse'; did you mean analyze"):
        attlog.analyse  # type: ignore[attr-defined]  # noqa: B018
    assert not hasattr(attlog, "__wrapped__")


def test_completion_shows_the_public_names_and_nothing_of_how_they_are_imported() -> None:
    assert set(dir(attlog)) == {*attlog.__all__, "__version__"}
    code = "import attlog; from attlog.rotation import to_euler; print(attlog.rotation.to_euler is to_euler)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "True"


def test_the_keywords_of_an_analysis_are_the_options_of_its_configuration() -> None:
    assert list(Options.__annotations__) == [field.name for field in fields(attlog.Config)]
    log = Path(__file__).parents[1] / "sample_logs" / "px4_steps.ulg"
    case = attlog.prepare(log, {"reference": "onboard", "score_from": 20}, reference="none", estimators=["gyro"])
    assert (case.reference.kind, case.settings["score_from"], case.settings["estimators"]) == ("none", 20, ["gyro"])
    with pytest.raises(attlog.UsageError, match="did you mean estimators"):
        attlog.analyze(log, estimator=["gyro"])  # type: ignore[call-arg]
    with pytest.raises(attlog.UsageError, match="not str"):
        attlog.analyze(log, "gyro")  # type: ignore[arg-type]


@pytest.mark.parametrize("name", attlog.__all__)
def test_help_tells_what_each_public_name_does_and_shows_no_address(name: str) -> None:
    told = getattr(attlog, name)
    assert len(inspect.getdoc(told) or "") > 100
    if callable(told) and not issubclass(told if isinstance(told, type) else str, Exception):
        assert " object at 0x" not in str(inspect.signature(told))


@pytest.mark.parametrize("name", ["read", "analyze", "prepare", "evaluate", "estimate", "compare_attitude"])
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
from attlog import (
    Aids, AttitudeComparison, Config, Estimate, FlightLog, Measurements, Result, analyze, compare_attitude, estimate,
    evaluate, place, prepare, read, rotation,
)
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
assert_type(analyze(log, estimators=["mahony"], reference="onboard", signals="none"), Result)
assert_type(result.windows, list[str])
assert_type(result.row("mahony"), attlog.EstimatorRow)
assert_type(estimate("mahony", log), Estimate)
assert_type(estimate("mahony", prepare(log)).q, NDArray[np.float64])
error = compare_attitude(log, log.imus[0].gyro.t, rotation.from_euler(0.0, 0.0, log.imus[0].gyro.t))
assert_type(error, AttitudeComparison)
assert_type(error.ape["tilt"].rmse, float)
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
