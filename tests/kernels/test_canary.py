"""The bird in the mine: a release of numba that breaks how kernels become object code is named in one sentence."""

from __future__ import annotations

import re
import tomllib
from typing import Any

import numba
import numpy as np
import pytest

from attlog.kernels import calling, emit
from attlog.kernels.kernel import Kernel
from tests.conftest import ROOT

TEXT = """
def running(x, gain, out, work):
    for i in range(len(x)):
        work[0] += gain * (math.sin(x[i]) - work[0])
        out[i] = work[0]
    return len(x)
"""
KERNEL = Kernel("running", "running", lambda: TEXT, "i8((f8[::1]), f8, f8[::1])", "a mean", (), (("f8", (1,)),))


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
        compiled = emit.cfunc(KERNEL)
        step = "inspect_llvm"
        text = compiled.inspect_llvm()
        step = "object file"
        code, needs = emit.objectified(text, "canary_of_attlog")
        step = "call"
        count = calling.load(KERNEL, code, "canary_of_attlog")(x, 0.5, out)
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
    monkeypatch.setattr(emit, name, gone)
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
