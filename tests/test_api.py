"""The public names: there at once, complete, and light until used."""

import subprocess
import sys

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
