"""``formats.open`` knows a log by its content and refuses the rest with one clear line."""

from __future__ import annotations

import gzip
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from attlog import formats
from attlog.core.errors import AttlogError, LogUnreadable, LogUnusable, NotALog
from attlog.formats import Format
from tests.conftest import SAMPLES, corpus_logs

FORMATS = {".ulg": "ulog", ".bin": "dataflash", ".tlog": "tlog", ".log": "dataflash_text", ".mavlink": "mavlink"}


@pytest.mark.parametrize("path", [p for p in corpus_logs() if "px4log" not in p.name], ids=lambda p: p.name)
def test_format_is_recognised_by_content(path: Path, tmp_path: Path) -> None:
    nameless = tmp_path / "log"
    nameless.symlink_to(path)
    assert formats.recognise(nameless) == FORMATS[path.suffix.lower()]


def test_an_encrypted_ulog_is_recognised_and_refused(tmp_path: Path) -> None:
    path = tmp_path / "secret.ulg"
    path.write_bytes(b"ULogEnc\x01" + bytes(range(256)) * 40)
    assert formats.recognise(path) == "ulog"
    with pytest.raises(LogUnusable, match="encrypted"):
        formats.open(path)


def one_line(error: AttlogError) -> bool:
    return "\n" not in str(error) and len(str(error)) < 400


def test_missing_file_folder_and_device_cannot_be_read(tmp_path: Path) -> None:
    for path, reason in [(tmp_path / "none.ulg", "no such file"), (tmp_path, "folder"), (Path("/dev/zero"), "regular")]:
        with pytest.raises(LogUnreadable, match=reason) as caught:
            formats.open(path)
        assert one_line(caught.value)
        assert caught.value.exit_code == 66


@pytest.mark.skipif(not Path("/proc/version").exists(), reason="no /proc")
def test_a_file_of_the_system_that_has_no_size_is_not_read() -> None:
    """``/proc/kmsg`` waits for ever; ``/proc/version`` is as regular and as empty to the eye."""
    assert Path("/proc/version").read_bytes()
    with pytest.raises(NotALog, match="empty"):
        formats.recognise("/proc/version")


@pytest.mark.rights
def test_file_without_permission_cannot_be_read(tmp_path: Path) -> None:
    path = tmp_path / "locked.ulg"
    path.write_bytes(b"x")
    path.chmod(0)
    with pytest.raises(LogUnreadable, match="ermission"):
        formats.open(path)


def firmware_image() -> bytes:
    """A vector table, code without structure, an odd text, erased flash; byte 8 begins like a MAVLink packet."""
    code = np.random.default_rng(11).integers(0, 256, 200_000, np.uint8).tobytes()
    return b"\x00\x00\x02\x20\xc1\x02\x00\x08\xfe\x09" + code + b"ArduCopter V4.3.0" + b"\xff" * 50_000


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("empty.bin", b""),
        ("one.bin", b"\xa3"),
        ("zeros.ulg", bytes(100_000)),
        ("erased.bin", b"\xff" * 100_000),
        ("firmware.bin", firmware_image()),
        ("random.tlog", np.random.default_rng(5).integers(0, 256, 300_000, np.uint8).tobytes()),
        ("image.png", b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20),
        ("notes.log", b"flew at the field today\nno FMT here, sorry\n" * 40),
        ("table.csv", b"t,gx,gy,gz\n0.0,0.1,0.2,0.3\n" * 100),
        ("archive.zip", b"PK\x03\x04" + np.random.default_rng(6).integers(0, 256, 9000, np.uint8).tobytes()),
    ],
)
def test_what_is_no_log_is_refused_in_one_line(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(NotALog) as caught:
        formats.open(tmp_path / name)
    assert one_line(caught.value)
    assert name in str(caught.value)
    assert caught.value.exit_code == 65


@pytest.mark.parametrize("name", ["px4_steps.ulg", "copter_yaw_turns.bin", "copter_steps_stabilize.tlog"])
@pytest.mark.parametrize("before", [b"\0" * 52_962, b"\xff" * 500_000], ids=["zeros", "erased"])
@pytest.mark.parametrize("packed", [False, True], ids=["plain", "gzip"])
def test_a_log_behind_erased_bytes_is_read_whole(name: str, before: bytes, packed: bool, tmp_path: Path) -> None:
    whole = SAMPLES / name
    path = tmp_path / f"behind-{name}"
    path.write_bytes(gzip.compress(before + whole.read_bytes(), 1) if packed else before + whole.read_bytes())
    log, known = formats.open(path), formats.open(whole)
    assert {key: len(table) for key, table in log.items()} == {key: len(table) for key, table in known.items()}
    lost = log.damage[0]
    assert (lost.offset, lost.length) == (0, pytest.approx(len(before), abs=8))


def test_telemetry_behind_foreign_bytes_is_recognised_by_its_checksums(tmp_path: Path) -> None:
    foreign = np.random.default_rng(3).integers(0, 256, 20_000, np.uint8).tobytes()
    path = tmp_path / "late.tlog"
    path.write_bytes(foreign + (SAMPLES / "copter_steps_stabilize.tlog").read_bytes()[:100_000])
    assert len(formats.open(path).names()) > 20
    stuffed = b"\xfe\x09" + bytes(15)
    (tmp_path / "stuffed").write_bytes(foreign + 40 * stuffed)
    with pytest.raises(NotALog):
        formats.recognise(tmp_path / "stuffed")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("FMT, 128, 89, FMT, BBnNZ, Type,Length\n".encode("utf-16"), "UTF-16"),
        (b"PK\x03\x04" + b"x" * 90, "a zip archive"),
        (gzip.compress(gzip.compress(b"x" * 90)), "a gzip archive"),
        (b"7z\xbc\xaf\x27\x1c" + b"x" * 90, "a 7z archive"),
    ],
    ids=["utf-16", "zip", "gzip twice", "7z"],
)
def test_what_a_log_may_be_wrapped_in_is_named(content: bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / "x.bin").write_bytes(content)
    with pytest.raises(NotALog, match=says):
        formats.open(tmp_path / "x.bin")


