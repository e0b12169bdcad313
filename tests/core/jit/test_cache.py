"""Compiled kernels are kept, shared, mended and done without."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from attlog.core import files
from attlog.core.jit import call, store

SOURCE = "@njit('f8(f8)', cache=KEEP, error_model='numpy')\ndef f(x):\n    return x + {0}\n"


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A user's cache folder of its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    forget()
    yield tmp_path
    forget()


def forget() -> None:
    """What a new process knows."""
    call.compiled.cache_clear()
    store.folder.cache_clear()


def machine_code(home: Path) -> list[Path]:
    return sorted(home.rglob("*.nbc"))


def test_a_kernel_is_kept_and_found_again(home: Path) -> None:
    assert call.compiled(SOURCE.format(1.0), "f")(2.0) == 3.0
    (kept,) = machine_code(home)
    before = kept.stat().st_mtime_ns
    forget()
    again = call.compiled(SOURCE.format(1.0), "f")
    assert again(2.0) == 3.0
    assert sum(again.stats.cache_hits.values()) == 1
    assert kept.stat().st_mtime_ns == before


def test_other_source_is_another_kernel(home: Path) -> None:
    assert call.compiled(SOURCE.format(1.0), "f")(2.0) == 3.0
    assert call.compiled(SOURCE.format(2.0), "f")(2.0) == 4.0
    assert len(machine_code(home)) == 2


@pytest.mark.parametrize("pattern", ["*.nbc", "*.nbi", "*.pyc"])
@pytest.mark.parametrize("place", [0.02, 0.5, 0.98])
def test_damaged_bytes_are_never_run(home: Path, monkeypatch: pytest.MonkeyPatch, pattern: str, place: float) -> None:
    """The file keeps its size, its time and its name: only its content tells."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    call.compiled(SOURCE.format(1.0), "f")
    (file,) = home.rglob(pattern)
    whole, times = file.read_bytes(), file.stat()
    at = int(place * len(whole))
    file.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    forget()
    loaded: list[bytes] = []
    real = call._load
    monkeypatch.setattr(
        call, "_load", lambda *a: (loaded.append(file.read_bytes() if file.is_file() else b""), real(*a))[1]
    )
    assert call.compiled(SOURCE.format(1.0), "f")(2.0) == 3.0
    assert loaded == [b""], "it is gone before numba looks"
    forget()
    again = call.compiled(SOURCE.format(1.0), "f")
    assert sum(again.stats.cache_hits.values()) == 1, "mended for the next start"


def test_code_without_a_checksum_is_not_run_and_a_lost_note_is_written_again(home: Path) -> None:
    call.compiled(SOURCE.format(1.0), "f")
    (note,) = home.rglob("*.sha256.json")
    note.write_text("[]")
    forget()
    anew = call.compiled(SOURCE.format(1.0), "f")
    assert sum(anew.stats.cache_hits.values()) == 0
    forget()
    assert sum(call.compiled(SOURCE.format(1.0), "f").stats.cache_hits.values()) == 1


@pytest.mark.parametrize("pattern", ["*.nbc", "*.nbi", "k_*.py"])
@pytest.mark.parametrize("keep", [0, 20])
def test_a_truncated_file_is_replaced(home: Path, pattern: str, keep: int) -> None:
    call.compiled(SOURCE.format(1.0), "f")
    (file,) = home.rglob(pattern)
    whole = file.read_bytes()
    file.write_bytes(whole[:keep])
    forget()
    assert call.compiled(SOURCE.format(1.0), "f")(2.0) == 3.0
    (file,) = home.rglob(pattern)
    assert len(file.read_bytes()) > keep


def test_without_a_user_folder_a_private_temporary_one_serves(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (home / "cache").write_text("a file where the folder should be")
    monkeypatch.setattr("tempfile.tempdir", str(home))
    assert call.compiled(SOURCE.format(1.0), "f")(2.0) == 3.0
    (kept,) = machine_code(home)
    assert "attlog-kernels-" in str(kept)


def test_without_any_folder_nothing_is_kept(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "is_private_folder", lambda place: False)
    assert call.compiled(SOURCE.format(1.0), "f")(2.0) == 3.0
    assert machine_code(home) == []


def test_a_real_error_is_raised_and_leaves_no_kernel(home: Path) -> None:
    with pytest.raises(Exception, match="no_such_name"):
        call.compiled("@njit('f8(f8)', cache=KEEP)\ndef f(x):\n    return no_such_name\n", "f")
    assert machine_code(home) == []
