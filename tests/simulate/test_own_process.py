"""A filter that is not attlog's flies in a process of its own: the same flight, and whatever it does ends there."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from attlog.base.errors import PluginError, PluginTimeout
from attlog.estimators import parse
from attlog.simulate.autopilot.pilot import make
from attlog.simulate.fly import fly
from tests.conftest import few
from tests.simulate.test_fly import everything, hop

FILE = '''"""Gyro alone."""
import os
import numpy as np
from attlog.estimators import Parameter
from attlog.estimators.engine.vectors import turn
PARAMETERS = (Parameter("scale", 1.0, "", 0, 2, "of the rates", "test"),)
print("at import")
def now():
    {now}
def start(params, acc, mag, q0):
    now()
    return q0.copy()
def step(state, params, dt, gyr, acc, mag):
    turn(state, params[0] * gyr[0], params[0] * gyr[1], params[0] * gyr[2], dt, 0.0)
    {step}
'''


def written(folder: Path, now: str = "pass", step: str = "pass") -> str:
    path = folder / "own.py"
    path.write_text(FILE.format(now=now, step=step))
    return str(path)


def test_the_flight_is_that_of_this_process_to_the_bit(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    name = written(tmp_path)
    scenario = hop(seconds=3.0, estimator={"name": f"{name}:scale=0.9"})
    there = fly(scenario, 3)
    out, err = capfd.readouterr()
    assert (out, "at import" in err) == ("", True)
    here = fly(scenario, 3, partial(make, row=parse(f"{name}:scale=0.9")))
    assert everything(there) == everything(here)
    assert there.onboard.estimator == "own:scale=0.9"
    assert np.isfinite(there.onboard.q[-1]).all()


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize(
    ("now", "step", "words"),
    few(
        [
            ("raise ValueError('no good')", "pass", "own.py, line 9: ValueError: no good"),
            ("os._exit(0)", "pass", "its process ended without a word (exit status 0)"),
            ("os.abort()", "pass", "SIGABRT"),
            ("os.closerange(3, 64)", "pass", "cannot answer any more"),
            ("return np.zeros(3)", "state[:] = np.nan", "cannot fly: gives"),
        ],
        1,
    ),
)
def test_what_it_does_ends_its_flight_alone(tmp_path: Path, now: str, step: str, words: str) -> None:
    with pytest.raises(PluginError, match="own") as told:
        fly(hop(seconds=2.0, estimator={"name": written(tmp_path, now, step)}))
    assert words in str(told.value)


@pytest.mark.slow
def test_an_endless_one_is_given_the_flights_own_seconds_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = written(tmp_path, "while True: pass")
    parse(name)  # loading takes its own time
    monkeypatch.setenv("ATTLOG_FILTER_TIMEOUT", "0.5")
    with pytest.raises(PluginTimeout, match=r"longer than 2\.5 s"):
        fly(hop(seconds=2.0, estimator={"name": name}))
