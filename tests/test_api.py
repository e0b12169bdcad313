"""The public names: there at once, complete, and light until used."""

import subprocess
import sys
from importlib import import_module

import pytest

import attlog


def test_all_public_names_are_listed_and_importable() -> None:
    for name in attlog.__all__:
        assert name in dir(attlog)
        assert getattr(attlog, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'analyse'"):
        attlog.analyse  # noqa: B018


def test_the_public_names_are_listed_before_their_first_use_and_import_nothing() -> None:
    code = (
        "import sys, attlog\n"
        "assert {'AttlogError', 'Config', 'Result', 'analyze', 'estimate', 'read'} <= set(dir(attlog))\n"
        "print(sorted({'numpy', 'pydantic', 'numba', 'pandas', 'attlog.analysis'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_every_error_on_purpose_is_an_attlog_error() -> None:
    with pytest.raises(attlog.AttlogError):
        attlog.read("/nowhere/at/all.ulg")


@pytest.mark.parametrize("room", ["attlog", "attlog.estimators", "attlog.metrics"])
def test_every_public_name_is_there_and_no_other(room: str) -> None:
    """Those that are imported late too."""
    module = import_module(room)
    assert all(getattr(module, name) is not None for name in module.__all__)
    assert set(module.__all__) <= set(dir(module))
    with pytest.raises(AttributeError, match="nothing_of_that_name"):
        module.nothing_of_that_name  # noqa: B018