@pytest.mark.parametrize("seed", range(10))
def test_random_bytes_are_never_a_log(seed: int, tmp_path: Path) -> None:
    content = np.random.default_rng(seed).integers(0, 256, 70_000, np.uint8).tobytes()
    (tmp_path / "random").write_bytes(content)
    with pytest.raises(NotALog):
        formats.open(tmp_path / "random")


def test_a_log_whose_format_definitions_are_lost_is_unusable(corpus: Path) -> None:
    with pytest.raises(LogUnusable):
        formats.open(corpus / "logs" / "made_bin_starts_midfile_nofmt.bin")


def test_opening_a_ulog_imports_nothing_heavy() -> None:
    import subprocess
    import sys

    names = ("numba", "pandas", "scipy", "plotly", "pymavlink", "pyulog")
    code = (
        "import sys; from attlog import formats; formats.open(sys.argv[1]); "
        f"print([n for n in {names} if n in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(SAMPLES / "px4_steps.ulg")], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


# The table of formats: every entry can be loaded, loads nothing early, and is all that opening needs.


@pytest.mark.parametrize("entry", formats.FORMATS, ids=lambda entry: entry.name)
def test_every_entry_names_what_exists(entry: Format) -> None:
    assert not entry.recognises(b"no log at all " * 300)
    assert formats.format_named(entry.name) is entry


NEW = """
import numpy as np
from attlog.formats.table import Field, Messages, Table

def recognises(head):
    return head.startswith(b"NEWLOG")

def read(path, *, data):
    values = np.frombuffer(data[6:].tobytes(), "<i4")
    places = 6 + 4 * np.arange(len(values))
    table = Table("T", 0, {"v": Field("v", values.dtype)}, places, lambda _, at: values[(at - 6) // 4])
    return Messages(path, "new", len(data), {("T", 0): table})

"""


def test_one_line_is_all_that_a_new_format_needs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    line = Format("new", "NEWLOG", ".new", "newformat", "reader.recognises", "reader.read")
    (tmp_path / "newformat").mkdir()
    (tmp_path / "newformat" / "reader.py").write_text(NEW)
    monkeypatch.setattr(formats, "__path__", [*formats.__path__, str(tmp_path)])
    monkeypatch.setattr(formats, "FORMATS", (*formats.FORMATS, line))
    (tmp_path / "x").write_bytes(b"NEWLOG" + np.arange(100, dtype="<i4").tobytes())
    assert formats.recognise(tmp_path / "x") == "new"
    log = formats.open(tmp_path / "x")
    np.testing.assert_array_equal(log["T", 0]["v"], np.arange(100))
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
