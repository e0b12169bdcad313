"""The table of formats: every entry can be loaded, loads nothing early, and is all that opening and verifying need."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.base.errors import NotALog
from attlog.formats import oracle
from attlog.formats.registry import Format
from attlog.formats.verify import verify
from tests.conftest import SAMPLES


@pytest.mark.parametrize("entry", formats.FORMATS, ids=lambda entry: entry.name)
def test_every_entry_names_what_exists(entry: Format) -> None:
    assert not entry.recognises(b"no log at all " * 300)
    assert entry.load_oracle().library in ("pyulog", "pymavlink", "rosbags")
    assert formats.format_named(entry.name) is entry


def test_names_are_different() -> None:
    assert len({entry.name for entry in formats.FORMATS}) == len(formats.FORMATS)


NEW = """
import numpy as np
from attlog.formats.base import Field, Messages, Table
from attlog.formats.oracle import Oracle

def recognises(head):
    return head.startswith(b"NEWLOG")

def read(path, *, data):
    values = np.frombuffer(data[6:].tobytes(), "<i4")
    places = 6 + 4 * np.arange(len(values))
    table = Table("T", 0, {"v": Field("v", values.dtype)}, places, lambda _, at: values[(at - 6) // 4])
    return Messages(path, "new", len(data), {("T", 0): table})

def theirs(path):
    return {("T", 0): {"v": np.frombuffer(path.read_bytes()[6:], "<i4")}}

ORACLE = Oracle("numpy", theirs, list, lambda log, key: {"v": log[key]["v"]})
"""


def test_one_line_is_all_that_a_new_format_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    line = Format("new", "NEWLOG", ".new", "newformat:recognises", "newformat:read", None, "newformat:ORACLE")
    (tmp_path / "newformat.py").write_text(NEW)
    monkeypatch.setattr(formats, "__path__", [*formats.__path__, str(tmp_path)])
    monkeypatch.setattr(formats, "FORMATS", (*formats.FORMATS, line))
    (tmp_path / "x").write_bytes(b"NEWLOG" + np.arange(100, dtype="<i4").tobytes())
    assert formats.recognise(tmp_path / "x") == "new"
    log = formats.open(tmp_path / "x")
    np.testing.assert_array_equal(log["T", 0]["v"], np.arange(100))
    theirs = formats.format_named("new").load_oracle().read(tmp_path / "x")
    np.testing.assert_array_equal(theirs["T", 0]["v"], np.arange(100))
    (tmp_path / "y").write_bytes(b"OLDLOG")
    with pytest.raises(NotALog, match=r"NEWLOG \.new"):
        formats.open(tmp_path / "y")


def test_the_vehicle_is_chosen_where_a_format_can_hold_several() -> None:
    tlog = SAMPLES / "copter_steps_stabilize.tlog"
    own = formats.open(tlog)
    assert own.info["system"] == 1
    assert own.params
    other = formats.open(tlog, system=255)
    assert other.info["system"] == 255
    assert not other.params
    assert list(other) == list(own)
    ulog = SAMPLES / "px4_steps.ulg"
    assert formats.open(ulog, system=255).params == formats.open(ulog).params


def test_recognising_a_log_loads_no_library_and_no_other_reader() -> None:
    code = (
        "import sys; from attlog import formats; formats.open(sys.argv[1]); "
        "print(sorted(m for m in sys.modules if m.startswith('attlog.formats.') and m.count('.') == 2))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(SAMPLES / "px4_steps.ulg")], capture_output=True, text=True, check=True
    )
    loaded = done.stdout
    assert "attlog.formats.ulog" in loaded
    assert "dataflash" not in loaded
    assert "mavlink" not in loaded
    assert "oracle" not in loaded


def test_the_oracle_runs_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A library that ends its process, or prints, or changes the process, does neither to ours."""
    (tmp_path / "pyulog.py").write_text("print('noise')\nimport os\nos._exit(3)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(oracle.OracleFailed, match=r"ended with code 3: noise"):
        oracle.read(SAMPLES / "px4_steps.ulg", "ulog")
    assert "pyulog" not in sys.modules or "site-packages" in str(sys.modules["pyulog"].__file__)
    result = verify(SAMPLES / "px4_steps.ulg")
    assert not result.agrees
    assert "cannot read this log (its process ended with code 3" in result.text
